"""Where the CoM of a robot that stands still may be, and which point of that is nearest to where it would go."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.polygon import orient
from shapely.ops import nearest_points

from optimization.balance.balance_regions import balance_polygon, contact_arrays
from optimization.balance.friction import FrictionCone
from optimization.balance.reserve import ALL, Reserve
from scenes.contact import Contact
from scenes.robots.robot import Robot

MARGIN = 0.03  # [m] the CoM keeps from the edge of the balance polygon, less where the polygon is smaller
MAX_CORNERS = 48  # of a balance polygon


class BalanceRegions:
    """Balance polygons of sets of contacts, each computed once."""

    def __init__(self, robot: Robot, cone: FrictionCone, reserve: Reserve = ALL) -> None:
        """Prepares an empty cache.

        Args:
            robot: its force limits and contact patches.
            cone: friction cone of every contact.
            reserve: what is left unused.
        """
        self._robot, self._cone, self._reserve = robot, cone, reserve
        self._known: dict[tuple[Contact, ...], np.ndarray] = {}

    def __call__(self, contacts: tuple[Contact, ...]) -> np.ndarray:
        """(V, 2) corners, CCW [m]; V = 0 where the contacts balance nowhere."""
        if contacts not in self._known:
            arrays = contact_arrays(contacts, self._robot, self._cone, self._reserve)
            self._known[contacts] = balance_polygon(arrays, MAX_CORNERS)
        return self._known[contacts]


def inset(region: np.ndarray, margin: float) -> np.ndarray:
    """(V, 2) the region reduced by a margin along its edge, counter-clockwise [m]; V = 0 where nothing is left.

    Args:
        region: (V, 2) corners of a convex polygon in W's horizontal plane [m].
        margin: width to remove [m].
    """
    if margin <= 0.0:
        return region
    inner = shapely.Polygon(region).buffer(-margin, join_style="mitre")
    return np.zeros((0, 2)) if inner.is_empty else np.array(orient(inner).exterior.coords)[:-1]


def resting_point(region: np.ndarray, toward: np.ndarray, margin: float = MARGIN) -> np.ndarray:
    """(2,) the point of the region inside the margin that is nearest to a given point [m].

    Args:
        region: (V, 2) corners of a convex polygon in W's horizontal plane [m].
        toward: (2,) the given point [m].
        margin: distance to keep from the edge [m], less where the region is too narrow.
    """
    inner = inset(region, margin)
    while not len(inner) and margin > 1e-3:
        margin *= 0.7
        inner = inset(region, margin)
    if not len(inner):
        return np.asarray(region).mean(axis=0)
    polygon, point = shapely.Polygon(inner), shapely.Point(toward)
    if polygon.contains(point):
        return np.asarray(toward, dtype=float)
    return np.array(nearest_points(polygon, point)[0].coords[0])
