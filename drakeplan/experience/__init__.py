"""Plans that are used again: deformed to a terrain that has changed."""
