"""Small convex polygons, compiled: parts of surfaces under a sole, their hull, and whether it is large enough to stand on."""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit

from scenes.footholds.convex_parts import below, copy_corners
from scenes.terrain.clipping import clip_between, seen_from

EXACT = 1e-9  # [m] points nearer than this are one


@njit(cache=True)
def part_within(
    polygon: np.ndarray, count: int, p: np.ndarray, R: np.ndarray, bound: np.ndarray, scratch: np.ndarray
) -> tuple[int, int]:
    """Corners of the part of a polygon (K, 3) of W within |x|, |y|, |z| <= bound of a frame, and where in `scratch` it is.

    Args:
        polygon: (K, 3) corners in W [m].
        count: how many are real.
        p: (3,) origin of the frame in W [m].
        R: (3, 3) its axes in W.
        bound: (3,) half edges of the box [m].
        scratch: (2, K + 8, 3).
    """
    seen_from(polygon, count, p, R, scratch[0])
    cur, m = 0, count
    for axis in range(3):
        cur, m = clip_between(scratch, cur, m, axis, -bound[axis], bound[axis])
    return m, cur


@njit(cache=True)
def convex_area(polygon: np.ndarray, count: int) -> float:
    """Area of a convex polygon from its first two coordinates, positive counter-clockwise [m^2].

    Args:
        polygon: (K, 2 or 3) corners [m].
        count: how many are real.
    """
    doubled = 0.0
    for k in range(1, count - 1):
        doubled += _turn(polygon[0], polygon[k], polygon[k + 1])
    return 0.5 * doubled


@njit(cache=True)
def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Twice the area of a triangle, positive counter-clockwise [m^2]."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@njit(cache=True)
def convex_hull(points: np.ndarray, n: int) -> int:
    """Puts the convex hull of n points (x, y) in their place, counter-clockwise; its size. Gift wrapping (Jarvis 1973).

    Args:
        points: (N, 2) [m]; written.
        n: how many are real.
    """
    if n < 3:
        return n
    source = points[:n].copy()
    first = 0
    for i in range(1, n):
        if source[i, 0] < source[first, 0] or (source[i, 0] == source[first, 0] and source[i, 1] < source[first, 1]):
            first = i
    size, here = 0, first
    while size < n:
        points[size] = source[here]
        size += 1
        after = -1
        for i in range(n):
            ex, ey = source[i, 0] - source[here, 0], source[i, 1] - source[here, 1]
            if ex * ex + ey * ey < EXACT * EXACT:
                continue
            if after < 0:
                after = i
                continue
            turn = _turn(source[here], source[after], source[i])
            fx, fy = source[after, 0] - source[here, 0], source[after, 1] - source[here, 1]
            length = np.sqrt(fx * fx + fy * fy)
            beside = turn / length  # how far the point lies left of the line; right of it, it comes before
            if beside < -EXACT or (beside <= EXACT and ex * ex + ey * ey > length * length and ex * fx + ey * fy > 0.0):
                after = i
        if after < 0:
            break
        ex, ey = source[after, 0] - source[first, 0], source[after, 1] - source[first, 1]
        if ex * ex + ey * ey < EXACT * EXACT:
            break
        here = after
    return size


@njit(cache=True)
def with_fewest_corners(points: np.ndarray, count: int, corners: np.ndarray) -> int:
    """Writes a convex polygon with at most 8 corners, those left out that cost the least area; how many remain.

    Args:
        points: (N, 2) corners [m]; written.
        count: how many are real.
        corners: (8, 2) written [m].
    """
    while count > corners.shape[0]:
        least, which = np.inf, 0
        for i in range(count):
            before, after = points[i - 1 if i > 0 else count - 1], points[i + 1 if i + 1 < count else 0]
            lost = _turn(before, points[i], after)
            if lost < least:
                least, which = lost, i
        for i in range(which, count - 1):
            points[i] = points[i + 1]
        count -= 1
    for i in range(count):
        corners[i] = points[i]
    return count


@njit(cache=True)
def holds_a_disc(polygon: np.ndarray, count: int, radius: float) -> bool:
    """Whether a disc lies inside a convex polygon: something is left when every edge moves inwards by the radius.

    Args:
        polygon: (K, 2) corners, counter-clockwise [m].
        count: how many are real.
        radius: of the disc [m].
    """
    room, spare = np.empty((2 * polygon.shape[0] + 2, 2)), np.empty((2 * polygon.shape[0] + 2, 2))
    m = copy_corners(polygon, count, room)
    for e in range(count):
        tail, head = polygon[e], polygon[e + 1 if e + 1 < count else 0]
        ex, ey = head[0] - tail[0], head[1] - tail[1]
        length = np.sqrt(ex * ex + ey * ey)
        if length < EXACT:
            continue
        nu, nv = ey / length, -ex / length
        m = below(room, m, nu, nv, nu * tail[0] + nv * tail[1] - radius, spare)
        room, spare = spare, room
        if m == 0:
            return False
    return True


@njit(cache=True)
def start_at_the_front_left(corners: np.ndarray, count: int) -> None:
    """Turns the list of corners so that the one farthest along x + y comes first, as in a whole patch.

    Args:
        corners: (K, 2) corners [m]; written.
        count: how many are real.
    """
    first = 0
    for i in range(1, count):
        if corners[i, 0] + corners[i, 1] > corners[first, 0] + corners[first, 1] + EXACT:
            first = i
    turned = corners.copy()
    for i in range(count):
        corners[i] = turned[(i + first) % count]


@njit(cache=True)
def box_middle(corners: np.ndarray, count: int) -> tuple[float, float]:
    """Centre of the box around some points [m]: a sole there has as much before it as behind it.

    Args:
        corners: (K, 2) points [m].
        count: how many are real.
    """
    x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
    for i in range(count):
        x0, x1 = min(x0, corners[i, 0]), max(x1, corners[i, 0])
        y0, y1 = min(y0, corners[i, 1]), max(y1, corners[i, 1])
    return 0.5 * (x0 + x1), 0.5 * (y0 + y1)
