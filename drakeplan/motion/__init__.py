"""Contacts into momenta, forces and a whole-body motion."""
