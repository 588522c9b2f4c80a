"""Balance polygons of sets of contacts: over which points the centre of mass can rest while they carry the robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optimization.balance.friction import DEFAULT_CONE, FrictionCone, cone_generators
from optimization.balance.reserve import ALL, Reserve
from optimization.balance.static_equilibrium import ContactArrays, com_polygon
from scenes.contact import Contact, support_corners
from scenes.effector import EFFECTORS
from scenes.robots.robot import Robot

ROOM = 256  # vertices that no polygon of four contacts exceeds
STRIP_CORNERS = 24  # of a strip's balance polygons; the others matter least
NARROW = 0.4  # share of the way from the nearest edge of a narrow polygon to its centroid that stands for the margin


def contact_arrays(
    contacts: Sequence[Contact], robot: Robot, cone: FrictionCone = DEFAULT_CONE, reserve: Reserve = ALL
) -> ContactArrays:
    """The arrays of some of a robot's contacts, with friction and supports from the contacts.

    Args:
        contacts: n of them.
        robot: gives patch sizes [m] and force limits [M g].
        cone: friction cone.
        reserve: what is left unused of friction and supports.

    Raises:
        InputError: no friction cone has this name.
    """
    index = [EFFECTORS.index(c.effector) for c in contacts]
    num_g, friction = len(cone_generators(cone, 0.0)), [reserve.friction * c.friction for c in contacts]
    return ContactArrays(
        p_WC=np.array([c.p_WC for c in contacts], float).reshape(-1, 3),
        R_WC=np.array([c.R_WC for c in contacts], float).reshape(-1, 3, 3),
        corners=reserve.supports(support_corners(contacts, np.array([e.half_extent for e in robot.effectors]))),
        generators=np.array([cone_generators(cone, mu) for mu in friction], float).reshape(-1, num_g, 3),
        force_limit=np.array([robot.force_limit[i] for i in index], float),
    )


def balance_polygon(arrays: ContactArrays, most: int = ROOM) -> np.ndarray:
    """(V, 2) all points over which the CoM can rest while exactly these contacts carry it, counter-clockwise, W [m].

    V = 0 nowhere (also without contacts), 1 a point, 2 a segment.

    Args:
        arrays: the contacts.
        most: greatest V; the vertices that matter least are left out.
    """
    if not len(arrays.p_WC):
        return np.zeros((0, 2))
    out = np.empty((most, 2))
    return out[: com_polygon(*arrays, out)].copy()


def balance_region(contacts: Sequence[Contact], robot: Robot, cone: FrictionCone = DEFAULT_CONE) -> np.ndarray:
    """All points over which the robot's centre of mass can rest while exactly these contacts carry it.

    Args:
        contacts: held at once, at most one per end effector.
        robot: gives patch sizes and force limits.
        cone: friction cone.

    Returns:
        (V, 2) vertices [m] in W, counter-clockwise; V = 0 nowhere, 1 a point, 2 a segment.

    Raises:
        InputError: no friction cone has this name.
    """
    return balance_polygon(contact_arrays(contacts, robot, cone))


class BalancePolygons:
    """Balance polygons of sets of some contacts whose poses change, each worked out once between two changes.

    Args:
        robot: gives patch sizes and force limits.
        contacts: C of them.
        cone: friction cone.
    """

    def __init__(self, robot: Robot, contacts: Sequence[Contact], cone: FrictionCone) -> None:
        self._arrays = contact_arrays(contacts, robot, cone)
        self._known: dict[tuple[int, ...], np.ndarray] = {}

    def move(self, X_WC: np.ndarray) -> None:
        """Puts the contacts at these poses (C, 4, 4)."""
        self._arrays = self._arrays._replace(p_WC=X_WC[:, :3, 3], R_WC=X_WC[:, :3, :3])
        self._known = {}

    def __call__(self, held: np.ndarray) -> np.ndarray:
        """(V, 2) polygon of the contacts that `held` names, -1 for none, counter-clockwise [m]; V = 0 where there is no
        contact or nothing balances.
        """
        key = tuple(int(c) for c in held if c >= 0)
        if key not in self._known:
            held_arrays = ContactArrays(*(np.ascontiguousarray(array[list(key)]) for array in self._arrays))
            self._known[key] = balance_polygon(held_arrays, STRIP_CORNERS)
        return self._known[key]


def edge_rows(polygon: np.ndarray, margin: float) -> tuple[np.ndarray, np.ndarray]:
    """Unit outward normals (V, 2) and bounds (V,) of a polygon (V, 2), CCW, drawn in by the margin or less [m].

    A polygon narrower than that keeps a share of the way from its nearest edge to its centroid. Fewer than three corners
    give no rows.

    Args:
        polygon: (V, 2) vertices [m] in W, counter-clockwise.
        margin: distance to keep from the edges [m].
    """
    if len(polygon) < 3:
        return np.zeros((0, 2)), np.zeros(0)
    edge = np.roll(polygon, -1, axis=0) - polygon
    normal = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.maximum(np.linalg.norm(edge, axis=1), 1e-12)[:, None]
    bound = (normal * polygon).sum(axis=1)
    inside = bound - normal @ polygon.mean(axis=0)
    return normal, bound - min(margin, NARROW * float(inside.min()))
