"""Convex polygons clipped along the axes of a frame, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def seen_from(polygon: np.ndarray, count: int, p: np.ndarray, R: np.ndarray, out: np.ndarray) -> None:
    """Writes the corners of a polygon in a frame.

    Args:
        polygon: (K, 3) corners in W [m].
        count: how many are real.
        p: (3,) origin of the frame in W [m].
        R: (3, 3) its axes in W.
        out: (count or more, 3) is written here [m].
    """
    for k in range(count):
        dx, dy, dz = polygon[k, 0] - p[0], polygon[k, 1] - p[1], polygon[k, 2] - p[2]
        for a in range(3):
            out[k, a] = R[0, a] * dx + R[1, a] * dy + R[2, a] * dz


@njit(cache=True)
def clip_between(work: np.ndarray, cur: int, count: int, axis: int, low: float, high: float) -> tuple[int, int]:
    """Clips a convex polygon to low <= coordinate <= high: where in `work` the result is, and how many corners it has.

    Args:
        work: (2, K + 2, 3) the polygon is in work[cur], the other half is scratch [m].
        cur: 0 or 1.
        count: corners of the polygon.
        axis: of the coordinate.
        low: its least value [m].
        high: its greatest value [m].
    """
    for side in range(2):
        sign, bound = (1.0, high) if side == 0 else (-1.0, -low)
        beyond = False
        for k in range(count):
            if sign * work[cur, k, axis] > bound:
                beyond = True
                break
        if not beyond:
            continue
        n = 0
        for k in range(count):
            j = k + 1 if k + 1 < count else 0
            here, there = sign * work[cur, k, axis] - bound, sign * work[cur, j, axis] - bound
            if here <= 0.0:
                for a in range(3):
                    work[1 - cur, n, a] = work[cur, k, a]
                n += 1
            if (here < 0.0 and there > 0.0) or (here > 0.0 and there < 0.0):
                share = here / (here - there)
                for a in range(3):
                    work[1 - cur, n, a] = work[cur, k, a] + share * (work[cur, j, a] - work[cur, k, a])
                n += 1
        count, cur = n, 1 - cur
    return cur, count
