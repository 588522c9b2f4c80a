"""A guiding path of the torso on SE(2) x motion modes, by A* (Lin 2020 sec. 5.4.1).

edge cost   l + w_s + w_tr Delta g_tr(mode of the step) + w_m [the mode changes]      Lin 2020 eq. 5.3
heuristic   d + w_s d / d_max       d: straight line to the goal region              Lin 2020 eq. 5.4
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from drakeplan.contact_planning.binary_heap import pop, push, sift_up
from drakeplan.contact_planning.torso_grid import SETTLED, UNSEEN
from drakeplan.guide.torso_graph import (
    StepWeights,
    TorsoGraph,
    neighbour,
    step_length,
    step_translation,
    torso_poses,
)
from drakeplan.guide.traversability_map import TraversabilityMap

MODES = 4
DOCUMENTED = StepWeights()


@dataclass(frozen=True, eq=False)
class GuidingPath:
    """Torso poses from start to goal, and how the robot moves from each to the next.

    Attributes:
        poses: (N, 4) x, y, z of the ground [m], yaw [rad].
        modes: (N - 1,) motion mode of each step.
        hardness: (N - 1,) its traversability cost Delta g_tr in that mode.
        cost: sum of the edge costs.
    """

    poses: np.ndarray
    modes: np.ndarray
    hardness: np.ndarray
    cost: float

    def __len__(self) -> int:
        """How many steps."""
        return len(self.modes)


def guiding_path(
    known: TraversabilityMap, modes: tuple[int, ...], weights: StepWeights = DOCUMENTED
) -> GuidingPath | None:
    """The cheapest path to the goal, None where there is none.

    Args:
        known: graph, start and traversability costs.
        modes: motion modes that may be used.
        weights: of a step.
    """
    graph = known.graph
    goals = torso_poses(graph, np.flatnonzero(graph.goal))[:, :2]
    middle = goals.mean(axis=0)
    radius = float(np.linalg.norm(goals - middle, axis=1).max())
    states, total = _search(graph, weights, known.row, known.cost, np.array(modes), known.start, middle, radius)
    if not len(states):
        return None
    nodes, mode, step = states[:, 0], states[1:, 1], states[1:, 2]
    tail = nodes[:-1]
    number = np.array(
        [step_translation(graph, graph.place[n, 2], e) for n, e in zip(tail.tolist(), step.tolist(), strict=True)],
        dtype=np.int64,
    )
    hardness = known.cost[mode, known.row[tail], number].astype(float)
    return GuidingPath(torso_poses(graph, nodes), mode, hardness, float(total))


@njit(cache=True)
def _search(
    graph: TorsoGraph,
    weights: StepWeights,
    row: np.ndarray,
    cost: np.ndarray,
    modes: np.ndarray,
    start: int,
    goal: np.ndarray,
    radius: float,
) -> tuple[np.ndarray, float]:
    """(N, 3) nodes with the mode and the number of the step that led there, and the cost; (0, 3) where there is no path."""
    nodes, steps = len(graph.z), graph.offset.shape[1] + 2
    farthest = 0.0
    for t in range(graph.offset.shape[0]):
        for e in range(steps):
            farthest = max(farthest, step_length(graph, t, e))
    per_metre = weights.length + weights.step / farthest
    so_far, estimate = np.full(nodes * MODES, np.inf), np.full(nodes * MODES, np.inf)
    before, by = np.full(nodes * MODES, -1, np.int64), np.full(nodes * MODES, -1, np.int64)
    place, heap, size = (
        np.full(nodes * MODES, UNSEEN, np.int32),
        np.empty(nodes * MODES, np.int32),
        np.zeros(1, np.int64),
    )
    to_go = np.empty(nodes)
    for n in range(nodes):
        x = graph.origin[0] + (graph.place[n, 0] + 0.5) * graph.cell - goal[0]
        y = graph.origin[1] + (graph.place[n, 1] + 0.5) * graph.cell - goal[1]
        to_go[n] = per_metre * max(np.sqrt(x * x + y * y) - radius, 0.0)
    for m in modes:
        s = start * MODES + m
        so_far[s], estimate[s] = 0.0, to_go[start]
        push(heap, place, size, s)
    while size[0] > 0:
        s = pop(heap, place, estimate, size)
        place[s] = SETTLED
        n, mode = s // MODES, s % MODES
        if graph.goal[n]:
            return _way_to(s, before, by), so_far[s]
        t = graph.place[n, 2]
        for e in range(steps):
            other = neighbour(graph, n, e, False)
            if other < 0:
                continue
            v = step_translation(graph, t, e)
            fixed = so_far[s] + weights.length * step_length(graph, t, e) + weights.step
            for m in modes:
                r = other * MODES + m
                if place[r] == SETTLED:
                    continue
                g = fixed + weights.traversability * cost[m, row[n], v] + (weights.mode if m != mode else 0.0)
                if g < so_far[r]:
                    so_far[r], estimate[r] = g, g + to_go[other]
                    before[r], by[r] = s, e
                    if place[r] == UNSEEN:
                        push(heap, place, size, r)
                    sift_up(heap, place, estimate, place[r])
    return np.empty((0, 3), np.int64), np.inf


@njit(cache=True)
def _way_to(s: int, before: np.ndarray, by: np.ndarray) -> np.ndarray:
    """(N, 3) nodes, modes and steps of the way to a state, first to last."""
    length, at = 1, s
    while before[at] >= 0:
        at, length = before[at], length + 1
    path = np.empty((length, 3), np.int64)
    at = s
    for k in range(length - 1, -1, -1):
        path[k, 0], path[k, 1], path[k, 2] = at // MODES, at % MODES, by[at]
        at = before[at]
    return path
