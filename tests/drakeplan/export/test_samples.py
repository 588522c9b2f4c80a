"""The samples of a motion: what holds between knots, whose torque is whose, where pressure acts."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan.export.samples import forward_rate, pressure_points, sample_motion
from scenes.input_error import InputError

GRAVITY = np.array([0.0, 0.0, -9.81])  # [m/s^2]


def test_forces_and_weight_change_the_momentum_as_newton_says(stepping_plan):
    samples = sample_motion(stepping_plan)
    rate = forward_rate(samples.t, samples.linear_momentum)[:-1]
    total = samples.force.sum(axis=1)[:-1] + stepping_plan.mass * GRAVITY
    assert np.abs(rate - total).max() < 1e-6
    assert np.abs(rate).max() > 1.0  # it does move


def test_forces_hold_from_one_knot_to_the_next(stepping_plan):
    samples, course = sample_motion(stepping_plan), stepping_plan.centroidal
    for k, t in enumerate(samples.t):
        knot = max(n for n in range(len(course)) if course.t[n] <= t + 1e-6)
        assert np.array_equal(samples.force[k], course.force_W[knot])
        assert np.array_equal(samples.contact[k], course.contact[knot])


def test_the_pressure_acts_where_the_moment_about_the_centre_of_mass_vanishes(stepping_plan):
    """The angular momentum of this plan stays 0; its forces act on the centre of mass at the end of their interval."""
    samples = sample_motion(stepping_plan)
    com = stepping_plan.centroidal.com[1:]
    at_knot = np.searchsorted(samples.t, stepping_plan.centroidal.t[:-1] - 1e-6)
    normal = np.zeros((*samples.contact.shape, 3))
    held = samples.contact >= 0
    normal[held] = stepping_plan.contacts.X_WC[samples.contact[held], :3, 2]
    arm = np.nan_to_num(samples.cop[at_knot]) - com[:, None]
    moment = np.cross(arm, samples.force[at_knot]) + samples.torque_n[at_knot, :, None] * normal[at_knot]
    assert np.abs(moment.sum(axis=1)).max() < 1e-6


def test_torques_come_in_the_order_of_the_joints(strolling_plan):
    samples, motion = sample_motion(strolling_plan), strolling_plan.motion
    assert motion.actuator_names != samples.joint_names  # Drake orders actuators another way
    for a, name in enumerate(motion.actuator_names):
        assert np.array_equal(samples.joint_torque[:, samples.joint_names.index(name)], motion.tau[:, a])


def test_the_base_is_called_as_in_the_model(stepping_plan):
    samples = sample_motion(stepping_plan)
    assert samples.base_name == "pelvis"
    assert samples.joint_names[:2] == ("waist_yaw", "left_shoulder_pitch")


def test_without_contact_there_is_no_centre_of_pressure(stepping_plan):
    contact = np.array([[0, -1, -1, -1]])
    points = pressure_points(stepping_plan.contacts, contact, np.full((1, 4, 2), 0.01))
    assert np.isnan(points[0, 1:]).all()
    assert np.allclose(points[0, 0], stepping_plan.contacts.X_WC[0, :3, 3] + [0.01, 0.01, 0.0])


@given(st.lists(st.floats(0.01, 2.0), min_size=1, max_size=12), st.floats(-5, 5), st.floats(-5, 5))
def test_the_rate_of_a_line_is_its_slope(steps, start, slope):
    t = np.concatenate([[0.0], np.cumsum(steps)])
    assert np.allclose(forward_rate(t, (start + slope * t)[:, None]), slope, atol=1e-9)


def test_a_single_sample_has_no_rate():
    assert forward_rate(np.array([1.0]), np.array([[3.0]])).tolist() == [[0.0]]


@pytest.mark.parametrize("names", [("a_x",) * 34, ("r_b_qw",) * 34])
def test_other_positions_than_a_floating_base_are_refused(stepping_plan, names):
    wrong = replace(stepping_plan, motion=replace(stepping_plan.motion, position_names=names))
    with pytest.raises(InputError, match="expected positions of a floating base"):
        sample_motion(wrong)


def test_times_that_stand_still_are_refused(stepping_plan):
    motion = stepping_plan.motion
    wrong = replace(stepping_plan, motion=replace(motion, t=np.zeros(len(motion))))
    with pytest.raises(InputError, match="do not grow"):
        sample_motion(wrong)
