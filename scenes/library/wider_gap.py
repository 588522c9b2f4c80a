"""A gap that needs motion: wider than static balance over either foot allows, within reach of the legs."""

from __future__ import annotations

from dataclasses import replace

from scenes.library import wide_gap
from scenes.scene import Scene

GAP = 0.8  # [m]; balanced over either foot escher spans 0.68 m, whatever its heading


def named(seed: int = 0, gap: float = GAP) -> Scene:
    """Level ground with a gap of 0.8 m, too wide to cross in static balance (not random).

    Args:
        seed: unused, nothing is drawn.
        gap: width of the gap [m]; the far platform and the goal move with it.
    """
    return replace(wide_gap.named(seed, gap), name="wider_gap", transition_model="leap_stride")
