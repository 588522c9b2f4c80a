"""A flat region as files of regions give it: an outline in space, holes, and what is said of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class Outline:
    """One flat region, in the file's own frame and unit.

    Attributes:
        name: what the file calls it, "" where it does not.
        rings: (K, 3) corners of the outlines whose union it is, holes not taken away.
        holes: (K, 3) corners of each hole.
        normal: (3,) outward, None where the order of the corners tells.
        friction: of this region [-], None for the scene's.
        contact: end effectors that may touch it, None by its tilt.
    """

    name: str
    rings: tuple[np.ndarray, ...]
    holes: tuple[np.ndarray, ...] = field(default=())
    normal: np.ndarray | None = None
    friction: float | None = None
    contact: tuple[str, ...] | None = None
