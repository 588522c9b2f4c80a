"""Closed forms of the bracer against forward kinematics of its model, and postures against what they were asked for."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.solvers import Solve

from drakeplan.bracing.bracer import ALIGNED, LONGEST, PALM_FRAMES, PLACED, SHORTEST, Bracer
from drakeplan.bracing.wall_frame import MODEL_FILE
from scenes.robots.bracer.make_bracer import FOREARM, HAND, TRACK, UPPER_ARM, WHEEL_RADIUS, WHEELBASE

ATOL = 1e-9  # [m] rounding of forward kinematics
INTO_WALL = np.array([0.0, 1.0, 0.0])
TURNED = {"torso_yaw": np.pi / 2, "torso_pitch": 0.0}  # to the wall, upright
# Angle of the elbow at which shoulder and wrist are LONGEST apart, by the law of cosines [rad].
BENT = np.arccos((LONGEST**2 - UPPER_ARM**2 - FOREARM**2) / (2.0 * UPPER_ARM * FOREARM))


def poses(bracer: Bracer, q: np.ndarray, *frames: str) -> list[np.ndarray]:
    """(4, 4) poses in B."""
    context = bracer.plant.CreateDefaultContext()
    bracer.plant.SetPositions(context, q)
    return [bracer.plant.GetFrameByName(name).CalcPoseInWorld(context).GetAsMatrix4() for name in frames]


def angles(bracer: Bracer, **named: float) -> np.ndarray:
    """(16,) configuration, joints that are not named at zero."""
    q = np.zeros(bracer.plant.num_positions())
    for name, angle in named.items():
        q[bracer.plant.GetJointByName(name).position_start()] = angle
    return q


def some_palms(rng: np.random.Generator, farthest: float = 0.8) -> np.ndarray:
    """(2, 3) palms at random on a wall beside the robot, each on its own side of the torso [m]."""
    y = rng.uniform(0.4, farthest)
    return np.array(
        [
            [0.1 - rng.uniform(0.0, 0.4), y, rng.uniform(0.5, 1.3)],
            [0.1 + rng.uniform(0.0, 0.4), y, rng.uniform(0.5, 1.3)],
        ]
    )


def test_it_weighs_what_the_links_of_its_file_weigh(bracer: Bracer) -> None:
    masses = re.findall(r'<mass value="([\d.]+)"/>', Path(MODEL_FILE).read_text(encoding="utf-8"))
    assert bracer.mass == pytest.approx(sum(map(float, masses)), abs=ATOL) == pytest.approx(96.0, abs=ATOL)


def test_it_stands_on_four_wheels_whose_axles_are_a_radius_above_the_ground(bracer: Bracer) -> None:
    names = [f"{end}_{side}_wheel" for end in ("front", "rear") for side in ("left", "right")]
    axles = np.array([X[:3, 3] for X in poses(bracer, angles(bracer), *names)])
    np.testing.assert_allclose(bracer.wheels, axles - [0.0, 0.0, WHEEL_RADIUS], atol=ATOL)
    np.testing.assert_allclose(np.ptp(bracer.wheels, axis=0), [WHEELBASE, TRACK, 0.0], atol=ATOL)


def test_the_shoulders_are_where_the_turned_torso_has_them(bracer: Bracer) -> None:
    links = [f"{side}_shoulder_pitch_link" for side in ("left", "right")]
    there = [X[:3, 3] for X in poses(bracer, angles(bracer, **TURNED), *links)]
    np.testing.assert_allclose(bracer.shoulders(), there, atol=ATOL)


def test_the_com_is_the_mean_of_its_bodies_by_mass(bracer: Bracer) -> None:
    plant, q = bracer.plant, angles(bracer, torso_yaw=1.2, torso_pitch=-0.4, left_elbow=-1.0, right_shoulder_roll=0.7)
    context, moment = plant.CreateDefaultContext(), np.zeros(3)
    plant.SetPositions(context, q)
    for index in plant.GetBodyIndices(plant.GetModelInstanceByName("bracer")):
        body = plant.get_body(index)
        inertia = body.default_spatial_inertia()
        X_BL = plant.EvalBodyPoseInWorld(context, body)
        moment += inertia.get_mass() * (X_BL @ inertia.get_com())
    np.testing.assert_allclose(bracer.com_of(q), moment / bracer.mass, atol=ATOL)


@pytest.mark.parametrize("palm", [0, 1])
def test_of_what_an_arm_reaches_from_an_upright_torso_only_a_nearly_straight_elbow_is_refused(
    bracer: Bracer, palm: int
) -> None:
    """Necessity, by forward kinematics: the elbow alone says how far apart shoulder and wrist are."""
    rng, side = np.random.default_rng(palm), ("left", "right")[palm]
    low, high = bracer.plant.GetPositionLowerLimits(), bracer.plant.GetPositionUpperLimits()
    elbow = bracer.plant.GetJointByName(f"{side}_elbow").position_start()
    seen = {True: 0, False: 0}
    for _ in range(400):
        q = rng.uniform(low, high)
        for name, angle in TURNED.items():
            q[bracer.plant.GetJointByName(name).position_start()] = angle
        (X_BP,) = poses(bracer, q, PALM_FRAMES[palm])
        expected = bool(abs(q[elbow]) >= BENT)
        assert bracer.reaches(palm, X_BP[:3, 3], X_BP[:3, 2]) == expected
        seen[expected] += 1
    assert min(seen.values()) > 30
    assert 0.0 < BENT < np.deg2rad(25.0), "and only a nearly straight one"


def test_no_palm_is_refused_that_inverse_kinematics_reach_with_the_torso_upright(bracer: Bracer) -> None:
    """The torso held upright and turned, palms flat on the wall, elbows bent as much as `LONGEST` leaves: nothing is lost.

    A torso that leans and turns carries its shoulders along: then an arm may reach what is refused here.
    """
    rng, reached, beyond = np.random.default_rng(5), 0, 0
    for _ in range(80):
        palms = some_palms(rng, 1.0)
        ik = InverseKinematics(bracer.plant)
        world = bracer.plant.world_frame()
        for name, point in zip(PALM_FRAMES, palms, strict=True):
            frame = bracer.plant.GetFrameByName(name)
            ik.AddPositionConstraint(frame, np.zeros(3), world, point, point)
            ik.AddAngleBetweenVectorsConstraint(frame, np.array([0.0, 0.0, 1.0]), world, INTO_WALL, 0.0, 1e-4)
        guess = bracer._guess(0.0)
        held = {name: (angle, angle) for name, angle in TURNED.items()}
        held |= {f"{side}_elbow": (-2.4, -BENT) for side in ("left", "right")}
        for name, limits in held.items():
            k = bracer.plant.GetJointByName(name).position_start()
            ik.prog().AddBoundingBoxConstraint(*limits, ik.q()[k])
        answer = Solve(ik.prog(), guess)
        accepted = all(bracer.reaches(palm, palms[palm], INTO_WALL) for palm in (0, 1))
        if answer.is_success():
            reached += 1
            assert accepted, palms
        beyond += not accepted
    assert reached > 20 and beyond > 5


@pytest.mark.parametrize("palm", [0, 1])
def test_a_point_beyond_the_longest_arm_or_too_near_the_shoulder_is_refused(bracer: Bracer, palm: int) -> None:
    rng, shoulder = np.random.default_rng(7), bracer.shoulders()[palm]
    for _ in range(100):
        away, into = rng.normal(size=(2, 3))
        away, into = away / np.linalg.norm(away), into / np.linalg.norm(into)
        for distance, expected in (
            (UPPER_ARM + FOREARM + 1e-3, False),
            (LONGEST - 1e-6, True),
            (SHORTEST + 1e-6, True),
            (SHORTEST - 1e-6, False),
        ):
            assert bracer.reaches(palm, shoulder + distance * away + HAND * into, into) == expected
    straight = shoulder + (UPPER_ARM + FOREARM + HAND + 0.01) * INTO_WALL
    assert not bracer.reaches(palm, straight, INTO_WALL)


def test_a_posture_has_both_palms_in_place_and_against_the_wall_and_every_joint_within_its_limits(
    bracer: Bracer,
) -> None:
    rng, found = np.random.default_rng(9), 0
    low, high = bracer.plant.GetPositionLowerLimits(), bracer.plant.GetPositionUpperLimits()
    for _ in range(40):
        palms, tilt = some_palms(rng), rng.uniform(-0.7, 0.2)
        into = np.array([0.0, np.cos(tilt), np.sin(tilt)])
        q = bracer.posture(palms, into)
        if q is None:
            continue
        found += 1
        assert q.shape == (16,) and (q >= low - 1e-6).all() and (q <= high + 1e-6).all()
        for point, X_BP in zip(palms, poses(bracer, q, *PALM_FRAMES), strict=True):
            assert np.linalg.norm(X_BP[:3, 3] - point) <= 2.0 * PLACED
            assert np.arccos(min(1.0, X_BP[:3, 2] @ into)) <= ALIGNED + 2e-3
    assert found >= 30


def test_there_is_no_posture_for_palms_farther_away_than_arms_and_torso_are_long(bracer: Bracer) -> None:
    palms = np.array([[-0.1, 2.2, 0.9], [0.3, 2.2, 0.9]])
    assert bracer.posture(palms, INTO_WALL) is None
    assert bracer.posture(np.array([[-1.2, 0.6, 0.9], [1.4, 0.6, 0.9]]), INTO_WALL) is None


def test_what_the_solver_says_does_not_count_where_palms_or_joints_are_off(bracer: Bracer) -> None:
    palms = np.array([[-0.1, 0.6, 0.9], [0.3, 0.6, 0.9]])
    q = bracer.posture(palms, INTO_WALL)
    assert q is not None and bracer._holds(q, palms, INTO_WALL)
    assert not bracer._holds(q, palms + np.array([0.0, 0.0, 0.02]), INTO_WALL)
    assert not bracer._holds(q, palms, -INTO_WALL)
    assert not bracer._holds(q, palms, np.array([np.sin(0.6), np.cos(0.6), 0.0]))
    turned = q.copy()
    turned[bracer.plant.GetJointByName("left_wrist_roll").position_start()] += (
        2.0 * np.pi
    )  # the same pose, no such angle
    assert not bracer._holds(turned, palms, INTO_WALL)


def test_the_com_of_the_search_is_that_of_a_posture_over_the_wheels(bracer: Bracer) -> None:
    low, high = bracer.wheels.min(axis=0), bracer.wheels.max(axis=0)
    assert (low[:2] < bracer.com[:2]).all() and (bracer.com[:2] < high[:2]).all()
    assert WHEEL_RADIUS < bracer.com[2] < bracer.shoulders()[0, 2]
