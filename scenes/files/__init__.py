"""Scene files: strict YAML in, scenes out, and back; and writing files whole."""
