"""Where a sole or a palm fits on a terrain, and where the robot stands at the start."""
