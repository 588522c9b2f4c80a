"""Footsteps: every assignment of surfaces by enumeration, and every answer judged by geometry of its own."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from optimization.balance.friction import stands_alone
from optimization.contact_programs.contact_choice import within
from optimization.contact_programs.contact_query import ContactQuery, FootstepOptions, movers
from optimization.contact_programs.footstep_program import FootstepProgram
from optimization.contact_programs.step_reach import StepReach, step_reach
from optimization.mixed_integer import scip_adapter
from optimization.mixed_integer.solver import MixedIntegerSettings
from scenes.contact import Contact, contact_pose
from scenes.files.scene_source import load_scene
from scenes.footholds.foothold_regions import foothold_regions
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
REACH = step_reach(ESCHER, transition_model())
SOLVER = "scip" if scip_adapter.available() else "drake"
EXACT = MixedIntegerSettings(SOLVER, time_limit=60.0, gap=1e-5)
WITHIN = 2e-4 if SOLVER == "scip" else 0.011  # Drake's branch and bound stops at 1 %
PATCH = 1e-6  # [m] rounding


def plate(name: str, x: tuple[float, float], y: tuple[float, float], z: float = 0.0, pitch: float = 0.0) -> Surface:
    corners = np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]])
    corners[:, 2] += np.tan(pitch) * (corners[:, 0] - np.mean(x))
    return Surface(name, corners)


def standing(terrain: Terrain, x: float = 0.0, heading: float = 0.0) -> Stance:
    packed = pack_terrain(terrain)
    feet = [
        set_down(packed, e, x, y, heading, ESCHER.effectors[k].half_extent)
        for k, (e, y) in enumerate((("left_foot", 0.1), ("right_foot", -0.1)))
    ]
    return Stance((feet[0], feet[1], None, None))


def query(terrain: Terrain, goal: Goal, reach: StepReach = REACH, **options) -> ContactQuery:
    return ContactQuery(terrain, ESCHER, standing(terrain), goal, reach, **options)


STONES = Terrain(
    (
        plate("start", (-0.4, 0.4), (-0.5, 0.5)),
        plate("left", (0.45, 0.85), (0.02, 0.45), 0.05, 0.1),
        plate("right", (0.45, 0.85), (-0.45, -0.02), -0.04, -0.15),
        plate("far", (0.9, 1.8), (-0.5, 0.5), 0.03),
    )
)
TINY = query(STONES, Goal((1.05, 0.0, 0.0), 0.15))


def cheapest_by_enumeration(q: ContactQuery, options: FootstepOptions) -> float:
    """The least cost over all assignments of surfaces, each assignment a small convex program of its own."""
    order = movers(options)
    regions = {
        e: foothold_regions(q.packed, q.robot, e, (0.0, 0.0), holds=partial(stands_alone, "inner")) for e in (0, 1)
    }
    best = np.inf
    for assignment in itertools.product(*(regions[m] for m in order)):
        if any(
            np.hypot(*np.maximum(0, np.abs(a.middle - b.middle)[:2] - 0.5 * np.ptp(a.vertices, axis=0)[:2]
                                 - 0.5 * np.ptp(b.vertices, axis=0)[:2])) > 0.56
            for a, b in itertools.pairwise(assignment)
        ):  # fmt: skip
            continue
        best = min(best, _steps_on(q, options, order, assignment))
    return best


def _steps_on(q: ContactQuery, options: FootstepOptions, order: list[int], assignment) -> float:
    """Steps on given surfaces as a small cone program over (x, y) of each, without binaries or big-M."""
    K = len(order)
    prog = MathematicalProgram()
    X = prog.NewContinuousVariables(2 * K)

    def rows(k: int) -> tuple[np.ndarray, np.ndarray]:
        """p_k = A X + b: the height follows from the plane."""
        r, A, b = assignment[k], np.zeros((3, 2 * K)), np.zeros(3)
        A[0, 2 * k] = A[1, 2 * k + 1] = 1.0
        A[2, 2 * k : 2 * k + 2], b[2] = -r.normal[:2] / r.normal[2], r.offset / r.normal[2]
        return A, b

    def ball(A: np.ndarray, b: np.ndarray, radius: float) -> None:
        prog.AddLorentzConeConstraint(np.vstack([np.zeros((1, 2 * K)), A]), np.append(radius, b), X)

    feet = [(np.zeros((3, 2 * K)), c.p_WC) for c in q.start.contacts[:2]]
    for k, mover in enumerate(order):
        (A, b), (Ao, bo), (As, bs) = rows(k), feet[mover], feet[1 - mover]
        for c, radius in q.reach.discs(1.0 if mover == 0 else -1.0):
            ball((A - As)[:2], (b - bs)[:2] - c, radius)
        ball(A - Ao, b - bo, q.reach.stride)
        prog.AddLinearConstraint((A - As)[2:], -q.reach.rise - (b - bs)[2:], q.reach.rise - (b - bs)[2:], X)
        r = assignment[k]
        prog.AddLinearConstraint(r.A @ A, np.full(len(r.b), -np.inf), r.b - r.A @ b, X)
        prog.Add2NormSquaredCost(np.sqrt(options.step) * (A - Ao), -np.sqrt(options.step) * (b - bo), X)
        feet[mover] = A, b
    A, b = 0.5 * (feet[0][0] + feet[1][0])[:2], 0.5 * (feet[0][1] + feet[1][1])[:2] - np.array(q.goal.xyz[:2])
    ball(A, b, q.goal.radius - 1e-3)
    prog.Add2NormSquaredCost(np.sqrt(options.goal) * A, -np.sqrt(options.goal) * b, X)
    result = ClarabelSolver().Solve(prog)
    return result.get_optimal_cost() if result.is_success() else np.inf


@pytest.mark.parametrize(("num", "first"), [(4, 0), (4, 1), (5, 1)])
def test_the_optimum_is_the_cheapest_assignment_of_surfaces(num: int, first: int) -> None:
    options = FootstepOptions(num, first=first)
    estimate = FootstepProgram(TINY, options).solve(EXACT)
    assert estimate.feasible, estimate.reason
    assert estimate.cost == pytest.approx(cheapest_by_enumeration(TINY, options), rel=WITHIN)


def test_too_few_contacts_are_infeasible_by_enumeration_too() -> None:
    options = FootstepOptions(2)
    estimate = FootstepProgram(TINY, options).solve(EXACT)
    assert not estimate.feasible and estimate.reason
    assert not np.isfinite(cheapest_by_enumeration(TINY, options))


# ---- answers judged on their own


def check_steps(q: ContactQuery, stances: tuple[Stance, ...], chord: float = 0.0) -> None:
    """Whole sole inside its surface, step within the lens (to the chord's error), rise and stride: from poses alone."""
    for before, after in itertools.pairwise(stances):
        changed = [e for e in range(4) if before.contacts[e] != after.contacts[e]]
        assert len(changed) == 1
        e = changed[0]
        if e >= 2:
            continue
        new, old, stand = after.contacts[e], before.contacts[e], after.contacts[1 - e]
        surface = q.terrain.surfaces[new.surface]
        hx, hy = ESCHER.effectors[e].half_extent
        for corner in ((hx, hy, 0), (-hx, hy, 0), (-hx, -hy, 0), (hx, -hy, 0)):
            p = new.p_WC + new.R_WC @ corner
            assert abs(surface.normal @ (p - surface.vertices[0])) < PATCH
            edges = np.roll(surface.vertices, -1, axis=0) - surface.vertices
            assert (np.cross(edges, p - surface.vertices) @ surface.normal > -PATCH).all()
        c, s = np.cos(stand.heading), np.sin(stand.heading)
        x, y = np.array([[c, s], [-s, c]]) @ (new.p_WC - stand.p_WC)[:2]
        centre, side = np.array(q.reach.centre), 1.0 if e == 0 else -1.0
        off = np.array([x - centre[0], side * y - centre[1]])
        away = q.reach.radius - q.reach.half_width
        for sign in (1.0, -1.0):
            # the centres turn with the foot: a chord that is short by its error moves them by that much of their distance
            lever = np.hypot(centre[0], centre[1] + sign * away)
            assert np.hypot(off[0], off[1] - sign * away) <= q.reach.radius + chord * lever + 1e-5
        assert abs(new.p_WC[2] - stand.p_WC[2]) <= q.reach.rise + PATCH
        assert np.linalg.norm(new.p_WC - old.p_WC) <= q.reach.stride + 1e-5
    mean = 0.5 * (stances[-1].contacts[0].p_WC + stances[-1].contacts[1].p_WC)
    assert np.hypot(*(mean[:2] - q.goal.xyz[:2])) <= q.goal.radius


@pytest.mark.parametrize("seed", [0, 3])
def test_steps_over_the_rubble_field_are_real_contacts_within_reach(seed: int) -> None:
    scene = load_scene("rubble_field", seed=seed)
    q = query(scene.terrain, scene.goal)
    estimate = FootstepProgram(q, FootstepOptions(14)).solve(
        MixedIntegerSettings(SOLVER, time_limit=20, first_only=True)
    )
    assert estimate.feasible, estimate.reason
    check_steps(q, estimate.stances)


def test_a_turn_goes_round_in_pieces_whose_error_is_that_of_the_chord() -> None:
    floor = Terrain((plate("floor", (-1, 3), (-1, 3)),))
    q = query(floor, Goal((0.5, 0.5, 0.0), 0.3, np.pi / 2))
    piece = np.deg2rad(30.0)
    headings = tuple((k * piece, (k + 1) * piece) for k in range(3))
    estimate = FootstepProgram(q, FootstepOptions(8, headings=headings)).solve(
        MixedIntegerSettings(SOLVER, time_limit=40, gap=0.1)
    )
    assert estimate.feasible, estimate.reason
    check_steps(q, estimate.stances, chord=1.0 - np.cos(piece / 2))
    feet = estimate.stances[-1].contacts[:2]
    assert 0.5 * (feet[0].heading + feet[1].heading) == pytest.approx(np.pi / 2, abs=np.deg2rad(15.1))
    turns = [abs(a.heading - b.heading) for stance in estimate.stances for a, b in [stance.contacts[:2]]]
    assert max(turns) <= max(q.reach.turn_in, q.reach.turn_out) + 1e-6


def test_trimmed_steps_are_no_more_than_the_goal_needs() -> None:
    q = query(Terrain((plate("floor", (-1, 3), (-1, 1)),)), Goal((0.6, 0.0, 0.0), 0.2))
    whole = FootstepProgram(q, FootstepOptions(10, contact=10.0, trim=True)).solve(EXACT)
    check_steps(q, whole.stances)
    least = next(n for n in range(1, 10) if FootstepProgram(q, FootstepOptions(n)).solve(EXACT).feasible)
    # The pattern's parity decides which foot moves first once steps are left out: one more at most.
    assert least <= len(whole.stances) - 1 <= least + 1


def test_a_narrowed_pair_of_surfaces_keeps_the_feet_closer_and_a_barred_one_is_not_used() -> None:
    options = FootstepOptions(5, first=1)
    free = FootstepProgram(TINY, options).solve(EXACT)
    pairs = {(s.contacts[0].surface, s.contacts[1].surface) for s in free.stances[1:-1]}
    barred = replace(TINY, narrowed=dict.fromkeys(pairs - {(0, 0), (3, 3)}, 0.0))
    estimate = FootstepProgram(barred, options).solve(EXACT)
    assert barred.narrowed and estimate.feasible, estimate.reason
    assert estimate.cost >= free.cost * (1 - WITHIN)
    assert not set(barred.narrowed) & {(s.contacts[0].surface, s.contacts[1].surface) for s in estimate.stances}
    floor = Terrain((plate("floor", (-1, 3), (-1, 1)),))
    q = query(floor, Goal((1.0, 0.0, 0.0), 0.2))
    narrow = replace(q, narrowed={(0, 0): 0.6})
    estimate = FootstepProgram(narrow, FootstepOptions(12)).solve(replace(EXACT, gap=0.1))
    check_steps(replace(q, reach=q.reach.scaled(0.6)), estimate.stances)


def test_a_forbidden_assignment_is_not_found_again_and_costs_no_less() -> None:
    program = FootstepProgram(TINY, FootstepOptions(4, first=1))
    first = program.solve(EXACT)
    used = {i: s.contacts[m].surface for i, (m, s) in enumerate(zip(program.movers, first.stances[1:], strict=True))}
    program.forbid(used)
    second = program.solve(EXACT)
    if second.feasible:
        again = {
            i: s.contacts[m].surface for i, (m, s) in enumerate(zip(program.movers, second.stances[1:], strict=True))
        }
        assert again != used
        assert second.cost >= first.cost * (1 - WITHIN)
    with pytest.raises(ValueError, match="cannot bar"):
        program.forbid({})


def test_palms_are_held_within_an_arm_of_the_shoulder_and_may_stay_free() -> None:
    wall = Surface("wall", np.array([[-1, 0.55, 0.8], [2, 0.55, 0.8], [2, 0.55, 1.6], [-1, 0.55, 1.6]]))
    wall = wall if wall.normal[1] < 0 else wall.flipped()
    terrain = Terrain((plate("floor", (-1, 2), (-1, 0.5)), wall))
    q = query(terrain, Goal((0.7, 0.0, 0.0), 0.2))
    estimate = FootstepProgram(q, FootstepOptions(9, palms=(2,))).solve(
        MixedIntegerSettings(SOLVER, time_limit=30, gap=0.1)
    )
    assert estimate.feasible, estimate.reason
    held = [s for s in estimate.stances if s.contacts[2] is not None]
    assert held  # leaving it free costs
    for stance in held:
        palm, shoulder = stance.contacts[2], stance.feet_mean() + np.array(q.reach.shoulder)
        assert palm.surface == 1
        assert np.linalg.norm(palm.p_WC - shoulder) <= q.reach.arm + 1e-5
    free = FootstepProgram(q, FootstepOptions(9, palms=(2,), free_palm=-10.0)).solve(
        MixedIntegerSettings(SOLVER, time_limit=30, gap=0.1)
    )
    assert all(s.contacts[2] is None for s in free.stances)


def test_a_palm_is_held_while_a_foot_stands_where_it_could_not_stand_alone() -> None:
    scene = load_scene("tilted_slab")
    q = query(scene.terrain, Goal((1.7, 0.1, 0.0), 0.3))
    options = FootstepOptions(18, palms=(2,), free_palm=-0.1)  # free where it may be
    estimate = FootstepProgram(q, options).solve(MixedIntegerSettings(SOLVER, time_limit=40, first_only=True))
    assert estimate.feasible, estimate.reason
    slab = next(k for k, s in enumerate(scene.terrain.surfaces) if s.name == "slab")
    on_slab = 0
    for before, after in itertools.pairwise(estimate.stances):
        for foot in (0, 1):
            if before.contacts[foot] != after.contacts[foot] and before.contacts[1 - foot].surface == slab:
                on_slab += 1
                assert before.contacts[2] is not None
    assert on_slab


def test_a_goal_out_of_reach_is_told_without_a_solver() -> None:
    q = query(Terrain((plate("floor", (-1, 1), (-1, 1)), plate("island", (5, 6), (-1, 1)))), Goal((5.5, 0, 0), 0.2))
    estimate = FootstepProgram(q, FootstepOptions(12)).solve()
    assert not estimate.feasible and estimate.record is None
    assert "no surface takes it within reach" in estimate.reason


def test_the_lens_spans_the_transition_model() -> None:
    steps = transition_model().steps
    (a, ra), (b, rb) = REACH.discs(1.0)
    inside = [np.hypot(*(s[:2] - a)) <= ra and np.hypot(*(s[:2] - b)) <= rb for s in steps]
    assert np.mean(inside) > 0.7  # a lens has no corners
    assert all(np.hypot(*s[:2]) <= REACH.farthest for s in steps)
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 201), np.linspace(-1, 1, 201)), axis=-1).reshape(-1, 2)
    lens = grid[(np.linalg.norm(grid - a, axis=1) <= ra) & (np.linalg.norm(grid - b, axis=1) <= rb)]
    assert np.linalg.norm(lens, axis=1).max() <= REACH.farthest
    small = REACH.scaled(0.5)
    (a, ra), (b, rb) = small.discs(1.0)
    shrunk = np.array(REACH.centre) + 0.5 * (lens - REACH.centre)
    assert (np.linalg.norm(shrunk - a, axis=1) <= ra + 1e-9).all()
    assert (np.linalg.norm(shrunk - b, axis=1) <= rb + 1e-9).all()


def test_regions_that_touch_a_disc_are_within_it() -> None:
    regions = foothold_regions(pack_terrain(STONES), ESCHER, 0, (0.0, 0.0))
    at = np.array([0.0, 0.0, 0.0])
    nearest = {r.surface: min(np.hypot(*v[:2]) for v in r.vertices) for r in regions}
    far = nearest[3]
    assert {r.surface for r in within(regions, at, far + 0.05)} >= {0, 3}
    assert 3 not in {r.surface for r in within(regions, at, 0.5 * far)}


@pytest.mark.parametrize(
    "options",
    [{"num_contacts": 0}, {"first": 2}, {"palms": (1,)}, {"headings": ((1.0, 0.0),)}, {"headings": ((np.nan, 1.0),)}],
)
def test_options_that_make_no_sense_are_refused(options: dict) -> None:
    with pytest.raises(InputError, match="mixed-integer planner"):
        FootstepOptions(**options)


def test_a_query_without_feet_or_with_a_goal_that_is_no_number_is_refused() -> None:
    palm = Contact("left_palm", 0, contact_pose("left_palm", [0, 0, 1], [0, -1, 0], 0.0), 0.5)
    with pytest.raises(InputError, match="both feet"):
        ContactQuery(STONES, ESCHER, Stance((None, None, palm, None)), TINY.goal, REACH)
    with pytest.raises(InputError, match="goal"):
        replace(TINY, goal=Goal((np.nan, 0, 0)))
