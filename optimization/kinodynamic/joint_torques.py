"""Joint torques that contact forces and a motion ask for, and the rows that keep them within the robot's limits.

tau = (M vdot + C v - tau_g - sum_e J_e^T w_e)[6:], with w_e the wrench of end effector e on the robot at its contact point.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import ARM
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.trajectory import CentroidalTrajectory
from optimization.convex.sparse_rows import SparseRows
from optimization.multibody.inverse_dynamics import inverse_dynamics
from optimization.multibody.kinematic_tree import KinematicTree, forward, frame_jacobian, point_jacobian
from optimization.multibody.kinematics import Kinematics
from scenes.gravity import GRAVITY

SAME_TIME = 1e-6  # [s] a frame this little before a knot is at it


def contact_wrenches(trajectory: CentroidalTrajectory, schedule: ContactSchedule) -> np.ndarray:
    """(N, E, 6) moment [N m] about the contact point and force [N] on the robot, in W; acts over [t_n, t_n+1).

    Args:
        trajectory: with N knots.
        schedule: its contacts.
    """
    _, R_WC, _ = schedule.poses()
    wrench = np.zeros((*trajectory.contact.shape, 6))
    at = trajectory.contact >= 0
    R = R_WC[trajectory.contact[at]]
    force = trajectory.force_W[at]
    lever = np.einsum("jab,jb->ja", R[:, :, :2], trajectory.cop_C[at])
    wrench[at, :3] = np.cross(lever, force) + R[:, :, 2] * trajectory.torque_n[at][:, None]
    wrench[at, 3:] = force
    return wrench


def joint_torques(
    tree: KinematicTree,
    q: np.ndarray,
    v: np.ndarray,
    vdot: np.ndarray,
    wrench: np.ndarray,
    p_WC: np.ndarray | None = None,
) -> np.ndarray:
    """(T, nv - 6) torques [N m] of the joints of a motion under wrenches (T, E, 6) as `contact_wrenches` gives them.

    Args:
        tree: of the robot.
        q: (T, nq) configurations.
        v: (T, nv) velocities.
        vdot: (T, nv) accelerations.
        wrench: (T, E, 6) moments [N m] about the contact points and forces [N] on the robot, in W.
        p_WC: (T, E, 3) those points in W [m]; None: the end effectors are exactly at them.
    """
    tau = inverse_dynamics(tree, q, v, vdot)
    about = np.full((*wrench.shape[:2], 3), np.nan) if p_WC is None else np.array(p_WC, dtype=float, order="C")
    _take_contacts(tree, np.array(q, dtype=float, order="C"), np.array(wrench, dtype=float, order="C"), about, tau)
    return tau[:, 6:]


def motion_torques(
    tree: KinematicTree,
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    trajectory: CentroidalTrajectory,
    schedule: ContactSchedule,
    damping: np.ndarray,
) -> np.ndarray:
    """(T, nv - 6) joint torques of a motion that is played under the forces of a trajectory [N m].

    Row i acts from frame i to the next: q and v of the frame, the change of v to the next frame as the acceleration, the
    forces of the interval that the frame is in. The last row repeats the one before.

    Args:
        tree: of the robot.
        t: (T,) times of the frames [s].
        q: (T, nq).
        v: (T, nv).
        trajectory, schedule: what `schedule.contacts` carry when.
        damping: (nv - 6,) of the joints, which the actuators overcome [N m s].
    """
    knot = np.searchsorted(trajectory.t, t[:-1] + SAME_TIME, side="right") - 1
    knot = np.clip(knot, 0, len(trajectory.t) - 2)
    p_WC = schedule.poses()[0][trajectory.contact[knot]]  # where none is held there is no force
    wrench = contact_wrenches(trajectory, schedule)[knot]
    tau = joint_torques(tree, q[:-1], v[:-1], np.diff(v, axis=0) / np.diff(t)[:, None], wrench, p_WC)
    tau += damping * v[:-1, 6:]
    return np.concatenate([tau, tau[-1:]])


@njit(cache=True)
def _take_contacts(tree: KinematicTree, q: np.ndarray, wrench: np.ndarray, p_WC: np.ndarray, tau: np.ndarray) -> None:
    """Subtracts sum_e J_e^T w_e; the wrenches act at p_WC (T, E, 3), where that is NaN at the end effectors."""
    n, nv = tree.parent.shape[0], tau.shape[1]
    R, p, J = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((6, nv))
    for t in range(q.shape[0]):
        forward(tree, q[t], R, p)
        for e in range(wrench.shape[1]):
            if not wrench[t, e].any():
                continue
            if np.isnan(p_WC[t, e, 0]):
                frame_jacobian(tree, R, p, e, J)
            else:
                x, y, z = p_WC[t, e, 0], p_WC[t, e, 1], p_WC[t, e, 2]
                point_jacobian(tree, R, p, tree.frame_link[e], x, y, z, J)
            for i in range(nv):
                for a in range(6):
                    tau[t, i] -= J[a, i] * wrench[t, e, a]


class TorqueRows:
    """Limits of the joint torques as linear rows on the contact wrenches of a centroidal program.

    Over [t_n, t_n+1) the robot is taken to be at configuration n + 1, as the program's moments are about com[n+1], to move
    as it does from n to n + 1 and to accelerate to what it does next.
    """

    def __init__(
        self, kinematics: Kinematics, problem: CentroidalProblem, effort: np.ndarray, q: np.ndarray, v: np.ndarray
    ) -> None:
        """`effort` (nv - 6,) [N m]; q (N, nq), and v (N, nv): at the start, then from each knot to the next."""
        self._tree, self._schedule, self._effort = kinematics.tree, problem.schedule, effort
        self._weight = problem.mass * GRAVITY
        self._q = q[1:]
        dt = problem.schedule.dt[:, None]
        rate = np.vstack([np.diff(v[1:], axis=0), np.zeros((1, v.shape[1]))]) / dt
        self._v, self._vdot = v[1:], rate
        self._jacobians = np.array([kinematics.effector_jacobians(x)[:, :, 6:] for x in self._q])

    def torques(self, trajectory: CentroidalTrajectory) -> np.ndarray:
        """(N - 1, nv - 6) torques under the forces of a trajectory [N m]."""
        wrench = contact_wrenches(trajectory, self._schedule)[:-1]
        return joint_torques(self._tree, self._q, self._v, self._vdot, wrench)

    def in_program(self, index: np.ndarray) -> tuple[SparseRows, np.ndarray, np.ndarray]:
        """Rows, lower and upper bounds for wrenches (J, 6) (f [M g], m [M g ARM], in contact frames) at these places.

        Joints without a limit, and those that no contact's chain passes, have no row.
        """
        bias = inverse_dynamics(self._tree, self._q, self._v, self._vdot)[:, 6:] / self._weight
        limit = self._effort / self._weight
        interval, effector = np.nonzero(self._schedule.active >= 0)
        _, R_WC, _ = self._schedule.poses()
        R = R_WC[self._schedule.active[interval, effector]]
        J = self._jacobians[interval, effector]  # (J, 6, joints), angular first
        blocks = np.concatenate(
            [np.einsum("jai,jab->jib", J[:, 3:], R), ARM * np.einsum("jai,jab->jib", J[:, :3], R)], axis=2
        )
        moves = np.zeros((len(self._q), len(limit)), bool)
        np.logical_or.at(moves, interval, (np.abs(blocks).max(axis=2) > 0.0) & np.isfinite(limit))
        number = np.cumsum(moves.ravel()).reshape(moves.shape) - 1
        rows = SparseRows()
        j, joint = np.nonzero((np.abs(blocks).max(axis=2) > 0.0) & np.isfinite(limit))
        rows.add(number[interval[j], joint][:, None], index[j], blocks[j, joint])
        upper = (bias + limit)[moves]
        return rows, (bias - limit)[moves], upper
