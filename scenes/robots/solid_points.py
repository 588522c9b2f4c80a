"""Points whose convex hull is a simple solid, or nearly so where it is round."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

ROUND = 24  # points around


def solid_points(kind: str, size: ArrayLike) -> np.ndarray:
    """(N, 3) points on a solid about the origin, its axis along z [m].

    Args:
        kind: "box", "sphere", "ellipsoid", "cylinder" or "capsule".
        size: [m] edges of a box; radius of a sphere; half axes of an ellipsoid; radius and length of a cylinder or capsule.
    """
    size = np.asarray(size, float)
    if kind == "box":
        return 0.5 * np.array(np.meshgrid((-1, 1), (-1, 1), (-1, 1))).reshape(3, -1).T * size
    if kind in ("sphere", "ellipsoid"):
        return _ball() * size
    radius, length = size
    angle = 2 * np.pi * np.arange(ROUND) / ROUND
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(ROUND)])
    end = np.array([0.0, 0.0, 0.5 * length])
    around = radius * (ring if kind == "cylinder" else _ball())
    return np.concatenate([around + end, around - end])


def _ball() -> np.ndarray:
    """(N, 3) unit vectors, those along the axes among them."""
    ring = np.arange(ROUND) * 2 * np.pi / ROUND
    rise = np.linspace(-0.5 * np.pi, 0.5 * np.pi, ROUND // 2 + 1)
    azimuth, elevation = (a.ravel() for a in np.meshgrid(ring, rise))
    flat = np.cos(elevation)
    return np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
