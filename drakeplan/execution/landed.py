"""A contact as it is made: a sole or palm never lands exactly where the plan has it, the terrain under it stays where it is."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.polygon import orient

LEAST = 2e-4  # [m^2] of what touches; below it the planned support is kept


def landed_support(corners: np.ndarray, half: np.ndarray, X_CE: np.ndarray) -> np.ndarray:
    """(n, 2) corners of what touches, in the frame of the patch as it lies, counter-clockwise [m].

    The edges of a support that are not those of the patch are edges of the terrain: they do not move with the patch.

    Args:
        corners: (m, 2) of the planned support in the contact's frame C, counter-clockwise [m].
        half: (2,) half extents of the patch [m].
        X_CE: (4, 4) pose of the patch in C.
    """
    patch = shapely.box(-half[0], -half[1], half[0], half[1])
    planned = shapely.Polygon(corners)
    if planned.area > (1.0 - 1e-6) * patch.area:
        return corners
    seen = (corners - X_CE[:2, 3]) @ X_CE[:2, :2]
    touching = shapely.Polygon(seen).intersection(patch)
    if touching.area < LEAST:
        return corners
    return np.array(orient(touching).exterior.coords)[:-1]


def landed_wrench(wrench: np.ndarray, X_CE: np.ndarray) -> np.ndarray:
    """(6,) the same wrench in the frame of the patch as it lies, about its origin: moment [N m], force [N].

    Args:
        wrench: (6,) planned, in the contact's frame C about its origin.
        X_CE: (4, 4) pose of the patch in C.
    """
    moment = wrench[:3] - np.cross(X_CE[:3, 3], wrench[3:])
    return np.concatenate([moment @ X_CE[:3, :3], wrench[3:] @ X_CE[:3, :3]])
