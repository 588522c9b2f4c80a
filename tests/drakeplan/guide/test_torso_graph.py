"""The torso's graph against its edges written out one by one, and costs to go against SciPy's Dijkstra."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_ground import STEPS, box, floor, graph_of, plain_edges, scene_on
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from drakeplan.guide.torso_graph import (
    StepWeights,
    TorsoGraph,
    costs_to_go,
    neighbour,
    node_at,
    step_length,
    step_translation,
    torso_poses,
)
from drakeplan.guide.torso_steps import CELL as TRANSLATION_CELL
from scenes.library.plates import level_plate
from scenes.terrain.terrain import terrain_from

ATOL = 1e-9
WEIGHTS = StepWeights(length=1.3, step=0.7, traversability=4.0, mode=0.0)


@pytest.fixture(scope="module")
def stairs(ik) -> TorsoGraph:
    """Treads of 0.3 m that rise by 0.12 m, with a pillar."""
    treads = [
        level_plate(f"t{k}", (0.3 * k - 0.6, 0.3 * k - 0.3), (-0.6, 0.6), max(0.12 * (k - 3), 0.0)) for k in range(8)
    ]
    return graph_of(
        scene_on(terrain_from([level_plate("f", (-1.0, -0.6), (-0.6, 0.6)), *treads]), (0.1, 0.0), (-0.6, 0.0)), ik
    )[0]


@pytest.fixture(scope="module")
def walled(ik) -> TorsoGraph:
    """A floor with a thin wall that is open at one end."""
    wall = box("wall", (0.6, -2.0, 0.0), (0.62, 0.3, 2.0))
    return graph_of(scene_on(floor((-0.7, 1.8), (-0.8, 1.5), wall), (1.2, 0.0), (0.0, -0.3)), ik)[0]


@pytest.fixture(params=["stairs", "walled"])
def graph(request) -> TorsoGraph:
    return request.getfixturevalue(request.param)


def all_steps(graph: TorsoGraph) -> range:
    return range(graph.offset.shape[1] + 2)


def test_every_edge_is_one_that_the_arrays_allow_and_none_is_missing(graph) -> None:
    edges = {(n, e): other for n, other, e, _, _ in plain_edges(graph)}
    rng = np.random.default_rng(0)
    for n in rng.choice(len(graph.z), 300, replace=False).tolist():
        for e in all_steps(graph):
            assert neighbour(graph, n, e, False) == edges.get((n, e), -1)


def test_steps_have_the_length_and_the_translation_of_their_edge(graph) -> None:
    rng = np.random.default_rng(1)
    edges = plain_edges(graph)
    for k in rng.choice(len(edges), 300).tolist():
        n, _, e, translation, length = edges[k]
        t = int(graph.place[n, 2])
        assert step_length(graph, t, e) == pytest.approx(length)
        assert step_translation(graph, t, e) == translation


def test_a_step_back_undoes_a_step(graph) -> None:
    count = 0
    for n in np.random.default_rng(2).choice(len(graph.z), 300, replace=False).tolist():
        for e in all_steps(graph):
            other = neighbour(graph, n, e, False)
            if other >= 0:
                assert neighbour(graph, other, e, True) == n
                count += 1
            before = neighbour(graph, n, e, True)
            assert before < 0 or neighbour(graph, before, e, False) == n
    assert count > 300


def test_the_same_ground_is_in_the_way_of_a_step_and_of_its_way_back(ik) -> None:
    """Three cells in a row, the middle one a footstep's height below the first and the last as high above it."""
    flat = graph_of(scene_on(floor((-0.5, 0.9), (-0.5, 0.5)), (0.4, 0.0)), ik)[0]
    (e,) = np.flatnonzero((flat.offset[0] == [2, 0]).all(axis=1) & (flat.translation[0] >= 0))
    place = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    one = flat._replace(
        start=np.array([[0], [1], [2]]), count=np.ones((3, 1), int), place=place, z=np.array([0.0, -0.3, 0.3]),
        goal=np.array([False, False, True]), step=0.35,
    )  # fmt: skip
    forth, back = neighbour(one, 0, int(e), False), neighbour(one, 2, int(e), True)
    assert (forth == 2) == (back == 0)


def test_steps_are_those_of_the_transition_model_turned_with_the_heading(graph) -> None:
    for t in range(12):
        c, s = np.cos(np.pi * t / 6), np.sin(np.pi * t / 6)
        there = graph.translation[t] >= 0
        xy = graph.offset[t][there] * graph.cell @ np.array([[c, -s], [s, c]])
        away = np.hypot(*(xy - STEPS.translations[graph.translation[t][there]] * TRANSLATION_CELL).T)
        assert away.max() <= 0.5 * np.sqrt(2.0) * TRANSLATION_CELL + ATOL
        assert len(np.unique(graph.offset[t][there], axis=0)) == there.sum() > 4
        assert not (graph.offset[t][there] == 0).all(axis=1).any()
    assert (STEPS.translations[graph.stay] == 0).all()


def test_no_step_leads_through_a_thin_wall(walled) -> None:
    poses = torso_poses(walled, np.arange(len(walled.z)))
    behind = poses[:, 1] < 0.3
    left, right = behind & (poses[:, 0] < 0.6), behind & (poses[:, 0] > 0.62)
    assert left.any() and right.any()
    for n, other, *_ in plain_edges(walled):
        assert not (left[n] and right[other]) and not (right[n] and left[other])
    for n in np.flatnonzero(left | right).tolist():
        for e in all_steps(walled):
            other = neighbour(walled, n, e, False)
            assert other < 0 or (not (left[n] and right[other]) and not (right[n] and left[other]))


def test_nodes_lie_in_their_cell_and_on_their_floor(graph) -> None:
    poses = torso_poses(graph, np.arange(len(graph.z)))
    for n in range(0, len(graph.z), 37):
        i, j, t = graph.place[n].tolist()
        np.testing.assert_allclose(poses[n, :2], graph.origin + (np.array([i, j]) + 0.5) * graph.cell)
        assert poses[n, 2] == graph.z[n] and poses[n, 3] == pytest.approx(np.pi * t / 6)
        assert graph.start[i, j] <= n < graph.start[i, j] + graph.count[i, j]
        assert node_at(graph, i, j, t, graph.z[n]) == n
        assert node_at(graph, i, j, t, graph.z[n] + graph.step + 0.01) == -1
    assert node_at(graph, -1, 0, 0, 0.0) == node_at(graph, *graph.count.shape, 0, 0.0) == -1
    assert graph.count.sum() == len(graph.z)


def random_costs(graph: TorsoGraph, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.integers(0, 20, len(graph.z)), rng.uniform(size=(4, 20, len(STEPS.translations))).astype(np.float32)


@pytest.mark.parametrize("modes", [(0,), (0, 2), (0, 1, 2, 3)])
def test_costs_to_go_are_those_of_a_dijkstra_with_the_best_mode_for_each_step(graph, modes: tuple[int, ...]) -> None:
    row, cost = random_costs(graph, len(modes))
    edges = plain_edges(graph)
    tail, head = (np.array([edge[k] for edge in edges]) for k in (0, 1))
    v, length = np.array([edge[3] for edge in edges]), np.array([edge[4] for edge in edges])
    hard = cost[list(modes)][:, row[tail], v].min(axis=0)
    weight = WEIGHTS.length * length + WEIGHTS.step + WEIGHTS.traversability * hard
    end = np.full(graph.goal.sum(), len(graph.z))  # a node beyond all goals; 1 is taken off again, for 0 is no edge
    rows, columns = np.concatenate([head, end]), np.concatenate([tail, np.flatnonzero(graph.goal)])
    size = len(graph.z) + 1
    matrix = csr_matrix((np.concatenate([weight, np.ones(len(end))]), (rows, columns)), shape=(size, size))
    expected = dijkstra(matrix, indices=len(graph.z))[:-1] - 1.0
    found = costs_to_go(graph, WEIGHTS, row, cost, np.array(modes))
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert (found[graph.goal] == 0.0).all() and np.isfinite(found).mean() > 0.9


def test_more_modes_never_cost_more_and_harder_ground_never_less(graph) -> None:
    row, cost = random_costs(graph, 7)
    few, many = (costs_to_go(graph, WEIGHTS, row, cost, np.array(modes)) for modes in ((1,), (1, 2, 3)))
    harder = costs_to_go(graph, WEIGHTS, row, np.minimum(2.0 * cost, 1.0), np.array([1]))
    assert (many <= few + ATOL).all() and (many < few - 0.1).any()
    assert (harder >= few - ATOL).all() and (harder > few + 0.1).any()


def test_where_nothing_is_a_goal_every_way_is_endless(walled) -> None:
    row, cost = random_costs(walled, 3)
    none = walled._replace(goal=np.zeros(len(walled.z), bool))
    assert np.isinf(costs_to_go(none, WEIGHTS, row, cost, np.array([0]))).all()
