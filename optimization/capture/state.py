"""A posture and joint velocities for a stance, a CoM and momenta: where a capture motion starts.

Lin 2020: Y.-C. Lin, "Learning for Humanoid Multi-Contact Navigation Planning" (dissertation), sec. 7.5: "we first optimize
the initial kinematic states to track r0, l0, k0 and the existing stance".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optimization.convex.box_qp import solve_box_qp
from optimization.inverse_kinematics.posture_tracking import TrackingTargets, track_postures
from optimization.inverse_kinematics.whole_body_ik import IkOptions, WholeBodyIK
from optimization.multibody.kinematics import Kinematics
from scenes.effector import EFFECTORS, LEFT_FOOT, RIGHT_FOOT
from scenes.robots.plant import nominal_posture
from scenes.robots.robot import Robot
from scenes.stance import Stance

HELD_WEIGHT, COM_WEIGHT, FREE_WEIGHT, POSTURE_WEIGHT = 300.0, 100.0, 10.0, 0.3  # [1/m, 1/rad]
LIFT = 0.06  # [m] a foot that is not held hangs this high over the ground that the other one stands on
BASE_SPEED = 8.0  # [rad/s, m/s] bound on the base's velocity, far from what joints allow
# weights of the velocity's terms: contacts [s/m], linear and angular momentum over M [s/m] and in N m s, joints [s/rad]
STILL_WEIGHT, LINEAR_WEIGHT, ANGULAR_WEIGHT, JOINT_WEIGHT = 1e3, 1e2, 3.0, 0.1


@dataclass(frozen=True, eq=False)
class FittedState:
    """A state of the whole body and what it misses.

    Attributes:
        q: (nq,) configuration within the joint limits.
        v: (nv,) velocity within the joints' speed limits.
        contact_error: greatest distance of a held end effector from its contact [m].
        contact_angle: greatest turn of one [rad].
        com_error: |com(q) - com| [m].
        contact_speed: greatest speed of a held end effector, an angular one counting 0.3 m [m/s].
        linear_gap: |M v_com - l| [kg m/s].
        angular_gap: |k(q, v) - k| [N m s].
    """

    q: np.ndarray
    v: np.ndarray
    contact_error: float
    contact_angle: float
    com_error: float
    contact_speed: float
    linear_gap: float
    angular_gap: float


class StateFit:
    """Fits states of one robot. Its bodies keep clear of each other where the first posture is found, no later."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.ik = WholeBodyIK(robot, IkOptions(com_tolerance=2e-3, restarts=2))

    @property
    def kinematics(self) -> Kinematics:
        """The robot's, frames in the order of `EFFECTORS`."""
        return self.ik.kinematics

    def fit(
        self, stance: Stance, com: np.ndarray, linear_momentum: np.ndarray, angular_momentum: np.ndarray
    ) -> FittedState:
        """The state near the nominal posture that holds the stance and has this CoM [m] and momenta [kg m/s, N m s].

        Args:
            stance: contacts held.
            com: (3,) in W [m].
            linear_momentum: (3,) [kg m/s].
            angular_momentum: (3,) about the CoM [N m s].
        """
        X_WE, held = _held_poses(stance)
        first = self.ik.solve(X_WE, held, com_target=com)
        q = self._settle(first.q, X_WE, held, stance, com)
        v = self._velocity(q, held, linear_momentum, angular_momentum)
        return self._judge(q, v, X_WE, held, com, linear_momentum, angular_momentum)

    def _settle(self, q: np.ndarray, X_WE: np.ndarray, held: np.ndarray, stance: Stance, com: np.ndarray) -> np.ndarray:
        """The posture again, to convergence, a free foot lifted off the ground beside the other."""
        tree = self.kinematics.tree
        place = np.where(held, HELD_WEIGHT, 0.0)
        for foot, other in ((LEFT_FOOT, RIGHT_FOOT), (RIGHT_FOOT, LEFT_FOOT)):
            standing = stance.contacts[other]
            if not held[foot] and standing is not None:
                X_WE[foot] = beside(standing.X_WC, self.robot, foot)
                place[foot] = FREE_WEIGHT
        targets = TrackingTargets(
            X_WE[None],
            place[None],
            0.3 * place[None],
            com[None],
            np.full((1, 3), COM_WEIGHT),
            self._upright(q)[None],
            np.full(len(q) - 1, POSTURE_WEIGHT) * np.r_[1, 1, 1, 0, 0, 0, np.ones(len(q) - 7)],
            tree.lower,
            tree.upper,
        )
        return track_postures(tree, targets, q[None], chained=False, max_iterations=20).q[0]

    def _upright(self, q: np.ndarray) -> np.ndarray:
        """(nq,) the nominal posture with the heading and place of q."""
        w, x, y, z = q[:4]
        heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        nominal = nominal_posture(self.robot).copy()
        c, s = np.cos(heading / 2), np.sin(heading / 2)
        w, x, y, z = nominal_posture(self.robot)[:4]
        nominal[:4] = c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w
        nominal[4:7] = q[4:7]
        return nominal

    def _velocity(self, q: np.ndarray, held: np.ndarray, l0: np.ndarray, k0: np.ndarray) -> np.ndarray:
        """The least joint speeds with these momenta while held end effectors stand still, within the speed limits."""
        tree = self.kinematics.tree
        A, J = self.kinematics.momentum_matrix(q), self.kinematics.effector_jacobians(q)
        mass = self.kinematics.total_mass
        rows = np.concatenate(
            [STILL_WEIGHT * J[held].reshape(-1, A.shape[1]), ANGULAR_WEIGHT * A[:3], LINEAR_WEIGHT / mass * A[3:]]
        )
        wanted = np.concatenate([np.zeros(len(rows) - 6), ANGULAR_WEIGHT * k0, LINEAR_WEIGHT / mass * l0])
        nv = A.shape[1]
        H = rows.T @ rows + np.diag(np.where(np.arange(nv) < 6, 1e-3, JOINT_WEIGHT) ** 2)
        high = np.concatenate([np.full(6, BASE_SPEED), tree.speed])
        v, side = np.zeros(nv), np.zeros(nv, np.int64)
        solve_box_qp(np.ascontiguousarray(H), rows.T @ wanted, -high, high, nv, side, v, 80)
        return np.clip(v, -high, high)

    def _judge(
        self,
        q: np.ndarray,
        v: np.ndarray,
        X_WE: np.ndarray,
        held: np.ndarray,
        com: np.ndarray,
        l0: np.ndarray,
        k0: np.ndarray,
    ) -> FittedState:
        poses = self.kinematics.effector_poses(q)[held]
        away = np.linalg.norm(poses[:, :3, 3] - X_WE[held][:, :3, 3], axis=1)
        cosine = (np.einsum("eab,eab->e", poses[:, :3, :3], X_WE[held][:, :3, :3]) - 1.0) / 2.0
        twist = (self.kinematics.effector_jacobians(q)[held] @ v) * np.array([0.3, 0.3, 0.3, 1.0, 1.0, 1.0])
        momentum = self.kinematics.momentum_matrix(q) @ v
        return FittedState(
            q,
            v,
            float(away.max()),
            float(np.arccos(np.clip(cosine, -1.0, 1.0)).max()),
            float(np.linalg.norm(self.kinematics.com(q) - com)),
            float(np.linalg.norm(twist.reshape(-1, 3), axis=1).max()),
            float(np.linalg.norm(momentum[3:] - l0)),
            float(np.linalg.norm(momentum[:3] - k0)),
        )


def beside(X_WC: np.ndarray, robot: Robot, foot: int) -> np.ndarray:
    """(4, 4) pose of a foot in the air beside the other one at X_WC: nominally apart, level, `LIFT` higher.

    Args:
        X_WC: (4, 4) pose of the foot that stands, in W [m].
        robot: gives the distance of the feet.
        foot: index of the foot in the air among the end effectors.
    """
    heading = np.arctan2(X_WC[1, 0], X_WC[0, 0])
    side = 1.0 if foot == LEFT_FOOT else -1.0
    c, s = np.cos(heading), np.sin(heading)
    X_WE = np.eye(4)
    X_WE[:2, :2] = [[c, -s], [s, c]]
    X_WE[:3, 3] = X_WC[:3, 3] + [-s * side * robot.foot_separation[1], c * side * robot.foot_separation[1], LIFT]
    return X_WE


def _held_poses(stance: Stance) -> tuple[np.ndarray, np.ndarray]:
    """(E, 4, 4) poses of the end effectors and (E,) which are held."""
    X_WE = np.tile(np.eye(4), (len(EFFECTORS), 1, 1))
    held = np.array([contact is not None for contact in stance.contacts])
    for e, contact in enumerate(stance.contacts):
        if contact is not None:
            X_WE[e] = contact.X_WC
    return X_WE, held
