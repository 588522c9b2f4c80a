"""Single transitions: the same answers as programs built for them, timing, the state that is handed on."""

from dataclasses import replace

import numpy as np
import pytest

from drakeplan.bench.random_transitions import random_transition
from optimization.centroidal.transition_dynamics import TransitionDynamics, transition_options
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.robots.robot import load_robot
from scenes.stance import Stance

ROBOT = load_robot("escher")


def contact(effector, point, normal=(0.0, 0.0, 1.0), mu=0.5):
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    name = EFFECTORS[effector]
    return Contact(name, 0, contact_pose(name, np.array(point, float), normal, 0.0), mu)


def step(stride=0.25, palm=False):
    hand = contact(2, [0.3, 0.5, 1.2], [0, -1, 0]) if palm else None
    before = Stance((contact(0, [0, 0.1, 0]), contact(1, [0, -0.1, 0]), hand, None))
    return before, before.replace(0, contact(0, [stride, 0.1, 0]))


COM = np.array([0.0, 0.0, ROBOT.com_height[1]])


def test_a_transition_lasts_a_second_of_shift_a_second_of_swing_and_one_interval():
    dynamics = TransitionDynamics(ROBOT)
    estimate = dynamics.estimate(*step(), COM, np.zeros(3))
    assert estimate.feasible, estimate.reason
    t = estimate.trajectory
    assert np.allclose(t.t, 0.2 * np.arange(12))
    assert (t.contact[:, 0] >= 0).tolist() == [True] * 5 + [False] * 5 + [True] * 2
    assert (t.contact[:, 1] >= 0).all()


def test_the_state_handed_on_is_the_last_knot_and_the_next_transition_starts_from_it():
    dynamics = TransitionDynamics(ROBOT)
    before, after = step(0.45)
    first = dynamics.estimate(before, after, COM, ROBOT.mass * np.array([0.3, 0.0, 0.0]))
    com, velocity = dynamics.final_state(first)
    assert np.allclose(com, first.trajectory.com[-1])
    assert np.allclose(velocity * ROBOT.mass, first.trajectory.linear_momentum[-1])
    assert np.abs(velocity).max() > 0.01  # it walks on: nothing makes it rest
    onward = after.replace(1, contact(1, [0.6, -0.1, 0]))
    second = dynamics.estimate(after, onward, com, ROBOT.mass * velocity)
    assert second.feasible, second.reason
    assert np.array_equal(second.trajectory.com[0], com)
    assert (np.abs(second.trajectory.com[-1] - onward.feet_mean() - [0, 0, ROBOT.com_height[1]]) < 0.1201).all()


def test_without_a_trajectory_there_is_no_state_to_hand_on():
    dynamics = TransitionDynamics(ROBOT)
    lost = dynamics.estimate(*step(), COM, ROBOT.mass * np.array([0, 0, 9.0]))
    assert not lost.feasible
    assert lost.trajectory is None
    with pytest.raises(ValueError, match="no trajectory"):
        dynamics.final_state(lost)


def test_stances_must_differ_in_one_end_effector_and_numbers_must_be_finite():
    dynamics = TransitionDynamics(ROBOT)
    before, after = step()
    with pytest.raises(InputError, match="one end effector"):
        dynamics.estimate(before, before, COM, np.zeros(3))
    with pytest.raises(InputError, match="one end effector"):
        dynamics.estimate(before, after.replace(1, None), COM, np.zeros(3))
    with pytest.raises(InputError, match="initial_com"):
        dynamics.estimate(before, after, np.array([0, np.nan, 0.9]), np.zeros(3))
    with pytest.raises(InputError, match="initial_linear_momentum"):
        dynamics.estimate(before, after, COM, np.zeros(2))


def test_reused_programs_answer_as_new_ones_do():
    rng = np.random.default_rng(4)
    dynamics = TransitionDynamics(ROBOT)
    seen = {True: 0, False: 0}
    for category in ("feet", "one palm", "both palms"):
        for _ in range(6):
            t = random_transition(rng, ROBOT, category)
            question = t.before, t.after, t.com, t.linear_momentum
            again, fresh = dynamics.estimate(*question), TransitionDynamics(ROBOT).estimate(*question)
            assert again.feasible == fresh.feasible
            seen[fresh.feasible] += 1
            if fresh.feasible:
                assert again.cost == pytest.approx(fresh.cost, rel=1e-6)
                assert np.allclose(again.trajectory.com, fresh.trajectory.com, atol=1e-5)
    assert min(seen.values()) >= 3


def test_the_options_come_from_the_robot():
    options = transition_options(ROBOT)
    assert options.com_height == ROBOT.com_height
    assert np.array_equal(options.com_reach, ROBOT.com_reach)
    assert not options.rest_at_end
    assert (options.dt, options.shift_time, options.swing_time) == (0.2, 1.0, 1.0)


@pytest.mark.parametrize("palm", [False, True])
def test_where_the_iteration_ends_does_not_decide_where_the_com_ends(palm):
    usual = transition_options(ROBOT)
    tight = replace(usual, tolerance=0.1 * usual.tolerance, max_iterations=3 * usual.max_iterations)
    ends = []
    for options in (usual, tight):
        dynamics = TransitionDynamics(ROBOT, options)
        estimate = dynamics.estimate(*step(palm=palm), COM, ROBOT.mass * np.array([0.05, 0.03, 0.0]))
        assert estimate.feasible, estimate.reason
        ends.append(dynamics.final_state(estimate)[0])
    assert np.abs(ends[0] - ends[1]).max() < 1e-3
