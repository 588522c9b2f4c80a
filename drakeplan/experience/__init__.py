"""Old plans used again: deformed to terrain that has moved."""
