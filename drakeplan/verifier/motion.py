"""Whether the motion keeps limits, contacts and the planned centre of mass."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportReturnType=false

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .collision import check_collisions
from .dynamics import check_dynamics
from .geometry import angle_between
from .limits import (
    ACCELERATION,
    AT_REST,
    EFFECTORS,
    HELD_ANGLE,
    HELD_POSITION,
    JOINT_LIMIT,
    QUATERNION,
    SAME_TIME,
    SPEED_LIMIT,
    VELOCITY,
)
from .plan_file import PlanFile, UnreadablePlan
from .report import Sheet, which_end
from .robot import RobotModel
from .scene import Scene
from .track import Track, follow


def check_motion(sheet: Sheet, plan: PlanFile, robot: RobotModel, scene: Scene) -> None:
    """The motion's limits, its contacts, dynamics and collisions.

    Raises:
        UnreadablePlan: positions or velocities are not those of the model.

    Args:
        sheet: takes the checks.
        plan: the plan file.
        robot: the robot's model.
        scene: the plan's scene.
    """
    t, q, v, plant = plan["motion/t"], plan["motion/q"], plan["motion/v"], robot.plant
    names = tuple(plant.GetPositionNames()), tuple(plant.GetVelocityNames())
    if names != (plan.names["position_names"], plan.names["velocity_names"]):
        raise UnreadablePlan(f"{plan.path}: motion: its position or velocity names are not those of the model")
    if (len(names[0]), len(names[1])) != (q.shape[1], v.shape[1]) or q.shape[1] != v.shape[1] + 1:
        raise UnreadablePlan(f"{plan.path}: motion: expected {len(names[0])} positions and {len(names[1])} velocities")
    if "motion/tau" in plan.data:
        if plan.names["actuator_names"] != tuple(robot.actuator_names):
            raise UnreadablePlan(f"{plan.path}: motion: its actuator names are not those of the model")
        if plan["motion/tau"].shape[1] != len(robot.actuator_names):
            raise UnreadablePlan(f"{plan.path}: motion: expected torques of {len(robot.actuator_names)} actuators")

    def at(index: tuple[int, ...], labels: Sequence[str] = ()) -> str:
        label = f", {labels[index[1]]}" if labels else ""
        return f"frame {index[0]}, t = {t[index[0]]:.3f} s{label}"

    norm = np.linalg.norm(q[:, :4], axis=1)
    unit = sheet.add("quaternion unit", np.abs(norm - 1), QUATERNION, "", at)
    sheet.add("quaternion sign", -(q[1:, :4] * q[:-1, :4]).sum(axis=1), 0, "", at)
    over = np.maximum(plant.GetPositionLowerLimits() - q, q - plant.GetPositionUpperLimits())
    sheet.add("joint limits", over, JOINT_LIMIT, "rad", lambda i: at(i, names[0]))
    difference = _difference(t, q) if norm.min() > 1e-3 else np.full((len(t) - 1, v.shape[1]), np.nan)
    lower, upper = plant.GetVelocityLowerLimits(), plant.GetVelocityUpperLimits()
    over = np.maximum(lower - v, v - upper)
    over[1:] = np.maximum(over[1:], np.maximum(lower - difference, difference - upper))
    sheet.add("joint speeds", over, SPEED_LIMIT, "rad/s", lambda i: at(i, names[1]))
    sheet.add("velocities", _velocity_error(v, difference), VELOCITY, "rad/s", lambda i: at(i, names[1]))
    joints = slice(6, None)
    acceleration = np.abs(np.diff(v[:, joints], axis=0)) / np.diff(t)[:, None]
    sheet.add("joint accelerations", acceleration, ACCELERATION, "rad/s^2", lambda i: at(i, names[1][joints]))
    sheet.add("posture at rest", np.abs(v[[0, -1]]), AT_REST, "rad/s", lambda i: f"{which_end(i[0])}, {names[1][i[1]]}")
    if not unit:
        return
    boxes = robot.body_boxes()
    track = follow(robot, plan, boxes.bodies)
    _check_held(sheet, plan, track)
    check_dynamics(sheet, plan, robot, track)
    check_collisions(sheet, plan, robot, scene, boxes, track.X_WB)


def _difference(t: np.ndarray, q: np.ndarray) -> np.ndarray:
    """(T-1, nv) mean velocity over each frame: base turn in W [rad/s], base point [m/s], joints [rad/s]."""
    dt = np.diff(t)[:, None]
    unit = q[:, :4] / np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    (w0, u0), (w1, u1) = (unit[:-1, :1], unit[:-1, 1:4]), (unit[1:, :1], unit[1:, 1:4])
    # q1 times the conjugate of q0 is the turn in W.
    scalar = w1 * w0 + (u1 * u0).sum(axis=1, keepdims=True)
    vector = w0 * u1 - w1 * u0 - np.cross(u1, u0)
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    angle = 2 * np.arctan2(length, scalar)
    turn = vector * np.where(length > 1e-12, angle / np.maximum(length, 1e-12), 2.0)
    return np.hstack([turn, np.diff(q[:, 4:], axis=0)]) / dt


def _velocity_error(v: np.ndarray, difference: np.ndarray) -> np.ndarray:
    """(T-1, nv) how far velocities (T, nv) are from the mean velocity over each frame (T-1, nv).

    The lesser of two differences, as velocities may be stored in either way. Samples of a curve: the mean velocity over a
    frame lies between those at its ends. Central differences of positions: the velocity at a frame is the mean of the mean
    velocities before and after it. `VELOCITY` says what remains of either where accelerations change.
    """
    between = np.maximum(np.minimum(v[:-1], v[1:]) - difference, difference - np.maximum(v[:-1], v[1:]))
    beside = np.concatenate([difference[:1], (difference[:-1] + difference[1:]) / 2, difference[-1:]])
    centred = np.abs(v - beside)
    return np.minimum(between, np.maximum(centred[:-1], centred[1:]))


def _check_held(sheet: Sheet, plan: PlanFile, track: Track) -> None:
    """Forward kinematics of every end effector that a phase says is held, both phases at their common instant."""
    t, X_WC = plan["motion/t"], plan["contacts/X_WC"]
    position, angle = np.full((len(t), 4), -np.inf), np.full((len(t), 4), -np.inf)
    phases = zip(plan["phases/start"], plan["phases/end"], plan["phases/contact"], strict=True)
    seen = np.zeros(len(t), dtype=bool)
    for start, end, contact in phases:
        frames = np.flatnonzero((t >= start - SAME_TIME) & (t <= end + SAME_TIME))
        seen[frames] = True
        for e, c in enumerate(contact):
            if c < 0:
                continue
            X = track.X_WE[frames, e]
            position[frames, e] = np.maximum(position[frames, e], np.linalg.norm(X[:, :3, 3] - X_WC[c, :3, 3], axis=1))
            angle[frames, e] = np.maximum(angle[frames, e], angle_between(X[:, :3, :3], X_WC[c, :3, :3]))

    def at(index: tuple[int, ...]) -> str:
        return f"frame {index[0]}, t = {t[index[0]]:.3f} s, {EFFECTORS[index[1]]}"

    position[~seen], angle[~seen] = np.nan, np.nan
    sheet.add("held contacts stay", position, HELD_POSITION, "m", at)
    sheet.add("held contacts keep level", angle, HELD_ANGLE, "rad", at)
