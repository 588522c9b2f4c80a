"""Joint torques of a floating-base robot that moves in a given way: recursive Newton-Euler in numba.

    tau = M(q) vdot + C(q, v) v - tau_g(q) - sum_e J_e^T w_e

with w_e the wrenches of the contacts. The recursion (Featherstone 2008, ch. 5) is written in the world's axes with the
link origins as points of reference: velocities and accelerations outwards, forces and moments inwards.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from pydrake.multibody.plant import MultibodyPlant

from optimization.kinematic_tree import KinematicTree, forward

GRAVITY = 9.81  # [m/s^2]


def inverse_dynamics(tree: KinematicTree, q: np.ndarray, v: np.ndarray, vdot: np.ndarray) -> np.ndarray:
    """(T, nv) generalized forces that bring about vdot without contacts: moment and force on the base, joint torques.

    Args:
        tree: the robot.
        q: (T, nq).
        v: (T, nv).
        vdot: (T, nv), its base part the derivative of (w_WB, v_WB) in W.
    """
    tau = np.empty_like(v, dtype=float)
    _inverse_dynamics(tree, *(np.array(x, dtype=float, order="C") for x in (q, v, vdot)), tau)
    return tau


def effort_limits(plant: MultibodyPlant) -> np.ndarray:
    """(nv - 6,) greatest torque [N m] or force [N] of each joint in the order of v[6:], inf where the model has none.

    Actuators come in another order than velocities.
    """
    limit = np.full(plant.num_velocities() - 6, np.inf)
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        limit[actuator.joint().velocity_start() - 6] = actuator.effort_limit()
    return limit


@njit(cache=True)
def _inverse_dynamics(tree: KinematicTree, q: np.ndarray, v: np.ndarray, vdot: np.ndarray, tau: np.ndarray) -> None:
    n = tree.parent.shape[0]
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    w, alpha, a = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    f, m = np.empty((n, 3)), np.empty((n, 3))
    for t in range(q.shape[0]):
        forward(tree, q[t], R, p)
        w[0], alpha[0], a[0] = v[t, :3], vdot[t, :3], vdot[t, 3:6]
        a[0, 2] += GRAVITY
        for i in range(1, n):
            k, z = tree.parent[i], R[i, :, 2]
            rate, acceleration = v[t, 5 + i], vdot[t, 5 + i]
            r = p[i] - p[k]
            w[i] = w[k]
            alpha[i] = alpha[k]
            a[i] = a[k] + np.cross(alpha[k], r) + np.cross(w[k], np.cross(w[k], r))
            if tree.prismatic[i]:
                a[i] += acceleration * z + 2.0 * rate * np.cross(w[k], z)
            else:
                w[i] += rate * z
                alpha[i] += acceleration * z + rate * np.cross(w[k], z)
        for i in range(n):
            c = R[i] @ tree.p_LLcm[i]
            at_com = a[i] + np.cross(alpha[i], c) + np.cross(w[i], np.cross(w[i], c))
            inertia = R[i] @ tree.I_LLcm_L[i] @ R[i].T
            f[i] = tree.mass[i] * at_com
            m[i] = inertia @ alpha[i] + np.cross(w[i], inertia @ w[i]) + np.cross(c, f[i])
        for i in range(n - 1, 0, -1):
            k = tree.parent[i]
            tau[t, 5 + i] = (f[i] if tree.prismatic[i] else m[i]) @ np.ascontiguousarray(R[i, :, 2])
            m[k] += m[i] + np.cross(p[i] - p[k], f[i])
            f[k] += f[i]
        tau[t, :3], tau[t, 3:6] = m[0], f[0]
