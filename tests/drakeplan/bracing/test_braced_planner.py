"""Braced plans step as palms step, stay on the wall, are held at every moment, and end in the goal."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from palms_on_wall import PalmsOnWall

from drakeplan.bracing import braced_planner
from drakeplan.bracing.braced_planner import APART, BracedPlan, Heuristic, plan_braced
from drakeplan.bracing.bracer import PALM_FRAMES, PLACED, Bracer
from drakeplan.bracing.wall_frame import SQUARE, to_wall
from drakeplan.contact_planning.contact_pool import CELL
from optimization.balance.static_equilibrium import is_balanced
from scenes.library.braced_ramp import PARTS, PIPE, BracedRamp, braced_ramp
from scenes.robots.bracer.make_bracer import PALM_RADIUS
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

SEEDS = (0, 1, 2)
HEURISTICS: tuple[Heuristic, ...] = ("grid", "traversability")
KEYS = [(seed, heuristic) for seed in SEEDS for heuristic in HEURISTICS]
DEADLINE = 300.0  # [s] a slow machine is no reason to fail
ON_PLATE = 1e-6  # [m] rounding of a projection


@pytest.fixture(scope="module")
def plans(bracer: Bracer) -> dict[tuple[int, Heuristic], BracedPlan]:
    """A plan of each seed and heuristic."""
    made = {}
    for seed, heuristic in KEYS:
        plan = plan_braced(braced_ramp(seed), bracer, heuristic, seed, DEADLINE)
        assert plan is not None, (seed, heuristic)
        made[seed, heuristic] = plan
    return made


def moved(plan: BracedPlan) -> list[int]:
    """The palm that moves in each step."""
    changed = np.abs(np.diff(plan.palms, axis=0)).max(axis=2) > 0.0
    assert (changed.sum(axis=1) == 1).all(), "one palm, and one only"
    return changed.argmax(axis=1).tolist()


def inside(point: np.ndarray, surface: Surface) -> float:
    """How far a point is from the nearest edge of a rectangle [m], less than 0 beyond it or off its plane."""
    v = surface.vertices
    if abs((point - v[0]) @ surface.normal) > ON_PLATE:
        return -np.inf
    inward = [np.cross(surface.normal, b - a) for a, b in zip(v, np.roll(v, -1, axis=0), strict=True)]
    return min(float((point - a) @ n / np.linalg.norm(n)) for a, n in zip(v, inward, strict=True))


def touched(plan: BracedPlan) -> np.ndarray:
    """(n, 3) all contact points, each once."""
    return np.unique(plan.palms.reshape(-1, 3).round(9), axis=0)


def test_every_draw_is_crossed_with_either_heuristic_and_one_palm_moves_at_a_time(plans) -> None:
    for plan in plans.values():
        movers = moved(plan)
        assert len(movers) == plan.steps == len(plan.postures) == len(plan.palms) - 1
        assert plan.refused == 0 < plan.expansions
        assert 0.0 < plan.checked_s < plan.seconds
        assert all(a != b for a, b in itertools.pairwise(movers)), "in turn: the palm behind goes ahead of the other"


def test_every_step_is_one_of_the_transition_model(plans) -> None:
    """0.1 to 0.4 m ahead of the standing palm and -0.2 to 0.2 m above it, but for contacts that count as one."""
    for plan in plans.values():
        for palm, before, after in zip(moved(plan), plan.palms[:-1], plan.palms[1:], strict=True):
            ahead, _, above = after[palm] - before[1 - palm]
            assert 0.1 - CELL <= ahead <= 0.4 + CELL
            assert -0.2 - CELL <= above <= 0.2 + CELL


def test_it_begins_with_both_palms_about_the_start_and_ends_with_their_mean_in_the_goal(plans) -> None:
    for (seed, _), plan in plans.items():
        ramp = braced_ramp(seed)
        first, last = to_wall(plan.palms[0]), to_wall(plan.palms[-1].mean(axis=0))
        np.testing.assert_allclose(np.diff(first, axis=0)[0, :2], [APART, 0.0], atol=1e-9)
        np.testing.assert_allclose(first.mean(axis=0)[:2], to_wall(ramp.start)[:2], atol=1e-9)
        assert np.linalg.norm((last - to_wall(ramp.goal))[:2]) <= ramp.radius
        before = to_wall(plan.palms[-2].mean(axis=0))
        assert np.linalg.norm((before - to_wall(ramp.goal))[:2]) > ramp.radius, "it ends when it is there"


def test_palms_are_on_surfaces_of_the_wall_with_the_square_that_stands_for_them(plans) -> None:
    for (seed, _), plan in plans.items():
        for point in touched(plan):
            assert max(inside(point, s) for s in braced_ramp(seed).wall.surfaces) >= SQUARE * np.cos(np.deg2rad(6.0))


def test_palms_are_on_surfaces_of_the_wall_with_all_of_their_disc(plans) -> None:
    for (seed, _), plan in plans.items():
        for point in touched(plan):
            assert max(inside(point, s) for s in braced_ramp(seed).wall.surfaces) >= PALM_RADIUS - ON_PLATE


def test_no_palm_is_behind_the_pipe(plans, bracer: Bracer) -> None:
    middle, width, _ = PIPE
    for plan in plans.values():
        for x, _, z in touched(plan):
            above = z > PARTS["above_the_window"][2]
            assert not (above and abs(x - middle) < width / 2 + PALM_RADIUS - CELL)
    palms = PalmsOnWall(braced_ramp(0), bracer)
    for palm, z in itertools.product((0, 1), (1.25, 1.35)):
        for x in np.arange(0.95, 2.05, 0.01):
            fits = palms.at(palm, float(x), z) >= 0
            if abs(x - middle) < width / 2 + PALM_RADIUS - 0.005:
                assert not fits, "behind the pipe, or its edge in the way"
            if abs(x - middle) > width / 2 + PALM_RADIUS + 0.02:  # the room over a tilted palm leans
                assert fits, "beside it"


def test_the_base_stands_beside_the_palm_that_stays_and_never_turns_on_the_ramp(plans) -> None:
    for (seed, _), plan in plans.items():
        ramp = braced_ramp(seed)
        for palm, X_WB, before in zip(moved(plan), plan.base, plan.palms[:-1], strict=True):
            np.testing.assert_array_equal(X_WB[:3, :3], ramp.ramp)
            np.testing.assert_allclose(X_WB, ramp.base(X_WB[0, 3]), atol=1e-12)
            assert X_WB[0, 3] + 0.1 == pytest.approx(before[1 - palm, 0])


def test_postures_have_both_palms_where_the_plan_says_before_and_after_every_step(plans, bracer: Bracer) -> None:
    plant, context = bracer.plant, bracer.plant.CreateDefaultContext()
    for plan in plans.values():
        for k, X_WB in enumerate(plan.base):
            for q, palms in zip(plan.postures[k], plan.palms[k : k + 2], strict=True):
                assert (q >= plant.GetPositionLowerLimits() - 1e-6).all()
                assert (q <= plant.GetPositionUpperLimits() + 1e-6).all()
                plant.SetPositions(context, q)
                for name, point in zip(PALM_FRAMES, palms, strict=True):
                    there = X_WB @ plant.GetFrameByName(name).CalcPoseInWorld(context).GetAsMatrix4()
                    assert np.linalg.norm(there[:3, 3] - point) <= 2.0 * PLACED


def test_wheels_and_the_standing_palm_hold_every_posture_and_some_would_tip_without_it(plans, bracer: Bracer) -> None:
    alone = []
    for (seed, _), plan in plans.items():
        wall = PalmsOnWall(braced_ramp(seed), bracer)
        for palm, X_WB, before, pair in zip(moved(plan), plan.base, plan.palms[:-1], plan.postures, strict=True):
            standing = before[1 - palm]
            number = wall.at(1 - palm, standing[0], standing[2])
            assert number >= 0
            for q in pair:
                com = X_WB[:3, :3] @ bracer.com_of(q) + X_WB[:3, 3]
                assert is_balanced(*wall.check.supports(number), com[:2])
                alone.append(is_balanced(*wall.check.supports(None, X_WB[0, 3]), com[:2]))
    assert not all(alone)


def test_equal_seeds_give_equal_plans(plans, bracer: Bracer) -> None:
    for heuristic in HEURISTICS:
        again, first = plan_braced(braced_ramp(1), bracer, heuristic, 1, DEADLINE), plans[1, heuristic]
        assert again is not None and again.expansions == first.expansions
        for name in ("palms", "base", "postures"):
            np.testing.assert_array_equal(getattr(again, name), getattr(first, name))


def test_traversability_expands_fewer_nodes_than_the_distance_alone(plans) -> None:
    sums = {h: sum(plans[seed, h].expansions for seed in SEEDS) for h in HEURISTICS}
    assert sums["traversability"] < sums["grid"]


@pytest.mark.parametrize("heuristic", HEURISTICS)
def test_without_time_there_is_no_plan(bracer: Bracer, heuristic: Heuristic) -> None:
    assert plan_braced(braced_ramp(0), bracer, heuristic, deadline=0.0) is None


def without(ramp: BracedRamp, *names: str) -> BracedRamp:
    """The ramp with surfaces of its wall broken away."""
    surfaces = tuple(s for s in ramp.wall.surfaces if s.name not in names)
    return dataclasses.replace(ramp, wall=Terrain(surfaces, ramp.wall.obstacles))


@pytest.mark.parametrize("heuristic", HEURISTICS)
def test_where_the_wall_ends_there_is_no_plan(bracer: Bracer, heuristic: Heuristic) -> None:
    gone = without(braced_ramp(0), "above_the_window", "below_the_window")
    assert plan_braced(gone, bracer, heuristic, deadline=10.0) is None


def test_a_start_where_no_wall_takes_a_palm_is_refused(bracer: Bracer) -> None:
    with pytest.raises(ValueError, match="no wall takes a palm at the start"):
        plan_braced(without(braced_ramp(0), "before_the_window"), bracer)


def test_a_step_that_drake_refuses_is_not_in_the_plan(plans, bracer: Bracer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the second posture of the plan is, the robot is made to be unable to take it."""
    first, asked, barred = plans[0, "grid"], [], []
    posture = bracer.posture

    def stiff(palms: np.ndarray, into_wall: np.ndarray) -> np.ndarray | None:
        asked.append(palms)
        if len(asked) == 2:
            barred.append(palms)
        return None if barred and np.array_equal(palms, barred[0]) else posture(palms, into_wall)

    monkeypatch.setattr(bracer, "posture", stiff)
    plan = plan_braced(braced_ramp(0), bracer, "grid", 0, DEADLINE)
    assert plan is not None and plan.refused >= 1
    assert plan.expansions > first.expansions, "the searches add up"
    assert not np.array_equal(plan.palms[1], first.palms[1])
    moved(plan)


def test_a_posture_that_the_linear_program_does_not_hold_is_refused(
    bracer: Bracer, monkeypatch: pytest.MonkeyPatch
) -> None:
    rests, asked = braced_planner._rests, []

    def once(*given) -> bool:
        asked.append(given)
        return len(asked) > 1 and rests(*given)

    monkeypatch.setattr(braced_planner, "_rests", once)
    plan = plan_braced(braced_ramp(0), bracer, "traversability", 0, DEADLINE)
    assert plan is not None and plan.refused >= 1
