"""Planners of contact sequences, and what a contact transition must satisfy."""
