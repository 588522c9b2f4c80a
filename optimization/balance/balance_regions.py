"""Where the centre of mass of a strip may be: balance polygons of sets of contacts, and the rows that keep it there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optimization.balance.friction import FrictionCone, cone_generators
from optimization.balance.static_equilibrium import com_polygon
from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.robots.robot import Robot

MAX_CORNERS = 24  # of a balance polygon; the others matter least
NARROW = 0.4  # share of the way from the nearest edge of a narrow polygon to its centroid that stands for the margin


class BalancePolygons:
    """Balance polygons of sets of some contacts whose poses change, each worked out once between two changes."""

    def __init__(self, robot: Robot, contacts: Sequence[Contact], cone: FrictionCone) -> None:
        self._which = np.array([EFFECTORS.index(c.effector) for c in contacts], np.int64)
        self._generators = [cone_generators(cone, c.friction) for c in contacts]
        self._half, self._limit = robot.half_extents, robot.force_limit
        self._X_WC = np.array([c.X_WC for c in contacts]).reshape(-1, 4, 4)
        self._known: dict[tuple[int, ...], np.ndarray] = {}

    def move(self, X_WC: np.ndarray) -> None:
        """Puts the contacts at these poses (C, 4, 4)."""
        self._X_WC, self._known = X_WC, {}

    def __call__(self, held: np.ndarray) -> np.ndarray:
        """(V, 2) polygon of the contacts that `held` names, -1 for none, counter-clockwise [m]; V = 0 where there is no
        contact or nothing balances.
        """
        key = tuple(int(c) for c in held if c >= 0)
        if key not in self._known:
            index, corners = list(key), np.empty((MAX_CORNERS, 2))
            count = 0
            if index:
                count = com_polygon(
                    np.ascontiguousarray(self._X_WC[index, :3, 3]), np.ascontiguousarray(self._X_WC[index, :3, :3]),
                    self._half[self._which[index]], np.array([self._generators[c] for c in index]),
                    self._limit[self._which[index]], corners,
                )  # fmt: skip
            self._known[key] = corners[: max(count, 0)].copy()
        return self._known[key]


def edge_rows(polygon: np.ndarray, margin: float) -> tuple[np.ndarray, np.ndarray]:
    """Unit outward normals (V, 2) and bounds (V,) of a polygon (V, 2), CCW, drawn in by the margin or less [m].

    A polygon narrower than that keeps a share of the way from its nearest edge to its centroid. Fewer than three corners
    give no rows.
    """
    if len(polygon) < 3:
        return np.zeros((0, 2)), np.zeros(0)
    edge = np.roll(polygon, -1, axis=0) - polygon
    normal = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.maximum(np.linalg.norm(edge, axis=1), 1e-12)[:, None]
    bound = (normal * polygon).sum(axis=1)
    inside = bound - normal @ polygon.mean(axis=0)
    return normal, bound - min(margin, NARROW * float(inside.min()))
