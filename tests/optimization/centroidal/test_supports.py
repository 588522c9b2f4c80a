"""Feet that rest on part of themselves: what the momentum program can do with them, in closed form."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from optimization.centroidal.check import violations
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem, structure
from optimization.centroidal.program import CentroidalProgram
from scenes.contact import Contact, contact_pose, patch_corners

HALF = np.array([[0.11, 0.05], [0.11, 0.05], [0.05, 0.05], [0.05, 0.05]])
WHOLE = patch_corners(HALF[0])
FRONT = np.array([[0.11, 0.05], [0.0, 0.05], [0.0, -0.05], [0.11, -0.05]])
OCTAGON = 0.04 * np.stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)], axis=1)
NO_TURNING = (0.5, 0.5, 0.5)  # [N m s] of angular momentum: with more, arms that whirl could push the body along
OPTIONS = dataclasses.replace(CentroidalOptions(), final_half_width=None, angular_momentum_limit=NO_TURNING)
INTERVALS, DT = 5, 0.2


def on_one_foot(support, x: float) -> CentroidalProblem:
    """Standing still on the left foot with the centre of mass x ahead of the middle of its sole [m]."""
    foot = Contact(
        "left_foot", 0, contact_pose("left_foot", np.zeros(3), np.array([0, 0, 1.0]), 0.0), 0.5, 0.0, support
    )
    schedule = ContactSchedule.from_rows([(foot, None, None, None)] * INTERVALS, DT)
    return CentroidalProblem(schedule, 76.0, HALF, np.array([x, 0.0, 0.9]))


def solve(problem: CentroidalProblem):
    return CentroidalProgram(problem, OPTIONS).solve()


@pytest.mark.parametrize(("support", "x"), [(FRONT, 0.02), (FRONT, 0.1), (OCTAGON, 0.03), (OCTAGON, -0.03)])
def test_what_stands_over_its_support_can_stay(support, x):
    estimate = solve(on_one_foot(support, x))
    assert estimate.feasible, estimate.reason
    assert np.abs(estimate.trajectory.com[:, 0] - x).max() < 0.02


@pytest.mark.parametrize("x", [-0.05, -0.1])
def test_half_a_sole_holds_nothing_that_stands_over_the_other_half(x):
    """The whole sole does, with no momentum at all."""
    assert solve(on_one_foot(None, x)).feasible
    assert not solve(on_one_foot(FRONT, x)).feasible


def test_pressure_stays_on_the_support():
    problem = on_one_foot(FRONT, 0.004)
    problem = dataclasses.replace(problem, initial_linear_momentum=np.array([76.0 * 0.05, 0.0, 0.0]))
    estimate = solve(problem)
    assert estimate.feasible, estimate.reason
    assert estimate.trajectory.cop_C[:, 0, 0].min() > -1e-6


def test_the_check_finds_pressure_off_the_support():
    problem = on_one_foot(None, 0.0)
    standing = solve(problem).trajectory
    assert not violations(problem, OPTIONS, standing)
    found = violations(on_one_foot(FRONT + 0.03 * np.array([[0, 0], [1, 0], [1, 0], [0, 0]]), 0.0), OPTIONS, standing)
    assert [v.block for v in found] == ["pressure centre"]
    assert found[0].amount == pytest.approx(0.03, abs=1e-3)  # from the middle to the support's edge [m]
    assert found[0].effector == "left_foot"


def test_a_support_that_is_the_whole_patch_changes_nothing():
    none, whole = (solve(on_one_foot(support, 0.03)).trajectory for support in (None, WHOLE))
    for name in ("com", "linear_momentum", "angular_momentum", "force_W", "cop_C", "torque_n"):
        assert np.array_equal(getattr(none, name), getattr(whole, name)), name


def test_a_program_takes_the_numbers_of_another_support_with_as_many_corners():
    program = CentroidalProgram(on_one_foot(None, 0.05), OPTIONS)
    assert program.solve().feasible
    program.update(on_one_foot(FRONT, 0.05))
    again, anew = program.solve().trajectory, solve(on_one_foot(FRONT, 0.05)).trajectory
    assert np.allclose(again.com, anew.com, atol=1e-6)
    assert structure(on_one_foot(OCTAGON, 0.0)) != structure(on_one_foot(FRONT, 0.0))
