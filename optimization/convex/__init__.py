"""Convex solvers and the programs that they take; nothing here knows a robot."""
