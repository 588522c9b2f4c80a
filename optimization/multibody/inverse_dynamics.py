"""Joint torques of a floating-base robot that moves in a given way: recursive Newton-Euler in numba.

    tau = M(q) vdot + C(q, v) v - tau_g(q) - sum_e J_e^T w_e

with w_e the wrenches of the contacts. The recursion (Featherstone 2008, ch. 5) is written in the world's axes with the
link origins as points of reference: velocities and accelerations outwards, forces and moments inwards.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from pydrake.multibody.plant import MultibodyPlant

from optimization.multibody.kinematic_tree import KinematicTree, forward
from scenes.gravity import GRAVITY


def inverse_dynamics(tree: KinematicTree, q: np.ndarray, v: np.ndarray, vdot: np.ndarray) -> np.ndarray:
    """(T, nv) generalized forces that bring about vdot without contacts: moment and force on the base, joint torques.

    Args:
        tree: the robot.
        q: (T, nq).
        v: (T, nv).
        vdot: (T, nv), its base part the derivative of (w_WB, v_WB) in W.
    """
    tau = np.empty_like(v, dtype=float)
    _inverse_dynamics(tree, *(np.array(x, dtype=float, order="C") for x in (q, v, vdot)), tau)  # type: ignore[call-arg]
    return tau


def actuated_joints(plant: MultibodyPlant) -> dict[str, int]:
    """Place of each actuator's joint in v[6:], by the actuator's name, in the plant's order of actuators."""
    actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    return {a.name(): a.joint().velocity_start() - 6 for a in actuators}


def joint_damping(plant: MultibodyPlant) -> np.ndarray:
    """(nv - 6,) viscous damping of each joint in the order of v[6:] [N m s]."""
    damping = np.zeros(plant.num_velocities() - 6)
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if joint.num_velocities() == 1:
            damping[joint.velocity_start() - 6] = joint.default_damping_vector()[0]
    return damping


def effort_limits(plant: MultibodyPlant) -> np.ndarray:
    """(nv - 6,) greatest torque [N m] or force [N] of each joint in the order of v[6:], inf where the model has none."""
    limit = np.full(plant.num_velocities() - 6, np.inf)
    for name, joint in actuated_joints(plant).items():
        limit[joint] = plant.GetJointActuatorByName(name).effort_limit()
    return limit


@njit(cache=True)
def _add_cross(a: np.ndarray, b: np.ndarray, scale: float, out: np.ndarray) -> None:
    """Adds scale a x b to out."""
    out[0] += scale * (a[1] * b[2] - a[2] * b[1])
    out[1] += scale * (a[2] * b[0] - a[0] * b[2])
    out[2] += scale * (a[0] * b[1] - a[1] * b[0])


@njit(cache=True)
def _turn(R: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """Writes R x."""
    for i in range(3):
        out[i] = R[i, 0] * x[0] + R[i, 1] * x[1] + R[i, 2] * x[2]


@njit(cache=True)
def _turn_back(R: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """Writes R^T x."""
    for i in range(3):
        out[i] = R[0, i] * x[0] + R[1, i] * x[1] + R[2, i] * x[2]


@njit(cache=True)
def _inverse_dynamics(tree: KinematicTree, q: np.ndarray, v: np.ndarray, vdot: np.ndarray, tau: np.ndarray) -> None:
    n = tree.parent.shape[0]
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    motion, load = np.empty((n, 3, 3)), np.empty((n, 2, 3))  # w, its rate, acceleration; force and moment
    for t in range(q.shape[0]):
        forward(tree, q[t], R, p)
        _accelerate(tree, R, p, v[t], vdot[t], motion)
        _load(tree, R, motion, load)
        lever = np.empty(3)
        for i in range(n - 1, 0, -1):
            k = tree.parent[i]
            force, moment = load[i, 0], load[i, 1]
            carried = force if tree.prismatic[i] else moment
            tau[t, 5 + i] = carried[0] * R[i, 0, 2] + carried[1] * R[i, 1, 2] + carried[2] * R[i, 2, 2]
            for a in range(3):
                lever[a] = p[i, a] - p[k, a]
                load[k, 0, a] += force[a]
                load[k, 1, a] += moment[a]
            _add_cross(lever, force, 1.0, load[k, 1])
        for a in range(3):
            tau[t, a], tau[t, 3 + a] = load[0, 1, a], load[0, 0, a]


@njit(cache=True)
def _accelerate(
    tree: KinematicTree, R: np.ndarray, p: np.ndarray, v: np.ndarray, vdot: np.ndarray, motion: np.ndarray
) -> None:
    """Writes w, alpha and the acceleration less gravity of every link's origin, outwards."""
    z, r, wr = np.empty(3), np.empty(3), np.empty(3)
    for a in range(3):
        motion[0, 0, a], motion[0, 1, a], motion[0, 2, a] = v[a], vdot[a], vdot[3 + a]
    motion[0, 2, 2] += GRAVITY
    for i in range(1, tree.parent.shape[0]):
        k = tree.parent[i]
        w, alpha, acceleration = motion[k, 0], motion[k, 1], motion[k, 2]
        rate, second = v[5 + i], vdot[5 + i]
        for a in range(3):
            z[a], r[a], wr[a] = R[i, a, 2], p[i, a] - p[k, a], 0.0
            motion[i, 0, a], motion[i, 1, a], motion[i, 2, a] = w[a], alpha[a], acceleration[a]
        _add_cross(w, r, 1.0, wr)
        _add_cross(alpha, r, 1.0, motion[i, 2])
        _add_cross(w, wr, 1.0, motion[i, 2])
        sliding = tree.prismatic[i]
        for a in range(3):
            if sliding:
                motion[i, 2, a] += second * z[a]
            else:
                motion[i, 0, a] += rate * z[a]
                motion[i, 1, a] += second * z[a]
        _add_cross(w, z, 2.0 * rate if sliding else rate, motion[i, 2] if sliding else motion[i, 1])


@njit(cache=True)
def _load(tree: KinematicTree, R: np.ndarray, motion: np.ndarray, load: np.ndarray) -> None:
    """Writes the force and the moment about its origin that each link alone needs."""
    c, wc, x, y, Iw, Ialpha = (np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3))
    for i in range(tree.parent.shape[0]):
        w, alpha = motion[i, 0], motion[i, 1]
        _turn(R[i], tree.p_LLcm[i], c)
        wc[:] = 0.0
        _add_cross(w, c, 1.0, wc)
        for a in range(3):
            load[i, 0, a] = motion[i, 2, a]
        _add_cross(alpha, c, 1.0, load[i, 0])
        _add_cross(w, wc, 1.0, load[i, 0])
        _turn_back(R[i], w, x)
        _turn(tree.I_LLcm_L[i], x, y)
        _turn(R[i], y, Iw)
        _turn_back(R[i], alpha, x)
        _turn(tree.I_LLcm_L[i], x, y)
        _turn(R[i], y, Ialpha)
        for a in range(3):
            load[i, 0, a] *= tree.mass[i]
            load[i, 1, a] = Ialpha[a]
        _add_cross(w, Iw, 1.0, load[i, 1])
        _add_cross(c, load[i, 0], 1.0, load[i, 1])
