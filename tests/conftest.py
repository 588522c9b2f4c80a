"""Hypothesis without deadlines (the first call of a compiled kernel takes seconds) and with the same examples each run."""

from hypothesis import settings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")
