"""The centroidal program against closed forms, invariants, another solver and an independent optimiser."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from optimization.balance.friction import CONES, contains
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions, CentroidalWeights
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS
from scenes.stance import Stance

MASS = 76.0
G = 9.81
WEIGHT = MASS * G
UP = np.array([0.0, 0.0, 1.0])
HALF = np.array([[0.11, 0.05], [0.11, 0.05], [0.05, 0.05], [0.05, 0.05]])
ROUNDING = 1e-9  # [M g, M g m]: what double precision leaves of sums over a hundred knots
CLOSE = 2e-4  # relative: the iteration ends when the cost stands still to 1e-3, quadratically before that
SOLVERS = ("piqp", "clarabel")


def contact(effector, point, normal=(0.0, 0.0, 1.0), mu=0.5, yaw=0.0):
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    return Contact(
        EFFECTORS[effector], 0, contact_pose(EFFECTORS[effector], np.array(point, float), normal, yaw), mu, yaw
    )


def feet(mu=0.5, normal=(0.0, 0.0, 1.0)):
    return contact(0, [0, 0.1, 0], normal, mu), contact(1, [0, -0.1, 0], normal, mu)


def standing(duration=1.0, dt=0.1, mu=0.5, normal=(0.0, 0.0, 1.0)):
    left, right = feet(mu, normal)
    return ContactSchedule.from_rows([(left, right, None, None)] * round(duration / dt), dt)


def problem(schedule, com=(0.0, 0.0, 0.9), **more):
    return CentroidalProblem(schedule, MASS, HALF, np.array(com, float), **more)


def solve(data, **changes):
    return CentroidalProgram(data, replace(CentroidalOptions(), **changes)).solve()


def walk(steps, tilt=0.0, palms=0, seed=0, stride=0.25):
    """Stances of a walk forward with feet on stones tilted by up to `tilt` [deg] and palms on vertical walls."""
    rng = np.random.default_rng(seed)

    def stone():
        rx, ry = rng.uniform(-1, 1, 2) * np.deg2rad(tilt)
        return np.array([np.sin(ry) * np.cos(rx), -np.sin(rx), np.cos(rx) * np.cos(ry)])

    def palm(e, x):
        side = 1 if e == 2 else -1
        return contact(e, [x, 0.55 * side, 1.2], [0, -side, 0])

    held = [contact(0, [0, 0.1, 0], stone()), contact(1, [0, -0.1, 0], stone())]
    held += [palm(2 + i, 0.3) if i < palms else None for i in range(2)]
    stances = [Stance(tuple(held))]
    for i in range(steps):
        e = i % 2
        x = stances[-1].contacts[1 - e].p_WC[0] + stride
        stances.append(stances[-1].replace(e, contact(e, [x, 0.1 - 0.2 * e, 0], stone())))
        if e == 1:
            for q in range(palms):
                stances.append(stances[-1].replace(2 + q, palm(2 + q, x + 0.3)))
    return stances


def walking(stances, dt=0.2):
    schedule = ContactSchedule.from_stances(stances, dt=dt, shift_time=1.0, swing_time=1.0)
    return problem(schedule, stances[0].feet_mean() + 0.9 * UP)


def residuals(data, t):
    """Greatest residuals of the plan file's three equations, from world forces alone, in M g and M g m."""
    worst = np.zeros(3)
    for n in range(len(t.t) - 1):
        dt = t.t[n + 1] - t.t[n]
        force, moment = np.array([0, 0, -WEIGHT]), np.zeros(3)
        for e in range(4):
            index = t.contact[n, e]
            if index < 0:
                assert not t.force_W[n, e].any()
                assert t.torque_n[n, e] == 0
                continue
            held = data.schedule.contacts[index]
            p_cop = held.p_WC + held.R_WC[:, :2] @ t.cop_C[n, e]
            force = force + t.force_W[n, e]
            moment = moment + np.cross(p_cop - t.com[n + 1], t.force_W[n, e]) + held.R_WC[:, 2] * t.torque_n[n, e]
        gaps = (
            (t.linear_momentum[n + 1] - t.linear_momentum[n]) / dt - force,
            (t.com[n + 1] - t.com[n] - dt * t.linear_momentum[n + 1] / MASS) / dt * WEIGHT,
            (t.angular_momentum[n + 1] - t.angular_momentum[n]) / dt - moment,
        )
        worst = np.maximum(worst, [np.abs(gap).max() / WEIGHT for gap in gaps])
    return worst


def corner_forces_exist(mu, half, force, cop, torque):
    """Whether four corner forces inside the octagon add up to this wrench, by HiGHS."""
    angle = np.arange(8) * np.pi / 4
    rays = np.stack([mu * np.cos(angle), mu * np.sin(angle), np.ones(8)], axis=1)
    corners = np.array([[sx * half[0], sy * half[1], 0] for sx in (1, -1) for sy in (1, -1)])
    columns = [np.concatenate([ray, np.cross(corner, ray)]) for corner in corners for ray in rays]
    moment = np.cross([*cop, 0], force) + torque * UP
    # the least that each of the six equations has to be broken, [M g] and [M g m]
    A = np.hstack([np.array(columns).T, np.eye(6), -np.eye(6)])
    cost = np.concatenate([np.zeros(32), np.ones(12)])
    answer = linprog(cost, A_eq=A, b_eq=np.concatenate([force, moment]) / WEIGHT, method="highs")
    return answer.status == 0 and answer.fun < 1e-6


@pytest.mark.parametrize("solver", SOLVERS)
def test_forces_carry_the_weight_when_standing_still(solver):
    data = problem(standing())
    estimate = solve(data, solver=solver, final_half_width=(0.0, 0.0, 0.0))
    t = estimate.trajectory
    assert estimate.feasible, estimate.reason
    assert np.allclose(t.force_W.sum(axis=1), [0, 0, WEIGHT], atol=1e-4)
    assert np.allclose(t.force_W[:, :2, 2], WEIGHT / 2, atol=1e-2)
    assert np.allclose(t.com, [0, 0, 0.9], atol=1e-6)
    assert np.allclose(t.angular_momentum, 0, atol=1e-4)
    assert np.allclose(t.cop_C, 0, atol=1e-4)
    assert not t.force_W[:, 2:].any()
    # 10 knots of 0.1 s, two feet: w_f |f|^2 with f = 1/2 each
    assert estimate.cost == pytest.approx(10 * 0.5 * 2 * 0.01 * 0.25, rel=1e-3)


def test_the_pressure_centre_stays_under_a_com_that_stands_off_the_middle():
    data = problem(standing(), com=(0.03, 0.02, 0.9))
    estimate = solve(replace(data, com_reference=np.tile(data.initial_com, (11, 1))))
    t = estimate.trajectory
    assert estimate.feasible, estimate.reason
    p_cop = t.cop_C[:, :2] + np.array([[0, 0.1], [0, -0.1]])
    share = t.force_W[:, :2, 2:] / t.force_W[:, :2, 2:].sum(axis=1, keepdims=True)
    assert np.allclose((share * p_cop).sum(axis=1), t.com[:, :2], atol=2e-3)


@pytest.mark.parametrize(("tilt", "palms"), [(0, 0), (20, 0), (20, 1), (20, 2)])
def test_a_walk_obeys_newton_and_euler_to_rounding_and_ends_at_rest(tilt, palms):
    data = walking(walk(4, tilt=tilt, palms=palms, seed=3))
    estimate = solve(data)
    t = estimate.trajectory
    assert estimate.feasible, estimate.reason
    assert residuals(data, t).max() < ROUNDING
    assert np.abs(t.linear_momentum[[0, -1]]).max() < 1e-4
    assert np.abs(t.angular_momentum[[0, -1]]).max() < 1e-4
    for array in (t.contact, t.force_W, t.cop_C, t.torque_n):
        assert np.array_equal(array[-1], array[-2])
    held = t.contact >= 0
    assert np.array_equal(held[:-1], data.schedule.active >= 0)
    for n, e in zip(*np.nonzero(held[:-1]), strict=True):
        here = data.schedule.contacts[t.contact[n, e]]
        force_C = here.R_WC.T @ t.force_W[n, e]
        assert contains("inner", here.friction, force_C, 1e-6 * WEIGHT)
        assert (np.abs(t.cop_C[n, e]) <= HALF[e] + 1e-9).all()
    for n in range(0, len(t.t) - 1, 3):
        for e in np.flatnonzero(held[n]):
            here = data.schedule.contacts[t.contact[n, e]]
            force_C = here.R_WC.T @ t.force_W[n, e]
            assert corner_forces_exist(here.friction, HALF[e], force_C, t.cop_C[n, e], t.torque_n[n, e])


def test_the_lp_refuses_wrenches_that_only_the_pressure_centre_and_the_cone_allow():
    # full friction needs all of it at each corner: no yaw torque is left
    force = WEIGHT * np.array([0.5, 0.0, 1.0])
    assert corner_forces_exist(0.5, HALF[0], force, (0, 0), 0.0)
    assert not corner_forces_exist(0.5, HALF[0], force, (0, 0), 0.02 * WEIGHT)


def test_nothing_but_gravity_acts_in_flight():
    left, right = feet()
    rows = [(left, right, None, None)] * 6 + [(None,) * 4] * 2 + [(left, right, None, None)] * 6
    data = problem(ContactSchedule.from_rows(rows, 0.1))
    estimate = solve(data)
    t = estimate.trajectory
    assert estimate.feasible, estimate.reason
    assert not t.force_W[6:8].any()
    assert np.allclose(np.diff(t.angular_momentum[6:9], axis=0), 0, atol=1e-12)
    assert np.allclose(np.diff(t.linear_momentum[6:9], axis=0), [0, 0, -WEIGHT * 0.1], atol=1e-9)
    assert residuals(data, t).max() < ROUNDING


def test_a_mirrored_walk_costs_the_same():
    stances = walk(4, tilt=15, palms=1, seed=1)

    def mirror(c):
        swap = {"left": "right", "right": "left"}
        side, part = c.effector.split("_")
        X_WC = np.diag([1, -1, 1, 1]) @ c.X_WC @ np.diag([1, -1, 1, 1])
        return Contact(f"{swap[side]}_{part}", 0, X_WC, c.friction)

    mirrored = [
        Stance(tuple(None if s.contacts[i] is None else mirror(s.contacts[i]) for i in (1, 0, 3, 2))) for s in stances
    ]
    one, other = solve(walking(stances), tolerance=1e-6), solve(walking(mirrored), tolerance=1e-6)
    assert one.feasible
    assert other.feasible
    assert other.cost == pytest.approx(one.cost, rel=1e-5)
    assert np.allclose(one.trajectory.com * [1, -1, 1], other.trajectory.com, atol=1e-4)


@pytest.mark.parametrize(("tilt", "palms"), [(20, 0), (20, 2)])
def test_clarabel_and_piqp_agree(tilt, palms):
    data = walking(walk(3, tilt=tilt, palms=palms, seed=5))
    one, other = (solve(data, solver=solver) for solver in SOLVERS)
    assert one.feasible
    assert other.feasible
    assert one.cost == pytest.approx(other.cost, rel=CLOSE)
    assert np.allclose(one.trajectory.com, other.trajectory.com, atol=1e-3)


def test_a_slope_of_30_deg_is_impossible_at_friction_one_half_under_every_true_cone():
    normal = np.array([np.sin(np.pi / 6), 0, np.cos(np.pi / 6)])
    data = problem(standing(normal=normal))
    for cone in CONES:
        estimate = solve(data, cone=cone)
        assert estimate.feasible == (cone == "diamond"), cone
        if cone != "diamond":
            assert estimate.trajectory is None
            assert "friction cone of" in estimate.reason
            assert "M g short" in estimate.reason


@pytest.mark.parametrize(
    ("degrees", "cone", "stands"), [(24, "inner", True), (26, "second_order", True), (20.5, "square", False)]
)
def test_standing_on_a_slope_stops_where_the_cone_does(degrees, cone, stands):
    angle = np.deg2rad(degrees)
    estimate = solve(problem(standing(normal=[np.sin(angle), 0, np.cos(angle)])), cone=cone)
    assert estimate.feasible == stands


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_push_that_moves_the_capture_point_off_the_feet_is_lost_only_where_k_and_kdot_are_bounded(solver):
    # linear inverted pendulum: the capture point of 1 m/s at 0.9 m is 0.30 m ahead, the toes are at 0.11 m
    data = problem(standing(1.5), initial_linear_momentum=MASS * np.array([1.0, 0.0, 0.0]))
    bounded = solve(data, solver=solver, final_half_width=None)
    assert not bounded.feasible
    assert "angular momentum" in bounded.reason
    infinite = (np.inf, np.inf, np.inf)
    free = solve(
        data,
        solver=solver,
        final_half_width=None,
        angular_momentum_limit=infinite,
        angular_momentum_rate_limit=infinite,
    )
    assert free.feasible
    assert np.abs(np.diff(free.trajectory.angular_momentum, axis=0) / 0.1).max() > 60.0
    # 0.3 m/s is captured inside the feet with hardly any angular momentum
    gentle = solve(
        replace(data, initial_linear_momentum=MASS * np.array([0.3, 0.0, 0.0])), solver=solver, final_half_width=None
    )
    assert gentle.feasible
    assert np.abs(gentle.trajectory.angular_momentum).max() < 0.5


def test_the_limits_on_k_and_kdot_hold_where_they_bind():
    data = problem(standing(1.5), initial_linear_momentum=MASS * np.array([0.5, 0.0, 0.0]))
    free = solve(data, final_half_width=None)
    rate = np.abs(np.diff(free.trajectory.angular_momentum, axis=0) / 0.1).max()
    most = 0.8 * rate
    bound = solve(data, final_half_width=None, angular_momentum_rate_limit=(most, most, most))
    assert free.feasible
    assert bound.feasible, bound.reason
    assert np.abs(np.diff(bound.trajectory.angular_momentum, axis=0) / 0.1).max() <= most * (1 + 1e-3)
    assert bound.cost > free.cost


def test_the_com_stays_in_its_box_over_the_feet_within_reach_and_ends_in_the_final_box():
    data = walking(walk(3, seed=4))
    free = solve(data)
    reference = free.trajectory.com + 0.01 * np.sin(np.arange(data.schedule.num_knots))[:, None] * [0, 1, 0]
    box = np.full((data.schedule.num_knots, 3), 0.015)
    held = solve(replace(data, com_reference=reference, com_box=box))
    assert held.feasible, held.reason
    assert (np.abs(held.trajectory.com - reference)[1:] <= box[1:] + 1e-6).all()
    low = solve(data, com_height=(0.5, 0.8, 0.85), com_reach=(0.9, 0.9, 0.9, 0.9))
    assert low.feasible, low.reason
    assert low.trajectory.com[1:, 2].max() <= 0.85 + 1e-6 < free.trajectory.com[1:, 2].max()
    last = np.mean([c.p_WC for c in data.schedule.contacts[-2:]], axis=0) + 0.9 * UP
    assert (np.abs(free.trajectory.com[-1] - last) <= 0.12 + 1e-6).all()


def test_a_reference_pulls_com_and_angular_momentum_towards_itself():
    data = problem(standing(2.0))
    knots = data.schedule.num_knots
    swing = np.sin(np.linspace(0, np.pi, knots))[:, None]
    com = data.initial_com + swing * [0.0, 0.03, 0.0]
    followed = solve(replace(data, com_reference=com), weights=CentroidalWeights(com_tracking=1e7))
    assert followed.feasible, followed.reason
    assert np.abs(followed.trajectory.com - com).max() < 5e-3
    wanted = swing**2 * [2.0, 0.0, 0.0]
    turned = solve(replace(data, angular_momentum_reference=wanted))
    assert turned.feasible, turned.reason
    assert np.abs(turned.trajectory.angular_momentum - wanted).max() < 0.6
    assert np.abs(solve(data).trajectory.angular_momentum - wanted).max() > 1.5


def test_the_pull_towards_a_reference_is_not_counted_as_cost():
    data = problem(standing())
    plain = solve(data)
    pulled = solve(replace(data, com_reference=np.tile(data.initial_com + 0.05 * UP, (11, 1))))
    assert pulled.feasible
    assert plain.cost < pulled.cost < plain.cost + 1000 * 0.05**2 * 10 * 0.5


def test_an_earlier_answer_is_a_start_from_which_one_program_suffices():
    data = walking(walk(2, tilt=20, palms=1, seed=7))
    first = CentroidalProgram(data).solve()
    again = CentroidalProgram(data)
    again.start_from(first.trajectory)
    second = again.solve()
    assert len(first.records) > 1
    assert len(second.records) == 1
    assert second.cost == pytest.approx(first.cost, rel=2e-3)
    assert again.solve().cost == pytest.approx(first.cost, rel=2e-3)


def test_every_cost_and_constraint_has_a_name():
    prog = CentroidalProgram(walking(walk(1, palms=1))).prog
    bindings = [b for b in (*prog.GetAllConstraints(), *prog.quadratic_costs()) if not b.evaluator().get_description()]
    assert not bindings


def test_force_limits_hold_and_too_small_ones_are_named():
    data = problem(standing(), com=(0.0, 0.05, 0.9))
    limited = solve(data, force_limit=(0.55, 0.55, 0.5, 0.5), final_half_width=(0.2, 0.2, 0.2))
    assert limited.feasible, limited.reason
    assert limited.trajectory.force_W[..., 2].max() <= 0.55 * WEIGHT * (1 + 1e-6)
    refused = solve(data, force_limit=(0.3, 0.3, 0.5, 0.5))
    assert not refused.feasible
    assert "force limit" in refused.reason


def test_an_infeasible_problem_says_which_block_fails_and_where():
    too_high = solve(problem(standing(0.5)), com_height=(1.6, 1.7, 1.8))
    assert too_high.reason.startswith("com height cannot be met at knot 1 (0.10 s)")
    too_fast = solve(problem(standing(0.5), initial_linear_momentum=np.array([0.0, 0.0, 5000.0])))
    too_far = solve(problem(standing(0.5), com=(0.6, 0.0, 0.9)), final_half_width=(0.01, 0.01, 0.01))
    for estimate in (too_high, too_fast, too_far):
        assert not estimate.feasible
        assert estimate.trajectory is None
        assert estimate.cost == np.inf
        assert "short" in estimate.reason


def test_shorter_intervals_change_the_cost_little_and_ever_less():
    """Backward Euler is of first order: half the interval leaves about half the error, here less than 3 % at 0.2 s."""
    stances = walk(2)
    coarse, fine, finer = (solve(walking(stances, dt=dt)) for dt in (0.2, 0.1, 0.05))
    assert coarse.feasible and fine.feasible and finer.feasible
    assert fine.cost == pytest.approx(coarse.cost, rel=0.03)
    assert abs(finer.cost - fine.cost) < 0.7 * abs(fine.cost - coarse.cost)


@settings(max_examples=8)
@given(
    seed=st.integers(0, 10_000),
    tilt=st.floats(0, 25),
    velocity=st.tuples(st.floats(-0.2, 0.5), st.floats(-0.3, 0.3)),
    palms=st.integers(0, 2),
    cone=st.sampled_from(("inner", "square")),
)
def test_what_is_called_feasible_obeys_every_law(seed, tilt, velocity, palms, cone):
    stances = walk(1, tilt=tilt, palms=palms, seed=seed)[:2]
    data = replace(walking(stances), initial_linear_momentum=MASS * np.array([*velocity, 0.0]))
    estimate = solve(data, cone=cone)
    if estimate.trajectory is None:
        assert not estimate.feasible
        return
    assert residuals(data, estimate.trajectory).max() < ROUNDING
    if not estimate.feasible:
        assert estimate.reason
        return
    t = estimate.trajectory
    assert np.abs(t.linear_momentum[-1]).max() < 1e-2
    assert np.abs(t.angular_momentum).max() <= 30.0 * 1.002
    assert t.com[1:, 2].min() >= 0.6 - 1e-3
