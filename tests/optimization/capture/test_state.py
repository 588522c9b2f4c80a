"""The state that a capture motion starts from: measured by Drake, not by the fit's own kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from optimization.capture.sampling import random_question
from optimization.capture.state import LIFT, StateFit, beside
from scenes.contact import Contact, contact_pose
from scenes.effector import LEFT_FOOT, RIGHT_FOOT
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot
from scenes.stance import Stance

ROBOT = load_robot("escher")
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def fit() -> StateFit:
    return StateFit(ROBOT)


def _standing(y: float = 0.1, heading: float = 0.0) -> Stance:
    foot = Contact("left_foot", 0, contact_pose("left_foot", np.array([0.0, y, 0.0]), UP, heading), 0.5)
    return Stance((foot, None, None, None))


@pytest.mark.parametrize("seed", range(8))
def test_drake_finds_the_momentum_the_centre_of_mass_and_the_standing_foot_that_were_asked_for(
    fit: StateFit, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    question = random_question(rng, ROBOT, "stay")
    k0 = rng.uniform(-3.0, 3.0, 3)
    state = fit.fit(question.stance, question.com, question.linear_momentum, k0)
    built = build_plant(ROBOT)
    plant, context = built.plant, built.plant.CreateDefaultContext()
    plant.SetPositions(context, state.q)
    plant.SetVelocities(context, state.v)
    com = plant.CalcCenterOfMassPositionInWorld(context)
    momentum = plant.CalcSpatialMomentumInWorldAboutPoint(context, com)
    assert np.linalg.norm(com - question.com) == pytest.approx(state.com_error, abs=1e-9)
    assert np.linalg.norm(momentum.translational() - question.linear_momentum) == pytest.approx(
        state.linear_gap, abs=1e-6
    )
    assert np.linalg.norm(momentum.rotational() - k0) == pytest.approx(state.angular_gap, abs=1e-6)
    (foot,) = question.stance.held
    frame = plant.GetFrameByName(foot.effector)
    X_WE = frame.CalcPoseInWorld(context).GetAsMatrix4()
    np.testing.assert_allclose(X_WE[:3, 3], foot.p_WC, atol=1e-4)
    np.testing.assert_allclose(X_WE[:3, :3], foot.R_WC, atol=1e-3)
    assert frame.CalcSpatialVelocityInWorld(context).translational() == pytest.approx(np.zeros(3), abs=1e-3)
    assert max(state.com_error, state.contact_error) < 1e-3
    assert max(state.linear_gap, state.angular_gap) < 0.1


def test_joints_keep_their_limits_and_their_speed_limits_whatever_is_asked(fit: StateFit) -> None:
    tree = fit.kinematics.tree
    state = fit.fit(_standing(), np.array([0.3, 0.1, 0.5]), np.array([300.0, 0.0, 0.0]), np.array([0.0, 200.0, 0.0]))
    assert (state.q[7:] >= tree.lower).all()
    assert (state.q[7:] <= tree.upper).all()
    assert (np.abs(state.v[6:]) <= tree.speed).all()
    assert state.linear_gap + state.angular_gap > 10.0  # and what could not be had is said


def test_a_robot_at_rest_is_fitted_at_rest(fit: StateFit) -> None:
    state = fit.fit(_standing(), np.array([0.0, 0.08, 0.9]), np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(state.v, 0.0, atol=1e-9)


def test_turning_the_question_turns_the_posture(fit: StateFit) -> None:
    """About the vertical: joints stay, the base turns."""
    heading = 1.1
    c, s = np.cos(heading), np.sin(heading)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    com, momentum = np.array([0.03, 0.06, 0.88]), np.array([20.0, -10.0, 3.0])
    straight = fit.fit(_standing(), com, momentum, np.zeros(3))
    foot = Contact("left_foot", 0, contact_pose("left_foot", R @ np.array([0.0, 0.1, 0.0]), UP, heading), 0.5)
    turned = fit.fit(Stance((foot, None, None, None)), R @ com, R @ momentum, np.zeros(3))
    np.testing.assert_allclose(turned.q[7:], straight.q[7:], atol=1e-3)
    np.testing.assert_allclose(turned.q[4:7], R @ straight.q[4:7], atol=1e-3)
    np.testing.assert_allclose(turned.v[6:], straight.v[6:], atol=1e-2)


def test_a_free_foot_hangs_beside_the_standing_one(fit: StateFit) -> None:
    stance = _standing()
    state = fit.fit(stance, np.array([0.0, 0.06, 0.9]), np.zeros(3), np.zeros(3))
    foot = fit.kinematics.effector_poses(state.q)[RIGHT_FOOT]
    wanted = beside(stance.held[0].X_WC, ROBOT, RIGHT_FOOT)
    np.testing.assert_allclose(foot[:3, 3], wanted[:3, 3], atol=0.05)
    assert foot[2, 3] > LIFT / 2
    assert beside(stance.held[0].X_WC, ROBOT, LEFT_FOOT)[1, 3] > stance.held[0].p_WC[1]
