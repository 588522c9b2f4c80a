"""Solids are solids: whether a point is inside an obstacle, by how often closed bodies wind around it."""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit

from scenes.terrain.packed_terrain import PackedTerrain, cells_under, height_at, in_cells
from scenes.terrain.terrain import Terrain

HEIGHTS_APART = 0.05  # [m] less than any trunk is high
EVERY = -1  # asks about all obstacles together


@njit(cache=True)
def winding(packed: PackedTerrain, x: float, y: float, z: float, obstacle: int) -> int:
    """How often closed bodies wind around a point: faces above it that look up less those that look down.

    The point is compared with the edges in the plan view so that each vertical line meets exactly one of two faces that
    share an edge: corners and edges need no tolerance.

    Args:
        packed: the terrain.
        x: of the point in W [m].
        y: of the point in W [m].
        z: of the point in W [m].
        obstacle: number of the obstacle that counts, `EVERY` for all.
    """
    total = 0
    rows, j0, j1 = cells_under(packed, x, y, x, y)
    for i in rows:
        for k in in_cells(packed, i, j0, j1):
            body = packed.solid[k]
            if body < 0 or (obstacle >= 0 and body != obstacle):
                continue
            if packed.high[k, 2] < z or packed.low[k, 0] > x or packed.high[k, 0] < x:
                continue
            if packed.low[k, 1] > y or packed.high[k, 1] < y:
                continue
            around = 0
            for e in range(3):
                a, b = packed.vertices[k, e], packed.vertices[k, (e + 1) % 3]
                if (a[1] > y) == (b[1] > y):
                    continue
                rising = b[1] > y
                low, high = (a, b) if rising else (b, a)  # the same order for both faces: the same rounding
                if x < low[0] + (y - low[1]) * (high[0] - low[0]) / (high[1] - low[1]):
                    around += 1 if rising else -1
            if around != 0 and packed.normal[k, 2] != 0.0 and height_at(packed, k, x, y) > z:
                total += around
    return total


@njit(cache=True)
def in_solid(packed: PackedTerrain, x: float, y: float, z: float) -> bool:
    """Whether a point is inside a box or a closed body of a mesh.

    Args:
        packed: the terrain.
        x: of the point in W [m].
        y: of the point in W [m].
        z: of the point in W [m].
    """
    return winding(packed, x, y, z, EVERY) > 0


@njit(cache=True)
def solid_columns(packed: PackedTerrain, x: np.ndarray, y: np.ndarray, low: float, high: float) -> np.ndarray:
    """(n,) bool, whether all of a vertical segment is inside solids, looked at every `HEIGHTS_APART`.

    Args:
        packed: the terrain.
        x: (n,) of the segments in W [m].
        y: (n,) of the segments in W [m].
        low: lowest height in W [m].
        high: greatest height in W [m].
    """
    solid = np.zeros(x.shape[0], np.bool_)
    steps = int(np.ceil((high - low) / HEIGHTS_APART)) + 1
    for k in range(x.shape[0]):
        solid[k] = True
        for m in range(steps):
            if not in_solid(packed, x[k], y[k], low + (high - low) * m / max(steps - 1, 1)):
                solid[k] = False
                break
    return solid


def solid_at(terrain: Terrain, packed: PackedTerrain, x: float, y: float, z: float) -> str:
    """What a point is inside of, "box 'crate'", or "".

    Args:
        terrain: has the names.
        packed: the same, packed.
        x: of the point in W [m].
        y: of the point in W [m].
        z: of the point in W [m].
    """
    if not in_solid(packed, x, y, z):
        return ""
    for number, obstacle in enumerate(terrain.obstacles):
        if winding(packed, x, y, z, number) > 0:
            return f"{obstacle.kind} {obstacle.name!r}"
    return ""
