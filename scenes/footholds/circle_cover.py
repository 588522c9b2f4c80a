"""Circles that cover the free part of a plane: grown from samples on a grid that gets finer where circles are small.

A sample that no circle holds yet gets one that holds it and has grown: its centre moves to where its radius is larger.
The largest circle about a point in a free space (`scenes.footholds.free_space`) has a radius in closed form; it may be negative, minus
a bound on the way back in.

Source: Lin 2020, "Learning for Humanoid Multi-Contact Navigation Planning", sec. 4.5.1.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from scenes.footholds.free_space import FreeSpace

LEAST_RADIUS = 0.1  # of the finest spacing; smaller circles hold nothing
GROWTH_STEP = 0.2  # of the finest spacing, where the search for a larger circle stops
COVERED = 0.999  # share of a circle that counts as covered, so that samples on its edge grow none


@njit(cache=True)
def free_radius(x: np.ndarray, space: FreeSpace) -> float:
    """Radius of the largest circle about a point in a free space [m]; negative where the point is not free.

    Args:
        x: (2,) the point [m].
        space: the free space, with an outline.
    """
    radius = -polygon_distance(x, space.outline, space.outline.shape[0])
    for b in range(space.start.shape[0] - 1):
        first, end = space.start[b], space.start[b + 1]
        radius = min(radius, polygon_distance(x, space.corner[first:end], end - first))
    return radius


@njit(cache=True)
def polygon_distance(x: np.ndarray, corners: np.ndarray, count: int) -> float:
    """Signed distance of x (2,) from a convex polygon, counter-clockwise [m]; minus the way out where x is inside.

    Args:
        x: (2,) the point [m].
        corners: (V, 2) of the polygon [m].
        count: how many corners are real.
    """
    inside, nearest = count > 2, np.inf
    for a in range(count):
        b = a + 1 if a + 1 < count else 0
        ex, ey = corners[b, 0] - corners[a, 0], corners[b, 1] - corners[a, 1]
        px, py = x[0] - corners[a, 0], x[1] - corners[a, 1]
        length2 = ex * ex + ey * ey
        t = min(max((px * ex + py * ey) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
        nearest = min(nearest, (px - t * ex) ** 2 + (py - t * ey) ** 2)
        inside = inside and ex * py - ey * px >= 0.0
    return -np.sqrt(nearest) if inside else np.sqrt(nearest)


@njit(cache=True)
def cover_free_space(space: FreeSpace, coarsest: float, finest: float) -> np.ndarray:
    """(K, 3) circles x, y, radius [m] that cover the free part, none within another.

    Args:
        space: the free part.
        coarsest: first spacing of the samples [m].
        finest: last spacing of the samples [m].
    """
    if space.outline.shape[0] < 3:
        return np.zeros((0, 3))
    u, v = space.outline[:, 0], space.outline[:, 1]
    low, high = (u.min(), v.min()), (u.max(), v.max())
    spacing = coarsest
    nx = max(int(np.ceil((high[0] - low[0]) / spacing)), 1) | 1  # odd: the middle is sampled, where circles are largest
    ny = max(int(np.ceil((high[1] - low[1]) / spacing)), 1) | 1
    cells = np.empty((nx * ny, 2))
    for i in range(nx):
        for j in range(ny):
            cells[i * ny + j, 0] = 0.5 * (low[0] + high[0]) + (i - 0.5 * (nx - 1)) * spacing
            cells[i * ny + j, 1] = 0.5 * (low[1] + high[1]) + (j - 0.5 * (ny - 1)) * spacing
    circles, n = np.empty((64, 3)), 0
    while cells.shape[0]:
        room = np.empty(cells.shape[0])
        for i in range(cells.shape[0]):
            room[i] = free_radius(cells[i], space)
        for i in np.argsort(-room):
            if room[i] < LEAST_RADIUS * finest:
                break
            if _holds(circles, n, cells[i], 0.0):
                continue
            if n == circles.shape[0]:
                larger = np.empty((2 * n, 3))
                larger[:n] = circles
                circles = larger
            circles[n] = _grown(cells[i], float(room[i]), spacing, finest, space)
            n += 1
        half = 0.5 * spacing
        if half < finest * (1.0 - 1e-9):
            break
        finer, m = np.empty((4 * cells.shape[0], 2)), 0
        for i in range(cells.shape[0]):
            across = np.sqrt(0.5) * spacing
            if room[i] < -across or _holds(circles, n, cells[i], across):
                continue
            for a in range(4):
                finer[m, 0] = cells[i, 0] + (0.25 if a < 2 else -0.25) * spacing
                finer[m, 1] = cells[i, 1] + (0.25 if a % 2 else -0.25) * spacing
                m += 1
        cells, spacing = finer[:m], half
    return circles[:n].copy()


@njit(cache=True)
def _grown(sample: np.ndarray, room: float, spacing: float, finest: float, space: FreeSpace) -> np.ndarray:
    """(3,) a circle that holds the sample: the one about it, its centre moved to where it grows, by a pattern search."""
    circle, x = np.array([sample[0], sample[1], room]), np.empty(2)
    step = 0.5 * spacing
    while step > GROWTH_STEP * finest:
        best_a, best = -1, circle[2] + 1e-9
        for a in range(8):
            x[0] = circle[0] + step * np.cos(0.25 * np.pi * a)
            x[1] = circle[1] + step * np.sin(0.25 * np.pi * a)
            radius = free_radius(x, space)
            away = np.sqrt((x[0] - sample[0]) ** 2 + (x[1] - sample[1]) ** 2)
            if radius > best and away <= COVERED * radius:
                best_a, best = a, radius
        if best_a < 0:
            step *= 0.5
        else:
            circle[0] += step * np.cos(0.25 * np.pi * best_a)
            circle[1] += step * np.sin(0.25 * np.pi * best_a)
            circle[2] = best
    return circle


@njit(cache=True)
def _holds(circles: np.ndarray, n: int, x: np.ndarray, around: float) -> bool:
    """Whether one of the first n circles holds all that is within `around` of x."""
    for k in range(n):
        room = COVERED * circles[k, 2] - around
        if room >= 0.0 and (x[0] - circles[k, 0]) ** 2 + (x[1] - circles[k, 1]) ** 2 <= room * room:
            return True
    return False
