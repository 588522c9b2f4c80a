"""Colours for the share of what is allowed: green for nothing, red for all of it."""

from __future__ import annotations

import colorsys

STEPS = 100  # a colour for each percent
SATURATION, LIGHTNESS = 0.75, 0.42  # as in the bar that shows how risky pushes are


def share_colour(share: float) -> str:
    """CSS colour of a share: green at 0, red at 1 and beyond."""
    hue = (1.0 - min(max(share, 0.0), 1.0)) / 3.0
    red, green, blue = (round(255 * c) for c in colorsys.hls_to_rgb(hue, LIGHTNESS, SATURATION))
    return f"#{red:02x}{green:02x}{blue:02x}"


def palette() -> list[str]:
    """The colour of every percent from 0 to 100."""
    return [share_colour(k / STEPS) for k in range(STEPS + 1)]


def gradient() -> str:
    """CSS gradient from 0 to 1, left to right."""
    stops = ",".join(share_colour(k / 4) for k in range(5))
    return f"linear-gradient(to right,{stops})"
