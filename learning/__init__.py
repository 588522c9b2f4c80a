"""Guess it quickly: learned stand-ins for the programs of `optimization`."""
