"""What the robot's model does in the motion: poses, momenta and joint torques, frame by frame, by Drake."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.tree import MultibodyForces, RigidBody

from .limits import SAME_TIME
from .plan_file import PlanFile
from .robot import RobotModel


@dataclass(frozen=True, eq=False)
class Track:
    """The model at each of the T frames.

    Attributes:
        X_WE: (T, 4, 4, 4) poses of the four end effectors' frames in W.
        com: (T, 3) centre of mass in W [m].
        X_WB: (T, B, 4, 4) poses of the bodies with collision shapes in W [m].
        linear: (T, 3) linear momentum in W [kg m/s].
        angular: (T, 3) angular momentum about the centre of mass in W [N m s].
        torque: (T-1, A) that each actuator has to apply from one frame to the next [N m].
    """

    X_WE: np.ndarray
    com: np.ndarray
    X_WB: np.ndarray
    linear: np.ndarray
    angular: np.ndarray
    torque: np.ndarray


def follow(robot: RobotModel, plan: PlanFile, bodies: Sequence[RigidBody]) -> Track:
    """Puts the model into the positions and velocities of every frame.

    The joint torques are those of inverse dynamics, tau = M(q) vdot + C(q, v) v - tau_g - sum J^T F: q and v of the
    frame, vdot the change of v to the next frame, tau_g gravity and the joints' damping, F the planned contact wrenches.

    Args:
        robot: the model.
        plan: with motion and forces.
        bodies: whose poses are asked for.
    """
    plant, context, forces = robot.plant, robot.plant_context, MultibodyForces(robot.plant)
    t, q, v = plan["motion/t"], plan["motion/q"], plan["motion/v"]
    vdot = np.diff(v, axis=0) / np.diff(t)[:, None]
    wrench, held = _contact_wrenches(plan), plan["centroidal/contact"] >= 0
    # The forces of knot n act over [t_n, t_n+1).
    knot = np.searchsorted(plan["centroidal/t"], t + SAME_TIME, side="right") - 1
    knot = np.clip(knot, 0, len(held) - 2)
    X_WE, com, X_WB = np.empty((len(q), 4, 4, 4)), np.empty((len(q), 3)), np.empty((len(q), len(bodies), 4, 4))
    momentum, torque = np.empty((len(q), 6)), np.empty((len(q) - 1, v.shape[1]))
    for k, state in enumerate(np.hstack([q, v])):
        plant.SetPositionsAndVelocities(context, state)
        X_WE[k] = [frame.CalcPoseInWorld(context).GetAsMatrix4() for frame in robot.frames]
        com[k] = plant.CalcCenterOfMassPositionInWorld(context)
        for b, body in enumerate(bodies):
            X_WB[k, b] = plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4()
        momentum[k] = plant.CalcSpatialMomentumInWorldAboutPoint(context, com[k]).get_coeffs()
        if k == len(torque):
            break
        plant.CalcForceElementsContribution(context, forces)
        for e in np.flatnonzero(held[knot[k]]):
            body = robot.frames[e].body()
            p_WB = body.EvalPoseInWorld(context).translation()
            about_origin = SpatialForce(wrench[knot[k], e, :3], wrench[knot[k], e, 3:])
            body.AddInForceInWorld(context, about_origin.Shift(p_WB), forces)
        torque[k] = plant.CalcInverseDynamics(context, vdot[k], forces)
    return Track(X_WE, com, X_WB, momentum[:, 3:], momentum[:, :3], torque[:, robot.actuated])


def _contact_wrenches(plan: PlanFile) -> np.ndarray:
    """(N, 4, 6) moment about W's origin [N m] and force [N] of every contact on the robot, in W; 0 where none is held."""
    contact, force = plan["centroidal/contact"], plan["centroidal/force_W"]
    X_WC = plan["contacts/X_WC"][np.maximum(contact, 0)]
    p_cop = X_WC[..., :3, 3] + np.einsum("neij,nej->nei", X_WC[..., :3, :2], plan["centroidal/cop_C"])
    moment = np.cross(p_cop, force) + plan["centroidal/torque_n"][..., None] * X_WC[..., :3, 2]
    return np.where(contact[..., None] >= 0, np.concatenate([moment, force], axis=2), 0.0)
