"""Triangle meshes as terrain: reading, orienting, and finding their flat regions."""
