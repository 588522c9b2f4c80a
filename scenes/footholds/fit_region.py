"""Where a whole patch lies on a surface with nothing above it, at one heading: the contact points, as convex parts.

In the contact frame of a heading the patch is a rectangle B along the axes, and the answer is closed:

    erosion of the surface by B    each edge of a convex surface moves inwards by B's support function; on a floor of several
                                   pieces, the points p whose p + B meets nothing that is off the floor
    less what covers it            whatever rises over the plane throws an outline Q on it; p + B' meets Q where p lies in
                                   the Minkowski sum of Q and -B', B' being the patch with its overhang

All of these are convex polygons, so that the answer is exact but for rounding. Coordinates are (u, v) = (x, y) of the
contact frame at the origin of W, [m].
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit

from scenes.footholds.convex_parts import CORNERS, NOTHING, PARTS, area, copy_corners, subtract
from scenes.footholds.floor_patch import take_floor
from scenes.footholds.projection import COVER_GAP, PATCH_MARGIN, PatchShape
from scenes.terrain.packed_terrain import PackedTerrain, near

ROUNDING = 1e-6  # [m] what covers the surface is widened by this


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
    size[0] = _surface(packed, surface, R, patch, low, high, parts[0], np.empty((parts.shape[1], 2)))
    if size[0] < 3 or area(parts[0], size[0]) < NOTHING:
        return 0
    u, v = parts[0, : size[0], 0], parts[0, : size[0], 1]
    window = (u.min(), v.min(), u.max(), v.max())
    half_u = 0.5 * (window[2] - window[0]) + patch.half_length + max(patch.front, patch.back)
    half_v = 0.5 * (window[3] - window[1]) + patch.half_width + patch.side
    reach = np.sqrt(half_u * half_u + half_v * half_v + patch.clearance * patch.clearance)
    middle = np.empty(3)
    for a in range(3):
        middle[a] = R[a, 0] * 0.5 * (window[0] + window[2]) + R[a, 1] * 0.5 * (window[1] + window[3])
        middle[a] += R[a, 2] * packed.offset[surface]
    around = near(packed, middle[0] - reach, middle[1] - reach, middle[0] + reach, middle[1] + reach)
    n = 1
    if packed.floor[surface] >= 0:
        n = _take_gaps(packed, surface, R, patch, window, middle, reach, around, parts, size, n)
    if n > 0:
        n = _take_covered(packed, surface, R, patch, window, middle[2], reach, around, parts, size, n)
    return max(n, 0)


@njit(cache=True)
def _surface(
    packed: PackedTerrain,
    surface: int,
    R: np.ndarray,
    patch: PatchShape,
    low: np.ndarray,
    high: np.ndarray,
    out: np.ndarray,
    spare: np.ndarray,
) -> int:
    """Writes a surface, within a box, less the support function of the patch where it is alone; how many corners."""
    d, m = packed.offset[surface], packed.count[surface]
    for k in range(m):
        _flat(packed.vertices[surface, k], R, out[k])
    if packed.floor[surface] < 0:
        for k in range(packed.count[surface]):
            e = packed.edge_normal[surface, k]
            nu = e[0] * R[0, 0] + e[1] * R[1, 0] + e[2] * R[2, 0]
            nv = e[0] * R[0, 1] + e[1] * R[1, 1] + e[2] * R[2, 1]
            across = e[0] * R[0, 2] + e[1] * R[1, 2] + e[2] * R[2, 2]
            support = patch.half_length * abs(nu) + patch.half_width * abs(nv) + PATCH_MARGIN + ROUNDING
            m = below(out, m, nu, nv, packed.edge_offset[surface, k] - d * across - support, spare)
            copy_corners(spare, m, out)
    for a in range(3):  # the box: each coordinate of W is linear in (u, v)
        m = below(out, m, R[a, 0], R[a, 1], high[a] - d * R[a, 2], spare)
        copy_corners(spare, m, out)
        m = below(out, m, -R[a, 0], -R[a, 1], d * R[a, 2] - low[a], spare)
        copy_corners(spare, m, out)
    return m


@njit(cache=True)
def _take_gaps(
    packed: PackedTerrain,
    surface: int,
    R: np.ndarray,
    patch: PatchShape,
    window: tuple[float, float, float, float],
    middle: np.ndarray,
    reach: float,
    around: np.ndarray,
    parts: np.ndarray,
    size: np.ndarray,
    n: int,
) -> int:
    """Takes the points where the patch would reach beyond the surface's floor; how many parts are left, -1: no room for them."""
    wide, long = patch.half_length + PATCH_MARGIN + ROUNDING, patch.half_width + PATCH_MARGIN + ROUNDING
    gaps, corners = np.empty((PARTS, CORNERS, 2)), np.empty(PARTS, np.int64)
    corners[0] = 4  # all around, before the floor is taken from it
    for a in range(4):
        gaps[0, a, 0] = (0.5 * (window[2] - window[0]) + wide) * (1.0 if (a == 0 or a == 3) else -1.0)
        gaps[0, a, 1] = (0.5 * (window[3] - window[1]) + long) * (1.0 if a < 2 else -1.0)
    scratch = np.empty((4, packed.vertices.shape[1] + 4 + CORNERS, 3))
    missing = take_floor(packed, surface, middle, R, reach, around, gaps, corners, 1, scratch)
    if missing < 0:
        return -1
    outline, hull = np.empty((CORNERS, 2)), np.empty((4 * CORNERS + 4, 2))
    inside, outside = np.empty((parts.shape[1] + 4 * CORNERS, 2)), np.empty((parts.shape[1] + 4 * CORNERS, 2))
    for g in range(missing):
        for k in range(corners[g]):
            outline[k, 0] = gaps[g, k, 0] + 0.5 * (window[0] + window[2])
            outline[k, 1] = gaps[g, k, 1] + 0.5 * (window[1] + window[3])
        m = _meeting(outline, corners[g], (-wide, -long, wide, long), hull)
        n = subtract(hull, m, parts, size, n, inside, outside)
        if n <= 0:
            break
    return n


@njit(cache=True)
def _take_covered(
    packed: PackedTerrain,
    surface: int,
    R: np.ndarray,
    patch: PatchShape,
    window: tuple[float, float, float, float],
    z: float,
    reach: float,
    around: np.ndarray,
    parts: np.ndarray,
    size: np.ndarray,
    n: int,
) -> int:
    """Takes the points where something stands above the patch or its overhang; how many parts are left, -1: no room for them."""
    box = (
        -patch.half_length - patch.back - ROUNDING,
        -patch.half_width - patch.side - ROUNDING,
        patch.half_length + patch.front + ROUNDING,
        patch.half_width + patch.side + ROUNDING,
    )
    room = packed.vertices.shape[1] + 8
    outline, hull, work = np.empty((room, 2)), np.empty((4 * room + 4, 2)), np.empty((2, room, 3))
    inside, outside = np.empty((parts.shape[1] + 4 * room, 2)), np.empty((parts.shape[1] + 4 * room, 2))
    for q in range(around.shape[0]):
        k = around[q]
        if k == surface or packed.low[k, 2] > z + reach or packed.high[k, 2] < z - reach:
            continue
        m = _outline(packed.vertices[k], packed.count[k], R, packed.offset[surface], patch.clearance, work, outline)
        if (
            m == 0
            or _one_side(outline, m, 0, window[0] + box[0], window[2] + box[2])
            or _one_side(outline, m, 1, window[1] + box[1], window[3] + box[3])
        ):
            continue
        n = subtract(hull, _meeting(outline, m, box, hull), parts, size, n, inside, outside)
        if n <= 0:
            break
    return n


@njit(cache=True)
def most_corners(packed: PackedTerrain) -> int:
    """How many corners a part of a region may have on this terrain."""
    return packed.vertices.shape[1] + CORNERS


@njit(cache=True)
def _flat(point: np.ndarray, R: np.ndarray, out: np.ndarray) -> None:
    """Writes (u, v) of a point of W."""
    for a in range(2):
        out[a] = R[0, a] * point[0] + R[1, a] * point[1] + R[2, a] * point[2]


@njit(cache=True)
def below(polygon: np.ndarray, count: int, nu: float, nv: float, bound: float, out: np.ndarray) -> int:
    """Writes the part of a polygon with nu u + nv v <= bound; its number of corners.

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
            share = here / (here - there)
            out[n, 0] = polygon[k, 0] + share * (polygon[j, 0] - polygon[k, 0])
            out[n, 1] = polygon[k, 1] + share * (polygon[j, 1] - polygon[k, 1])
            n += 1
    return n


@njit(cache=True)
def _outline(
    vertices: np.ndarray,
    count: int,
    R: np.ndarray,
    offset: float,
    clearance: float,
    work: np.ndarray,
    out: np.ndarray,
) -> int:
    """Writes (u, v) of the part of a polygon (K, 3) of W that stands above a plane, within the clearance; how many corners."""
    m, cur = count, 0
    lowest, highest = np.inf, -np.inf
    for k in range(m):
        _flat(vertices[k], R, work[0, k])
        h = R[0, 2] * vertices[k, 0] + R[1, 2] * vertices[k, 1] + R[2, 2] * vertices[k, 2] - offset
        work[0, k, 2] = h
        lowest, highest = min(lowest, h), max(highest, h)
    if highest < COVER_GAP or lowest > clearance:
        return 0
    for side in range(2):
        sign, bound = (1.0, clearance) if side == 0 else (-1.0, -COVER_GAP)
        n = 0
        for k in range(m):
            j = k + 1 if k + 1 < m else 0
            here, there = sign * work[cur, k, 2] - bound, sign * work[cur, j, 2] - bound
            if here <= 0.0:
                work[1 - cur, n] = work[cur, k]
                n += 1
            if (here < 0.0 and there > 0.0) or (here > 0.0 and there < 0.0):
                share = here / (here - there)
                work[1 - cur, n] = work[cur, k] + share * (work[cur, j] - work[cur, k])
                n += 1
        m, cur = n, 1 - cur
    return copy_corners(work[cur], m, out)


@njit(cache=True)
def _one_side(outline: np.ndarray, m: int, axis: int, low: float, high: float) -> bool:
    """Whether an outline lies wholly below or wholly above an interval of u (axis 0) or v (1)."""
    below, above = True, True
    for c in range(m):
        below = below and outline[c, axis] < low
        above = above and outline[c, axis] > high
    return below or above


@njit(cache=True)
def _meeting(outline: np.ndarray, m: int, box: tuple[float, float, float, float], hull: np.ndarray) -> int:
    """Writes the points p for which p + box meets an outline: convex, counter-clockwise; how many corners.

    The Minkowski sum of a convex outline and a box is the convex hull of all sums of their corners (Andrew's monotone chain).
    """
    points = np.empty((4 * m, 2))
    for c in range(m):
        for a in range(4):
            points[4 * c + a, 0] = outline[c, 0] - (box[0] if a < 2 else box[2])
            points[4 * c + a, 1] = outline[c, 1] - (box[1] if (a == 0 or a == 3) else box[3])
    for i in range(1, 4 * m):  # by u, then by v; insertion sort: there are few
        u, v = points[i, 0], points[i, 1]
        j = i - 1
        while j >= 0 and (points[j, 0] > u or (points[j, 0] == u and points[j, 1] > v)):
            points[j + 1, 0], points[j + 1, 1] = points[j, 0], points[j, 1]
            j -= 1
        points[j + 1, 0], points[j + 1, 1] = u, v
    n = 0
    for i in range(4 * m):
        n = _chain(hull, n, 0, points[i])
    start = n - 1
    for i in range(4 * m - 2, -1, -1):
        n = _chain(hull, n, start, points[i])
    return n - 1  # the last is the first again


@njit(cache=True)
def _chain(hull: np.ndarray, n: int, start: int, point: np.ndarray) -> int:
    """Adds a point to a chain that begins at `start` and turns left, dropping those that it leaves inside; its new end."""
    while n >= start + 2:
        ux, uy = hull[n - 1, 0] - hull[n - 2, 0], hull[n - 1, 1] - hull[n - 2, 1]
        if ux * (point[1] - hull[n - 2, 1]) - uy * (point[0] - hull[n - 2, 0]) > 0.0:
            break
        n -= 1
    hull[n, 0], hull[n, 1] = point[0], point[1]
    return n + 1
