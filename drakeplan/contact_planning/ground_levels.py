"""The floors over each cell of a grid in the plan view, looked up when a cell is first visited.

A cell has the levels of the surfaces over its centre, and borrows those of cells nearby that it has no floor for: a gap is
stepped over. Levels closer than the torso's height over the ground are one, the highest: nobody stands between them.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.terrain.packed_terrain import PackedTerrain, cells_under, height_at, in_cells, over_polygon

INSIDE_MARGIN = 0.02  # [m] a cell's centre this far outside a polygon still has its ground
MOST_FLOORS = 32  # of one cell; higher ones are left out
MOST_BORROWED = 4  # levels that one cell takes over from its neighbourhood
MOST_LEVELS = MOST_FLOORS + MOST_BORROWED
UNKNOWN, OWN, ALL = 0, 1, 2  # what is known of a cell: nothing, the levels of its own, the borrowed ones too


class GroundLevels(NamedTuple):
    """Levels over the cells of a grid; those of one cell are a list, `first` and then `following`.

    Attributes:
        origin: (2,) lowest x and y of the grid in W [m].
        cell: edge of a cell [m].
        support_radius: levels are borrowed from cells whose centres lie this near [m].
        step: levels this close are the same floor to a step [m].
        knee: height of the torso over the ground: two levels closer than this have one floor [m].
        feet: (P,) bool, polygons that a foot may use.
        known: (nx, ny) UNKNOWN, OWN or ALL.
        first: (nx, ny) 1 + the first level of a cell, 0 where it has none.
        following: (levels,) 1 + the next level of the same cell, 0 for none.
        z: (levels,) height [m].
        own: (levels,) whether a surface of that height is over the cell's centre.
        at: (levels, 2) the cell.
        count: (1,) how many levels there are.
    """

    origin: np.ndarray
    cell: float
    support_radius: float
    step: float
    knee: float
    feet: np.ndarray
    known: np.ndarray
    first: np.ndarray
    following: np.ndarray
    z: np.ndarray
    own: np.ndarray
    at: np.ndarray
    count: np.ndarray


def most_new_levels(support_radius: float, cell: float) -> int:
    """How many levels a visit of a cell and its eight neighbours makes at most.

    Args:
        support_radius: levels are borrowed from cells whose centres lie this near [m].
        cell: edge of a cell [m].
    """
    return (2 * int(np.ceil(support_radius / cell)) + 3) ** 2 * MOST_FLOORS + 9 * MOST_BORROWED


@njit(cache=True)
def _append(ground: GroundLevels, i: int, j: int, z: float, own: bool) -> None:
    """Adds a level at the end of a cell's list."""
    level = ground.count[0]
    ground.count[0] = level + 1
    ground.following[level], ground.z[level], ground.own[level] = 0, z, own
    ground.at[level, 0], ground.at[level, 1] = i, j
    last = ground.first[i, j]
    if last == 0:
        ground.first[i, j] = level + 1
        return
    while ground.following[last - 1] > 0:
        last = ground.following[last - 1]
    ground.following[last - 1] = level + 1


@njit(cache=True)
def _find_own(packed: PackedTerrain, ground: GroundLevels, i: int, j: int) -> None:
    """The levels of the surfaces over a cell's centre."""
    ground.known[i, j] = OWN
    x, y = ground.origin[0] + (i + 0.5) * ground.cell, ground.origin[1] + (j + 0.5) * ground.cell
    heights = np.empty(MOST_FLOORS)
    n = 0
    margin = 2.0 * INSIDE_MARGIN  # more than a tilted polygon's own margin reaches in the plan view
    rows, j0, j1 = cells_under(packed, x - margin, y - margin, x + margin, y + margin)
    for row in rows:
        for k in in_cells(packed, row, j0, j1):
            if k >= packed.num_surfaces or not ground.feet[k] or packed.normal[k, 2] < 1e-3:
                continue
            z = height_at(packed, k, x, y)
            if n < MOST_FLOORS and over_polygon(packed, k, x, y, z, INSIDE_MARGIN):
                heights[n] = z
                n += 1
    if n == 0:
        return
    if n == 1:
        _append(ground, i, j, heights[0], True)
        return
    ordered = np.sort(heights[:n])
    _append(ground, i, j, ordered[n - 1], True)
    for q in range(n - 2, -1, -1):
        if ordered[q + 1] - ordered[q] >= ground.knee:
            _append(ground, i, j, ordered[q], True)


@njit(cache=True)
def _serves(ground: GroundLevels, i: int, j: int, z: float) -> bool:
    """Whether a cell has a level for this height already, or ground of its own too close above it."""
    level = ground.first[i, j]
    while level > 0:
        h = ground.z[level - 1]
        if abs(h - z) <= ground.step:
            return True
        if ground.own[level - 1]:
            if 0.0 < h - z < ground.knee:
                return True
        elif abs(h - z) < ground.knee:
            return True
        level = ground.following[level - 1]
    return False


@njit(cache=True)
def borrow_levels(packed: PackedTerrain, ground: GroundLevels, i: int, j: int) -> None:
    """Gives a cell the levels of the nearest cells within the support radius that it has no level for.

    Args:
        packed: the terrain.
        ground: the levels.
        i: of the cell.
        j: of the cell.
    """
    if ground.known[i, j] == UNKNOWN:
        _find_own(packed, ground, i, j)
    if ground.known[i, j] == ALL:
        return
    ground.known[i, j] = ALL
    nx, ny = ground.first.shape
    r = int(np.ceil(ground.support_radius / ground.cell))
    within = (ground.support_radius / ground.cell) ** 2 + 1e-9
    for _ in range(MOST_BORROWED):
        best, best_z = within, -np.inf
        for a in range(-r, r + 1):
            for b in range(-r, r + 1):
                u, v = i + a, j + b
                squared = float(a * a + b * b)
                if not (0 <= u < nx and 0 <= v < ny) or squared > best:
                    continue
                if ground.known[u, v] == UNKNOWN:
                    _find_own(packed, ground, u, v)
                level = ground.first[u, v]
                while level > 0:
                    z = ground.z[level - 1]
                    nearer = squared < best or (squared == best and z > best_z)
                    if ground.own[level - 1] and nearer and not _serves(ground, i, j, z):
                        best, best_z = squared, z
                    level = ground.following[level - 1]
        if best_z == -np.inf:
            return
        _append(ground, i, j, best_z, False)


@njit(cache=True)
def own_levels(packed: PackedTerrain, ground: GroundLevels, i: int, j: int) -> int:
    """1 + the first level of a cell, looked up where it was not yet; 0 where it has none.

    Args:
        packed: the terrain.
        ground: the levels.
        i: of the cell.
        j: of the cell.
    """
    if ground.known[i, j] == UNKNOWN:
        _find_own(packed, ground, i, j)
    return ground.first[i, j]


@njit(cache=True)
def nearest_level(
    first: np.ndarray, following: np.ndarray, height: np.ndarray, i: int, j: int, z: float, off: float
) -> int:
    """The level of a cell, of those that are known, that is nearest to a height, -1 if none is within `off`.

    Args:
        first: as in `GroundLevels`.
        following: as there.
        height: as there [m].
        i: of the cell.
        j: of the cell.
        z: height in W [m].
        off: [m].
    """
    found, least = -1, off
    level = int(first[i, j])
    while level > 0:
        apart = abs(float(height[level - 1]) - z)
        if apart <= least:
            found, least = level - 1, apart
        level = int(following[level - 1])
    return found


@njit(cache=True)
def level_near(packed: PackedTerrain, ground: GroundLevels, i: int, j: int, z: float) -> int:
    """The level of a cell that is nearest to a height and less than the torso's height from it, -1 if there is none.

    Args:
        packed: the terrain.
        ground: the levels.
        i: of the cell.
        j: of the cell.
        z: height in W [m].
    """
    first, following, height = ground.first, ground.following, ground.z
    own_levels(packed, ground, i, j)
    found = nearest_level(first, following, height, i, j, z, ground.step)
    if found >= 0:
        return found
    borrow_levels(packed, ground, i, j)
    found = nearest_level(first, following, height, i, j, z, ground.step)
    return found if found >= 0 else nearest_level(first, following, height, i, j, z, ground.knee)
