"""Coordinates of georeferenced maps: an offset is taken from them, so that computing has its digits for the robot.

Eastings and northings are millions of metres; a terrain reaches at most `FAR`. What is farther out than that is taken to be
georeferenced, whatever else a file holds: a local start goes with a georeferenced mesh.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

FAR = 1e5  # [m] no local coordinate is farther out; beyond it doubles lose the micrometre
ROUND = 100.0  # [m] offsets that are found are multiples of this


def is_far(points: np.ndarray | Sequence[float]) -> bool:
    """Whether points (..., 3) are georeferenced: the first two coordinates of one reach beyond `FAR`."""
    return bool(np.abs(np.asarray(points, float)[..., :2]).max(initial=0.0) > FAR)


def offset_for(points: np.ndarray) -> tuple[float, float, float]:
    """The offset for a map with these points (..., 3) [m]: their middle, rounded; heights stay."""
    flat = np.asarray(points, float).reshape(-1, 3)
    x, y = ROUND * np.round((flat.min(axis=0) + flat.max(axis=0))[:2] / (2 * ROUND))
    return float(x), float(y), 0.0


def to_local(points: np.ndarray | Sequence[float], offset: Sequence[float] | None) -> np.ndarray:
    """(..., 3) the points without the offset where they are georeferenced, else as they are [m].

    Args:
        points: (..., 3) of one thing [m].
        offset: (3,) of the map [m], None where it has none.
    """
    points = np.asarray(points, float)
    return points - offset if offset is not None and is_far(points) else points


def offset_note(offset: Sequence[float]) -> str:
    """What is said where an offset was found."""
    return (
        f"coordinates are georeferenced: origin_offset [{', '.join(f'{x:.12g}' for x in offset)}] m was subtracted; "
        "start and goal may be given with or without it"
    )
