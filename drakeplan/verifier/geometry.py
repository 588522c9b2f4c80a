"""Corners of patches and supports, parts of polygons, angles between frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def patch(half: np.ndarray) -> np.ndarray:
    """(4, 2) corners of a patch with half extents (2,) in its own frame [m], counter-clockwise."""
    return np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) * half


def in_world(X_WC: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 3) points of a contact's plane in W [m].

    Args:
        X_WC: (4, 4) pose of the contact frame in W [m].
        points: (n, 2) in that frame [m].
    """
    return X_WC[:3, 3] + points @ X_WC[:3, :2].T


def clip(polygon: np.ndarray, low: np.ndarray | Sequence[float], high: np.ndarray | Sequence[float]) -> np.ndarray:
    """The part (n, 3) of a convex polygon inside the box between `low` and `high` (Sutherland & Hodgman 1974).

    Args:
        polygon: (K, 3) corners in order [m].
        low: (3,) least coordinates of the box [m].
        high: (3,) greatest coordinates of the box [m].
    """
    for axis in range(3):
        for sign, bound in ((1.0, high[axis]), (-1.0, -low[axis])):
            if not len(polygon):
                return polygon
            height = sign * polygon[:, axis] - bound  # positive is outside
            if height.max() <= 0:
                continue
            kept = []
            for a, b, ha, hb in zip(polygon, np.roll(polygon, -1, 0), height, np.roll(height, -1), strict=True):
                if ha <= 0:
                    kept.append(a)
                if (ha <= 0) != (hb <= 0):
                    kept.append(a + (b - a) * (ha / (ha - hb)))
            polygon = np.array(kept).reshape(-1, 3)
    return polygon


def angle_between(R_WA: np.ndarray, R_WB: np.ndarray) -> np.ndarray:
    """(n,) angle between rotations (n, 3, 3) and (3, 3) [rad]: |R - I|_F = 2 sqrt 2 |sin angle/2|, exact when small.

    Args:
        R_WA: (n, 3, 3) rotations of frames A in W.
        R_WB: (3, 3) rotation of one frame B in W.
    """
    chord = np.linalg.norm(R_WA - R_WB, axis=(1, 2)) / (2 * np.sqrt(2))
    return 2 * np.arcsin(np.clip(chord, 0.0, 1.0))
