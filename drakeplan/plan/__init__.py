"""The plan: what a planner hands over, and its file."""
