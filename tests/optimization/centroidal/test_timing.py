"""Free timing: never worse than fixed timing, within its bounds, and where two closed problems say it must be."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from optimization.centroidal.check import violations
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions, CentroidalWeights
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from optimization.centroidal.timing import TimingOptions, optimise_timing
from optimization.centroidal.timing_step import TimingStep
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.stance import Stance

MASS, G = 76.0, 9.81
WEIGHT = MASS * G
HALF = np.array([[0.11, 0.05], [0.11, 0.05], [0.05, 0.05], [0.05, 0.05]])
FREE = (np.inf, np.inf, np.inf)
RESIDUAL = 1e-6  # [M g, M g m]


def contact(effector, point, normal=(0.0, 0.0, 1.0), mu=0.5):
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    pose = contact_pose(EFFECTORS[effector], np.array(point, float), normal, 0.0)
    return Contact(EFFECTORS[effector], 0, pose, mu, 0.0)


def walk(steps, tilt=0.0, palm=False, seed=0):
    rng = np.random.default_rng(seed)

    def stone():
        rx, ry = rng.uniform(-1, 1, 2) * np.deg2rad(tilt)
        return np.array([np.sin(ry), -np.sin(rx), 1.0])

    held = [contact(0, [0, 0.1, 0], stone()), contact(1, [0, -0.1, 0], stone()), None, None]
    if palm:
        held[2] = contact(2, [0.3, 0.55, 1.2], [0, -1, 0])
    stances = [Stance(tuple(held))]
    for i in range(steps):
        x = stances[-1].contacts[1 - i % 2].p_WC[0] + 0.25
        stances.append(stances[-1].replace(i % 2, contact(i % 2, [x, 0.1 - 0.2 * (i % 2), 0], stone())))
    schedule = ContactSchedule.from_stances(stances, dt=0.2)
    return CentroidalProblem(schedule, MASS, HALF, np.array([0, 0, 0.9]))


def residuals(data, t):
    """Greatest residual of the plan file's difference equations, from world forces alone [M g, M g m]."""
    worst = 0.0
    for n, dt in enumerate(np.diff(t.t)):
        force, moment = np.array([0, 0, -WEIGHT]), np.zeros(3)
        for e in range(4):
            if t.contact[n, e] >= 0:
                held = data.schedule.contacts[t.contact[n, e]]
                p_cop = held.p_WC + held.R_WC[:, :2] @ t.cop_C[n, e]
                force = force + t.force_W[n, e]
                moment = moment + np.cross(p_cop - t.com[n + 1], t.force_W[n, e]) + held.R_WC[:, 2] * t.torque_n[n, e]
        gaps = (
            (t.linear_momentum[n + 1] - t.linear_momentum[n]) / dt - force,
            (t.com[n + 1] - t.com[n] - dt * t.linear_momentum[n + 1] / MASS) / dt * WEIGHT,
            (t.angular_momentum[n + 1] - t.angular_momentum[n]) / dt - moment,
        )
        worst = max(worst, *(float(np.abs(gap).max()) / WEIGHT for gap in gaps))
    return worst


@pytest.mark.parametrize("case", [{"steps": 2}, {"steps": 3, "tilt": 15.0, "palm": True}, {"steps": 2, "seed": 1}])
@pytest.mark.parametrize("total", [None, np.inf])
def test_free_timing_costs_less_by_the_same_rules_within_its_bounds(case, total):
    data, options = walk(**case), CentroidalOptions()
    timing = TimingOptions(total=total, shortest=0.6, longest=1.8)
    timed = optimise_timing(data, options, timing)
    fixed = CentroidalProgram(data, options).solve()
    assert timed.fixed.cost == pytest.approx(fixed.cost, rel=1e-9)
    assert timed.estimate.feasible
    assert timed.estimate.cost < 0.98 * fixed.cost
    assert timed.objective <= timed.fixed_objective
    t = timed.estimate.trajectory
    assert residuals(timed.problem, t) < RESIDUAL
    assert violations(timed.problem, options, t) == []
    # durations are those of the schedule that was solved, each within its bounds, and so is their sum
    assert np.allclose(np.bincount(timed.group, np.diff(t.t)), timed.durations)
    assert (timed.durations >= 0.6 * timed.given - 1e-9).all()
    assert (timed.durations <= 1.8 * timed.given + 1e-9).all()
    if total is None:
        assert timed.durations.sum() <= timed.given.sum() + 1e-6
    else:
        assert timed.durations.sum() > timed.given.sum()
    assert np.array_equal(timed.problem.schedule.active, data.schedule.active)


def test_at_the_optimum_a_second_is_worth_the_same_in_every_phase_that_is_free_to_change():
    """With the sum bound, the gradient of the free durations is the multiplier of the sum (Karush, Kuhn, Tucker)."""
    data = walk(2)
    options = replace(CentroidalOptions(), tolerance=1e-6)
    timed = optimise_timing(
        data, options, TimingOptions(shortest=0.3, longest=3.0, interval=(0.02, 1.0), tolerance=1e-6)
    )
    at_least = timed.durations < 0.3 * timed.given + 1e-6
    at_most = timed.durations > 3.0 * timed.given - 1e-6
    free = ~(at_least | at_most)
    assert free.sum() >= 2
    worth = timed.gradient[free].mean()
    assert np.allclose(timed.gradient[free], worth, rtol=0.05)
    assert (timed.gradient[at_least] > worth).all()  # a longer one would bring less than it takes from the others


def test_the_duration_gradient_is_the_difference_quotient_of_the_fixed_time_optimum():
    data = walk(1, tilt=10.0, palm=True)
    options = replace(CentroidalOptions(), tolerance=1e-9, max_iterations=60)
    program = CentroidalProgram(data, options)
    estimate = program.solve()
    group = data.schedule.phases
    gradient = TimingStep(program, estimate.trajectory, group, data.schedule.dt).gradient()

    def optimum(phase, factor):
        dt = np.where(group == phase, factor * data.schedule.dt, data.schedule.dt)
        longer = CentroidalProgram(replace(data, schedule=replace(data.schedule, dt=dt)), options)
        longer.start_from(estimate.trajectory)
        return longer.solve().cost

    step = 1e-3
    durations = np.bincount(group, data.schedule.dt)
    for phase, duration in enumerate(durations):
        quotient = (optimum(phase, 1 + step) - optimum(phase, 1 - step)) / (2 * step * duration)
        assert gradient[phase] == pytest.approx(quotient, rel=1e-3, abs=1e-3 * np.abs(gradient).max())


def test_one_lift_takes_the_time_at_which_haste_costs_as_much_as_holding_on():
    """A vertical lift between rests: its least cost for each duration is a linear system, its best duration a search."""
    N, given, rise, rate, hold = 8, 1.2, 0.08, 0.02, 300.0
    left, right = contact(0, [0, 0.1, 0]), contact(1, [0, -0.1, 0])
    schedule = ContactSchedule.from_rows([(left, right, None, None)] * N, given / N)
    weights = CentroidalWeights(0.0, rate, 0.0, 0.0, force=hold, torque=1e-3, lateral_force=0.0, pressure_centre=0.0)
    options = CentroidalOptions(
        weights=weights, com_height=(0.5, 0.9 + rise, 1.2), final_half_width=(0.0, 0.0, 0.0), tolerance=1e-7
    )

    def least_cost(duration):
        """min sum dt/0.2 (rate u^2 + 2 hold ((u + Mg) / 2 Mg)^2), u the net force; l[N-1] = l[N] = 0, z[N] = rise."""
        dt = duration / N
        momentum = dt * np.tril(np.ones((N, N)))
        height = dt / MASS * np.tril(np.ones((N, N))) @ momentum
        A = np.stack([momentum[-2], momentum[-1], height[-1]])
        curvature, slope = 2 * (rate + hold / (2 * WEIGHT**2)), hold / WEIGHT
        kkt = np.block([[curvature * np.eye(N), A.T], [A, np.zeros((3, 3))]])
        u = np.linalg.solve(kkt, np.concatenate([-slope * np.ones(N), [0, 0, rise]]))[:N]
        return dt / 0.2 * np.sum(rate * u**2 + hold / 2 * ((u + WEIGHT) / WEIGHT) ** 2)

    best = minimize_scalar(least_cost, bounds=(0.3, 3.0), method="bounded", options={"xatol": 1e-7})
    assert 0.4 < best.x < 2.5
    assert abs(best.x - given) > 0.3
    data = CentroidalProblem(schedule, MASS, HALF, np.array([0, 0, 0.9]))
    timing = TimingOptions(shortest=0.25, longest=4.0, total=np.inf, tolerance=1e-7)
    timed = optimise_timing(data, options, timing)
    assert timed.fixed.cost == pytest.approx(least_cost(given), rel=1e-4)
    assert timed.estimate.cost == pytest.approx(best.fun, rel=1e-4)
    assert timed.durations[0] == pytest.approx(best.x, rel=2e-2)  # the minimum is flat


def test_where_the_given_time_is_too_short_a_longer_one_is_found():
    left, right = contact(0, [0, 0.1, 0]), contact(1, [0, -0.1, 0])
    schedule = ContactSchedule.from_rows([(left, right, None, None)] * 6, 0.05)
    falling = np.array([0, 0, -MASS * 1.2])
    data = CentroidalProblem(schedule, MASS, HALF, np.array([0, 0, 1.0]), initial_linear_momentum=falling)
    options = CentroidalOptions(
        force_limit=(0.65, 0.65, 1, 1), com_height=(0.2, 0.9, 1.2), final_half_width=None,
        angular_momentum_limit=FREE, angular_momentum_rate_limit=FREE,
    )  # fmt: skip
    timed = optimise_timing(data, options, TimingOptions(total=np.inf))
    assert timed.fixed.trajectory is None
    assert timed.estimate.feasible
    assert timed.durations[0] > 1.2 / (0.3 * G)  # v0 / ((F - 1) g), less the last interval
    nowhere = optimise_timing(data, options, TimingOptions())
    assert nowhere.reason == "no trajectory"
    assert not nowhere.estimate.feasible
    assert nowhere.estimate.reason


def test_dear_changes_keep_the_given_intervals():
    data = walk(1)
    timed = optimise_timing(data, timing=TimingOptions(each="interval", change_weight=1e9, total=np.inf))
    assert np.allclose(timed.durations, data.schedule.dt, atol=1e-4)


def test_intervals_of_their_own_are_no_dearer_than_whole_phases():
    data = walk(1)
    options = replace(CentroidalOptions(), tolerance=1e-5)
    phases = optimise_timing(data, options, TimingOptions(tolerance=1e-5))
    each = optimise_timing(data, options, TimingOptions(each="interval", tolerance=1e-5))
    assert each.estimate.feasible
    assert each.objective <= phases.objective * (1 + 1e-3)
    assert len(each.durations) == len(data.schedule.dt)


def test_each_duration_keeps_to_bounds_of_its_own():
    data = walk(1)
    timed = optimise_timing(data, timing=TimingOptions(shortest=(0.5, 1.0, 0.5), longest=(2.0, 1.0, 2.0)))
    assert timed.durations[1] == pytest.approx(timed.given[1])
    assert not np.allclose(timed.durations, timed.given)
    assert timed.objective < timed.fixed_objective


def test_less_time_than_given_is_kept_to():
    data = walk(1)
    timed = optimise_timing(data, timing=TimingOptions(total=2.6))
    assert timed.given.sum() == pytest.approx(2.6)  # it starts within the total
    assert timed.durations.sum() <= 2.6 + 1e-6
    assert timed.estimate.feasible


def test_limits_leave_the_best_so_far():
    data = walk(2)
    one = optimise_timing(data, timing=TimingOptions(max_iterations=1))
    assert one.reason == "iterations"
    assert len(one.records) == 1
    assert one.objective <= one.fixed_objective
    none = optimise_timing(data, timing=TimingOptions(time_limit=1e-9))
    assert none.reason == "time"
    assert none.estimate is none.fixed


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"each": "knot"}, "each"),
        ({"shortest": 1.5}, "shortest"),
        ({"longest": np.inf}, "longest"),
        ({"shortest": (0.5, 1.2)}, "shortest"),
        ({"interval": (0.3, 0.1)}, "interval"),
        ({"total": -1.0}, "total"),
        ({"radius": 0.0}, "radius"),
        ({"change_weight": np.nan}, "change_weight"),
        ({"max_iterations": 0}, "max_iterations"),
    ],
)
def test_options_that_make_no_sense_are_named(change, word):
    with pytest.raises(InputError, match=word):
        TimingOptions(**change)


def test_bounds_that_the_given_times_break_are_named():
    data = walk(1)
    with pytest.raises(InputError, match="outside the bounds"):
        optimise_timing(data, timing=TimingOptions(interval=(0.02, 0.1)))
    with pytest.raises(InputError, match="2 factors for 3 durations"):
        optimise_timing(data, timing=TimingOptions(shortest=(0.5, 1.0)))
    with pytest.raises(InputError, match="shortest durations take"):
        optimise_timing(data, timing=TimingOptions(total=0.5))
