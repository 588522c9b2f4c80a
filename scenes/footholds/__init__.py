"""Where a sole or a palm fits on a terrain."""
