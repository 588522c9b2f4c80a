"""Every check of a capture motion bites: a motion that holds is spoilt in one way after the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from optimization.capture.check import Fault, dynamics_faults, motion_faults, torque_fault
from optimization.capture.checker import CaptureChecker
from optimization.capture.question import CaptureQuestion
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.trajectory import CentroidalTrajectory
from scenes.contact import Contact, contact_pose
from scenes.robots.robot import load_robot
from scenes.stance import Stance

ROBOT = load_robot("escher")
UP = np.array([0.0, 0.0, 1.0])
SWING = 0.4


class Case:
    """A step to the right foot that is captured."""

    def __init__(self) -> None:
        self.checker = CaptureChecker(ROBOT)
        left, right = (
            Contact(e, 0, contact_pose(e, np.array([x, y, 0.0]), UP, 0.0), 0.5)
            for e, x, y in (("left_foot", 0.0, 0.1), ("right_foot", 0.05, -0.12))
        )
        stance = Stance((left, None, None, None))
        momentum = ROBOT.mass * np.array([0.05, -0.1, 0.0])
        self.question = CaptureQuestion(stance, np.array([0.0, 0.07, 0.9]), momentum, new_contact=right)
        state = self.checker.fit.fit(stance, self.question.com, momentum, np.zeros(3))
        attempt = self.checker.attempt(self.question, state, SWING)
        assert attempt.reason == ""
        self.problem: CentroidalProblem = self.checker.problem(self.question, SWING)
        assert attempt.estimate.centroidal is not None
        trajectory = attempt.estimate.centroidal.trajectory
        assert trajectory is not None
        self.trajectory: CentroidalTrajectory = trajectory
        self.q = attempt.estimate.q

    def motion(self, q: np.ndarray) -> list[Fault]:
        agreement = self.checker.options.kinodynamic.agreement
        return motion_faults(self.checker.fit.kinematics, self.problem.schedule, self.trajectory, q, agreement)

    def dynamics(self, trajectory: CentroidalTrajectory) -> list[Fault]:
        return dynamics_faults(self.problem, self.checker.options.kinodynamic.centroidal, trajectory)


@pytest.fixture(scope="module")
def case() -> Case:
    return Case()


def test_the_motion_itself_has_no_fault(case: Case) -> None:
    assert case.motion(case.q) == []
    assert case.dynamics(case.trajectory) == []


def test_a_standing_foot_that_slips_is_found_where_it_slips(case: Case) -> None:
    q = case.q.copy()
    q[2, 4] += 0.01
    fault = case.motion(q)[0]
    assert fault.block == "contact of left_foot"
    assert "10.0 mm" in fault.detail
    assert fault.told(case.question, SWING).startswith("swing of right_foot, 0.")


def test_a_new_contact_that_is_missed_is_found_after_the_swing(case: Case) -> None:
    hip = 7 + case.checker.fit.kinematics.joint_names.index("right_hip_roll")
    q = case.q.copy()
    q[5:, hip] += 0.02
    fault = case.motion(q)[0]
    assert fault.block == "contact of right_foot"
    assert fault.told(case.question, SWING).startswith("after contact of right_foot, 0.4")


def test_before_it_is_made_the_new_contact_binds_nothing(case: Case) -> None:
    hip = 7 + case.checker.fit.kinematics.joint_names.index("right_hip_roll")
    q = case.q.copy()
    q[2, hip] += 0.02
    assert "contact of right_foot" not in {fault.block for fault in case.motion(q)}


def test_a_foot_that_turns_in_place_is_found(case: Case) -> None:
    ankle = 7 + case.checker.fit.kinematics.joint_names.index("left_ankle_roll")
    q = case.q.copy()
    q[6, ankle] += np.deg2rad(2.0)
    assert any("turned by 2.0 deg" in fault.detail for fault in case.motion(q))


def test_a_joint_beyond_its_limit_is_named(case: Case) -> None:
    kinematics = case.checker.fit.kinematics
    elbow = kinematics.joint_names.index("left_elbow")
    q = case.q.copy()
    q[:, 7 + elbow] = kinematics.tree.upper[elbow] + 0.01
    assert "limit of left_elbow" in {fault.block for fault in case.motion(q)}


def test_a_joint_that_moves_too_fast_is_named_with_its_instant(case: Case) -> None:
    wrist = 7 + case.checker.fit.kinematics.joint_names.index("left_wrist_yaw")
    q = case.q.copy()
    q[4:, wrist] += 1.5 if q[4, wrist] < 0 else -1.5
    faults = {fault.block: fault for fault in case.motion(q)}
    assert faults["speed of left_wrist_yaw"].time == pytest.approx(0.3)


def test_a_centre_of_mass_that_goes_elsewhere_than_the_forces_send_it_is_found(case: Case) -> None:
    trajectory = replace(case.trajectory, com=case.trajectory.com + np.array([0.0, 0.02, 0.0]))
    agreement = case.checker.options.kinodynamic.agreement
    kinematics = case.checker.fit.kinematics
    blocks = [f.block for f in motion_faults(kinematics, case.problem.schedule, trajectory, case.q, agreement)]
    assert blocks == ["CoM"]


def test_angular_momentum_that_the_limbs_do_not_have_is_found(case: Case) -> None:
    off = case.trajectory.angular_momentum + np.array([8.0, 0.0, 0.0])
    agreement = case.checker.options.kinodynamic.agreement
    kinematics = case.checker.fit.kinematics
    trajectory = replace(case.trajectory, angular_momentum=off)
    blocks = [f.block for f in motion_faults(kinematics, case.problem.schedule, trajectory, case.q, agreement)]
    assert blocks == ["angular momentum"]


def test_a_robot_that_still_moves_at_the_end_is_found(case: Case) -> None:
    q = case.q.copy()
    q[-1, 4:7] += [0.02, 0.0, 0.0]
    assert any("left at the end" in fault.detail for fault in case.motion(q))


def test_a_motor_that_is_too_weak_is_named(case: Case) -> None:
    """The knee of the standing leg carries the body; half of what it needs is not enough."""
    kinematics = case.checker.fit.kinematics
    state = case.checker.fit.fit(
        case.question.stance, case.question.com, case.question.linear_momentum, case.question.angular_momentum
    )
    strong = np.full(len(kinematics.joint_names), 1e4)
    asked = kinematics, case.problem, case.trajectory, case.q, state.v
    assert torque_fault(*asked, strong) is None
    weak = strong.copy()
    weak[kinematics.joint_names.index("left_knee")] = 5.0
    fault = torque_fault(*asked, weak)
    assert fault is not None
    assert fault.block == "torque of left_knee"


@pytest.mark.parametrize("spoil", [np.nan, np.inf])
def test_numbers_that_are_none_never_pass(case: Case, spoil: float) -> None:
    q = case.q.copy()
    q[3, 12] = spoil
    assert case.motion(q)
    assert case.motion(q[:-1])
    assert case.motion(q[:0])


@pytest.mark.parametrize(
    ("field", "change", "block"),
    [
        ("force_W", lambda f: 1.05 * f, "newton"),
        ("com", lambda c: c + [0.0, 0.0, 1e-3] * np.arange(len(c))[:, None], "com integration"),
        ("angular_momentum", lambda k: k + np.linspace(0, 1, len(k))[:, None], "euler"),
        ("cop_C", lambda z: z + 0.2, "pressure centre"),
        ("linear_momentum", lambda x: x + 1.0, "rest: linear momentum"),
    ],
)
def test_forces_and_momenta_that_break_the_dynamics_are_found(
    case: Case, field: str, change: object, block: str
) -> None:
    trajectory = replace(case.trajectory, **{field: change(getattr(case.trajectory, field))})  # type: ignore[operator]
    assert any(fault.block.startswith(block) for fault in case.dynamics(trajectory))
