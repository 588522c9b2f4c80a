"""Plane regions kept as disjoint convex parts, for compiled code: cut by a line, less a convex polygon."""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit

PARTS, CORNERS = 64, 24  # usual room for a region: convex parts, and corners of each
SHORT = 1e-9  # [m] edges shorter than this are rounding
NOTHING = 1e-8  # [m^2] parts smaller than this are rounding


@njit(cache=True)
def subtract(
    piece: np.ndarray,
    m: int,
    parts: np.ndarray,
    size: np.ndarray,
    n: int,
    inside: np.ndarray,
    outside: np.ndarray,
) -> int:
    """Takes a convex polygon from the n parts of a region; how many are left, -1 where they have no room.

    Args:
        piece: (K, 2 or more) corners of the polygon, counter-clockwise [m].
        m: how many of them are real.
        parts: (P, C, 2) room for P parts of C corners, counter-clockwise [m].
        size: (P,) corners of each part.
        n: number of parts.
        inside: (C + K + 8, 2 or more) scratch.
        outside: the same.
    """
    for i in range(n - 1, -1, -1):
        # Meets it at all? Else cutting would only split it.
        met = copy_corners(parts[i], size[i], inside)
        for e in range(m):
            met = cut(inside, met, piece[e], piece[e + 1 if e + 1 < m else 0], 1.0, outside)
            copy_corners(outside, met, inside)
            if met < 3:
                break
        if met < 3 or area(inside, met) < NOTHING:
            continue
        left = copy_corners(parts[i], size[i], inside)
        n -= 1  # the part goes; the last one takes its place
        copy_corners(parts[n], size[n], parts[i])
        size[i] = size[n]
        for e in range(m):
            tail, head = piece[e], piece[e + 1 if e + 1 < m else 0]
            beyond = cut(inside, left, tail, head, -1.0, outside)
            if beyond >= 3 and area(outside, beyond) >= NOTHING:
                if n == parts.shape[0] or beyond > parts.shape[1]:
                    return -1
                size[n] = copy_corners(outside, beyond, parts[n])
                n += 1
            left = cut(inside, left, tail, head, 1.0, outside)
            copy_corners(outside, left, inside)
            if left < 3:
                break
    return n


@njit(cache=True)
def copy_corners(source: np.ndarray, count: int, target: np.ndarray) -> int:
    """Copies so many corners from one array to another; their number.

    Args:
        source: (K, 2 or more) [m].
        count: how many are copied.
        target: (count or more, 2 or more) is written here.
    """
    for k in range(count):
        target[k, 0], target[k, 1] = source[k, 0], source[k, 1]
    return count


@njit(cache=True)
def cut(polygon: np.ndarray, count: int, tail: np.ndarray, head: np.ndarray, sign: float, out: np.ndarray) -> int:
    """Writes the part of a polygon left (sign 1) or right (-1) of the line from tail to head; its number of corners.

    Args:
        polygon: (K, 2 or more) corners [m].
        count: how many are real.
        tail: (2 or more,) where the line comes from [m].
        head: (2 or more,) where it goes to [m].
        sign: 1 for the part to the left of the line, -1 for the part to its right.
        out: (count + 1 or more, 2 or more) is written here.
    """
    ex, ey = head[0] - tail[0], head[1] - tail[1]
    if ex * ex + ey * ey < SHORT * SHORT:  # no direction: nothing is beyond it
        return copy_corners(polygon, count, out) if sign > 0.0 else 0
    n = 0
    for k in range(count):
        j = k + 1 if k + 1 < count else 0
        here = sign * (ex * (polygon[k, 1] - tail[1]) - ey * (polygon[k, 0] - tail[0]))
        there = sign * (ex * (polygon[j, 1] - tail[1]) - ey * (polygon[j, 0] - tail[0]))
        if here >= 0.0:
            out[n, 0], out[n, 1] = polygon[k, 0], polygon[k, 1]
            n += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            n = _add_between(polygon[k], polygon[j], here / (here - there), out, n)
    return n


@njit(cache=True)
def below(polygon: np.ndarray, count: int, nu: float, nv: float, bound: float, out: np.ndarray) -> int:
    """Writes the part of a convex polygon with nu u + nv v <= bound; its number of corners.

    Args:
        polygon: (K, 2) corners (u, v) [m].
        count: how many are real.
        nu: of the half plane's outward normal.
        nv: of the half plane's outward normal.
        bound: of the half plane [m].
        out: (count + 1 or more, 2) is written here.
    """
    n = 0
    for k in range(count):
        j = k + 1 if k + 1 < count else 0
        here = nu * polygon[k, 0] + nv * polygon[k, 1] - bound
        there = nu * polygon[j, 0] + nv * polygon[j, 1] - bound
        if here <= 0.0:
            out[n, 0], out[n, 1] = polygon[k, 0], polygon[k, 1]
            n += 1
        if (here < 0.0 and there > 0.0) or (here > 0.0 and there < 0.0):
            n = _add_between(polygon[k], polygon[j], here / (here - there), out, n)
    return n


@njit(cache=True)
def _add_between(one: np.ndarray, other: np.ndarray, share: float, out: np.ndarray, n: int) -> int:
    """Writes the point at a share of the way from one corner to another as number n; n + 1."""
    out[n, 0] = one[0] + share * (other[0] - one[0])
    out[n, 1] = one[1] + share * (other[1] - one[1])
    return n + 1


@njit(cache=True)
def area(polygon: np.ndarray, count: int) -> float:
    """Signed area of a polygon [m^2].

    Args:
        polygon: (K, 2 or more) corners [m].
        count: how many are real.
    """
    doubled = 0.0
    for k in range(1, count - 1):
        ax, ay = polygon[k, 0] - polygon[0, 0], polygon[k, 1] - polygon[0, 1]
        bx, by = polygon[k + 1, 0] - polygon[0, 0], polygon[k + 1, 1] - polygon[0, 1]
        doubled += ax * by - ay * bx
    return 0.5 * doubled
