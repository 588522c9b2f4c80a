"""Whether a patch rests on several pieces of one floor: the pieces are taken from the patch, and nothing may remain."""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit

from scenes.footholds.convex_parts import CORNERS, PARTS, subtract
from scenes.terrain.clipping import clip_between, seen_from
from scenes.terrain.floors import FLUSH, LEVEL
from scenes.terrain.packed_terrain import PackedTerrain


@njit(cache=True)
def lies_on_floor(
    packed: PackedTerrain,
    surface: int,
    p: np.ndarray,
    R: np.ndarray,
    half_length: float,
    half_width: float,
    around: np.ndarray,
) -> bool:
    """Whether pieces of a surface's floor, and the joints between them, lie under all of a patch at pose (p, R).

    What lies farther than `FLUSH` from the patch's plane, or is turned from it by more than a degree, supports nothing.

    Args:
        packed: the terrain.
        surface: number of the surface whose plane the patch is in.
        p: (3,) contact point in W [m].
        R: (3, 3) contact frame in W.
        half_length: of the patch along x [m].
        half_width: of the patch along y [m].
        around: (m,) polygons near the patch, ascending.
    """
    parts, size = np.empty((PARTS, CORNERS, 2)), np.empty(PARTS, np.int64)
    scratch = np.empty((4, packed.vertices.shape[1] + 4 + CORNERS, 3))
    size[0] = 4
    for a in range(4):
        parts[0, a, 0] = half_length if (a == 0 or a == 3) else -half_length
        parts[0, a, 1] = half_width if a < 2 else -half_width
    reach = np.sqrt(half_length * half_length + half_width * half_width) + FLUSH
    return take_floor(packed, surface, p, R, reach, around, parts, size, 1, scratch) == 0


@njit(cache=True)
def take_floor(
    packed: PackedTerrain,
    surface: int,
    p: np.ndarray,
    R: np.ndarray,
    reach: float,
    around: np.ndarray,
    parts: np.ndarray,
    size: np.ndarray,
    n: int,
    scratch: np.ndarray,
) -> int:
    """Takes all that supports in a surface's plane from the n parts of a region; how many are left, -1: no room for them.

    Args:
        packed: the terrain.
        surface: number of the surface whose plane the region is in.
        p: (3,) origin of the region's frame in W [m].
        R: (3, 3) axes of that frame in W; z is the surface's normal.
        reach: pieces of the floor farther than this from p along any axis of W are not looked at [m].
        around: (m,) polygons near the region, ascending.
        parts: (P, C, 2) convex parts in the region's frame [m].
        size: (P,) corners of each part.
        n: number of parts.
        scratch: (4, K + 4 + C, 3) for polygons of K vertices.
    """
    for q in range(around.shape[0]):
        k = around[q]
        if k >= packed.num_surfaces:
            break  # ascending: triangles follow
        if k != surface and (packed.floor[k] < 0 or packed.floor[k] != packed.floor[surface]):
            continue
        turned = 0.0
        apart = False
        for a in range(3):
            turned += packed.normal[k, a] * R[a, 2]
            if packed.low[k, a] > p[a] + reach or packed.high[k, a] < p[a] - reach:
                apart = True
        if turned < LEVEL:
            continue
        if not apart:
            n = _take(packed.vertices[k], packed.count[k], p, R, parts, size, n, scratch)
            if n <= 0:
                return n
        for j in range(packed.joint_start[k], packed.joint_start[k + 1]):
            n = _take(packed.joint[j], 3, p, R, parts, size, n, scratch)
            if n <= 0:
                return n
    return n


@njit(cache=True)
def _take(
    polygon: np.ndarray,
    count: int,
    p: np.ndarray,
    R: np.ndarray,
    parts: np.ndarray,
    size: np.ndarray,
    n: int,
    scratch: np.ndarray,
) -> int:
    """Takes a convex polygon (K, 3) of W from the n parts of a region; how many are left, -1 where they have no room."""
    seen_from(polygon, count, p, R, scratch[0])
    cur, m = clip_between(scratch[:2], 0, count, 2, -FLUSH, FLUSH)
    if m < 3:
        return n
    return subtract(scratch[cur], m, parts, size, n, scratch[2], scratch[3])
