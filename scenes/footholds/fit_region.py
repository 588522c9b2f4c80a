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
    hx, hy = patch.half_length, patch.half_width
    d = packed.offset[surface]
    width = packed.vertices.shape[1]
    base, spare = np.empty((parts.shape[1], 2)), np.empty((parts.shape[1], 2))
    whole = packed.floor[surface] < 0
    m = packed.count[surface]
    for k in range(m):
        _flat(packed.vertices[surface, k], R, base[k])
    if whole:
        for k in range(packed.count[surface]):
            e = packed.edge_normal[surface, k]
            nu = e[0] * R[0, 0] + e[1] * R[1, 0] + e[2] * R[2, 0]
            nv = e[0] * R[0, 1] + e[1] * R[1, 1] + e[2] * R[2, 1]
            across = e[0] * R[0, 2] + e[1] * R[1, 2] + e[2] * R[2, 2]
            reach = packed.edge_offset[surface, k] - d * across - hx * abs(nu) - hy * abs(nv)
            m = below(base, m, nu, nv, reach - PATCH_MARGIN - ROUNDING, spare)
            copy_corners(spare, m, base)
    for a in range(3):  # the box: each coordinate of W is linear in (u, v)
        m = below(base, m, R[a, 0], R[a, 1], high[a] - d * R[a, 2], spare)
        copy_corners(spare, m, base)
        m = below(base, m, -R[a, 0], -R[a, 1], d * R[a, 2] - low[a], spare)
        copy_corners(spare, m, base)
    if m < 3 or area(base, m) < NOTHING:
        return 0
    size[0] = copy_corners(base, m, parts[0])
    n = 1

    u_low, v_low, u_high, v_high = base[0, 0], base[0, 1], base[0, 0], base[0, 1]
    for k in range(1, m):
        u_low, u_high = min(u_low, base[k, 0]), max(u_high, base[k, 0])
        v_low, v_high = min(v_low, base[k, 1]), max(v_high, base[k, 1])
    beyond = np.array([hx + max(patch.front, patch.back), hy + patch.side])
    half_u, half_v = 0.5 * (u_high - u_low), 0.5 * (v_high - v_low)
    origin = np.empty(3)
    for a in range(3):
        origin[a] = R[a, 0] * (u_low + half_u) + R[a, 1] * (v_low + half_v) + R[a, 2] * d
    reach = np.sqrt((half_u + beyond[0]) ** 2 + (half_v + beyond[1]) ** 2 + patch.clearance**2)
    around = near(packed, origin[0] - reach, origin[1] - reach, origin[0] + reach, origin[1] + reach)
    room = max(width + 8, CORNERS)
    outline, hull = np.empty((room, 2)), np.empty((4 * room + 4, 2))
    inside, outside = np.empty((parts.shape[1] + 4 * room, 2)), np.empty((parts.shape[1] + 4 * room, 2))

    if not whole:
        gaps, corners = np.empty((PARTS, CORNERS, 2)), np.empty(PARTS, np.int64)
        scratch = np.empty((4, width + 4 + CORNERS, 3))
        corners[0] = 4
        for a in range(4):
            gaps[0, a, 0] = (half_u + hx + 0.01) * (1.0 if (a == 0 or a == 3) else -1.0)
            gaps[0, a, 1] = (half_v + hy + 0.01) * (1.0 if a < 2 else -1.0)
        missing = take_floor(packed, surface, origin, R, reach, around, gaps, corners, 1, scratch)
        if missing < 0:
            return 0
        box = (
            -hx - PATCH_MARGIN - ROUNDING,
            -hy - PATCH_MARGIN - ROUNDING,
            hx + PATCH_MARGIN + ROUNDING,
            hy + PATCH_MARGIN + ROUNDING,
        )
        for g in range(missing):
            for k in range(corners[g]):
                outline[k, 0], outline[k, 1] = gaps[g, k, 0] + u_low + half_u, gaps[g, k, 1] + v_low + half_v
            n = subtract(hull, _meeting(outline, corners[g], box, hull), parts, size, n, inside, outside)
            if n <= 0:
                return 0

    box = (
        -hx - patch.back - ROUNDING,
        -hy - patch.side - ROUNDING,
        hx + patch.front + ROUNDING,
        hy + patch.side + ROUNDING,
    )
    work = np.empty((2, width + 8, 3))
    for q in range(around.shape[0]):
        k = around[q]
        if k == surface or packed.low[k, 2] > origin[2] + reach or packed.high[k, 2] < origin[2] - reach:
            continue
        m = _outline(packed.vertices[k], packed.count[k], R, d, patch.clearance, work, outline)
        if m == 0:
            continue
        apart_u, apart_v = True, True
        for c in range(m):
            if u_low + box[0] <= outline[c, 0] <= u_high + box[2]:
                apart_u = False
            if v_low + box[1] <= outline[c, 1] <= v_high + box[3]:
                apart_v = False
        if (apart_u and _one_side(outline, m, 0, u_low + box[0], u_high + box[2])) or (
            apart_v and _one_side(outline, m, 1, v_low + box[1], v_high + box[3])
        ):
            continue
        n = subtract(hull, _meeting(outline, m, box, hull), parts, size, n, inside, outside)
        if n <= 0:
            return 0
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
