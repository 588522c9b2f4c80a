"""The guiding path costs what SciPy's Dijkstra over nodes and modes says, and what its own steps add up to."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from made_up_ground import STEPS, box, floor, graph_of, plain_edges, scene_on
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from drakeplan.guide.guiding_path import DOCUMENTED, GuidingPath, guiding_path
from drakeplan.guide.torso_graph import StepWeights, torso_poses
from drakeplan.guide.traversability_map import TraversabilityMap

SOME_WEIGHTS = StepWeights(length=1.0, step=0.4, traversability=1.5, mode=0.3)


@pytest.fixture(scope="module")
def known(ik) -> TraversabilityMap:
    """A floor with a pillar, random hardness by place and mode."""
    pillar = box("pillar", (0.5, -0.3, 0.0), (0.6, 0.3, 2.0))
    graph, start = graph_of(scene_on(floor((-0.5, 1.7), (-0.9, 0.9), pillar), (1.2, 0.1), (-0.1, 0.0)), ik)
    rng = np.random.default_rng(5)
    row = rng.integers(0, 40, len(graph.z))
    cost = (rng.uniform(size=(4, 40, len(STEPS.translations))) ** 2).astype(np.float32)
    return TraversabilityMap(graph, row, cost, (), start)


@pytest.fixture(scope="module")
def edges(known) -> tuple[np.ndarray, ...]:
    """tail, head, translation and length [m] of all edges."""
    found = plain_edges(known.graph)
    return tuple(np.array([edge[k] for edge in found]) for k in (0, 1, 3, 4))


def least(known: TraversabilityMap, edges, modes: tuple[int, ...], weights: StepWeights) -> float:
    """The least cost over nodes times modes, by a graph in which a mode is that of the step just made."""
    tail, head, v, length = edges
    rows, columns, values = [], [], []
    for m in modes:
        hard = known.cost[m, known.row[tail], v]
        for before in modes:
            change = weights.mode if before != m else 0.0
            rows.append(4 * tail + before)
            columns.append(4 * head + m)
            values.append(weights.length * length + weights.step + weights.traversability * hard + change)
    size = 4 * len(known.graph.z)
    matrix = csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(size, size))
    goal = (4 * np.flatnonzero(known.graph.goal)[:, None] + np.array(modes)).ravel()
    return float(dijkstra(matrix, indices=[4 * known.start + m for m in modes])[:, goal].min())


def path_of(known: TraversabilityMap, modes: tuple[int, ...], weights: StepWeights) -> GuidingPath:
    path = guiding_path(known, modes, weights)
    assert path is not None
    return path


@pytest.mark.parametrize("modes", [(0,), (0, 3), (0, 1, 2, 3)])
@pytest.mark.parametrize("weights", [SOME_WEIGHTS, SOME_WEIGHTS._replace(mode=0.0), DOCUMENTED])
def test_no_path_over_places_and_modes_is_cheaper(known, edges, modes: tuple[int, ...], weights: StepWeights) -> None:
    assert path_of(known, modes, weights).cost == pytest.approx(least(known, edges, modes, weights), rel=1e-6)


@pytest.mark.parametrize("weights", [SOME_WEIGHTS, SOME_WEIGHTS._replace(mode=0.0, traversability=6.0)])
def test_the_cost_is_the_sum_over_the_steps_of_the_path(known, edges, weights: StepWeights) -> None:
    path = path_of(known, (0, 1, 2, 3), weights)
    graph, (tail, head, v, length) = known.graph, edges
    poses = torso_poses(graph, np.arange(len(graph.z)))
    nodes = [int(np.abs(poses - pose).max(axis=1).argmin()) for pose in path.poses]
    np.testing.assert_allclose(poses[nodes], path.poses)
    assert nodes[0] == known.start and graph.goal[nodes[-1]] and len(path) == len(nodes) - 1 > 3
    total = weights.mode * float(np.count_nonzero(np.diff(path.modes)))
    for k, (a, b) in enumerate(itertools.pairwise(nodes)):
        (edge,) = np.flatnonzero((tail == a) & (head == b))
        assert path.hardness[k] == pytest.approx(known.cost[path.modes[k], known.row[a], v[edge]])
        total += weights.length * length[edge] + weights.step + weights.traversability * path.hardness[k]
    assert path.cost == pytest.approx(total)


def test_changes_of_mode_that_are_free_never_make_a_path_dearer_and_dear_ones_become_rare(known) -> None:
    cost, changes = [], []
    for mode in (0.0, 0.2, 1.0, 100.0):
        path = path_of(known, (0, 1, 2, 3), SOME_WEIGHTS._replace(mode=mode))
        cost.append(path.cost)
        changes.append(np.count_nonzero(np.diff(path.modes)))
    assert cost == sorted(cost) and cost[0] < cost[-1]
    assert changes == sorted(changes, reverse=True) and changes[0] > 0 == changes[-1]


def test_no_step_of_the_path_has_a_mode_that_was_not_asked_for(known) -> None:
    assert set(path_of(known, (1, 3), SOME_WEIGHTS).modes.tolist()) <= {1, 3}
    one, more = path_of(known, (1,), SOME_WEIGHTS), path_of(known, (1, 3), SOME_WEIGHTS)
    assert more.cost <= one.cost


def test_on_even_ground_it_leads_straight_to_the_goal_with_the_longest_steps(ik) -> None:
    graph, start = graph_of(scene_on(floor((-0.5, 2.5), (-0.6, 0.6)), (2.0, 0.0)), ik)
    known = TraversabilityMap(graph, np.zeros(len(graph.z), int), np.zeros((4, 1, len(STEPS.translations))), (), start)
    path = path_of(known, (0,), DOCUMENTED)
    assert np.ptp(path.poses[:, 1]) < 2 * graph.cell and not path.modes.any()
    stride = graph.cell * np.hypot(*graph.offset[0].T).max()
    assert len(path) <= np.ceil((2.0 - 0.2) / stride) + 1


def test_where_no_way_leads_to_the_goal_there_is_no_path(known) -> None:
    poses = torso_poses(known.graph, np.arange(len(known.graph.z)))
    cut = known.graph.count.copy()
    column = int((0.2 - known.graph.origin[0]) / known.graph.cell)
    cut[column : column + 4] = 0
    alone = TraversabilityMap(known.graph._replace(count=cut), known.row, known.cost, (), known.start)
    assert poses[known.start, 0] < 0.2 and guiding_path(alone, (0,)) is None


def test_who_stands_in_the_goal_has_nowhere_to_go(known) -> None:
    there = TraversabilityMap(known.graph, known.row, known.cost, (), int(np.flatnonzero(known.graph.goal)[0]))
    path = path_of(there, (0, 1), SOME_WEIGHTS)
    assert len(path) == 0 and path.cost == 0.0 and path.poses.shape == (1, 4)
