"""Values of the command line of `drakeplan plan` as the library takes them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drakeplan.timing.step_timing import Timing


def timing_of(shift: float | None, swing: float | None, *, free: bool, pushes: bool) -> Timing:
    """The durations that were asked for, else those that planning with or without pushes walks by.

    Args:
        shift, swing: as asked for [s]; None for the usual ones.
        free: whether durations are optimised then.
        pushes: whether pushes are planned against.
    """
    from drakeplan.timing.step_timing import WALKING, Timing

    usual = WALKING if pushes else Timing()
    return Timing(usual.shift if shift is None else shift, usual.swing if swing is None else swing, free)


def in_radians(place: Sequence[float]) -> tuple[float, ...] | None:
    """(x, y) or (x, y, yaw) with the yaw in radians; None for nothing.

    Args:
        place: x, y [m] and perhaps the yaw [deg].
    """
    if not place:
        return None
    return (*place[:2], *(math.radians(yaw) for yaw in place[2:]))
