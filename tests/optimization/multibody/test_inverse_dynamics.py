"""Inverse dynamics and contact torques against Drake, and closed forms of standing still."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.math import RotationMatrix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.tree import MultibodyForces

from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import ARM
from optimization.centroidal.problem import CentroidalProblem
from optimization.kinodynamic.joint_torques import TorqueRows, joint_torques
from optimization.multibody.inverse_dynamics import effort_limits, inverse_dynamics
from optimization.multibody.kinematics import Kinematics
from scenes.contact import Contact, contact_pose
from scenes.gravity import GRAVITY
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import load_robot

ROBOTS = ("escher", "jvrc1")


def loaded(name: str):
    robot = load_robot(name)
    plant = build_plant(robot).plant
    return robot, plant, Kinematics.from_plant(plant, [e.frame for e in robot.effectors])


def moving(robot, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q = np.array(nominal_posture(robot))
    q[:4] = rng.normal(size=4)
    q[:4] /= np.linalg.norm(q[:4])
    q[4:7] = rng.normal(size=3)
    q[7:] += rng.uniform(-0.4, 0.4, len(q) - 7)
    return q, rng.normal(size=len(q) - 1), rng.normal(size=len(q) - 1)


@pytest.mark.parametrize("name", ROBOTS)
def test_inverse_dynamics_are_drakes(name: str):
    robot, plant, kinematics = loaded(name)
    context, zero = plant.CreateDefaultContext(), MultibodyForces(plant)
    for seed in range(5):
        q, v, vdot = moving(robot, seed)
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        zero.SetZero()
        drake = plant.CalcInverseDynamics(context, vdot, zero) - plant.CalcGravityGeneralizedForces(context)
        ours = inverse_dynamics(kinematics.tree, q[None], v[None], vdot[None])[0]
        assert np.allclose(ours, drake, atol=1e-9)


def test_torques_under_contact_wrenches_are_drakes():
    robot, plant, kinematics = loaded("escher")
    context, forces = plant.CreateDefaultContext(), MultibodyForces(plant)
    q, v, vdot = moving(robot, 7)
    plant.SetPositions(context, q)
    plant.SetVelocities(context, v)
    wrench = 100.0 * np.random.default_rng(0).normal(size=(4, 6))
    forces.SetZero()
    for e, spec in enumerate(robot.effectors):
        frame = plant.GetFrameByName(spec.frame)
        body = frame.body()
        p_BE = frame.CalcPose(context, body.body_frame()).translation()
        body.AddInForce(context, p_BE, SpatialForce(wrench[e, :3], wrench[e, 3:]), plant.world_frame(), forces)
    drake = plant.CalcInverseDynamics(context, vdot, forces) - plant.CalcGravityGeneralizedForces(context)
    ours = joint_torques(kinematics.tree, q[None], v[None], vdot[None], wrench[None])[0]
    assert np.allclose(ours, drake[6:], atol=1e-9)


def test_a_robot_at_rest_weighs_its_weight_at_its_centre_of_mass():
    robot, _, kinematics = loaded("escher")
    q, v, _ = moving(robot, 3)
    tau = inverse_dynamics(kinematics.tree, q[None], 0 * v[None], 0 * v[None])[0]
    weight = np.array([0.0, 0.0, GRAVITY * kinematics.total_mass])
    assert np.allclose(tau[3:6], weight, atol=1e-9)
    assert np.allclose(tau[:3], np.cross(kinematics.com(q) - q[4:7], weight), atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_effort_limits_are_in_the_order_of_velocities(name: str):
    _, plant, kinematics = loaded(name)
    limit = effort_limits(plant)
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        assert limit[kinematics.joint_names.index(actuator.joint().name())] == actuator.effort_limit()


def test_rows_in_the_program_say_what_the_torques_are():
    """bias - rows w = torque, for any wrenches w, in the program's units and contact frames."""
    robot, plant, kinematics = loaded("escher")
    q0 = np.array(nominal_posture(robot))
    poses = kinematics.effector_poses(q0)
    tilt = RotationMatrix.MakeXRotation(0.2).matrix()
    feet = [Contact(n, 0, contact_pose(n, poses[e, :3, 3], tilt[:, 2], 0.3), 0.6) for e, n in
            enumerate(("left_foot", "right_foot"))]  # fmt: skip
    schedule = ContactSchedule.from_rows([(*feet, None, None), (feet[0], None, None, None)], 0.1)
    problem = CentroidalProblem(schedule, robot.mass, robot.half_extents, kinematics.com(q0))
    rng = np.random.default_rng(0)
    q, v = np.tile(q0, (3, 1)), rng.normal(size=(3, len(q0) - 1))
    effort = effort_limits(plant)
    rows = TorqueRows(kinematics, problem, effort, q, v)
    index = np.arange(18).reshape(3, 6)
    sparse, lower, upper = rows.in_program(index)
    at, column = sparse.places
    A = np.zeros((len(upper), 18))
    np.add.at(A, (at, column), sparse.values)
    w = rng.normal(size=(3, 6))
    weight = robot.mass * GRAVITY
    torque = weight * (0.5 * (lower + upper) - A @ w.ravel())
    wrench_W = np.zeros((2, 4, 6))
    for j, (n, e) in enumerate([(0, 0), (0, 1), (1, 0)]):
        R = feet[e].X_WC[:3, :3]
        wrench_W[n, e] = weight * np.concatenate([ARM * R @ w[j, 3:], R @ w[j, :3]])
    rate = np.array([(v[2] - v[1]) / 0.1, 0 * v[0]])
    expected = joint_torques(kinematics.tree, q[1:], v[1:], rate, wrench_W)
    moved = [
        n * expected.shape[1] + j for n in range(2) for j in range(expected.shape[1]) if _on_a_chain(kinematics, n, j)
    ]
    assert np.allclose(torque, expected.ravel()[moved], atol=1e-6 * weight)
    assert np.allclose(weight * 0.5 * (upper - lower), np.tile(effort, 2)[moved])


def _on_a_chain(kinematics: Kinematics, interval: int, joint: int) -> bool:
    """Whether a foot that carries in this interval hangs on the joint."""
    for e in (0, 1) if interval == 0 else (0,):
        link = int(kinematics.tree.frame_link[e])
        while link > 0:
            if link == joint + 1:
                return True
            link = int(kinematics.tree.parent[link])
    return False
