"""Where a whole patch lies on a surface with nothing above it, at one heading: the contact points, as convex parts.

All polygons of the free space (`scenes.footholds.free_space`) are convex, so that the answer is exact but for rounding.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from scenes.footholds.convex_parts import CORNERS, copy_corners, subtract
from scenes.footholds.free_space import box_sides, footprint_of, free_space, half_planes
from scenes.footholds.projection import PatchShape
from scenes.terrain.packed_terrain import PackedTerrain


@njit(cache=True)
def fit_region(
    packed: PackedTerrain,
    surface: int,
    R: np.ndarray,
    patch: PatchShape,
    low: np.ndarray,
    high: np.ndarray,
    parts: np.ndarray,
    size: np.ndarray,
) -> int:
    """Writes the disjoint convex parts of the contact points on a surface where a patch fits; how many there are.

    Where there is no room for all parts, some of the region is left out, never too much put in.

    Args:
        packed: the terrain.
        surface: number of the surface.
        R: (3, 3) contact frame in W at the heading.
        patch: the room that the end effector takes.
        low: (3,) the part of the surface that is asked for: lowest corner of a box in W [m].
        high: (3,) the box's greatest corner in W [m].
        parts: (P, C, 2) written here, (u, v), counter-clockwise; C >= `most_corners`.
        size: (P,) corners of each part, written here.
    """
    sides = half_planes(box_sides(low, high), R, packed.offset[surface])
    space = free_space(packed, surface, R, footprint_of(patch), sides)
    if space.outline.shape[0] < 3:
        return 0
    n, longest = 1, 0
    size[0] = copy_corners(space.outline, space.outline.shape[0], parts[0])
    for b in range(space.start.shape[0] - 1):
        longest = max(longest, space.start[b + 1] - space.start[b])
    inside, outside = np.empty((parts.shape[1] + longest + 8, 2)), np.empty((parts.shape[1] + longest + 8, 2))
    for b in range(space.start.shape[0] - 1):
        first, end = space.start[b], space.start[b + 1]
        n = subtract(space.corner[first:end], end - first, parts, size, n, inside, outside)
        if n <= 0:
            break
    return max(n, 0)


@njit(cache=True)
def most_corners(packed: PackedTerrain) -> int:
    """How many corners a part of a region may have on this terrain."""
    return packed.vertices.shape[1] + CORNERS
