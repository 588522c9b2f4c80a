"""Momenta and a whole-body motion that agree."""
