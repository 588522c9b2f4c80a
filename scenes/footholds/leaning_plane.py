"""The plane of a sole that leans on edges: the facet over its middle of the upper convex hull of what lies under it."""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit

from scenes.footholds.projection import PatchShape
from scenes.footholds.support_polygon import part_within
from scenes.terrain.packed_terrain import PackedTerrain

MOST_POINTS = 24  # corners of what lies under one sole; where there are more the sole is given up
FLATTEST = np.cos(np.deg2rad(30.0))  # a sole leans no more than this
ABOVE = 1e-6  # [m] a point that stands less above a plane is on it
INSIDE = 1e-9  # [m^2] the middle may be this much outside a facet
FAR = 100.0  # [m] heights farther than this from each other are not looked at


@njit(cache=True)
def leaning_plane(
    packed: PackedTerrain,
    xy_yaw: np.ndarray,
    z_range: tuple[float, float],
    patch: PatchShape,
    around: np.ndarray,
    normal: np.ndarray,
) -> tuple[float, int]:
    """Height of a sole's middle where it is laid on what is under it, and a polygon that it touches; -1 for none.

    Args:
        packed: the terrain.
        xy_yaw: (3,) place [m] and heading [rad] of the sole in W.
        z_range: least and greatest height of what it may touch in W [m].
        patch: the sole.
        around: (m,) polygons near there, ascending.
        normal: (3,) of the plane, upwards; written.
    """
    lowest = np.inf
    for q in range(around.shape[0]):
        lowest = min(lowest, packed.low[around[q], 2])
    z_low = max(z_range[0], lowest - 1.0)
    z_high = min(z_range[1], z_low + FAR)
    c, s = np.cos(xy_yaw[2]), np.sin(xy_yaw[2])
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    p = np.array([xy_yaw[0], xy_yaw[1], 0.5 * (z_low + z_high)])
    bound = np.array([patch.half_length, patch.half_width, 0.5 * (z_high - z_low)])
    points, owner, n = np.empty((MOST_POINTS, 3)), np.empty(MOST_POINTS, np.int64), 0
    scratch = np.empty((2, packed.vertices.shape[1] + 8, 3))
    reach = np.sqrt(patch.half_length**2 + patch.half_width**2)
    for q in range(around.shape[0]):
        k = around[q]
        if packed.low[k, 0] > p[0] + reach or packed.high[k, 0] < p[0] - reach:
            continue
        if packed.low[k, 1] > p[1] + reach or packed.high[k, 1] < p[1] - reach:
            continue
        m, cur = part_within(packed.vertices[k], packed.count[k], p, R, bound, scratch)
        if n + m > MOST_POINTS:
            return 0.0, -1
        for i in range(m):
            points[n], owner[n] = scratch[cur, i], k
            n += 1
    for i in range(n):
        for j in range(i + 1, n):
            for k in range(j + 1, n):
                if not _over_the_middle(points[i], points[j], points[k]):
                    continue
                a, b = points[j] - points[i], points[k] - points[i]
                u0, u1, u2 = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
                if u2 < 0.0:
                    u0, u1, u2 = -u0, -u1, -u2
                length = np.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
                if u2 < FLATTEST * length or length == 0.0:
                    continue
                on_top = True
                for q in range(n):
                    d = points[q] - points[i]
                    if u0 * d[0] + u1 * d[1] + u2 * d[2] > ABOVE * length:
                        on_top = False
                        break
                if on_top:
                    for q in range(3):
                        normal[q] = (R[q, 0] * u0 + R[q, 1] * u1 + R[q, 2] * u2) / length
                    z = points[i, 2] + (u0 * points[i, 0] + u1 * points[i, 1]) / u2
                    return p[2] + z, owner[i]
    return 0.0, -1


@njit(cache=True)
def _over_the_middle(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> bool:
    """Whether a triangle with an area holds the origin in the plan view."""
    ab, bc, ca = a[0] * b[1] - a[1] * b[0], b[0] * c[1] - b[1] * c[0], c[0] * a[1] - c[1] * a[0]
    if abs(ab + bc + ca) < 1e-7:
        return False
    return (ab >= -INSIDE and bc >= -INSIDE and ca >= -INSIDE) or (ab <= INSIDE and bc <= INSIDE and ca <= INSIDE)
