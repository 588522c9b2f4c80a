"""CoM, momenta and end effectors of a whole motion, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from optimization.multibody.kinematic_tree import (
    KinematicTree,
    center_of_mass,
    difference,
    forward,
    frame_pose,
    momentum_matrix,
)


def motion_momentum(tree: KinematicTree, q: np.ndarray, dt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, 3) CoM of each frame [m] and (T - 1, 6) angular and linear momentum from each frame to the next.

    Args:
        tree: of the robot.
        q: (T, nq) motion.
        dt: (T - 1,) times between the frames [s].
    """
    com, momentum = np.empty((len(q), 3)), np.empty((len(q) - 1, 6))
    _momentum(tree, np.array(q, dtype=float, order="C"), np.array(dt, dtype=float), com, momentum)
    return com, momentum


def motion_poses(tree: KinematicTree, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, E, 4, 4) poses of the named frames in W [m] and (T, 3) CoM [m] of a motion q (T, nq).

    Args:
        tree: of the robot.
        q: (T, nq) motion.
    """
    X_WE, com = np.zeros((len(q), len(tree.frame_link), 4, 4)), np.empty((len(q), 3))
    X_WE[..., 3, 3] = 1.0
    _poses(tree, np.array(q, dtype=float, order="C"), X_WE, com)
    return X_WE, com


@njit(cache=True)
def _momentum(tree: KinematicTree, q: np.ndarray, dt: np.ndarray, com: np.ndarray, momentum: np.ndarray) -> None:
    n, nv = tree.parent.shape[0], q.shape[1] - 1
    R, p, v = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty(nv)
    A = np.empty((2, 6, nv))
    for t in range(q.shape[0]):
        forward(tree, q[t], R, p)
        momentum_matrix(tree, R, p, com[t], A[t % 2])
        if t > 0:
            difference(q[t - 1], q[t], v)
            for a in range(3):
                momentum[t - 1, a] = 0.0
                for i in range(nv):
                    momentum[t - 1, a] += 0.5 * (A[0, a, i] + A[1, a, i]) * v[i] / dt[t - 1]
                momentum[t - 1, 3 + a] = tree.total_mass * (com[t, a] - com[t - 1, a]) / dt[t - 1]


@njit(cache=True)
def _poses(tree: KinematicTree, q: np.ndarray, X_WE: np.ndarray, com: np.ndarray) -> None:
    n = tree.parent.shape[0]
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    for t in range(q.shape[0]):
        forward(tree, q[t], R, p)
        center_of_mass(tree, R, p, com[t])
        for e in range(X_WE.shape[1]):
            frame_pose(tree, R, p, e, X_WE[t, e, :3, :3], X_WE[t, e, :3, 3])
