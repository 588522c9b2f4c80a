"""The grid's distances against closed forms and a plain Dijkstra."""

from __future__ import annotations

import heapq
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drakeplan.contact_planning.torso_grid import STOOPED, TURNS, TorsoGrid
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


# Floors above each other -----------------------------------------------------------------------------------------


def test_under_a_bridge_the_distance_is_that_of_the_floor_alone() -> None:
    ground, bridge = floor("ground", -1, 3, -1, 1), floor("bridge", 0.5, 1.5, -1, 1, z=2.3)
    covered, open_sky = grid_on(Terrain((ground, bridge))), grid_on(Terrain((ground,)))
    for x in np.linspace(-0.8, 2.8, 13):
        assert ask(covered, x, 0.2) == ask(open_sky, x, 0.2)


LOWEST_TOP = 1.65 - (0.953 - 0.5)  # [m] of escher's torso box, less what its CoM comes down


@pytest.mark.parametrize("height", [0.8, 1.0, LOWEST_TOP - 0.01, LOWEST_TOP + 0.01, 1.5, 1.64, 1.7, 2.0, 5.0])
def test_a_ceiling_lower_than_the_lowest_torso_leaves_no_way_under_it(height: float) -> None:
    ground, ceiling = floor("ground", -1, 3, -1, 1), floor("ceiling", 0.5, 1.5, -3, 3, z=height)
    assert np.isfinite(ask(grid_on(Terrain((ground, ceiling))), 0.0, 0.0)) == (height > LOWEST_TOP)


@settings(max_examples=15, deadline=None)
@given(height=st.floats(1.2, 2.2), depth=st.floats(0.3, 1.2))
def test_a_way_on_which_the_robot_lowers_itself_counts_more_by_its_length(height: float, depth: float) -> None:
    ground = floor("ground", -1, 3, -1, 1)
    ceiling = floor("ceiling", 1.0 - 0.5 * depth, 1.0 + 0.5 * depth, -3, 3, z=height)
    under, open_sky = (ask(grid_on(Terrain(parts)), 0.0, 0.0) for parts in ((ground, ceiling), (ground,)))
    low = depth + 0.24 + 2 * CELL  # the torso box is 0.24 m deep
    extra = under - open_sky
    if height > 1.66:
        assert extra == 0.0
    else:
        assert (STOOPED - 1.0) * (depth - CELL) <= extra <= (STOOPED - 1.0) * low + 1e-9


def test_the_robot_goes_round_a_low_ceiling_where_that_is_hardly_longer() -> None:
    ground = floor("ground", -1, 3, -3, 3)
    beam = floor("beam", 0.5, 1.5, -0.2, 3, z=1.4)
    under = ask(grid_on(Terrain((ground, floor("beam", 0.5, 1.5, -3, 3, z=1.4)))), 0.0, 0.0)
    assert ask(grid_on(Terrain((ground,))), 0.0, 0.0) < ask(grid_on(Terrain((ground, beam))), 0.0, 0.0) < under


def test_the_goal_counts_on_its_own_floor_alone() -> None:
    storeys = Terrain((floor("low", -1, 3, -1, 1), floor("high", -1, 3, -1, 1, z=2.4)))
    below, above = grid_on(storeys, goal=(2.0, 0.0, 0.0)), grid_on(storeys, goal=(2.0, 0.0, 2.4))
    assert ask(below, 0.0, 0.0, z=0.0) == ask(above, 0.0, 0.0, z=2.4) == pytest.approx(1.9, abs=0.15)
    assert ask(below, 0.0, 0.0, z=2.4) == ask(above, 0.0, 0.0, z=0.0) == np.inf


def flight(count: int, rise: float, x0: float, run: float, y: tuple[float, float], z0: float) -> list[Surface]:
    """Treads that rise along x (or against it where `run` is negative)."""
    edges = x0 + run * np.arange(count + 1)
    return [
        floor(f"{y}{z0}{k}", min(a, b), max(a, b), *y, z=z0 + rise * (k + 1))
        for k, (a, b) in enumerate(itertools.pairwise(edges))
    ]


def two_storeys(rise: float = 0.17) -> Terrain:
    """A hall and a storey above it, joined by two flights of seven steps with a landing between."""
    up, back = flight(7, rise, 1.3, 0.28, (-1.6, -0.1), 0.0), flight(7, rise, 3.26, -0.28, (0.1, 1.6), 7 * rise)
    landing = floor("landing", 3.26, 4.6, -1.6, 1.6, z=7 * rise)
    hall, upper = floor("hall", -1.2, 1.3, -1.6, 1.6), floor("upper", -1.2, 1.3, 0.1, 1.6, z=14 * rise)
    return Terrain((hall, *up, landing, *back, upper))


def test_two_flights_of_stairs_lead_to_the_storey_above_the_start() -> None:
    grid = grid_on(two_storeys(), goal=(0.0, 0.8, 14 * 0.17))
    there_and_back = 2 * (3.26 - 0.0)
    assert ask(grid, 0.0, 0.8, z=0.0) > there_and_back
    assert ask(grid, 0.0, 0.8, z=14 * 0.17) == 0.0
    assert np.isfinite(ask(grid, 0.0, 0.8, z=0.0))


def test_stairs_whose_steps_are_too_high_join_nothing() -> None:
    assert ask(grid_on(two_storeys(rise=0.36), goal=(0.0, 0.8, 14 * 0.36)), 0.0, 0.8, z=0.0) == np.inf


def test_a_spiral_is_climbed_all_the_way_round() -> None:
    """Sectors about an axis, two turns of 2.4 m each: where one passes over another there is head room."""
    per_turn, treads = 16, []
    for k in range(2 * per_turn):
        a, b = 2 * np.pi * k / per_turn, 2 * np.pi * (k + 1) / per_turn
        corners = [[r * np.cos(t), r * np.sin(t), 0.15 * k] for r, t in ((0.6, a), (1.8, a), (1.8, b), (0.6, b))]
        treads.append(Surface(f"tread {k}", np.array(corners)))
    middle = np.array([1.2 * np.cos(np.pi / per_turn), 1.2 * np.sin(np.pi / per_turn)])
    grid = grid_on(Terrain(tuple(treads)), goal=(*middle, 2.4))
    once_round = 2 * np.pi * (0.6 - 0.4)  # the torso leans over the inner edge by the support radius at most
    assert ask(grid, *middle, z=2.4) == pytest.approx(0.0, abs=CELL)
    assert once_round < ask(grid, *middle, z=0.0) < 2 * np.pi * 1.8
    assert once_round < ask(grid, *middle, yaw=0.5 * np.pi, z=4.65) < 2 * np.pi * 1.8


def test_slabs_too_close_to_stand_between_are_one_floor_at_the_top() -> None:
    slabs = [floor(f"slab {k}", -1, 3, -1, 1, z=0.3 * k) for k in range(4)]
    stacked, top = (
        grid_on(Terrain(tuple(slabs)), goal=(2.0, 0.0, 0.9)),
        grid_on(Terrain((slabs[3],)), goal=(2.0, 0.0, 0.9)),
    )
    assert ask(stacked, 0.0, 0.0, z=0.9) == ask(top, 0.0, 0.0, z=0.9)
    _, heights, _ = stacked.settled_nodes()
    assert np.all(heights == slabs[3].vertices[0, 2])


@pytest.mark.parametrize("below", [None, -3.0, -1.0])
def test_a_gap_is_as_wide_with_a_floor_under_it_as_with_none(below: float | None) -> None:
    banks = [floor("near", -1, 1, -1, 1), floor("far", 1.5, 3, -1, 1)]
    ground = [] if below is None else [floor("ground", -1, 3, -1, 1, z=below)]
    open_gap, other = grid_on(Terrain(tuple(banks))), grid_on(Terrain((*banks, *ground)))
    assert ask(other, 0.0, 0.3) == ask(open_gap, 0.0, 0.3) == pytest.approx(1.93, abs=0.2)


def test_inside_a_solid_there_is_no_way_however_large_it_is() -> None:
    X_WO = np.eye(4)
    block = Box("block", np.array([60.0, 60.0, 60.0]), X_WO)
    grid = grid_on(Terrain((floor("f", -1, 3, -1, 1),), (block,)))
    assert grid.num_goal_cells == 0
    assert ask(grid, 0.0, 0.0) == np.inf


def test_memory_goes_with_the_way_and_not_with_the_floor() -> None:
    small, large = (grid_on(Terrain((floor("f", -h, h, -h, h),))) for h in (10.0, 200.0))
    assert ask(small, 0.0, 0.0) == pytest.approx(ask(large, 0.0, 0.0), abs=1e-9)
    levels = [len(np.unique(g.settled_nodes()[0][:, :2], axis=0)) for g in (small, large)]
    assert levels[0] == levels[1] < 3000


def test_room_for_levels_is_made_as_they_come() -> None:
    storeys = Terrain(tuple(floor(f"f{k}", -6, 6, -6, 6, z=2.4 * k) for k in range(8)))
    one = grid_on(Terrain((floor("f", -6, 6, -6, 6, z=4.8),)), goal=(2.0, 0.0, 4.8))
    grid = grid_on(storeys, goal=(2.0, 0.0, 4.8))
    for x, y in ((-5.0, 5.0), (5.0, -5.0)):
        assert ask(grid, x, y, z=4.8) == ask(one, x, y, z=4.8)


def test_growing_settles_every_cell_within_a_distance_of_the_goal_and_few_beyond() -> None:
    pillar = np.eye(4)
    pillar[:3, 3] = [0.8, 0.2, 1.0]
    terrain = Terrain((floor("f", -2, 3, -1.5, 1.5),), (Box("pillar", np.array([0.2, 0.6, 2.0]), pillar),))
    whole, part = grid_on(terrain), grid_on(terrain)
    whole.grow(np.inf)
    cells, z, distance = whole.settled_nodes()
    known = {
        (*cell, round(h, 6)): d for cell, h, d in zip(map(tuple, cells.tolist()), z.tolist(), distance, strict=True)
    }
    assert len(known) == len(cells) and np.isfinite(distance).all()
    for farthest in (0.3, 1.0, 2.5):  # it goes on where it was
        part.grow(farthest)
        cells, z, distance = part.settled_nodes()
        some = {
            (*cell, round(h, 6)): d for cell, h, d in zip(map(tuple, cells.tolist()), z.tolist(), distance, strict=True)
        }
        assert {key for key, d in known.items() if d <= farthest - 1e-9} <= some.keys() <= known.keys()
        assert distance.max() <= farthest + 1e-9
        assert all(d == pytest.approx(known[key], abs=1e-9) for key, d in some.items())
    assert ask(part, -1.5, -1.0, 2.0) == pytest.approx(ask(whole, -1.5, -1.0, 2.0), abs=1e-9)


def test_where_the_goal_is_closed_nothing_grows() -> None:
    block = Box("block", np.array([60.0, 60.0, 60.0]), np.eye(4))
    grid = grid_on(Terrain((floor("f", -1, 3, -1, 1),), (block,)))
    grid.grow(np.inf)
    assert len(grid.settled_nodes()[0]) == 0
