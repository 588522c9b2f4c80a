"""Static equilibrium: over which points can the centre of mass rest while these contacts hold the robot?

A robot at rest needs contact wrenches that balance its weight. Each contact is a rectangular patch that transmits sums
of four corner forces inside its friction cone, and may press with a limited normal force; no contact pulls. Contacts
need not be coplanar, and the height of the centre of mass does not matter. The admissible points form a convex
polygon in the plane (Bretl & Lall 2008), which is computed exactly: with a feasible basis in hand, the direction
turns once around and every pivot walks along one edge (the shadow-vertex rule of Gass & Saaty 1955), so a polygon of
V vertices costs little more than V pivots. `static_equilibrium_program` states the same problem for Drake.

Bretl & Lall 2008: "Testing static equilibrium for legged robots", IEEE T-RO 24(4).
Caron et al. 2015: "Stability of surface contacts for humanoid robots", ICRA.
Lin 2020: "Learning for Humanoid Multi-Contact Navigation Planning", sec. 3.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from optimization.friction import DEFAULT_CONE, cone_generators
from optimization.patch_simplex import (
    ENTERS,
    MAX_PIVOTS,
    PIVOT,
    WRENCH,
    Basis,
    Patches,
    best_column,
    find_feasible,
    leaving_row,
    new_basis,
    next_column,
    num_generators,
    pivot,
    set_wrench,
    shift_right_hand_side,
    transform,
    transform_moving,
)
from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.stance import Stance, changed_effector

if TYPE_CHECKING:
    from scenes.robot import Robot

MAX_WALK = 2000  # pivots of one polygon; 4 contacts under the 16-gon take 100
DISTINCT = 1e-9  # [m] vertices that stand out less than this are left out
ROOM = 256  # vertices of a friendly polygon at most


class ContactArrays(NamedTuple):
    """Contacts as the compiled functions read them; the fields are their first arguments, in order.

    Attributes:
        p_WC: (n, 3) patch centres in W [m].
        R_WC: (n, 3, 3) contact frames.
        half: (n, 2) half extents of the patches [m].
        generators: (n, G, 3) friction cones in C, rays with fz = 1.
        force_limit: (n,) greatest normal force of each contact [M g].
    """

    p_WC: np.ndarray
    R_WC: np.ndarray
    half: np.ndarray
    generators: np.ndarray
    force_limit: np.ndarray


@njit(cache=True)
def _recentred(
    p_WC: np.ndarray, R_WC: np.ndarray, half: np.ndarray, generators: np.ndarray, force_limit: np.ndarray
) -> tuple[Patches, float, float, bool]:
    """(patches seen from the mean contact point, its x, its y, whether all numbers are finite and there are any)."""
    n = p_WC.shape[0]
    p = np.empty((n, 3))
    x, y, z, finite = 0.0, 0.0, 0.0, 0.0
    for c in range(n):
        x += p_WC[c, 0]
        y += p_WC[c, 1]
        z += p_WC[c, 2]
    for c in range(n):
        p[c, 0], p[c, 1], p[c, 2] = p_WC[c, 0] - x / n, p_WC[c, 1] - y / n, p_WC[c, 2] - z / n
        finite += 0.0 * (p[c, 0] + p[c, 1] + p[c, 2] + half[c, 0] + half[c, 1] + force_limit[c])
        for k in range(3):
            finite += 0.0 * (R_WC[c, k, 0] + R_WC[c, k, 1] + R_WC[c, k, 2])
    return Patches(p, R_WC, half, generators, force_limit), x / max(n, 1), y / max(n, 1), n > 0 and finite == 0.0


@njit(cache=True)
def is_balanced(
    p_WC: np.ndarray, R_WC: np.ndarray, half: np.ndarray, generators: np.ndarray, force_limit: np.ndarray,
    com_xy: np.ndarray,
) -> bool:  # fmt: skip
    """Whether a robot at rest with its centre of mass over `com_xy` can be held by these contacts.

        exists  w >= 0:   sum_j w_j (f_j, p_j x f_j) = (e_z, com x e_z),    sum_{j in contact c} w_j <= limit_c

    Args:
        p_WC, R_WC, half, generators, force_limit: as in `ContactArrays`; n contacts, any number, C-ordered.
        com_xy: (2,) [m] in W.

    Returns:
        False also when there is no contact or any number is not finite.
    """
    patches, x, y, usable = _recentred(p_WC, R_WC, half, generators, force_limit)
    if not usable or not np.isfinite(com_xy[0] + com_xy[1]):
        return False
    return find_feasible(patches, new_basis(WRENCH, p_WC.shape[0]), WRENCH, com_xy[0] - x, com_xy[1] - y)


@njit(cache=True)
def com_polygon(
    p_WC: np.ndarray, R_WC: np.ndarray, half: np.ndarray, generators: np.ndarray, force_limit: np.ndarray,
    out: np.ndarray,
) -> int:  # fmt: skip
    """All points over which the centre of mass can rest, as a convex polygon.

    Args:
        p_WC, R_WC, half, generators, force_limit: as in `ContactArrays`; n contacts, any number, C-ordered.
        out: (V, 2) receives the vertices [m] in W, counter-clockwise. Where the polygon has more than V vertices those
            that matter least are left out, so it comes out smaller, never larger.

    Returns:
        Number of vertices: 0 nowhere (also without contacts or where a number is not finite), 1 a point, 2 a segment.
    """
    patches, x, y, usable = _recentred(p_WC, R_WC, half, generators, force_limit)
    if not usable or out.shape[0] == 0:
        return 0
    basis = new_basis(4, p_WC.shape[0])
    if not find_feasible(patches, basis, 4, 0.0, 0.0):
        return 0
    _drop_artificial(patches, basis)
    _set_objectives(patches, basis)
    path = np.empty((MAX_WALK, 2))
    count = _walk_around(patches, basis, path)
    count = _thin(path, count, out)
    for i in range(count):
        out[i, 0] += x
        out[i, 1] += y
    return count


@njit(cache=True)
def _drop_artificial(patches: Patches, basis: Basis) -> None:
    """Exchanges artificial columns at zero for real ones; a row that has none is redundant and stays as it is."""
    T, m, n = basis.T, basis.column.shape[0], patches.limit.shape[0]
    y = np.zeros(WRENCH + n)
    T[m:] = 0.0
    for i in range(m):
        if basis.column[i] < num_generators(patches) + n:
            continue
        chosen, size = -1, PIVOT
        for sign in (1.0, -1.0):
            y[:4] = sign * T[i, :4]
            y[WRENCH:] = sign * T[i, 4:m]
            j = best_column(patches, y)
            if j >= 0:
                transform(patches, basis, 4, j)
                if abs(basis.entering[i]) > size:
                    chosen, size = j, abs(basis.entering[i])
        if chosen >= 0:
            transform(patches, basis, 4, chosen)
            pivot(basis, i, chosen)
    shift_right_hand_side(basis)


@njit(cache=True)
def _set_objectives(patches: Patches, basis: Basis) -> None:
    """Fills the objective rows with minus the multipliers of the CoM's x and y; their right-hand sides are -x and -y."""
    T, m, a = basis.T, basis.column.shape[0], basis.wrench
    T[m:] = 0.0
    for i in range(m):
        if basis.column[i] < num_generators(patches):
            set_wrench(patches, basis.column[i], a)
            T[m] -= a[4] * T[i]
            T[m + 1] -= a[5] * T[i]


@njit(cache=True)
def _point_multipliers(basis: Basis, ux: float, uy: float, y: np.ndarray) -> None:
    """Multipliers of the objective ux x + uy y over the six rows and the limits."""
    T, m = basis.T, basis.column.shape[0]
    for k in range(4):
        y[k] = ux * T[m, k] + uy * T[m + 1, k]
    y[4], y[5] = ux, uy
    for k in range(4, m):
        y[WRENCH + k - 4] = ux * T[m, k] + uy * T[m + 1, k]


@njit(cache=True)
def _walk_around(patches: Patches, basis: Basis, path: np.ndarray) -> int:
    """Writes the vertices met while the direction u turns once to the left; 0 if the walk fails to close.

    u starts at an optimum. The column of the next edge enters; its reduced costs (rx, ry) are that edge's direction, so
    u becomes (ry, -rx), the edge's outward normal.
    """
    T, m, w = basis.T, basis.column.shape[0], basis.entering
    y, z = np.empty(WRENCH + m - 4), np.empty(WRENCH + m - 4)
    ux, uy = 0.8, 0.6
    for _ in range(MAX_PIVOTS):
        _point_multipliers(basis, ux, uy, y)
        j = best_column(patches, y)
        if j < 0:
            break
        transform_moving(patches, basis, j)
        row = leaving_row(basis)
        if row < 0:
            return 0
        pivot(basis, row, j)
    path[0, 0], path[0, 1] = -T[m, m], -T[m + 1, m]
    count, turned = 1, 0.0
    while count < path.shape[0]:
        _point_multipliers(basis, ux, uy, y)
        _point_multipliers(basis, -uy, ux, z)
        j = next_column(patches, y, z)
        vx, vy = -uy, ux
        if j >= 0:
            transform_moving(patches, basis, j)
            length = np.sqrt(w[m] * w[m] + w[m + 1] * w[m + 1])
            vx, vy = w[m + 1] / length, -w[m] / length
        turned += max(np.arctan2(ux * vy - uy * vx, ux * vx + uy * vy), 0.0)
        if turned > 2 * np.pi - ENTERS:
            return count
        ux, uy = vx, vy
        if j >= 0:
            row = leaving_row(basis)
            if row < 0:
                return 0
            pivot(basis, row, j)
            path[count, 0], path[count, 1] = -T[m, m], -T[m + 1, m]
            count += 1
    return 0


@njit(cache=True)
def _thin(path: np.ndarray, count: int, out: np.ndarray) -> int:
    """Copies a convex path into `out` without repetitions and points on edges, coarser until it fits."""
    slack, kept = DISTINCT, 0
    while count > 0:
        kept, last = 1, 0
        out[0] = path[0]
        fits = True
        for i in range(1, count):
            after = path[(i + 1) % count]
            if not _stands_out(path, last + 1, i, out[kept - 1], after, slack):
                continue
            if kept == out.shape[0]:
                fits = False
                break
            out[kept] = path[i]
            kept, last = kept + 1, i
        if fits:
            break
        slack = max(4.0 * slack, 1e-5)
    if kept > 2 and _distance(out[0], out[kept - 1], out[1]) <= DISTINCT:
        out[: kept - 1] = out[1:kept].copy()
        kept -= 1
    return kept


@njit(cache=True)
def _stands_out(path: np.ndarray, first: int, last: int, a: np.ndarray, b: np.ndarray, slack: float) -> bool:
    """Whether leaving out path[first] to path[last] for the segment a b would cost more than `slack`."""
    for i in range(first, last + 1):
        if _distance(path[i], a, b) > slack:
            return True
    return False


@njit(cache=True)
def _distance(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Distance of a point from a segment in the plane [m]."""
    ex, ey, px, py = b[0] - a[0], b[1] - a[1], p[0] - a[0], p[1] - a[1]
    length2 = ex * ex + ey * ey
    t = min(max((px * ex + py * ey) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
    return np.hypot(px - t * ex, py - t * ey)


@njit(cache=True)
def polygon_margin(polygon: np.ndarray, count: int, x: float, y: float) -> float:
    """Signed distance of a point from a convex polygon's boundary [m]: positive inside, not positive outside.

    Args:
        polygon: (V, 2) counter-clockwise vertices; the first `count` are real. A point (1) or a segment (2) has no
            inside; no polygon at all (0) is infinitely far.
    """
    p = np.array((x, y))
    nearest, inside = np.inf, count > 2
    for i in range(count):
        a, b = polygon[i], polygon[(i + 1) % count]
        nearest = min(nearest, _distance(p, a, b))
        if (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) < 0.0:
            inside = False
    return nearest if inside else -nearest


def contact_arrays(contacts: Sequence[Contact], robot: Robot, cone: str = DEFAULT_CONE) -> ContactArrays:
    """The arrays of some of a robot's contacts: patches and force limits from the robot, friction from the contacts.

    Raises:
        InputError: no friction cone has this name.
    """
    index = [EFFECTORS.index(c.effector) for c in contacts]
    num_g = len(cone_generators(cone, 0.0))
    return ContactArrays(
        p_WC=np.array([c.p_WC for c in contacts], float).reshape(-1, 3),
        R_WC=np.array([c.R_WC for c in contacts], float).reshape(-1, 3, 3),
        half=np.array([robot.effectors[i].half_extent for i in index], float).reshape(-1, 2),
        generators=np.array([cone_generators(cone, c.friction) for c in contacts], float).reshape(-1, num_g, 3),
        force_limit=np.array([robot.force_limit[i] for i in index], float),
    )


def balance_region(contacts: Sequence[Contact], robot: Robot, cone: str = DEFAULT_CONE) -> np.ndarray:
    """All points over which the robot's centre of mass can rest while exactly these contacts carry it.

    Args:
        contacts: held at once, at most one per end effector.
        robot: gives patch sizes and force limits.
        cone: one of `optimization.friction.CONES`.

    Returns:
        (V, 2) vertices [m] in W, counter-clockwise; V = 0 nowhere, 1 a point, 2 a segment.

    Raises:
        InputError: no friction cone has this name.
    """
    out = np.empty((ROOM, 2))
    return out[: com_polygon(*contact_arrays(contacts, robot, cone), out)].copy()


@dataclass(frozen=True, eq=False)
class CriticalConfiguration:
    """A moment of a transition at which balance is hardest: the moving end effector touches and carries nothing.

    Attributes:
        support: the contacts that carry the robot.
        touching: where the moving end effector is, None where it is free.
        region: (V, 2) where the centre of mass may be [m] in W, counter-clockwise; V = 0 when the support cannot hold.
    """

    support: tuple[Contact, ...]
    touching: Contact | None
    region: np.ndarray


def transition_regions(
    before: Stance, after: Stance, robot: Robot, cone: str = DEFAULT_CONE
) -> tuple[CriticalConfiguration, CriticalConfiguration]:
    """The two critical configurations of a transition (Lin 2020, sec. 3.3).

    In the first the moving end effector has just broken contact, in the second it is about to make contact. The
    contacts that both stances share carry both, so the regions are equal; what differs is where the moving end effector
    must be, and so where the rest of the robot can be.

    Raises:
        ValueError: the stances do not differ in exactly one end effector.
        InputError: no friction cone has this name.
    """
    moving = changed_effector(before, after)
    support = before.replace(moving, None).held
    region = balance_region(support, robot, cone)
    region.setflags(write=False)
    first = CriticalConfiguration(support, before.contacts[moving], region)
    return first, CriticalConfiguration(support, after.contacts[moving], region)
