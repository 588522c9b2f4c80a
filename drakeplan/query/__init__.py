"""One query, from a scene to a verified plan."""
