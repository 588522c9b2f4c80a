"""Whether a patch rests on several pieces of one floor: the pieces are taken from the patch, and nothing may remain."""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit

from scenes.terrain.floors import FLUSH, LEVEL
from scenes.terrain.packed_terrain import PackedTerrain

PARTS, CORNERS = 64, 24  # room for what remains of a patch: convex parts, and corners of each
SHORT = 1e-9  # [m] edges shorter than this are rounding
NOTHING = 1e-8  # [m^2] parts smaller than this are rounding


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
    n, reach = 1, np.sqrt(half_length * half_length + half_width * half_width) + FLUSH
    for q in range(around.shape[0]):
        k = around[q]
        if k >= packed.num_surfaces:
            break  # ascending: triangles follow
        if packed.floor[k] != packed.floor[surface]:
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
                return n == 0
        for j in range(packed.joint_start[k], packed.joint_start[k + 1]):
            n = _take(packed.joint[j], 3, p, R, parts, size, n, scratch)
            if n <= 0:
                return n == 0
    return False


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
    """Takes a convex polygon (K, 3) of W from the n parts of a patch; how many are left, -1 where they have no room."""
    cur, m = 0, count
    for k in range(m):
        for a in range(3):
            scratch[0, k, a] = (
                R[0, a] * (polygon[k, 0] - p[0]) + R[1, a] * (polygon[k, 1] - p[1]) + R[2, a] * (polygon[k, 2] - p[2])
            )
    for side in range(2):
        sign = 1.0 if side == 0 else -1.0
        out = 0
        for k in range(m):
            j = k + 1 if k + 1 < m else 0
            above, next_above = sign * scratch[cur, k, 2] - FLUSH, sign * scratch[cur, j, 2] - FLUSH
            if above <= 0.0:
                scratch[1 - cur, out] = scratch[cur, k]
                out += 1
            if (above < 0.0 and next_above > 0.0) or (above > 0.0 and next_above < 0.0):
                share = above / (above - next_above)
                scratch[1 - cur, out] = scratch[cur, k] + share * (scratch[cur, j] - scratch[cur, k])
                out += 1
        m, cur = out, 1 - cur
    if m < 3:
        return n
    piece = scratch[cur]
    before = n
    inside, outside = scratch[2], scratch[3]
    for i in range(before - 1, -1, -1):
        # Meets it at all? Else cutting would only split it.
        met = _copy(parts[i], size[i], inside)
        for e in range(m):
            met = _cut(inside, met, piece[e], piece[e + 1 if e + 1 < m else 0], 1.0, outside)
            _copy(outside, met, inside)
            if met < 3:
                break
        if met < 3 or _area(inside, met) < NOTHING:
            continue
        left = _copy(parts[i], size[i], inside)
        n -= 1  # the part goes; the last one takes its place
        _copy(parts[n], size[n], parts[i])
        size[i] = size[n]
        for e in range(m):
            tail, head = piece[e], piece[e + 1 if e + 1 < m else 0]
            beyond = _cut(inside, left, tail, head, -1.0, outside)
            if beyond >= 3 and _area(outside, beyond) >= NOTHING:
                if n == PARTS or beyond > CORNERS:
                    return -1
                size[n] = _copy(outside, beyond, parts[n])
                n += 1
            left = _cut(inside, left, tail, head, 1.0, outside)
            _copy(outside, left, inside)
            if left < 3:
                break
    return n


@njit(cache=True)
def _copy(source: np.ndarray, count: int, target: np.ndarray) -> int:
    for k in range(count):
        target[k, 0], target[k, 1] = source[k, 0], source[k, 1]
    return count


@njit(cache=True)
def _cut(polygon: np.ndarray, count: int, tail: np.ndarray, head: np.ndarray, sign: float, out: np.ndarray) -> int:
    """Writes the part of a polygon left (sign 1) or right (-1) of the line from tail to head; its number of corners."""
    ex, ey = head[0] - tail[0], head[1] - tail[1]
    if ex * ex + ey * ey < SHORT * SHORT:  # no direction: nothing is beyond it
        return _copy(polygon, count, out) if sign > 0.0 else 0
    n = 0
    for k in range(count):
        j = k + 1 if k + 1 < count else 0
        here = sign * (ex * (polygon[k, 1] - tail[1]) - ey * (polygon[k, 0] - tail[0]))
        there = sign * (ex * (polygon[j, 1] - tail[1]) - ey * (polygon[j, 0] - tail[0]))
        if here >= 0.0:
            out[n, 0], out[n, 1] = polygon[k, 0], polygon[k, 1]
            n += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            share = here / (here - there)
            out[n, 0] = polygon[k, 0] + share * (polygon[j, 0] - polygon[k, 0])
            out[n, 1] = polygon[k, 1] + share * (polygon[j, 1] - polygon[k, 1])
            n += 1
    return n


@njit(cache=True)
def _area(polygon: np.ndarray, count: int) -> float:
    doubled = 0.0
    for k in range(1, count - 1):
        ax, ay = polygon[k, 0] - polygon[0, 0], polygon[k, 1] - polygon[0, 1]
        bx, by = polygon[k + 1, 0] - polygon[0, 0], polygon[k + 1, 1] - polygon[0, 1]
        doubled += ax * by - ay * bx
    return 0.5 * doubled
