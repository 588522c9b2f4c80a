"""A slope just steeper than friction holds: nobody stands there, and who keeps moving gets down."""

from __future__ import annotations

import math
from dataclasses import replace

from scenes.library import steep_slope
from scenes.scene import Scene

TILT = math.radians(27.0)  # friction 0.5 holds up to 26.57 deg
LENGTH = 2.0  # [m] along the slope


def named(seed: int = 0, tilt: float = TILT, length: float = LENGTH) -> Scene:
    """Down a 2 m slope of 27 deg, just steeper than friction 0.5 holds (no draws).

    Args:
        seed: unused, nothing is drawn.
        tilt: of the slope [rad].
        length: along it [m].
    """
    return replace(steep_slope.named(seed, tilt, length), name="slippery_slope")
