"""Gravity: one value for every package."""

GRAVITY = 9.81  # [m/s^2] magnitude, as in Drake; it acts along -z of W
