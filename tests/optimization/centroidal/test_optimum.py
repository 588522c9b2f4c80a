"""The optimum of the centroidal program, certified by an independent optimiser and by steps away from it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from optimization.balance.friction import wrench_rows
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.model import CentroidalModel
from optimization.centroidal.options import CentroidalOptions, CentroidalWeights
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from optimization.convex.sequential_convex import minimise
from optimization.convex.solver import ConvexSolver
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS

MASS = 76.0
WEIGHT = MASS * 9.81
HALF = np.array([[0.11, 0.05], [0.11, 0.05], [0.05, 0.05], [0.05, 0.05]])


def contact(effector, point, normal):
    name = EFFECTORS[effector]
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    return Contact(name, 0, contact_pose(name, np.array(point, float), normal, 0.0), 0.5)


def test_a_tiny_problem_has_the_optimum_that_slsqp_finds_for_the_textbook_equations():
    """Variables are wrenches, SI, cost and constraints written from Lin 2020 alone; the cone is Caron's 17 rows."""
    dt, intervals = 0.2, 4
    foot = contact(0, [0.02, 0.1, 0.0], [0, 0, 1])
    schedule = ContactSchedule.from_rows([(foot, None, None, None)] * intervals, dt)
    push = MASS * np.array([0.02, 0.08, 0.0])
    data = CentroidalProblem(schedule, MASS, HALF, np.array([0.03, 0.125, 0.9]), initial_linear_momentum=push)
    rows = wrench_rows(0.5, HALF[0])

    def roll_out(x):
        l, com, k, cost, at_end = data.initial_linear_momentum, data.initial_com, np.zeros(3), 0.0, []
        for wrench in WEIGHT * x.reshape(intervals, 6):
            f, m = wrench[:3], wrench[3:]
            l_rate = f - [0, 0, WEIGHT]
            l = l + dt * l_rate
            com = com + dt * l / MASS
            k_rate = np.cross(foot.p_WC - com, f) + m
            k = k + dt * k_rate
            cop = np.array([-m[1], m[0]]) / f[2]
            torque = m[2] - (cop[0] * f[1] - cop[1] * f[0])
            cost += 0.2 * l @ l + 0.01 * l_rate @ l_rate + 1.0 * k @ k + 0.3 * k_rate @ k_rate
            cost += (0.01 * f @ f + 10.0 * f[:2] @ f[:2]) / WEIGHT**2
            cost += torque**2 + np.sum((cop / (2 * HALF[0])) ** 2)
            at_end += [l, k]
        return cost, np.concatenate(at_end[-4:])

    start = np.tile([0, 0, 1.0, 0, 0, 0], intervals)
    answer = minimize(
        lambda x: 1e-2 * roll_out(x)[0],
        start,
        method="SLSQP",
        options={"maxiter": 300, "ftol": 1e-12},
        constraints=[
            {"type": "eq", "fun": lambda x: roll_out(x)[1] / 10},
            {"type": "ineq", "fun": lambda x: -(rows @ x.reshape(-1, 6).T).ravel()},
        ],
    )
    assert answer.success, answer.message
    options = replace(CentroidalOptions(), cone="square", final_half_width=None, tolerance=1e-7)
    ours = CentroidalProgram(data, options).solve()
    assert ours.feasible, ours.reason
    assert ours.cost == pytest.approx(100 * answer.fun, rel=1e-3)
    used = (rows @ answer.x.reshape(-1, 6).T).max(axis=1)
    assert used[5:9].max() > -1e-4  # the optimum leans on an edge of the patch: a constraint is active


def test_the_cost_is_the_documents_objective_of_the_numbers_that_are_written():
    left, right = contact(0, [0, 0.1, 0], [0.2, 0.1, 1]), contact(1, [0, -0.1, 0], [-0.1, 0.2, 1])
    palm = contact(2, [0.2, 0.5, 1.2], [0, -1, 0])
    rows = [(left, right, palm, None)] * 4 + [(left, None, palm, None)] * 6
    push = MASS * np.array([0.15, 0.1, 0.02])
    w = CentroidalWeights(torque=0.01)
    for dt in (0.2, 0.1):
        schedule = ContactSchedule.from_rows(rows, dt)
        data = CentroidalProblem(schedule, MASS, HALF, np.array([0.0, 0.02, 0.9]), initial_linear_momentum=push)
        estimate = CentroidalProgram(data, CentroidalOptions(rest_at_end=False, weights=w)).solve()
        t = estimate.trajectory
        assert estimate.feasible, estimate.reason
        cost = 0.0
        for n in range(len(rows)):
            l_rate, k_rate = (np.diff(a[n : n + 2], axis=0)[0] / dt for a in (t.linear_momentum, t.angular_momentum))
            cost += w.linear_momentum * np.sum(t.linear_momentum[n + 1] ** 2) + w.linear_momentum_rate * l_rate @ l_rate
            cost += w.angular_momentum * np.sum(t.angular_momentum[n + 1] ** 2)
            cost += w.angular_momentum_rate * k_rate @ k_rate
            for e in np.flatnonzero(t.contact[n] >= 0):
                force_C = data.schedule.contacts[t.contact[n, e]].R_WC.T @ t.force_W[n, e] / WEIGHT
                part = min(force_C[2] / 0.01, 1.0)  # below 1 % of the weight the moments count as over 1 %
                turn = t.cop_C[n, e, 0] * force_C[1] - t.cop_C[n, e, 1] * force_C[0]
                cost += w.force * force_C @ force_C + w.lateral_force * force_C[:2] @ force_C[:2]
                cost += w.torque * (t.torque_n[n, e] + WEIGHT * turn * (1 - part)) ** 2
                cost += w.pressure_centre * np.sum((part * t.cop_C[n, e] / (2 * HALF[e])) ** 2)
        assert estimate.cost == pytest.approx(cost * dt / 0.2, rel=1e-9)
        assert np.abs(t.torque_n).max() > 0.1
        assert np.abs(t.cop_C[:, :2]).max() > 0.01


def test_no_step_towards_another_feasible_trajectory_lowers_the_cost():
    left, right = contact(0, [0, 0.1, 0], [0.2, 0.1, 1]), contact(1, [0, -0.1, 0], [-0.1, 0.2, 1])
    stepped = contact(1, [0.3, -0.12, 0.05], [0.0, -0.2, 1])
    palm = contact(2, [0.2, 0.5, 1.2], [0, -1, 0])
    rows = [(left, right, palm, None)] * 5 + [(left, None, palm, None)] * 5 + [(left, stepped, palm, None)] * 3
    data = CentroidalProblem(ContactSchedule.from_rows(rows, 0.2), MASS, HALF, np.array([0.0, 0.0, 0.9]))

    def best(weights):
        program = CentroidalProgram(data, CentroidalOptions(weights=weights))
        model = CentroidalModel(program.data, program.linearise, program.bound_step)
        outcome = minimise(
            model, ConvexSolver(program.prog), max_iterations=30, tolerance=1e-8, time_limit=30, radius=0.1
        )
        return model, outcome.point

    model, optimum = best(CentroidalWeights())
    for other in (
        CentroidalWeights(linear_momentum=5.0),
        CentroidalWeights(pressure_centre=1000.0),
        CentroidalWeights(lateral_force=1000.0),
        CentroidalWeights(angular_momentum_rate=0.01, angular_momentum=0.01),
    ):
        _, elsewhere = best(other)
        assert model.between(elsewhere, elsewhere, 0.0).merit > optimum.merit * (1 + 1e-6)
        for step in (1e-3, 1e-2, 1e-1, 1.0):
            assert model.between(optimum, elsewhere, step).merit >= optimum.merit * (1 - 1e-7)
