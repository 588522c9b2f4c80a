"""Searches that know no robots."""
