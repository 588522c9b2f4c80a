"""The contact point nearest to a given one where a patch fits, on one surface and at one heading of a `FootholdTable`."""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.footholds.convex_parts import NOTHING, area, below, copy_corners
from scenes.footholds.foothold_table import TURN, FootholdTable
from scenes.footholds.projection import contact_axes


class Plane(NamedTuple):
    """What of a surface the search for its footholds needs: handing a whole terrain over costs more than a look-up.

    Attributes:
        surface: number of the surface.
        normal: (3,) outward unit normal in W; points p of the plane have normal @ p = offset.
        offset: [m].
        low: (3,) least coordinates of the surface in W [m].
    """

    surface: int
    normal: np.ndarray
    offset: float
    low: np.ndarray


@njit(cache=True)
def nearest_on_surface(
    table: FootholdTable,
    plane: Plane,
    turn: int,
    palm: bool,
    radius: float,
    margin: float,
    p: np.ndarray,
    within: float,
    limits: np.ndarray,
    work: np.ndarray,
    q: np.ndarray,
) -> tuple[int, float, float]:
    """The foothold of a surface at a heading that is nearest to the point p of its plane.

    Args:
        table: of this kind of patch.
        plane: of the surface.
        turn: number of the heading, 0 to TURNS - 1.
        palm: whether a palm touches, not a foot.
        radius: footholds farther from p than this are not looked for [m].
        margin: the foothold is moved off the edge of where the patch fits by this, as far as there is room [m].
        p: (3,) in the plane of the surface, in W [m].
        within: the same as radius, but it may change from call to call [m].
        limits: (L, 4) half spaces of W in which the contact point has to be: rows (a, b) mean a @ q <= b [m].
        work: (2, C + L, 2) scratch, C as in `most_corners`.
        q: (3,) the contact point in W [m] is written here.

    Returns:
        A tile whose region has to be found first, -1 where all are known; the distance before the margin was added [m]; and
        how far the contact point is from the edge [m], -1 where there is none.
    """
    best, best_room = min(within, radius), -1.0
    R = np.empty((3, 3))
    known = False
    u, v, d = 0.0, 0.0, plane.offset
    count = table.tiles[plane.surface]
    i0, i1 = _tile_range(plane.low[0], count[0], table.edge[0], p[0], radius)
    j0, j1 = _tile_range(plane.low[1], count[1], table.edge[0], p[1], radius)
    k0, k1 = _tile_range(plane.low[2], count[2], table.edge[0], p[2], radius)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            for k in range(k0, k1 + 1):
                tile = table.tile_start[plane.surface] + i + count[0] * (j + count[1] * k)
                row = table.row[tile]
                if row < 0 or table.region[row, turn] < 0:
                    return tile, 0.0, -1.0
                number = table.region[row, turn]
                if not _is_near(table.bounds[number], p, best):
                    continue
                if not known:
                    contact_axes(plane.normal, table.heading[0] + turn * TURN, palm, R)
                    u = R[0, 0] * p[0] + R[1, 0] * p[1] + R[2, 0] * p[2]
                    v = R[0, 1] * p[0] + R[1, 1] * p[1] + R[2, 1] * p[2]
                    known = True
                best, best_room = _nearest_in_region(
                    table, number, R, d, u, v, margin, limits, best, best_room, work, q
                )
    return -1, best, best_room


@njit(cache=True)
def _nearest_in_region(
    table: FootholdTable,
    number: int,
    R: np.ndarray,
    d: float,
    u: float,
    v: float,
    margin: float,
    limits: np.ndarray,
    best: float,
    best_room: float,
    work: np.ndarray,
    q: np.ndarray,
) -> tuple[float, float]:
    """Distance and room of the nearest contact point so far and in one region more; `q` gets it where it is in the region."""
    for part in range(table.part_start[number], table.part_start[number + 1]):
        corner = table.corner[table.corner_start[part] : table.corner_start[part + 1]]
        a, b, away = _nearest_in(corner, u, v)
        if away > best or (away == best and best_room >= 0.0):
            continue
        keeps = _keeps(limits, R, d, a, b)
        a, b, room = _moved_in(corner, a, b, margin)
        if not keeps or not _keeps(limits, R, d, a, b):
            m = _limited(corner, limits, R, d, work[0], work[1])
            if m < 3 or area(work[0], m) < NOTHING:
                continue
            a, b, away = _nearest_in(work[0, :m], u, v)
            if away > best or (away == best and best_room >= 0.0):
                continue
            a, b, room = _moved_in(work[0, :m], a, b, margin)
        best, best_room = away, room
        for w in range(3):
            q[w] = R[w, 0] * a + R[w, 1] * b + R[w, 2] * d
    return best, best_room


@njit(cache=True)
def _is_near(bounds: np.ndarray, p: np.ndarray, radius: float) -> bool:
    """Whether a point is within a radius of a box along each axis; never near the bounds of nothing."""
    near = True
    for a in range(3):
        near = near and bounds[a] - radius <= p[a] <= bounds[3 + a] + radius
    return near


@njit(cache=True)
def _tile_range(low: float, count: int, edge: float, at: float, radius: float) -> tuple[int, int]:
    """First and last of the tiles from `low` on that are within a radius of a coordinate."""
    if count == 1:
        return 0, 0
    along = at - low
    return max(int(np.floor((along - radius) / edge)), 0), min(int(np.floor((along + radius) / edge)), count - 1)


@njit(cache=True)
def _keeps(limits: np.ndarray, R: np.ndarray, d: float, u: float, v: float) -> bool:
    """Whether the point (u, v) of a plane is in all half spaces."""
    for i in range(limits.shape[0]):
        reached = 0.0
        for w in range(3):
            reached += limits[i, w] * (R[w, 0] * u + R[w, 1] * v + R[w, 2] * d)
        if reached > limits[i, 3]:
            return False
    return True


@njit(cache=True)
def _limited(
    corner: np.ndarray, limits: np.ndarray, R: np.ndarray, d: float, out: np.ndarray, spare: np.ndarray
) -> int:
    """Writes the part of a convex polygon that is in all half spaces; how many corners it has."""
    m = copy_corners(corner, corner.shape[0], out)
    for i in range(limits.shape[0]):
        nu, nv, bound = 0.0, 0.0, limits[i, 3]
        for w in range(3):
            nu += limits[i, w] * R[w, 0]
            nv += limits[i, w] * R[w, 1]
            bound -= limits[i, w] * R[w, 2] * d
        m = below(out, m, nu, nv, bound, spare)
        copy_corners(spare, m, out)
    return m


@njit(cache=True)
def _nearest_in(corner: np.ndarray, u: float, v: float) -> tuple[float, float, float]:
    """The point of a convex polygon, counter-clockwise, that is nearest to (u, v), and its distance."""
    inside, least = True, np.inf
    a, b = u, v
    n = corner.shape[0]
    for k in range(n):
        j = k + 1 if k + 1 < n else 0
        eu, ev = corner[j, 0] - corner[k, 0], corner[j, 1] - corner[k, 1]
        du, dv = u - corner[k, 0], v - corner[k, 1]
        if eu * dv - ev * du >= 0.0:
            continue
        inside = False
        long = eu * eu + ev * ev
        share = min(max((eu * du + ev * dv) / long, 0.0), 1.0) if long > 0.0 else 0.0
        away = (du - share * eu) ** 2 + (dv - share * ev) ** 2
        if away < least:
            least, a, b = away, corner[k, 0] + share * eu, corner[k, 1] + share * ev
    return (u, v, 0.0) if inside else (a, b, np.sqrt(least))


@njit(cache=True)
def _moved_in(corner: np.ndarray, u: float, v: float, margin: float) -> tuple[float, float, float]:
    """A point of a convex polygon moved towards its middle, by the margin at most, and its distance from the nearest edge."""
    n = corner.shape[0]
    mu, mv = 0.0, 0.0
    for k in range(n):
        mu += corner[k, 0] / n
        mv += corner[k, 1] / n
    long = np.sqrt((mu - u) ** 2 + (mv - v) ** 2)
    share = min(margin / long, 1.0) if long > 0.0 else 0.0
    u, v = u + share * (mu - u), v + share * (mv - v)
    room = np.inf
    for k in range(n):
        j = k + 1 if k + 1 < n else 0
        eu, ev = corner[j, 0] - corner[k, 0], corner[j, 1] - corner[k, 1]
        long = np.sqrt(eu * eu + ev * ev)
        if long > 1e-9:
            room = min(room, (eu * (v - corner[k, 1]) - ev * (u - corner[k, 0])) / long)
    return u, v, max(room, 0.0)
