"""Capture: whether a robot that was pushed can come to rest."""
