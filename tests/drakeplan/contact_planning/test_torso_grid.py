"""The grid's distances against closed forms and a plain Dijkstra."""

from __future__ import annotations

import heapq

import numpy as np
import pytest

from drakeplan.contact_planning.torso_grid import TURNS, TorsoGrid
from scenes.robots.robot import load_robot
from scenes.scene import Goal
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

CELL = 0.1


def floor(name: str, x0: float, x1: float, y0: float, y1: float, z: float = 0.0) -> Surface:
    return Surface(name, np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]))


def grid_on(terrain: Terrain, goal=(2.0, 0.0), radius=0.1, yaw=None) -> TorsoGrid:
    x, y, *z = goal
    return TorsoGrid(pack_terrain(terrain), load_robot("escher"), Goal((x, y, z[0] if z else 0.0), radius, yaw))


def ask(grid: TorsoGrid, x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> float:
    return float(grid.distance(np.array([x]), np.array([y]), np.array([z]), np.array([yaw]))[0])


def test_on_an_empty_floor_the_distance_is_octile() -> None:
    grid = grid_on(Terrain((floor("f", -3, 3, -3, 3),)))
    rng = np.random.default_rng(0)
    for _ in range(200):
        x, y = rng.uniform(-2.5, 2.5, 2)
        dx, dy = abs(x - 2.0), abs(y)
        octile = max(dx, dy) + (np.sqrt(2) - 1) * min(dx, dy)
        assert ask(grid, x, y) == pytest.approx(octile, abs=0.1 + 1.5 * CELL)
        assert ask(grid, x, y) * np.cos(np.pi / 8) <= np.hypot(dx, dy) + 1.5 * CELL


def test_a_wall_is_walked_round() -> None:
    X_WO = np.eye(4)
    X_WO[:3, 3] = [1.0, -1.0, 1.0]
    wall = Box("wall", np.array([0.1, 4.0, 2.0]), X_WO)  # open for y > 1
    grid = grid_on(Terrain((floor("f", -1, 3, -3, 3),), (wall,)))
    assert ask(grid, 0.0, 0.0) > 2.0 + 1.0
    assert np.isfinite(ask(grid, 0.0, 0.0))


def test_a_wall_across_the_whole_way_leaves_none() -> None:
    X_WO = np.eye(4)
    X_WO[:3, 3] = [1.0, 0.0, 1.0]
    grid = grid_on(Terrain((floor("f", -1, 3, -1, 1),), (Box("wall", np.array([0.1, 9.0, 2.0]), X_WO),)))
    assert ask(grid, 0.0, 0.0) == np.inf
    assert np.isfinite(ask(grid, 2.0, 0.4))


@pytest.mark.parametrize(("gap", "reachable"), [(0.5, True), (1.0, False)])
def test_a_gap_can_be_crossed_only_if_ground_is_within_reach_on_both_sides(gap: float, reachable: bool) -> None:
    grid = grid_on(Terrain((floor("near", -1, 1, -1, 1), floor("far", 1 + gap, 3, -1, 1))), goal=(2.5, 0.0))
    assert np.isfinite(ask(grid, 0.0, 0.0)) == reachable


def test_a_ledge_higher_than_a_step_is_no_way() -> None:
    for z, reachable in ((0.3, True), (0.6, False)):
        grid = grid_on(Terrain((floor("low", -1, 1, -1, 1), floor("high", 1, 3, -1, 1, z))))
        assert np.isfinite(ask(grid, 0.0, 0.0)) == reachable


def test_a_goal_heading_costs_the_turn() -> None:
    terrain = Terrain((floor("f", -3, 3, -3, 3),))
    free, facing_back = grid_on(terrain), grid_on(terrain, yaw=np.pi)
    assert ask(facing_back, 0.0, 0.0) - ask(free, 0.0, 0.0) == pytest.approx(0.3 * np.pi, abs=0.02)


def test_every_settled_cell_agrees_with_a_plain_dijkstra() -> None:
    rng = np.random.default_rng(1)
    boxes = []
    for k in range(8):
        X_WO = np.eye(4)
        X_WO[:3, 3] = [*rng.uniform(-1, 1, 2), 1.0]
        boxes.append(Box(f"b{k}", np.array([*rng.uniform(0.05, 0.4, 2), 2.0]), X_WO))
    grid = grid_on(Terrain((floor("f", -1.5, 2.5, -1.5, 1.5),), tuple(boxes)))
    ask(grid, -1.2, 0.0)
    nx, ny, _ = grid.shape
    cells, heights, distances = grid.settled_nodes()
    assert np.all(heights == 0.0)
    cost, settled = np.full(grid.shape, np.inf), np.zeros(grid.shape, bool)
    cost[tuple(cells.T)], settled[tuple(cells.T)] = distances, True
    plain = np.full(grid.shape, np.inf)
    heap = []
    for cell in zip(*np.nonzero(settled & (cost == 0)), strict=True):
        plain[cell] = 0.0
        heap.append((0.0, *map(int, cell)))
    while heap:
        d, i, j, t = heapq.heappop(heap)
        if d > plain[i, j, t]:
            continue
        moves = [(i + a, j + b, t, CELL * np.hypot(a, b)) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
        moves += [(i, j, (t + s) % TURNS, 0.3 * 2 * np.pi / TURNS) for s in (-1, 1)]
        for u, v, w, c in moves:
            if 0 <= u < nx and 0 <= v < ny and settled[u, v, w] and d + c < plain[u, v, w] - 1e-12:
                plain[u, v, w] = d + c
                heapq.heappush(heap, (d + c, u, v, w))
    np.testing.assert_allclose(cost[settled], plain[settled], atol=1e-9)
    assert settled.sum() > 500
