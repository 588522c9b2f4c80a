"""Frames of a motion: contacts stay where they are, limits are never left, targets are reached where possible."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RotationMatrix

from optimization.differential_ik import DifferentialIK, TrackingOptions
from scenes.contact import contact_pose
from scenes.effector import EFFECTORS
from scenes.plant import build_plant
from scenes.robot import load_robot

DT = 0.02  # [s]
BOTH_FEET = np.array([True, True, False, False])
ROUNDING = 1e-9


@pytest.fixture(scope="module")
def ik():
    return DifferentialIK(load_robot("escher"))


@pytest.fixture(scope="module")
def plant():
    return build_plant(load_robot("escher")).plant


def ease(s):
    """A fifth-order ramp from 0 to 1, at rest at both ends."""
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)


def step_and_shift(ik):
    """Yields 160 frames of targets: lower the CoM and shift it over the left foot, swing the right one, shift back."""
    q = np.array(ik.robot.q_nominal)
    X_start, com_start = ik.poses(q), ik.kinematics.com(q)
    for t in range(160):
        X_WE, com = X_start.copy(), com_start + np.array([0.0, 0.09, -0.07]) * ease(t / 60)
        swing = ease((t - 60) / 50)
        X_WE[1, :3, 3] += [0.3 * swing, 0.0, 0.1 * np.sin(np.pi * swing) + 0.02 * swing]
        angle = 0.2 * swing
        X_WE[1, :3, :3] = RotationMatrix.MakeYRotation(angle).matrix()
        com += ease((t - 110) / 50) * np.array([0.15, -0.09, 0.0])
        held = np.array([True, not 60 < t < 110, False, False])
        yield X_WE, com, held


def run(ik, frames, **extra):
    q, v, answers = np.array(ik.robot.q_nominal), np.zeros(33), []
    for X_WE, com, held in frames:
        weight = np.where(held, 0.0, [30.0, 30.0, 0.0, 0.0])
        answer = ik.track(
            q, X_WE, held=held, com=com, dt=DT, swing_linear=weight, swing_angular=0.3 * weight, v_previous=v, **extra
        )
        q, v = answer.q, answer.v
        answers.append(answer)
    return answers


def test_a_step_keeps_contacts_and_limits_by_drakes_measure(ik, plant):
    frames = list(step_and_shift(ik))
    context, q_last = plant.CreateDefaultContext(), np.array(ik.robot.q_nominal)
    speed, lower, upper = (
        plant.GetVelocityUpperLimits()[6:],
        *(limit[7:] for limit in (plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits())),
    )
    for (X_WE, com, held), answer in zip(frames, run(ik, frames), strict=True):
        plant.SetPositions(context, answer.q)
        for e in np.flatnonzero(held):
            X = plant.GetFrameByName(EFFECTORS[e]).CalcPoseInWorld(context)
            assert np.linalg.norm(X.translation() - X_WE[e, :3, 3]) < 1e-3
            turn = RotationMatrix(X.rotation().matrix().T @ X_WE[e, :3, :3]).ToAngleAxis().angle()
            assert abs(turn) < np.deg2rad(0.2)
        assert np.linalg.norm(plant.CalcCenterOfMassPositionInWorld(context) - com) < 5e-3
        if not held[1]:
            X = plant.GetFrameByName("right_foot").CalcPoseInWorld(context)
            assert np.linalg.norm(X.translation() - X_WE[1, :3, 3]) < 5e-3
        assert (np.abs(answer.q[7:] - q_last[7:]) <= DT * speed + ROUNDING).all()
        assert ((lower - ROUNDING <= answer.q[7:]) & (answer.q[7:] <= upper + ROUNDING)).all()
        np.testing.assert_allclose(ik.kinematics.integrate(q_last, answer.v, DT), answer.q, atol=ROUNDING)
        q_last = answer.q


def test_smooth_targets_give_a_smooth_motion(ik):
    velocities = np.array([answer.v for answer in run(ik, step_and_shift(ik))])
    accelerations = np.diff(velocities, axis=0) / DT
    assert np.abs(velocities).max() < 5.0
    assert np.abs(accelerations[5:]).max() < 80.0


def test_hands_on_walls_stay_there_while_the_body_circles(ik):
    q = np.array(ik.robot.q_nominal)
    X_WE, com = ik.poses(q), ik.kinematics.com(q) - np.array([0.0, 0.0, 0.05])
    for e, wall in ((2, 1.0), (3, -1.0)):
        target = contact_pose(EFFECTORS[e], np.array([0.25, 0.6 * wall, 1.25]), np.array([0.0, -wall, 0.0]), 0.0)
        X_WE[e] = target
    for _ in range(150):
        approach = ik.track(
            q, X_WE, held=BOTH_FEET, com=com, dt=DT, swing_linear=[0, 0, 30, 30], swing_angular=[0, 0, 9, 9]
        )
        q = approach.q
    assert approach.errors.swing_position < 1e-3
    for t in range(150):
        angle = 2 * np.pi * t / 75
        offset = 0.05 * ease(t / 30) * np.array([np.cos(angle), np.sin(angle), 0.0])
        answer = ik.track(q, X_WE, held=np.ones(4, bool), com=com + offset, dt=DT)
        q = answer.q
        assert answer.errors.held_position < 1e-3
        assert answer.errors.held_angle < np.deg2rad(0.2)
        assert answer.errors.com < 5e-3


def test_reported_errors_are_the_errors(ik):
    frames = list(step_and_shift(ik))[60:64]
    X_WE, com, held = frames[-1]
    q = np.array(ik.robot.q_nominal)
    X_WE[0, 2, 3] += 0.4  # far: one frame cannot do it
    answer = ik.track(q, X_WE, held=held, com=com, dt=DT, swing_linear=[0, 10, 0, 0])
    reached = ik.poses(answer.q)
    assert answer.errors.held_position == pytest.approx(np.linalg.norm(reached[0, :3, 3] - X_WE[0, :3, 3]), abs=1e-12)
    assert answer.errors.swing_position == pytest.approx(np.linalg.norm(reached[1, :3, 3] - X_WE[1, :3, 3]), abs=1e-12)
    assert answer.errors.com == pytest.approx(np.linalg.norm(ik.kinematics.com(answer.q) - com), abs=1e-12)
    assert answer.errors.held_position > 0.05


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), leap=st.floats(0.0, 2.0))
def test_no_target_makes_a_joint_leave_its_limits(ik, seed, leap):
    rng = np.random.default_rng(seed)
    tree = ik.kinematics.tree
    q = np.array(ik.robot.q_nominal)
    q[7:] = np.clip(q[7:] + rng.normal(0, 0.5, 27), tree.lower, tree.upper)
    X_WE = ik.poses(q)
    X_WE[:, :3, 3] += leap * rng.standard_normal((5, 3))
    answer = ik.track(q, X_WE, held=rng.random(4) < 0.5, com=leap * rng.standard_normal(3), dt=DT)
    assert np.isfinite(answer.q).all()
    assert (np.abs(answer.v[6:]) <= tree.speed * (1 + 1e-9)).all()
    assert ((tree.lower - ROUNDING <= answer.q[7:]) & (answer.q[7:] <= tree.upper + ROUNDING)).all()


def test_a_target_that_jumps_is_approached_at_the_speed_limit(ik):
    q = np.array(ik.robot.q_nominal)
    X_WE = ik.poses(q)
    X_WE[3, :3, 3] += [0.2, 0.0, 0.3]
    first = ik.track(q, X_WE, held=BOTH_FEET, dt=DT, swing_linear=[0, 0, 0, 30])
    assert first.errors.at_speed_limit > 0
    assert first.errors.swing_position > 0.02
    for _ in range(40):
        answer = ik.track(q, X_WE, held=BOTH_FEET, dt=DT, swing_linear=[0, 0, 0, 30])
        q = answer.q
    assert answer.errors.swing_position < 5e-3
    assert answer.errors.held_position < 1e-3


def test_contacts_win_over_a_centre_of_mass_that_is_out_of_reach(ik):
    q = np.array(ik.robot.q_nominal)
    X_WE, com = ik.poses(q), ik.kinematics.com(q)
    for t in range(100):
        answer = ik.track(q, X_WE, held=BOTH_FEET, com=com + np.array([0, 0, 0.2]) * ease(t / 50), dt=DT)
        q = answer.q
        assert answer.errors.held_position < 1e-3
        assert answer.errors.held_angle < np.deg2rad(0.2)
    assert answer.errors.com > 0.05


def test_a_point_stays_in_front_of_a_plane(ik):
    q = np.array(ik.robot.q_nominal)
    X_WE = ik.poses(q)
    start = X_WE[2, 0, 3]
    wall = start + 0.05  # the left palm is asked to go 0.2 m forward, the wall stands at 0.05 m
    apart = ik.point_pairs([("left_palm", [0, 0, 0], None, [wall, 0, 0], [-1, 0, 0], 0.0)])
    for t in range(80):
        X_WE[2, 0, 3] = start + 0.2 * ease(t / 60)
        answer = ik.track(q, X_WE, held=BOTH_FEET, dt=DT, swing_linear=[0, 0, 30, 0], apart=apart)
        q = answer.q
        assert ik.poses(q)[2, 0, 3] < wall + 1e-3
        assert np.abs(answer.v).max() < 4.0
    assert ik.poses(q)[2, 0, 3] == pytest.approx(wall, abs=2e-3)


def test_two_points_of_the_body_keep_their_distance(ik):
    q = np.array(ik.robot.q_nominal)
    X_WE = ik.poses(q)
    start = X_WE[:, 1, 3].copy()
    apart = ik.point_pairs([("left_palm", [0, 0, 0], "right_palm", [0, 0, 0], [0, 1, 0], 0.5)])
    for t in range(80):
        X_WE[2, 1, 3], X_WE[3, 1, 3] = start[2] - 0.3 * ease(t / 60), start[3] + 0.3 * ease(t / 60)
        q = ik.track(q, X_WE, held=BOTH_FEET, dt=DT, swing_linear=[0, 0, 30, 30], apart=apart).q
        reached = ik.poses(q)
        assert reached[2, 1, 3] - reached[3, 1, 3] > 0.5 - 1e-3
    assert reached[2, 1, 3] - reached[3, 1, 3] == pytest.approx(0.5, abs=2e-3)


def test_hands_asked_into_the_chest_stay_out_of_it(ik):
    robot_plant = build_plant(ik.robot)
    q = np.array(ik.robot.q_nominal)
    X_WE = ik.poses(q)
    X_WE[2, :3, 3] = X_WE[3, :3, 3] = X_WE[4, :3, 3] + [0.0, 0.0, 0.2]

    def depth(options):
        q = np.array(ik.robot.q_nominal)
        for _ in range(60):
            q = ik.track(q, X_WE, held=BOTH_FEET, dt=DT, swing_linear=[0, 0, 5, 5], options=options).q
        context = robot_plant.new_context()
        robot_plant.plant.SetPositions(robot_plant.plant.GetMyContextFromRoot(context), q)
        scene_graph = robot_plant.scene_graph
        query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
        return -min([s.distance for s in query.ComputeSignedDistancePairwiseClosestPoints(0.02)] + [0.02])

    assert depth(TrackingOptions(distance_weight=0.0)) > 0.03
    assert depth(TrackingOptions()) < 5e-3


def test_without_targets_the_posture_returns_to_the_reference(ik):
    rng = np.random.default_rng(2)
    q = np.array(ik.robot.q_nominal)
    X_WE = ik.poses(q)
    q[7:] = np.clip(q[7:] + rng.normal(0, 0.2, 27), ik.kinematics.tree.lower, ik.kinematics.tree.upper)
    for _ in range(100):
        q = ik.track(q, X_WE, held=np.zeros(4, bool), dt=DT).q
    np.testing.assert_allclose(q[7:], ik.robot.q_nominal[7:], atol=1e-3)


def test_smoothness_keeps_the_velocity_when_nothing_else_is_asked(ik):
    options = TrackingOptions(torso_weight=0.0, posture_weight=0.0, effort_weight=0.0, smooth_weight=1.0)
    q, v = np.array(ik.robot.q_nominal), 0.05 * np.random.default_rng(0).standard_normal(33)
    answer = ik.track(q, ik.poses(q), held=np.zeros(4, bool), dt=DT, v_previous=v, options=options)
    np.testing.assert_allclose(answer.v, v, atol=1e-6)


def test_two_runs_are_identical_to_the_bit(ik):
    first, second = (run(ik, list(step_and_shift(ik))[:80])[-1] for _ in range(2))
    np.testing.assert_array_equal(first.q, second.q)


@pytest.mark.parametrize(
    "wrong",
    [
        {"X_WE": np.zeros((4, 4, 4))},
        {"X_WE": np.full((5, 4, 4), np.nan)},
        {"q": np.zeros(33)},
        {"swing_linear": np.zeros(3)},
    ],
)
def test_malformed_targets_are_refused(ik, wrong):
    q = np.array(ik.robot.q_nominal)
    arguments = {"q": q, "X_WE": ik.poses(q), "held": BOTH_FEET, "dt": DT} | wrong
    with pytest.raises(ValueError, match="must be"):
        ik.track(**arguments)
