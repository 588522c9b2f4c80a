"""Who finds contacts, and what a contact transition must satisfy."""
