"""Friction, contact wrenches and static equilibrium."""
