"""The bound against Dijkstra over a grid of footholds, closed forms, and what search finds."""

from __future__ import annotations

import heapq
import itertools
from dataclasses import replace

import numpy as np
import pytest

from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.search.ana_star import Limits
from optimization.contact_programs.length_bound import length_lower_bound
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.footholds.projection import set_down
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene
from scenes.stance import Stance
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain
from scenes.transition_model import transition_model

ESCHER = load_robot("escher")


def plate(name: str, x: tuple[float, float], y: tuple[float, float], z: float = 0.0) -> Surface:
    return Surface(name, np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]]))


def standing(terrain: Terrain) -> Stance:
    packed = pack_terrain(terrain)
    feet = [
        set_down(packed, e, 0.0, y, 0.0, ESCHER.effectors[k].half_extent)
        for k, (e, y) in enumerate((("left_foot", 0.1), ("right_foot", -0.1)))
    ]
    return Stance((feet[0], feet[1], None, None))


ROUNDABOUT = Terrain(  # the straight line is a gap
    (
        plate("start", (-0.3, 0.3), (-0.3, 0.3)),
        plate("aside", (0.1, 0.7), (0.35, 0.75), 0.05),
        plate("corner", (0.75, 1.2), (0.3, 0.75), 0.1),
        plate("goal", (0.95, 1.5), (-0.4, 0.25)),
    )
)


def by_dijkstra(scene: Scene, start: Stance, step_weight: float, spacing: float) -> float:
    """Cheapest walk over a grid of footholds by the bound's own rules, without sets or relaxation."""
    points = []
    for surface in scene.terrain.surfaces:
        low, high = surface.vertices[:, :2].min(axis=0) + 0.05, surface.vertices[:, :2].max(axis=0) - 0.05
        xs, ys = (np.linspace(a, b, max(int((b - a) / spacing) + 1, 2)) for a, b in zip(low, high, strict=True))
        points += [(x, y, surface.vertices[0, 2]) for x in xs for y in ys]
    points += [tuple(c.p_WC) for c in start.contacts[:2]]
    p = np.array(points)
    n = len(p)
    reach = np.hypot(transition_model().steps[:, 0], transition_model().steps[:, 1]).max()
    near = [
        np.flatnonzero((np.hypot(*(p - q)[:, :2].T) <= reach) & (abs(p[:, 2] - q[2]) <= ESCHER.max_step_height))
        for q in p
    ]
    goal = np.array(scene.goal.xyz[:2])
    done: set[tuple[int, int, int]] = set()
    heap = [(0.0, n - 2, n - 1, m) for m in (0, 1)]
    while heap:
        cost, left, right, mover = heapq.heappop(heap)
        if (left, right, mover) in done:
            continue
        done.add((left, right, mover))
        if np.hypot(*(0.5 * (p[left] + p[right])[:2] - goal)) <= scene.goal.radius:
            return cost
        old, stand = (left, right) if mover == 0 else (right, left)
        travel = np.linalg.norm(p[near[stand]] - p[old], axis=1)
        for k, d in zip(near[stand], travel, strict=True):
            if d <= ESCHER.max_foot_translation:
                after = (k, right) if mover == 0 else (left, k)
                heapq.heappush(heap, (cost + d + step_weight, int(after[0]), int(after[1]), 1 - mover))
    return np.inf


@pytest.mark.parametrize("step_weight", [0.0, 3.0])
def test_no_walk_over_a_grid_of_footholds_is_cheaper(step_weight: float) -> None:
    scene = Scene("roundabout", ROUNDABOUT, goal=Goal((1.2, -0.05, 0.0), 0.1))
    start = standing(ROUNDABOUT)
    bound = length_lower_bound(scene, ESCHER, start, step_weight=step_weight, palms=False)
    walk = by_dijkstra(scene, start, step_weight, 0.13)
    assert np.isfinite(walk)
    assert bound.straight <= bound.cost <= walk
    assert bound.cost > 0.5 * walk


def test_the_bound_sees_the_way_round_that_the_straight_line_does_not() -> None:
    scene = Scene("roundabout", ROUNDABOUT, goal=Goal((1.2, -0.05, 0.0), 0.1))
    bound = length_lower_bound(scene, ESCHER, standing(ROUNDABOUT), palms=False)
    assert not bound.reason
    assert bound.cost > bound.straight + 0.2


def test_on_a_floor_it_is_the_straight_line() -> None:
    floor = Terrain((plate("floor", (-1, 4), (-1, 1)),))
    scene = Scene("floor", floor, goal=Goal((2.0, 0.0, 0.0), 0.2))
    bound = length_lower_bound(scene, ESCHER, standing(floor), step_weight=0.0)
    assert bound.cost == pytest.approx(2 * 1.8, rel=1e-3)
    with_steps = length_lower_bound(scene, ESCHER, standing(floor))
    assert with_steps.cost >= 2 * 1.8 + 3.0 * 4.5 - 1e-2  # a stride moves the mean by 0.4 m


def test_at_the_goal_nothing_is_left() -> None:
    floor = Terrain((plate("floor", (-1, 4), (-1, 1)),))
    scene = Scene("floor", floor, goal=Goal((0.1, 0.0, 0.0), 0.2))
    assert length_lower_bound(scene, ESCHER, standing(floor)).cost == 0.0


def test_fewer_layers_give_a_weaker_bound_that_is_still_one() -> None:
    scene = Scene("roundabout", ROUNDABOUT, goal=Goal((1.2, -0.05, 0.0), 0.1))
    start = standing(ROUNDABOUT)
    bounds = [length_lower_bound(scene, ESCHER, start, palms=False, num_steps=n).cost for n in (1, 2, 4, 7)]
    assert all(a <= b + 1e-2 for a, b in itertools.pairwise(bounds))
    assert bounds[-1] <= by_dijkstra(scene, start, 3.0, 0.13)


def test_palms_weaken_the_bound_and_a_higher_weight_raises_it() -> None:
    wall = Surface("wall", np.array([[-1, 0.9, 0.5], [2, 0.9, 0.5], [2, 0.9, 2], [-1, 0.9, 2]]))
    terrain = Terrain((*ROUNDABOUT.surfaces, wall))
    scene = Scene("roundabout", terrain, goal=Goal((1.2, -0.05, 0.0), 0.1))
    start = standing(ROUNDABOUT)
    with_palms = length_lower_bound(scene, ESCHER, start).cost
    without = length_lower_bound(scene, ESCHER, start, palms=False).cost
    assert with_palms <= without + 1e-2
    assert length_lower_bound(scene, ESCHER, start, step_weight=1.0).cost < with_palms


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [("flat", 0), ("stairs", 0), ("narrow_flat", 0), ("rubble_field", 4)])
def test_what_search_finds_is_never_below_the_bound(name: str, seed: int) -> None:
    scene = load_scene(name, seed=seed)
    context = QueryContext(scene, ESCHER, WholeBodyIK(ESCHER))
    planner = SearchPlanner(context, PlannerOptions(seed=seed))
    cheapest = min((p.cost for p in planner.plans(Limits(expansions=1500))), default=np.inf)
    assert np.isfinite(cheapest)
    bound = length_lower_bound(scene, ESCHER, context.start, context.goal)
    assert bound.straight <= bound.cost <= cheapest
    assert 0 <= bound.gap(cheapest) < 0.6


def test_a_query_without_goal_or_feet_is_refused() -> None:
    floor = Terrain((plate("floor", (-1, 4), (-1, 1)),))
    scene = Scene("floor", floor)
    with pytest.raises(InputError, match="goal"):
        length_lower_bound(scene, ESCHER, standing(floor))
    with pytest.raises(InputError, match="both feet"):
        length_lower_bound(replace(scene, goal=Goal((1, 0, 0))), ESCHER, Stance((None, None, None, None)))
