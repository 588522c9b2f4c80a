"""Static equilibrium: over which points can the centre of mass rest while these contacts hold the robot?

A robot at rest needs contact wrenches that balance its weight. Each contact transmits sums of forces at the corners of its
support (a rectangular patch, or the part of it that rests on something) inside its friction cone, and may press with a
limited normal force; no contact pulls. Contacts need not be coplanar, and the height of the centre of mass does not
matter. The admissible points form a convex polygon in the plane (Bretl & Lall 2008), which is computed exactly: with a
feasible basis in hand, the direction turns once around and every pivot walks along one edge (the shadow-vertex rule of
Gass & Saaty 1955), so a polygon of V vertices costs little more than V pivots. `reference_program` states the same problem for Drake.

Bretl & Lall 2008: "Testing static equilibrium for legged robots", IEEE T-RO 24(4).
Caron et al. 2015: "Stability of surface contacts for humanoid robots", ICRA.
Lin 2020: "Learning for Humanoid Multi-Contact Navigation Planning", sec. 3.3.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.balance.patch_simplex import (
    ENTERS,
    MAX_PIVOTS,
    PIVOT,
    WRENCH,
    best_column,
    find_feasible,
    leaving_row,
    multipliers,
    next_column,
    num_generators,
    pack,
    pivot,
    set_objectives,
    shift,
    transform,
    transform_moving,
)
from optimization.balance.proved_polygon import complete, right_hand_side

MAX_WALK = 2000  # pivots of one polygon; 4 contacts under the 16-gon take 100
SMALL = 1e-4  # pivots below this or above its inverse lose digits
SHORT = 1e-6  # [m] per unit of weight: an edge that moves the centre of mass less has no sure direction
BACK = 1e-9  # [rad] that rounding may turn the direction back
DISTINCT = 1e-9  # [m] vertices that stand out less than this are left out
COARSER = 1e-5  # [m] where thinning starts once there are too many


class ContactArrays(NamedTuple):
    """Contacts as the compiled functions read them; the fields are their first arguments, in order.

    Attributes:
        p_WC: (n, 3) patch centres in W [m].
        R_WC: (n, 3, 3) contact frames.
        corners: (n, V, 2) corners of the supports in C [m]; one of fewer corners repeats its last.
        generators: (n, G, 3) friction cones in C, rays with fz = 1.
        force_limit: (n,) greatest normal force of each contact [M g].
    """

    p_WC: np.ndarray
    R_WC: np.ndarray
    corners: np.ndarray
    generators: np.ndarray
    force_limit: np.ndarray


@njit(cache=True)
def is_balanced(
    p_WC: np.ndarray,
    R_WC: np.ndarray,
    corners: np.ndarray,
    generators: np.ndarray,
    force_limit: np.ndarray,
    com_xy: np.ndarray,
) -> bool:
    """Whether a robot at rest with its centre of mass over `com_xy` can be held by these contacts.

        exists  w >= 0:   sum_j w_j (f_j, p_j x f_j) = (e_z, com x e_z),    sum_{j in contact c} w_j <= limit_c

    Args:
        p_WC, R_WC, corners, generators, force_limit: as in `ContactArrays`; n contacts, any number, C-ordered.
        com_xy: (2,) [m] in W.

    Returns:
        False also when there is no contact or any number is not finite.
    """
    contacts, x, y, usable = pack(p_WC, R_WC, corners, generators, force_limit)
    if not usable or not np.isfinite(com_xy[0] + com_xy[1]):
        return False
    T, basic, w = _new_basis(WRENCH + contacts.shape[0])
    return find_feasible(contacts, generators, force_limit, com_xy[0] - x, com_xy[1] - y, T, basic, w)


@njit(cache=True)
def _new_basis(m: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.zeros((m + 2, m + 1)), np.empty(m, np.int64), np.empty(m + 2)


@njit(cache=True)
def com_polygon(
    p_WC: np.ndarray,
    R_WC: np.ndarray,
    corners: np.ndarray,
    generators: np.ndarray,
    force_limit: np.ndarray,
    out: np.ndarray,
) -> int:
    """All points over which the centre of mass can rest, as a convex polygon.

    Args:
        p_WC, R_WC, corners, generators, force_limit: as in `ContactArrays`; n contacts, any number, C-ordered.
        out: (V, 2) receives the vertices [m] in W, counter-clockwise. Where the polygon has more than V vertices those
            that matter least are left out, so it comes out smaller, never larger.

    Returns:
        Number of vertices: 0 nowhere (also without contacts or where a number is not finite), 1 a point, 2 a segment.
    """
    contacts, x, y, usable = pack(p_WC, R_WC, corners, generators, force_limit)
    if not usable or out.shape[0] == 0:
        return 0
    T, basic, w = _new_basis(4 + contacts.shape[0])
    if not find_feasible(contacts, generators, force_limit, 0.0, 0.0, T, basic, w):
        return 0
    _drop_artificial(contacts, generators, T, basic, w)
    set_objectives(contacts, generators, T, basic)
    path = np.empty((MAX_WALK, 2))
    first = basic.copy()
    b = right_hand_side(contacts, generators, T, basic)
    count, proved = _walk_around(contacts, generators, T, basic, w, path)
    vertices = _thin(path, count, out) if proved else 0
    if not proved or not _is_convex(out, vertices):
        count = complete(contacts, generators, b, basic, first, path, count)
        vertices = _thin(path, count, out)
    for i in range(vertices):
        out[i, 0] += x
        out[i, 1] += y
    return vertices


@njit(cache=True)
def _drop_artificial(
    contacts: np.ndarray, generators: np.ndarray, T: np.ndarray, basic: np.ndarray, w: np.ndarray
) -> None:
    """Exchanges artificial columns for real ones; a row that has none is redundant and stays as it is.

    What an artificial column still weighs is at most what may be left unbalanced: it is struck off the right-hand side.
    """
    n = contacts.shape[0]
    m = 4 + n
    y = np.zeros(WRENCH + n)
    for i in range(m):
        if basic[i] < num_generators(contacts, generators) + n:
            continue
        chosen, size = basic[i], PIVOT
        for sign in (1.0, -1.0):
            for k in range(4):
                y[k] = sign * T[i, k]
            for k in range(n):
                y[WRENCH + k] = sign * T[i, 4 + k]
            j = best_column(contacts, generators, y, ENTERS)
            if j >= 0:
                transform(contacts, generators, T, w, j)
                if abs(w[i]) > size:
                    chosen, size = j, abs(w[i])
        if chosen != basic[i]:
            transform(contacts, generators, T, w, chosen)
            T[i, m] = 0.0
            pivot(T, basic, w, i, chosen)
            T[i, m] = shift(i)


@njit(cache=True)
def _walk_around(
    contacts: np.ndarray, generators: np.ndarray, T: np.ndarray, basic: np.ndarray, w: np.ndarray, path: np.ndarray
) -> tuple[int, bool]:
    """Writes the vertices met while the direction u turns once to the left; (how many, whether these are all).

    u starts at an optimum. The column of the next edge enters; its reduced costs (rx, ry) are that edge's direction, so
    u becomes (ry, -rx), the edge's outward normal. No column is ever free to grow without end, because normal forces
    are limited.

    Rounding spoils the walk where an edge is so short that its direction is lost, or a pivot so small or so great that
    the basis is nearly singular. Contacts that are tilted by 1e-10 to 1e-5 rad have both. The walk then says that
    vertices may be missing, and stops before a vertex can be wrong.
    """
    m = basic.shape[0]
    y, z = np.empty(WRENCH + m - 4), np.empty(WRENCH + m - 4)
    ux, uy = 0.8, 0.6
    for turn in range(MAX_PIVOTS):
        multipliers(T, ux, uy, y)
        j = best_column(contacts, generators, y, ENTERS)
        if j < 0:
            break
        transform_moving(contacts, generators, T, w, j)
        row = leaving_row(T, w)
        if row < 0 or turn == MAX_PIVOTS - 1 or not SMALL < w[row] < 1.0 / SMALL:
            return 0, False
        pivot(T, basic, w, row, j)
    path[0, 0], path[0, 1] = -T[m, m], -T[m + 1, m]
    count, turned, sharp = 1, 0.0, True
    while count < path.shape[0]:
        multipliers(T, ux, uy, y)
        multipliers(T, -uy, ux, z)
        j = next_column(contacts, generators, y, z)
        vx, vy = -uy, ux
        if j >= 0:
            transform_moving(contacts, generators, T, w, j)
            length = np.sqrt(w[m] * w[m] + w[m + 1] * w[m + 1])
            vx, vy = w[m + 1] / length, -w[m] / length
            sharp = sharp and length > SHORT
        turn = np.arctan2(ux * vy - uy * vx, ux * vx + uy * vy)
        sharp = sharp and turn > -BACK
        turned += max(turn, 0.0)
        if turned > 2 * np.pi - ENTERS:
            return count, sharp  # pyright: ignore[reportReturnType]
        ux, uy = vx, vy
        if j >= 0:
            row = leaving_row(T, w)
            if row < 0 or not SMALL < w[row] < 1.0 / SMALL:
                return count, False
            pivot(T, basic, w, row, j)
            path[count, 0], path[count, 1] = -T[m, m], -T[m + 1, m]
            count += 1
    return count, False


@njit(cache=True)
def _thin(path: np.ndarray, count: int, out: np.ndarray) -> int:
    """Copies a convex path into `out` without repetitions and points on edges, coarser until it fits."""
    slack, kept = DISTINCT, 0
    while count > 0:
        kept, last, fits = 1, 0, True
        out[0, 0], out[0, 1] = path[0, 0], path[0, 1]
        for i in range(1, count):
            after = i + 1 if i + 1 < count else 0
            if not _stands_out(path, last + 1, i, last, after, slack):
                continue
            if kept == out.shape[0]:
                fits = False
                break
            out[kept, 0], out[kept, 1] = path[i, 0], path[i, 1]
            kept, last = kept + 1, i
        if fits:
            break
        slack = max(1.5 * slack, COARSER)
    if kept > 2 and _distance(out[0, 0], out[0, 1], out, kept - 1, 1) <= DISTINCT:
        kept -= 1
        for i in range(kept):
            out[i, 0], out[i, 1] = out[i + 1, 0], out[i + 1, 1]
    return kept


@njit(cache=True)
def _stands_out(path: np.ndarray, first: int, last: int, a: int, b: int, slack: float) -> bool:
    """Whether replacing path[first] to path[last] by the segment path[a] path[b] would cost more than `slack`."""
    for i in range(first, last + 1):  # noqa: SIM110 (compiled: no generators)
        if _distance(path[i, 0], path[i, 1], path, a, b) > slack:
            return True
    return False


@njit(cache=True)
def _is_convex(out: np.ndarray, count: int) -> bool:
    """Whether a closed path turns left at every vertex."""
    for i in range(count if count > 2 else 0):
        a, b, c = out[i - 1 if i > 0 else count - 1], out[i], out[i + 1 if i + 1 < count else 0]
        if (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]) <= 0.0:
            return False
    return True


@njit(cache=True)
def _distance(x: float, y: float, points: np.ndarray, a: int, b: int) -> float:
    """Distance of (x, y) from the segment points[a] points[b] in the plane [m]."""
    ex, ey = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    px, py = x - points[a, 0], y - points[a, 1]
    length2 = ex * ex + ey * ey
    t = min(max((px * ex + py * ey) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
    return np.sqrt((px - t * ex) ** 2 + (py - t * ey) ** 2)


@njit(cache=True)
def polygon_margin(polygon: np.ndarray, count: int, x: float, y: float) -> float:
    """Signed distance of a point from a convex polygon's boundary [m]: positive inside, not positive outside.

    Args:
        polygon: (V, 2) counter-clockwise vertices [m].
        count: how many of them are real. A point (1) or a segment (2) has no inside; no polygon at all (0) is
            infinitely far.
        x, y: the point, in the frame of the polygon [m].
    """
    nearest, inside = np.inf, count > 2
    for a in range(count):
        b = a + 1 if a + 1 < count else 0
        nearest = min(nearest, _distance(x, y, polygon, a, b))
        ex, ey = polygon[b, 0] - polygon[a, 0], polygon[b, 1] - polygon[a, 1]
        inside = inside and ex * (y - polygon[a, 1]) - ey * (x - polygon[a, 0]) >= 0.0
    return nearest if inside else -nearest
