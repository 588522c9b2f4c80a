"""Surfaces to touch, obstacles to avoid, and both as arrays for compiled code."""
