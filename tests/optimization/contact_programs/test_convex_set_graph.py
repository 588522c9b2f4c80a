"""The graph of convex sets against the mixed-integer program of the same steps."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from optimization.contact_programs.contact_query import ContactQuery, FootstepOptions
from optimization.contact_programs.convex_set_graph import ConvexSetGraph
from optimization.contact_programs.footstep_program import FootstepProgram
from optimization.contact_programs.step_reach import step_reach
from optimization.mixed_integer import scip_adapter
from optimization.mixed_integer.solver import MixedIntegerSettings
from scenes.files.scene_source import load_scene
from scenes.footholds.projection import set_down
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.scene import Goal
from scenes.stance import Stance
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain
from scenes.transition_model import transition_model

ESCHER = load_robot("escher")
SOLVER = "scip" if scip_adapter.available() else "drake"
WITHIN = 2e-4 if SOLVER == "scip" else 0.011  # Drake's branch and bound stops at 1 %
TIGHT = MixedIntegerSettings(SOLVER, time_limit=60.0, gap=1e-4)


def query(terrain: Terrain, goal: Goal, heading: float = 0.0) -> ContactQuery:
    packed = pack_terrain(terrain)
    across = np.array([-np.sin(heading), np.cos(heading)])
    feet = [
        set_down(packed, e, *(side * 0.1 * across), heading, ESCHER.effectors[k].half_extent)
        for k, (e, side) in enumerate((("left_foot", 1), ("right_foot", -1)))
    ]
    return ContactQuery(
        terrain, ESCHER, Stance((feet[0], feet[1], None, None)), goal, step_reach(ESCHER, transition_model())
    )


def plate(name: str, x: tuple[float, float], y: tuple[float, float], z: float = 0.0) -> Surface:
    return Surface(name, np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]]))


FLOOR = Terrain((plate("floor", (-1, 3), (-1, 1)),))
STONES = Terrain(
    (
        plate("start", (-0.4, 0.4), (-0.5, 0.5)),
        plate("left", (0.45, 0.85), (0.02, 0.45), 0.05),
        plate("right", (0.45, 0.85), (-0.45, -0.02), -0.04),
        plate("far", (0.9, 1.8), (-0.5, 0.5), 0.03),
    )
)


@pytest.mark.parametrize("num", [4, 5, 7])
def test_its_relaxation_is_below_and_its_path_above_the_mixed_integer_optimum(num: int) -> None:
    q, options = query(STONES, Goal((1.05, 0.0, 0.0), 0.15)), FootstepOptions(num, first=1)
    optimum = FootstepProgram(q, options).solve(TIGHT)
    graph = ConvexSetGraph(q, options).solve(TIGHT)
    assert graph.feasible == optimum.feasible
    if optimum.feasible:
        assert graph.record.bound <= optimum.cost + 1e-4
        assert graph.cost >= optimum.cost * (1 - WITHIN) - 1e-5
        assert graph.cost <= 1.25 * optimum.cost


def test_on_one_floor_the_relaxation_is_the_optimum() -> None:
    q, options = query(FLOOR, Goal((1.0, 0.0, 0.0), 0.1)), FootstepOptions(8)
    optimum, graph = FootstepProgram(q, options).solve(TIGHT), ConvexSetGraph(q, options).solve(TIGHT)
    assert graph.cost == pytest.approx(optimum.cost, rel=WITHIN)
    assert graph.record.bound == pytest.approx(graph.cost, rel=1e-4)


def test_paths_over_rubble_are_steps_of_one_foot_in_turn_within_the_lens() -> None:
    scene = load_scene("rubble_field", seed=2)
    q = query(scene.terrain, scene.goal)
    estimate = ConvexSetGraph(q, FootstepOptions(12)).solve(MixedIntegerSettings(time_limit=60, gap=0.2))
    assert estimate.feasible, estimate.reason
    for k, (before, after) in enumerate(itertools.pairwise(estimate.stances)):
        changed = [e for e in range(4) if before.contacts[e] != after.contacts[e]]
        assert len(changed) == 1
        new, stand = after.contacts[changed[0]], after.contacts[1 - changed[0]]
        apart = (new.p_WC - stand.p_WC)[:2]
        for centre, radius in q.reach.discs(1.0 if changed[0] == 0 else -1.0):
            assert np.hypot(*(apart - centre)) <= radius + 1e-5, k
        surface = q.terrain.surfaces[new.surface]
        assert abs(surface.normal @ (new.p_WC - surface.vertices[0])) < 1e-9


def test_it_turns_by_vertices() -> None:
    q = query(Terrain((plate("floor", (-1, 3), (-1, 3)),)), Goal((0.4, 0.4, 0.0), 0.3, np.pi / 2))
    piece = np.deg2rad(30.0)
    headings = tuple((k * piece, (k + 1) * piece) for k in range(3))
    estimate = ConvexSetGraph(q, FootstepOptions(8, headings=headings)).solve(TIGHT)
    assert estimate.feasible, estimate.reason
    feet = estimate.stances[-1].contacts[:2]
    assert 0.5 * (feet[0].heading + feet[1].heading) == pytest.approx(np.pi / 2, abs=np.deg2rad(15.1))


def test_a_barred_pair_of_surfaces_is_avoided_and_no_way_is_said() -> None:
    q = query(STONES, Goal((1.05, 0.0, 0.0), 0.15))
    options = FootstepOptions(5, first=1)
    free = ConvexSetGraph(q, options).solve(TIGHT)
    pairs = {(s.contacts[0].surface, s.contacts[1].surface) for s in free.stances}
    barred = replace(q, narrowed=dict.fromkeys(pairs - {(0, 0), (3, 3)}, 0.0))
    estimate = ConvexSetGraph(barred, options).solve(TIGHT)
    found = {(s.contacts[0].surface, s.contacts[1].surface) for s in estimate.stances}
    assert not found & set(barred.narrowed)
    nowhere = replace(q, narrowed={(a, b): 0.0 for a in range(4) for b in range(4) if a != b})
    estimate = ConvexSetGraph(nowhere, options).solve(TIGHT)
    assert not estimate.feasible and estimate.reason


def test_a_goal_out_of_reach_is_told_without_a_solver() -> None:
    q = query(Terrain((plate("floor", (-1, 1), (-1, 1)), plate("island", (5, 6), (-1, 1)))), Goal((5.5, 0, 0), 0.2))
    estimate = ConvexSetGraph(q, FootstepOptions(12)).solve()
    assert not estimate.feasible and estimate.record is None and "no surface" in estimate.reason


def test_the_callers_wish_to_stop_is_heard_between_paths() -> None:
    scene = load_scene("rubble_field", seed=2)
    estimate = ConvexSetGraph(query(scene.terrain, scene.goal), FootstepOptions(12)).solve(stop=lambda: True)
    assert not estimate.feasible and estimate.limited


def test_trimming_is_refused() -> None:
    with pytest.raises(InputError, match="trim"):
        ConvexSetGraph(query(FLOOR, Goal((1, 0, 0))), FootstepOptions(trim=True))
