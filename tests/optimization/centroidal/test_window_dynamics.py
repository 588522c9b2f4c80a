"""The dynamics of several transitions together: they prepare each other, and what is left of an optimum is optimal."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from optimization.centroidal.transition_dynamics import TransitionDynamics, transition_options
from optimization.centroidal.window_dynamics import BodyState, WindowDynamics
from scenes.contact import Contact
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.stance import Stance

ROBOT = load_robot("escher")
TILT, EDGE = np.deg2rad(27.0), 0.5  # steeper than friction 0.5 holds


def foot(effector: int, way: float, tilt: float = 0.0) -> Contact:
    """A foot this far along a way that goes downhill from EDGE on [m]."""
    on = max(way - EDGE, 0.0)
    c, s = (np.cos(tilt), np.sin(tilt)) if on else (1.0, 0.0)
    X_WC = np.eye(4)
    X_WC[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    X_WC[:3, 3] = min(way, EDGE) + c * on, 0.1 - 0.2 * effector, -s * on
    return Contact(("left_foot", "right_foot")[effector], int(on > 0), X_WC, 0.5)


def walk(steps: int, tilt: float = 0.0) -> list[Stance]:
    stances, mover, way = [Stance((foot(0, 0.3), foot(1, 0.3), None, None))], 0, 0.3
    for _ in range(steps):
        way += 0.35
        stances.append(stances[-1].replace(mover, foot(mover, way, tilt)))
        mover = 1 - mover
    return stances


def rest(stance: Stance) -> BodyState:
    return BodyState(stance.feet_mean() + np.array([0.0, 0.0, ROBOT.com_height[1]]))


def test_a_tail_of_one_is_a_transition() -> None:
    stances = walk(1)
    start = rest(stances[0])
    one = WindowDynamics(ROBOT, transition_options(ROBOT)).solve(start, stances)
    other = TransitionDynamics(ROBOT).estimate(*stances, start.com, np.zeros(3))
    assert one.feasible
    assert one.cost == pytest.approx(other.cost, rel=1e-6)


def test_what_is_left_of_a_least_effort_motion_is_one_too() -> None:
    dynamics, stances = WindowDynamics(ROBOT, transition_options(ROBOT)), walk(3)
    whole = dynamics.solve(rest(stances[0]), stances)
    at = dynamics.at_touchdown(whole.trajectory, 0)
    left = dynamics.solve(at, stances[1:])
    assert left.feasible
    n = len(left.trajectory.t)
    np.testing.assert_allclose(left.trajectory.com, whole.trajectory.com[-n:], atol=5e-3)
    assert left.cost < whole.cost


def test_the_states_are_those_of_the_knots_that_they_name() -> None:
    dynamics, stances = WindowDynamics(ROBOT, transition_options(ROBOT)), walk(2)
    trajectory = dynamics.solve(rest(stances[0]), stances).trajectory
    for k in (0, 1):
        mover = k
        lift, touch = dynamics.at_lift_off(trajectory, k), dynamics.at_touchdown(trajectory, k)
        free = np.flatnonzero(trajectory.contact[:-1, mover] < 0)
        np.testing.assert_array_equal(lift.com, trajectory.com[free[0]])
        np.testing.assert_array_equal(touch.com, trajectory.com[free[-1] + 1])


def test_steps_onto_a_slope_that_holds_nobody_must_be_prepared() -> None:
    stances, options = walk(4, TILT), transition_options(ROBOT)
    alone = TransitionDynamics(ROBOT, options)
    com, momentum, made = rest(stances[0]).com, np.zeros(3), 0
    for before, after in pairwise(stances):
        estimate = alone.estimate(before, after, com, momentum)
        if not estimate.feasible:
            break
        com, velocity = alone.final_state(estimate)
        momentum, made = ROBOT.mass * velocity, made + 1
    assert made < 4  # least effort in each leaves the next one no way
    assert WindowDynamics(ROBOT, options).solve(rest(stances[0]), stances).feasible


def test_programs_are_used_again_and_answers_are_counted() -> None:
    dynamics, stances = WindowDynamics(ROBOT, transition_options(ROBOT)), walk(2)
    first = dynamics.solve(rest(stances[0]), stances)
    again = dynamics.solve(rest(stances[0]), stances)
    assert again.cost == pytest.approx(first.cost, rel=1e-6)
    assert dynamics.asked["exact"] == 2
    assert len(dynamics._programs) == 1


def test_stances_that_differ_in_two_feet_are_refused() -> None:
    stances = walk(2)
    with pytest.raises(InputError, match="differ in 2"):
        WindowDynamics(ROBOT, transition_options(ROBOT)).solve(rest(stances[0]), [stances[0], stances[2]])
