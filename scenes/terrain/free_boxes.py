"""Whether a box stands free: no polygon of the terrain meets it, and it is in no solid."""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit

from scenes.terrain.packed_terrain import PackedTerrain, cells_under, in_cells, polygon_meets_box
from scenes.terrain.solids import in_solid


@njit(cache=True)
def box_is_free(packed: PackedTerrain, p: np.ndarray, yaw: float, centre: np.ndarray, size: np.ndarray) -> bool:
    """Whether an upright box (`centre`, `size` in the frame at p with this yaw) touches no polygon and is in no solid.

    Args:
        packed: the terrain.
        p: (3,) origin of the box's frame in W [m].
        yaw: of that frame [rad].
        centre: (3,) of the box in that frame [m].
        size: (3,) full edges of the box [m].
    """
    c, s = np.cos(yaw), np.sin(yaw)
    low, high = centre - 0.5 * size, centre + 0.5 * size
    reach = np.sqrt(max(low[0] ** 2, high[0] ** 2) + max(low[1] ** 2, high[1] ** 2))
    rows, j0, j1 = cells_under(packed, p[0] - reach, p[1] - reach, p[0] + reach, p[1] + reach)
    for i in rows:
        for k in in_cells(packed, i, j0, j1):
            if packed.low[k, 2] > p[2] + high[2] or packed.high[k, 2] < p[2] + low[2]:
                continue
            if packed.low[k, 0] > p[0] + reach or packed.high[k, 0] < p[0] - reach:
                continue
            if packed.low[k, 1] > p[1] + reach or packed.high[k, 1] < p[1] - reach:
                continue
            work = np.empty((2, packed.vertices.shape[1] + 8, 3))
            R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            if polygon_meets_box(packed.vertices[k], packed.count[k], R, p, low, high, work):
                return False
    x, y = p[0] + c * centre[0] - s * centre[1], p[1] + s * centre[0] + c * centre[1]
    return not in_solid(packed, x, y, p[2] + centre[2])


@njit(cache=True)
def boxes_are_free(
    packed: PackedTerrain, p: np.ndarray, yaw: np.ndarray, centre: np.ndarray, size: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """(n,) `wanted`, less where the box at p (n, 3) and yaw (n,) touches a polygon.

    Args:
        packed: the terrain.
        p: (n, 3) origins of the box's frames in W [m].
        yaw: (n,) of those frames [rad].
        centre: (3,) of the box in its frame [m].
        size: (3,) full edges of the box [m].
        wanted: (n,) bool, which are looked at.
    """
    free = wanted.copy()
    for k in range(p.shape[0]):
        if free[k]:
            free[k] = box_is_free(packed, p[k], yaw[k], centre, size)
    return free


@njit(cache=True)
def nothing_near(packed: PackedTerrain, x: float, y: float, reach: float, z_low: float, z_high: float) -> bool:
    """Whether no polygon's bounds meet the square of half width `reach` about (x, y) between z_low and z_high.

    Nor is it in a solid whose faces are all further away.

    Args:
        packed: the terrain.
        x: of the square's centre in W [m].
        y: of the square's centre in W [m].
        reach: half width of the square [m].
        z_low: lowest height in W [m].
        z_high: greatest height in W [m].
    """
    rows, j0, j1 = cells_under(packed, x - reach, y - reach, x + reach, y + reach)
    for i in rows:
        for k in in_cells(packed, i, j0, j1):
            if (
                packed.low[k, 2] <= z_high
                and packed.high[k, 2] >= z_low
                and packed.low[k, 0] <= x + reach
                and packed.high[k, 0] >= x - reach
                and packed.low[k, 1] <= y + reach
                and packed.high[k, 1] >= y - reach
            ):
                return False
    return not in_solid(packed, x, y, 0.5 * (z_low + z_high))
