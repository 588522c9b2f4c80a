"""Sides of a box that end effectors may touch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenes.effector import is_foot
from scenes.terrain.surface import FOOT_MAX_TILT, Surface
from scenes.terrain.terrain import Box

SIDES = ("top", "bottom", "front", "back", "left", "right")  # along z, -z, x, -x, y, -y of the box
NARROWEST = 0.01  # [m] a side narrower than this carries nothing
OUTWARD = ((2, 1.0), (2, -1.0), (0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0))  # axis and sign of each


def box_sides(box: Box, effectors: Sequence[str], friction: float) -> list[Surface]:
    """The sides of a box that carry these end effectors: feet where it is level enough, nothing where it looks down.

    Args:
        box: whose sides; they are called `<box>/top` and so on.
        effectors: names of the end effectors.
        friction: Coulomb coefficient of all sides.
    """
    half, sides = np.asarray(box.size, float) / 2, []
    for name, (axis, sign) in zip(SIDES, OUTWARD, strict=True):
        u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        corners = np.array([u + v, v - u, -u - v, u - v])[:: int(sign)]  # counter-clockwise seen from outside
        corners = (corners + sign * np.eye(3)[axis]) * half
        normal = sign * box.X_WO[:3, axis]
        tilt = float(np.arccos(np.clip(normal[2], -1.0, 1.0)))
        able = frozenset(
            e for e in effectors if tilt <= (FOOT_MAX_TILT if is_foot(e) else np.pi - FOOT_MAX_TILT) + 1e-9
        )
        if able and np.delete(half, axis).min() > NARROWEST / 2:
            vertices = corners @ box.X_WO[:3, :3].T + box.X_WO[:3, 3]
            sides.append(Surface(f"{box.name}/{name}", vertices, friction, able))
    return sides
