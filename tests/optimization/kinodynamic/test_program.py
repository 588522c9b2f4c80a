"""The kino-dynamic program: both halves agree, contacts stay, torques and speeds are kept, bad input is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.kinodynamic.momentum_gap import Gap, MomentumGap
from optimization.kinodynamic.program import HOLD, KinodynamicOptions, KinodynamicProblem, KinodynamicProgram
from scenes.contact import Contact, contact_pose
from scenes.effector import LEFT_FOOT, RIGHT_FOOT
from scenes.input_error import InputError
from scenes.robots.plant import nominal_posture
from scenes.robots.robot import load_robot
from scenes.stance import Stance

ROBOT = load_robot("escher")
DT = 0.1
NEVER = MomentumGap(Gap(0.0, 0.0), Gap(0.0, 0.0), Gap(0.0, 0.0))
OPTIONS = KinodynamicOptions(centroidal=CentroidalOptions(dt=DT))
PROGRAM = KinodynamicProgram(ROBOT, OPTIONS)
Q = np.array(nominal_posture(ROBOT))


def foot(name: str, x: float, y: float) -> Contact:
    return Contact(name, 0, contact_pose(name, np.array([x, y, 0.0]), np.array([0.0, 0.0, 1.0]), 0.0), 0.6)


STANDING = Stance((foot("left_foot", 0.0, 0.1), foot("right_foot", 0.0, -0.1), None, None))
STEP = [STANDING, STANDING.replace(LEFT_FOOT, foot("left_foot", 0.25, 0.1))]
STEPS = [*STEP, STEP[-1].replace(RIGHT_FOOT, foot("right_foot", 0.25, -0.1))]


def problem(stances: list[Stance], **changes: object) -> KinodynamicProblem:
    centroidal = CentroidalProblem(
        schedule=ContactSchedule.from_stances(stances, dt=DT),
        mass=ROBOT.mass,
        half_extent=ROBOT.half_extents,
        initial_com=PROGRAM.kinematics.com(Q),
    )
    return KinodynamicProblem(centroidal, Q, **changes)


def test_dynamics_and_kinematics_agree_on_two_steps():
    estimate = PROGRAM.solve(problem(STEPS))
    assert estimate.feasible, estimate.reason
    assert estimate.gaps[-1].com.worst < 2e-3
    assert estimate.gaps[-1].angular.worst < 1.0
    assert estimate.held_error < 1e-3


def test_the_gap_is_what_the_configurations_say():
    wanted = problem(STEPS)
    estimate = PROGRAM.solve(wanted)
    kinematics, trajectory = PROGRAM.kinematics, estimate.centroidal.trajectory
    com = np.array([kinematics.com(x) for x in estimate.q])
    assert Gap.of(com[1:] - trajectory.com[1:]).worst == pytest.approx(estimate.gaps[-1].com.worst, abs=1e-9)
    middle = [
        kinematics.momentum_matrix(kinematics.integrate(a, kinematics.difference(a, b), 0.5))
        @ kinematics.difference(a, b)
        / DT
        for a, b in zip(estimate.q[:-1], estimate.q[1:], strict=True)
    ]
    assert np.abs(np.array(middle) - estimate.momentum).max() < 0.05  # second order in the step


def test_feeding_the_motion_back_closes_the_angular_gap():
    program = KinodynamicProgram(ROBOT, replace(OPTIONS, iterations=3, agreement=NEVER, angular_weight=0.03))
    gaps = program.solve(problem(STEPS)).gaps
    assert gaps[1].angular.rms < 0.5 * gaps[0].angular.rms
    assert gaps[2].angular.rms < gaps[1].angular.rms


def test_a_robot_at_rest_over_its_feet_stays():
    estimate = PROGRAM.solve(problem([STANDING], q_reference=None))
    assert estimate.feasible, estimate.reason
    assert np.abs(estimate.momentum).max() < 12.0  # the CoM moves over the middle of the feet, no more
    assert np.abs(estimate.q[-1] - estimate.q[-2]).max() < 5e-3


def test_joint_limits_hold_and_speeds_are_reported():
    estimate = PROGRAM.solve(problem(STEPS))
    tree = PROGRAM.kinematics.tree
    assert (estimate.q[1:, 7:] >= tree.lower - 1e-12).all()
    assert (estimate.q[1:, 7:] <= tree.upper + 1e-12).all()
    v = np.array([PROGRAM.kinematics.difference(a, b) for a, b in zip(estimate.q[:-1], estimate.q[1:], strict=True)])
    assert estimate.speed_share == pytest.approx((np.abs(v[:, 6:]) / DT / tree.speed).max())


def test_a_problem_solved_again_gives_the_same_answer():
    program = KinodynamicProgram(ROBOT, OPTIONS)
    first = program.solve(problem(STEP))
    program.solve(problem(STEPS))
    again = program.solve(problem(STEP))
    assert np.allclose(first.q, again.q, atol=1e-4)


def test_contact_forces_that_cannot_be_had_make_it_infeasible():
    far = STANDING.replace(LEFT_FOOT, foot("left_foot", 3.0, 0.1))
    estimate = PROGRAM.solve(problem([STANDING, far]))
    assert not estimate.feasible
    assert estimate.reason.startswith("dynamics: reach of left_foot exceeded")


def test_torque_limits_bound_the_forces():
    free = KinodynamicProgram(ROBOT, replace(OPTIONS, iterations=2, agreement=NEVER))
    need = free.solve(problem(STEP)).torque_share
    tight = KinodynamicProgram(ROBOT, replace(OPTIONS, iterations=4, agreement=NEVER, torque_limits=True))
    tight.effort = 0.93 * need * tight.effort
    estimate = tight.solve(problem(STEP))
    assert estimate.centroidal.feasible
    assert estimate.torque_share < 1.02  # of the tightened limits: the rows belong to the iteration before


def test_distances_are_kept():
    """The left palm may not come below a height that it has at the start plus 10 cm."""
    from optimization.inverse_kinematics.frame_task import DistanceRows

    tree = PROGRAM.kinematics.tree
    height = PROGRAM.kinematics.effector_poses(Q)[2, 2, 3] + 0.1

    def above(q: np.ndarray) -> DistanceRows:
        n = len(q)
        return DistanceRows(
            np.arange(n + 1), np.tile([int(tree.frame_link[2]), -1], (n, 1)),
            np.tile(np.stack([tree.p_LE[2], np.zeros(3)]), (n, 1, 1)), np.tile([0.0, 0.0, 1.0], (n, 1)),
            np.where(np.arange(n) < 5, -10.0, height), np.full(n, 50.0),
        )  # fmt: skip

    estimate = PROGRAM.solve(problem(STEP, distances=above))
    palm = np.array([PROGRAM.kinematics.effector_poses(x)[2, 2, 3] for x in estimate.q])
    assert palm[8:].min() > height - 0.01


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"v_start": np.full(33, np.nan)}, "v_start"),
        ({"q_reference": np.zeros((3, 34))}, "q_reference"),
        ({"X_WE": np.zeros((1, 4, 4, 4))}, "X_WE"),
        ({"effector_weight": np.full((len(problem(STEP).centroidal.schedule.times), 4, 2), HOLD)}, "X_WE"),
    ],
)
def test_bad_arrays_are_named(changes: dict, named: str):
    with pytest.raises(InputError, match=named):
        PROGRAM.solve(problem(STEP, **changes))
