"""Robots as data, their Drake plants, and one folder for each robot."""
