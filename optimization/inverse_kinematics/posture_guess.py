"""Where to start looking for a posture: the nominal one, set over the feet that are held."""

from __future__ import annotations

import numpy as np
from numba import njit

from optimization.inverse_kinematics.ik_tasks import edge_normal
from optimization.inverse_kinematics.stance_task import StanceTask, WholeBodyModel
from optimization.multibody.kinematic_tree import center_of_mass, forward, rotation_of_quaternion

NUM_FEET = 2  # the first two end effectors


@njit(cache=True)
def _heading(task: StanceTask, q: np.ndarray) -> tuple[float, float]:
    """Cosine and sine of the mean yaw of the active feet; of the base where none is active."""
    x, y = 0.0, 0.0
    for e in range(NUM_FEET):
        if task.active[e]:
            length = np.hypot(task.X_WE[e, 0, 0], task.X_WE[e, 1, 0])
            if length > 1e-6:
                x += task.X_WE[e, 0, 0] / length
                y += task.X_WE[e, 1, 0] / length
    length = np.hypot(x, y)
    if length < 1e-6:
        w, i, j, k = q[0], q[1], q[2], q[3]
        x, y = w * w + i * i - j * j - k * k, 2.0 * (i * j + w * k)
        length = max(np.hypot(x, y), 1e-12)
    return x / length, y / length


@njit(cache=True)
def upright_base(model: WholeBodyModel, task: StanceTask, q: np.ndarray) -> np.ndarray:
    """(3, 3) the base's nominal orientation, turned to the heading of the feet.

    Args:
        model: of the robot.
        task: its feet give the heading.
        q: (nq,) gives the heading where no foot is active.
    """
    c, s = _heading(task, q)
    R_nominal = np.empty((3, 3))
    rotation_of_quaternion(model.q_nominal, R_nominal)
    R = R_nominal.copy()
    for b in range(3):
        R[0, b] = c * R_nominal[0, b] - s * R_nominal[1, b]
        R[1, b] = s * R_nominal[0, b] + c * R_nominal[1, b]
    return R


@njit(cache=True)
def guess_posture(model: WholeBodyModel, task: StanceTask, drop: float, bend: float, q: np.ndarray) -> None:
    """Writes q (nq,): the nominal posture set over the active feet, its CoM moved into the polygon.

    The base faces the mean heading of the feet, its hips over them, as high as nominal or as the legs reach, less
    `drop` [m]. The joints are nominal at `bend` 0 and in the middle of their limits at 1. Without an active foot,
    heading and place are those of the q that is passed in.

    Args:
        model: of the robot.
        task: what the posture must hold.
        drop: of the pelvis below its usual height [m].
        bend: 0 for nominal joints, 1 for the middle of their limits.
        q: (nq,) written.
    """
    c, s = _heading(task, q)
    x, y, z, ceiling, feet = 0.0, 0.0, 0.0, np.inf, 0
    for e in range(NUM_FEET):
        if task.active[e]:
            side = model.hip[1] if e == 0 else -model.hip[1]
            x += task.X_WE[e, 0, 3] + s * side
            y += task.X_WE[e, 1, 3] - c * side
            z += task.X_WE[e, 2, 3]
            feet += 1
    old_x, old_y, old_z = q[4], q[5], q[6]
    for i in range(q.shape[0]):
        q[i] = model.q_nominal[i]
    for j in range(model.tree.lower.shape[0]):
        middle = 0.5 * (model.tree.lower[j] + model.tree.upper[j])
        if np.isfinite(middle):
            q[7 + j] += bend * (middle - q[7 + j])
    half = 0.5 * np.arctan2(s, c)
    _turn_about_z(np.cos(half), np.sin(half), q)
    if feet == 0:
        q[4], q[5], q[6] = old_x, old_y, old_z
        return
    x, y, z = x / feet, y / feet, z / feet
    for e in range(NUM_FEET):
        if task.active[e]:
            side = model.hip[1] if e == 0 else -model.hip[1]
            hx, hy = x + c * model.hip[0] - s * side, y + s * model.hip[0] + c * side
            away2 = (task.X_WE[e, 0, 3] - hx) ** 2 + (task.X_WE[e, 1, 3] - hy) ** 2
            reach = np.sqrt(max(model.leg_length**2 - away2, (0.5 * model.leg_length) ** 2))
            ceiling = min(ceiling, task.X_WE[e, 2, 3] + reach - model.hip[2])
    base_x, base_y = model.q_nominal[4], model.q_nominal[5]
    q[4] = x + c * base_x - s * base_y
    q[5] = y + s * base_x + c * base_y
    q[6] = model.q_nominal[6] + min(z, ceiling) - drop
    _move_com_inside(model, task, q)


@njit(cache=True)
def _turn_about_z(c: float, s: float, q: np.ndarray) -> None:
    """Turns the base's quaternion by the quaternion (c, 0, 0, s) from the left."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    q[0], q[1], q[2], q[3] = c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w


@njit(cache=True)
def _move_com_inside(model: WholeBodyModel, task: StanceTask, q: np.ndarray) -> None:
    """Shifts the base so that the CoM enters the polygon on the way to its centre, or goes to its target."""
    n = model.tree.parent.shape[0]
    R, p, com, normal = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty(3), np.empty(2)
    forward(model.tree, q, R, p)
    center_of_mass(model.tree, R, p, com)
    for a in range(2):
        if not np.isnan(task.com_target[a]):
            q[4 + a] += task.com_target[a] - com[a]
            com[a] = task.com_target[a]
    if task.num_vertices == 0:
        return
    dx, dy = -com[0], -com[1]
    for k in range(task.num_vertices):
        dx += task.region[k, 0] / task.num_vertices
        dy += task.region[k, 1] / task.num_vertices
    step = 0.0
    for k in range(task.num_vertices):
        b = edge_normal(task.region, k, task.num_vertices, normal)
        v = normal[0] * com[0] + normal[1] * com[1] - b
        towards = -(normal[0] * dx + normal[1] * dy)
        if v > -0.01 and towards > 1e-9:
            step = max(step, (v + 0.01) / towards)
    q[4] += min(step, 1.0) * dx
    q[5] += min(step, 1.0) * dy
