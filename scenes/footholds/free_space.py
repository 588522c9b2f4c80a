"""What bounds the contact points where a whole patch lies on a surface with nothing above it: one outline, less convex polygons.

A patch that may have any heading of a range sweeps a convex polygon B in the plane, a rectangle where it has one heading.
The contact points are then closed:

    erosion of the surface by B    each edge of a convex surface moves inwards by B's support function; on a floor of several
                                   pieces, the points p whose p + B meets nothing that is off the floor
    less what covers it            whatever rises over the plane throws an outline Q on it; p + B' meets Q where p lies in
                                   the Minkowski sum of Q and -B', B' being the patch with its overhang

Coordinates are (u, v) = (x, y) of a contact frame at the origin of W, [m].
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.footholds.convex_parts import CORNERS, NOTHING, PARTS, area, below, copy_corners
from scenes.footholds.floor_patch import take_floor
from scenes.footholds.projection import COVER_GAP, PATCH_MARGIN, PatchShape
from scenes.terrain.clipping import clip_between
from scenes.terrain.packed_terrain import PackedTerrain, near
from scenes.terrain.polygon import convex_hull

ROUNDING = 1e-6  # [m] what covers the surface is widened by this
TURN_STEP = np.deg2rad(4.0)  # between the headings whose hull stands for a range of them


class Footprint(NamedTuple):
    """What an end effector takes of a plane at the headings that it may have: convex polygons about its contact point.

    Attributes:
        patch: (F, 2) has to lie on the surface [m].
        margin: the patch keeps this distance from the surface's edges [m].
        wide: (F, 2) the patch with its margin [m].
        body: (G, 2) nothing may stand over it, within the clearance [m].
        clearance: [m].
    """

    patch: np.ndarray
    margin: float
    wide: np.ndarray
    body: np.ndarray
    clearance: float


class FreeSpace(NamedTuple):
    """The contact points of a convex outline that are in none of B convex polygons.

    Attributes:
        outline: (m, 2) corners, counter-clockwise [m]; none where nothing is free.
        corner: (K, 2) corners of all polygons, counter-clockwise [m]; they reach beyond the outline.
        start: (B + 1,) polygon b has the corners start[b] to start[b + 1].
        complete: False where the surface was taken alone, because its floor has too many pieces: some of the space is missing.
    """

    outline: np.ndarray
    corner: np.ndarray
    start: np.ndarray
    complete: bool


@njit(cache=True)
def footprint_of(patch: PatchShape) -> Footprint:
    """The footprint of an end effector at one heading, in its contact frame."""
    margin = PATCH_MARGIN + ROUNDING
    long, wide = patch.half_length, patch.half_width
    return Footprint(
        _rectangle(long, long, wide),
        margin,
        _rectangle(long + margin, long + margin, wide + margin),
        _rectangle(long + patch.front + ROUNDING, long + patch.back + ROUNDING, wide + patch.side + ROUNDING),
        patch.clearance,
    )


def turned_footprint(patch: PatchShape, low: float, high: float, margin: float, gap: float) -> Footprint:
    """The footprint of an end effector that may turn about its contact normal.

    Args:
        patch: the room that it takes.
        low: least turn from the contact frame [rad].
        high: greatest turn [rad].
        margin: distance that the patch keeps from the surface's edges [m].
        gap: distance that the end effector keeps from what stands above the surface [m].
    """
    steps = int(np.ceil((high - low) / TURN_STEP - 1e-9))
    angle = np.linspace(low, high, steps + 1)
    # Between two samples a corner leaves their chord: as far out, the chord would touch the arc.
    outwards = 1.0 / np.cos(0.5 * (high - low) / steps) if steps else 1.0
    c, s = outwards * np.cos(angle), outwards * np.sin(angle)
    turns = np.stack([np.stack([c, -s], 1), np.stack([s, c], 1)], 1)

    def swept(front: float, back: float, side: float) -> np.ndarray:
        corners = np.einsum("aij,fj->afi", turns, _rectangle(front, back, side))
        return convex_hull(corners.reshape(-1, 2))

    long, wide = patch.half_length, patch.half_width
    return Footprint(
        swept(long, long, wide),
        margin,
        swept(long + margin, long + margin, wide + margin),
        swept(long + patch.front + gap, long + patch.back + gap, wide + patch.side + gap),
        patch.clearance,
    )


@njit(cache=True)
def _rectangle(front: float, back: float, side: float) -> np.ndarray:
    """(4, 2) corners of a rectangle about the origin, counter-clockwise."""
    return np.array([[-back, -side], [front, -side], [front, side], [-back, side]])


@njit(cache=True)
def free_space(
    packed: PackedTerrain, surface: int, R: np.ndarray, footprint: Footprint, sides: np.ndarray
) -> FreeSpace:
    """The contact points on a surface where a footprint fits.

    Where a floor has more pieces near the surface than there is room for, the surface is taken alone.

    Args:
        packed: the terrain.
        surface: number of the surface.
        R: (3, 3) contact frame in W.
        footprint: in that frame.
        sides: (L, 3) half planes that are asked for: rows (a, b, c) mean a u + b v <= c [m].
    """
    outline = _outline(packed, surface, R, footprint, packed.floor[surface] < 0, sides)
    corner, start, blockers, complete = np.empty((64, 2)), np.zeros(17, np.int64), 0, True
    if outline.shape[0] < 3:
        return FreeSpace(outline[:0], corner[:0], start[:1], complete)
    window = _bounds(outline, outline.shape[0])
    wide, body = _bounds(footprint.wide, len(footprint.wide)), _bounds(footprint.body, len(footprint.body))
    half_u = 0.5 * (window[2] - window[0]) + max(wide[2], -wide[0], body[2], -body[0])
    half_v = 0.5 * (window[3] - window[1]) + max(wide[3], -wide[1], body[3], -body[1])
    reach = np.sqrt(half_u * half_u + half_v * half_v + footprint.clearance * footprint.clearance)
    middle = np.empty(3)
    for a in range(3):
        middle[a] = R[a, 0] * 0.5 * (window[0] + window[2]) + R[a, 1] * 0.5 * (window[1] + window[3])
        middle[a] += R[a, 2] * packed.offset[surface]
    around = near(packed, middle[0] - reach, middle[1] - reach, middle[0] + reach, middle[1] + reach)
    if packed.floor[surface] >= 0:
        gaps, corners = np.empty((PARTS, CORNERS, 2)), np.empty(PARTS, np.int64)
        missing = _gaps(packed, surface, R, window, wide, middle, reach, around, gaps, corners)
        if missing < 0:
            complete = False
            outline = _outline(packed, surface, R, footprint, True, sides)
            if outline.shape[0] < 3:
                return FreeSpace(outline[:0], corner[:0], start[:1], complete)
        for g in range(missing):
            corner, start = _with_sum(gaps[g], corners[g], footprint.wide, corner, start, blockers)
            blockers += 1
    shadow, work = np.empty((packed.vertices.shape[1] + 8, 2)), np.empty((2, packed.vertices.shape[1] + 8, 3))
    for q in range(around.shape[0]):
        k = around[q]
        if k == surface or packed.low[k, 2] > middle[2] + reach or packed.high[k, 2] < middle[2] - reach:
            continue
        m = _shadow(packed.vertices[k], packed.count[k], R, packed.offset[surface], footprint.clearance, work, shadow)
        if m == 0 or _apart(_bounds(shadow, m), window, body):
            continue
        corner, start = _with_sum(shadow, m, footprint.body, corner, start, blockers)
        blockers += 1
    return FreeSpace(outline, corner[: start[blockers]], start[: blockers + 1], complete)


@njit(cache=True)
def half_planes(half_spaces: np.ndarray, R: np.ndarray, offset: float) -> np.ndarray:
    """(L, 3) half spaces of W as half planes of a surface's plane: rows (a, b, c) mean a u + b v <= c [m].

    Args:
        half_spaces: (L, 4) rows (n, b) mean n @ q <= b for a point q of W [m].
        R: (3, 3) contact frame in W.
        offset: of the surface's plane [m].
    """
    sides = np.zeros((half_spaces.shape[0], 3))
    for i in range(half_spaces.shape[0]):
        sides[i, 2] = half_spaces[i, 3]
        for a in range(3):
            sides[i, 0] += half_spaces[i, a] * R[a, 0]
            sides[i, 1] += half_spaces[i, a] * R[a, 1]
            sides[i, 2] -= half_spaces[i, a] * R[a, 2] * offset
    return sides


@njit(cache=True)
def box_sides(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(6, 4) half spaces of a box along the axes of W: rows (n, b) mean n @ q <= b [m].

    Args:
        low: (3,) lowest corner in W [m].
        high: (3,) greatest corner in W [m].
    """
    sides = np.zeros((6, 4))
    for a in range(3):
        sides[2 * a, a], sides[2 * a, 3] = 1.0, high[a]
        sides[2 * a + 1, a], sides[2 * a + 1, 3] = -1.0, -low[a]
    return sides


@njit(cache=True)
def _outline(
    packed: PackedTerrain, surface: int, R: np.ndarray, footprint: Footprint, alone: bool, sides: np.ndarray
) -> np.ndarray:
    """(m, 2) a surface within half planes, less the support function of the patch where it is alone; (0, 2) for nothing."""
    d, m = packed.offset[surface], packed.count[surface]
    room = 2 * packed.vertices.shape[1] + sides.shape[0] + 1
    out, spare = np.empty((room, 2)), np.empty((room, 2))
    for k in range(m):
        _flat(packed.vertices[surface, k], R, out[k])
    if alone:
        for k in range(packed.count[surface]):
            e = packed.edge_normal[surface, k]
            nu = e[0] * R[0, 0] + e[1] * R[1, 0] + e[2] * R[2, 0]
            nv = e[0] * R[0, 1] + e[1] * R[1, 1] + e[2] * R[2, 1]
            across = e[0] * R[0, 2] + e[1] * R[1, 2] + e[2] * R[2, 2]
            support = -np.inf
            for f in range(footprint.patch.shape[0]):
                support = max(support, footprint.patch[f, 0] * nu + footprint.patch[f, 1] * nv)
            inside = packed.edge_offset[surface, k] - d * across - (support + footprint.margin)
            m = below(out, m, nu, nv, inside, spare)
            out, spare = spare, out
    for k in range(sides.shape[0]):
        m = below(out, m, sides[k, 0], sides[k, 1], sides[k, 2], spare)
        out, spare = spare, out
    return out[:m] if m >= 3 and area(out, m) >= NOTHING else out[:0]


@njit(cache=True)
def _gaps(
    packed: PackedTerrain,
    surface: int,
    R: np.ndarray,
    window: tuple[float, float, float, float],
    wide: tuple[float, float, float, float],
    middle: np.ndarray,
    reach: float,
    around: np.ndarray,
    gaps: np.ndarray,
    corners: np.ndarray,
) -> int:
    """Writes what is off the surface's floor, as far as a patch in the window reaches; how many parts, -1: no room for them."""
    half_u = 0.5 * (window[2] - window[0]) + max(wide[2], -wide[0])
    half_v = 0.5 * (window[3] - window[1]) + max(wide[3], -wide[1])
    corners[0] = 4  # all around, before the floor is taken from it
    gaps[0, :4] = _rectangle(half_u, half_u, half_v)
    scratch = np.empty((4, packed.vertices.shape[1] + 4 + CORNERS, 3))
    missing = take_floor(packed, surface, middle, R, reach, around, gaps, corners, 1, scratch)
    for g in range(missing):
        for k in range(corners[g]):
            gaps[g, k, 0] += 0.5 * (window[0] + window[2])
            gaps[g, k, 1] += 0.5 * (window[1] + window[3])
    return missing


@njit(cache=True)
def _flat(point: np.ndarray, R: np.ndarray, out: np.ndarray) -> None:
    """Writes (u, v) of a point of W."""
    for a in range(2):
        out[a] = R[0, a] * point[0] + R[1, a] * point[1] + R[2, a] * point[2]


@njit(cache=True)
def _shadow(
    vertices: np.ndarray,
    count: int,
    R: np.ndarray,
    offset: float,
    clearance: float,
    work: np.ndarray,
    out: np.ndarray,
) -> int:
    """Writes (u, v) of the part of a polygon (K, 3) of W that stands above a plane, within the clearance; how many corners."""
    lowest, highest = np.inf, -np.inf
    for k in range(count):
        _flat(vertices[k], R, work[0, k])
        h = R[0, 2] * vertices[k, 0] + R[1, 2] * vertices[k, 1] + R[2, 2] * vertices[k, 2] - offset
        work[0, k, 2] = h
        lowest, highest = min(lowest, h), max(highest, h)
    if highest < COVER_GAP or lowest > clearance:
        return 0
    cur, m = clip_between(work, 0, count, 2, COVER_GAP, clearance)
    return copy_corners(work[cur], m, out)


@njit(cache=True)
def _bounds(corners: np.ndarray, count: int) -> tuple[float, float, float, float]:
    """Least u and v, greatest u and v of some points (K, 2)."""
    u0, v0, u1, v1 = np.inf, np.inf, -np.inf, -np.inf
    for k in range(count):
        u0, u1 = min(u0, corners[k, 0]), max(u1, corners[k, 0])
        v0, v1 = min(v0, corners[k, 1]), max(v1, corners[k, 1])
    return u0, v0, u1, v1


@njit(cache=True)
def _apart(
    shadow: tuple[float, float, float, float],
    window: tuple[float, float, float, float],
    body: tuple[float, float, float, float],
) -> bool:
    """Whether something is farther from a window along an axis than a body in it reaches."""
    beside = shadow[2] < window[0] + body[0] or shadow[0] > window[2] + body[2]
    return beside or shadow[3] < window[1] + body[1] or shadow[1] > window[3] + body[3]


@njit(cache=True)
def _with_sum(
    piece: np.ndarray, m: int, footprint: np.ndarray, corner: np.ndarray, start: np.ndarray, number: int
) -> tuple[np.ndarray, np.ndarray]:
    """Adds, as polygon `number`, the contact points whose footprint meets a convex piece: both arrays, longer if need be.

    The Minkowski sum of two convex polygons is the convex hull of all sums of their corners (Andrew's monotone chain).
    """
    size = footprint.shape[0]
    points, hull = np.empty((m * size, 2)), np.empty((m * size + 2, 2))
    for c in range(m):
        for f in range(size):
            points[size * c + f, 0] = piece[c, 0] - footprint[f, 0]
            points[size * c + f, 1] = piece[c, 1] - footprint[f, 1]
    for i in range(1, m * size):  # by u, then by v; insertion sort: there are few
        u, v = points[i, 0], points[i, 1]
        j = i - 1
        while j >= 0 and (points[j, 0] > u or (points[j, 0] == u and points[j, 1] > v)):
            points[j + 1, 0], points[j + 1, 1] = points[j, 0], points[j, 1]
            j -= 1
        points[j + 1, 0], points[j + 1, 1] = u, v
    n = 0
    for i in range(m * size):
        n = _chain(hull, n, 0, points[i])
    turn = n - 1
    for i in range(m * size - 2, -1, -1):
        n = _chain(hull, n, turn, points[i])
    n -= 1  # the last is the first again
    end = start[number] + n
    if end > corner.shape[0]:
        longer = np.empty((2 * end, 2))
        copy_corners(corner, start[number], longer)
        corner = longer
    if number + 2 > start.shape[0]:
        start = np.concatenate((start, np.zeros(start.shape[0], np.int64)))
    copy_corners(hull, n, corner[start[number] :])
    start[number + 1] = end
    return corner, start


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
