"""When contacts are made and broken."""
