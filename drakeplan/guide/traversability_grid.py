"""Distance to the goal that counts how hard the ground is: the heuristic "traversability" of the search.

    g_combined = sum over the torso's steps of  w_l l + w_s + w_tr Delta g_tr        Lin & Berenson 2017 eq. 7, 11

in metres of level ground: divided by what a metre of feet costs the search, so that it stands in for `TorsoGrid.distance`. Where
palms may be used, a step counts in its best motion mode.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from drakeplan.contact_planning.torso_grid import TURNS
from drakeplan.context import QueryContext
from drakeplan.experience.retrieval import usable_modes
from drakeplan.experience.stored_plan import MODES
from drakeplan.guide.torso_graph import StepWeights, TorsoGraph, costs_to_go, node_at
from drakeplan.guide.traversability_map import TraversabilityMap, traversability_map

FOOT_PER_TORSO = 2.0  # a foot travels so much for each metre of the mean of the feet
HARDNESS = 3.0  # w_tr [m]: a step that surely fails counts as two (5 beside w_s = 10 in Lin & Berenson 2017, 10 beside 3 in Lin 2020)


class TraversabilityGrid:
    """Distances to the goal [m] with traversability; has the method `distance` of `TorsoGrid`.

    Attributes:
        map: of the costs; None where the grid knows no way from the start.
    """

    def __init__(
        self, known: TraversabilityMap | None, modes: tuple[int, ...], weights: StepWeights, per_metre: float
    ) -> None:
        """Sums costs up to the goal.

        Args:
            known: the map of costs; None where the grid knows no way.
            modes: motion modes that may be used, the best at each step.
            weights: of a step of the torso, as the search counts.
            per_metre: cost of a metre of the mean of the feet in the search.
        """
        self.map, self._to_go = known, np.empty(0)
        if known is not None:
            self._to_go = costs_to_go(known.graph, weights, known.row, known.cost, np.array(modes)) / per_metre

    def distance(self, x: np.ndarray, y: np.ndarray, z: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """(n,) distance to the goal region [m], interpolated between cells; inf where there is no way.

        Args:
            x: (n,) of the means of the feet in W [m].
            y: (n,) of the means of the feet in W [m].
            z: (n,) of the means of the feet in W [m]; says on which floor.
            yaw: (n,) headings in W [rad].
        """
        if self.map is None:
            return np.full(len(x), np.inf)
        return _interpolated(self.map.graph, self._to_go, x, y, z, yaw)


def traversability_grid(
    context: QueryContext, use_palms: bool, per_metre: float, step: float, kind: str
) -> TraversabilityGrid:
    """Distances of a query.

    Args:
        context: of the query.
        use_palms: whether palms may be used.
        per_metre: cost of a metre of the mean of the feet in the search.
        step: what a step costs in the search, w_s.
        kind: of regressor, `learning.traversability.KINDS`.

    Raises:
        WeightsError: no weights for this robot, or damaged ones.
    """
    modes = tuple(MODES.index(mode) for mode in usable_modes(context, use_palms))
    weights = StepWeights(FOOT_PER_TORSO, step, HARDNESS)
    return TraversabilityGrid(traversability_map(context, modes, kind), modes, weights, per_metre)


@njit(cache=True)
def _interpolated(
    graph: TorsoGraph, to_go: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray, yaw: np.ndarray
) -> np.ndarray:
    """(n,) values between the four cells about each pose, at the nearest heading."""
    out = np.full(len(x), np.inf)
    for k in range(len(x)):
        t = int(np.rint(yaw[k] / (2 * np.pi / TURNS))) % TURNS
        u = (x[k] - graph.origin[0]) / graph.cell - 0.5
        v = (y[k] - graph.origin[1]) / graph.cell - 0.5
        i, j = int(np.floor(u)), int(np.floor(v))
        total = weight = 0.0
        for a in range(2):
            for b in range(2):
                n = node_at(graph, i + a, j + b, t, z[k])
                if n >= 0 and np.isfinite(to_go[n]):
                    w = (u - i if a else i + 1 - u) * (v - j if b else j + 1 - v) + 1e-9
                    total += w * to_go[n]
                    weight += w
        if weight > 0.0:
            out[k] = total / weight
    return out
