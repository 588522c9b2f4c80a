"""Ways that differ: every corridor is found, an open field has few, a closed one none."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_ground import box, floor, graph_of, scene_on
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from drakeplan.guide.promising_paths import DIFFERENT, LONGEST, MOST_PATHS, nodes_near, promising_paths
from drakeplan.guide.torso_graph import TorsoGraph, torso_poses
from scenes.library import three_corridors

LENGTH = 4.5  # [m]


@pytest.fixture(scope="module")
def corridors(ik) -> tuple[TorsoGraph, int]:
    """Three parallel corridors between two rooms."""
    walls = [box(f"w{y}", (1.0, y - 0.05, 0.0), (3.5, y + 0.05, 2.0)) for y in (-0.7, 0.7)]
    scene = scene_on(floor((-0.5, LENGTH + 0.5), (-1.9, 1.9), *walls), (LENGTH, 0.0))
    return graph_of(scene, ik)


@pytest.fixture(scope="module")
def field(ik) -> tuple[TorsoGraph, int]:
    return graph_of(scene_on(floor((-0.5, 3.0), (-0.35, 0.35)), (2.5, 0.0)), ik)


def length(path: np.ndarray) -> float:
    return float(np.hypot(*np.diff(path[:, :2], axis=0).T).sum())


def test_of_three_parallel_corridors_each_is_found(corridors) -> None:
    paths = promising_paths(*corridors)
    through = {round(float(path[np.abs(path[:, 0] - 2.25).argmin(), 1]) / 1.4) for path in paths}
    assert through == {-1, 0, 1}
    assert len(paths) <= MOST_PATHS


def test_the_corridors_of_the_named_scene_are_found_too(ik) -> None:
    paths = promising_paths(*graph_of(three_corridors.named(1), ik))
    middle = np.array(three_corridors.MIDDLES)
    found = {int(np.abs(middle - path[len(path) // 2, 1]).argmin()) for path in paths}
    assert found == {0, 1, 2}


def test_the_first_is_the_shortest_and_the_others_lead_elsewhere_and_not_too_far(corridors) -> None:
    graph, start = corridors
    paths = promising_paths(graph, start)
    lengths = [length(path) for path in paths]
    assert lengths[0] == min(lengths) and max(lengths) <= LONGEST * lengths[0]
    for k, path in enumerate(paths):
        for other in paths[:k]:
            away = np.linalg.norm(path[:, None] - other[None], axis=2).min(axis=1)
            assert away.max() > DIFFERENT


def test_ways_begin_at_the_start_end_in_the_goal_and_go_from_cell_to_cell(corridors) -> None:
    graph, start = corridors
    poses = torso_poses(graph, np.arange(len(graph.z)))
    for path in promising_paths(graph, start):
        np.testing.assert_allclose(path[0], poses[start, :3])
        assert (np.linalg.norm(poses[graph.goal, :3] - path[-1], axis=1) < 1e-9).any()
        assert np.abs(np.diff(path[:, :2], axis=0)).max() <= graph.cell + 1e-9
        assert (np.linalg.norm(poses[:, None, :3] - path[None, ::5], axis=2).min(axis=0) < 1e-9).all()


def test_the_shortest_is_as_long_as_a_dijkstra_over_cells_says(corridors) -> None:
    graph, start = corridors
    cells = np.unique(graph.place[:, :2], axis=0)
    number = {cell: k for k, cell in enumerate(map(tuple, cells.tolist()))}
    tail, head, weight = [], [], []
    for (i, j), k in number.items():
        for u, v in ((1, 0), (0, 1), (1, 1), (1, -1)):
            if (i + u, j + v) in number:
                tail.append(k)
                head.append(number[i + u, j + v])
                weight.append(graph.cell * np.hypot(u, v))
    matrix = csr_matrix((weight, (tail, head)), shape=(len(cells), len(cells)))
    far = dijkstra(matrix, directed=False, indices=number[tuple(graph.place[start, :2].tolist())])
    goals = [number[cell] for cell in {tuple(cell) for cell in graph.place[graph.goal, :2].tolist()}]
    assert length(promising_paths(graph, start)[0]) == pytest.approx(far[goals].min())


def test_an_open_field_has_few_ways_and_a_narrow_one_a_single_one(field, ik) -> None:
    assert len(promising_paths(*field)) == 1
    wide = promising_paths(*graph_of(scene_on(floor((-0.5, 3.5), (-1.5, 1.5)), (3.0, 0.0)), ik))
    assert 1 <= len(wide) <= MOST_PATHS
    away = np.abs(wide[0][:, 1]).max()
    assert away < 0.2, "the first leads straight ahead"


def test_where_no_way_leads_there_is_none(field) -> None:
    graph, start = field
    assert promising_paths(graph._replace(goal=np.zeros(len(graph.z), bool)), start) == []
    cut = graph.count.copy()
    cut[int((1.2 - graph.origin[0]) / graph.cell)] = 0
    assert promising_paths(graph._replace(count=cut), start) == []
    assert len(nodes_near(graph, [], 0.5, 1.0)) == 0


def test_nodes_near_a_way_are_near_it_and_turned_about_as_it_leads(field) -> None:
    graph, start = field
    (path,) = promising_paths(graph, start)
    near = nodes_near(graph, [path], 0.4, np.deg2rad(60.0))
    poses = torso_poses(graph, np.arange(len(graph.z)))
    away = np.linalg.norm(poses[:, None, :3] - path[None], axis=2).min(axis=1)
    ahead = np.abs(np.arctan2(np.sin(poses[:, 3]), np.cos(poses[:, 3])))  # it leads along x
    assert np.abs(path[:, 1] - path[0, 1]).max() < 1e-9, "the field is straight"
    expected = (away < 0.4 - 1e-9) & (ahead <= np.deg2rad(60.0) + 1e-6)
    np.testing.assert_array_equal(near, np.flatnonzero(expected))
