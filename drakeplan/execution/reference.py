"""A plan as smooth functions of plan time: postures, CoM, momentum, poses of the end effectors, contact wrenches."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from drakeplan.plan.plan import Plan, PlanCentroidal, PlanMotion
from scenes.input_error import InputError

AROUND = 1  # intervals before and after one whose planned wrenches are averaged with its own, in the same phase


class Sample(NamedTuple):
    """The plan at one time; derivatives are with respect to plan time.

    Attributes:
        q, v, a: (nq,), (nv,) and (nv,) configuration, velocity and the joints' accelerations.
        com, com_v, com_a: (3,) centre of mass in W [m] and its derivatives.
        angular: (3,) angular momentum about it in W [kg m^2/s].
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    com: np.ndarray
    com_v: np.ndarray
    com_a: np.ndarray
    angular: np.ndarray


class Course(NamedTuple):
    """Where an end effector is to be: pose in W, spatial velocity and acceleration.

    Attributes:
        p, R: (3,) [m] and (3, 3).
        v, w: (3,) [m/s] and [rad/s].
        a, alpha: (3,) [m/s^2] and [rad/s^2].
    """

    p: np.ndarray
    R: np.ndarray
    v: np.ndarray
    w: np.ndarray
    a: np.ndarray
    alpha: np.ndarray


class PlanReference:
    """A complete plan, sampled at any time.

    Attributes:
        duration: of the plan [s].
    """

    def __init__(self, plan: Plan, plant: MultibodyPlant) -> None:
        """Fits splines to the plan.

        Args:
            plan: complete.
            plant: the robot alone.

        Raises:
            InputError: the plan has no motion.
        """
        if plan.motion is None or plan.centroidal is None or plan.phases is None:
            raise InputError("the plan has contacts only: there is no motion to play")
        self._plan, self._plant, self._context = plan, plant, plant.CreateDefaultContext()
        motion, centroidal = plan.motion, plan.centroidal
        self.duration = float(motion.t[-1])
        self._q = CubicSpline(motion.t, motion.q)
        slope = centroidal.linear_momentum / plan.mass
        slope[1:-1] = 0.5 * (slope[1:-1] + slope[2:])  # com[n+1] - com[n] = dt l[n+1] / M
        self._com = CubicHermiteSpline(centroidal.t, centroidal.com, slope)
        self._angular = CubicSpline(centroidal.t, centroidal.angular_momentum)
        X_WE = self._poses(motion)
        self._p = CubicSpline(motion.t, X_WE[..., :3, 3])
        self._R = [RotationSpline(motion.t, Rotation.from_matrix(X[:, :3, :3])) for X in X_WE.swapaxes(0, 1)]
        self._wrenches: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = {}

    def at(self, s: float) -> Sample:
        """The plan at time s [s], at its ends before and after it."""
        s = float(np.clip(s, 0.0, self.duration))
        q, q_dot, q_ddot = self._q(s), self._q(s, 1), self._q(s, 2)
        q[:4] /= np.linalg.norm(q[:4])
        self._plant.SetPositions(self._context, q)
        v = self._plant.MapQDotToVelocity(self._context, q_dot)
        a = np.concatenate([np.zeros(6), q_ddot[7:]])
        return Sample(q, v, a, self._com(s), self._com(s, 1), self._com(s, 2), self._angular(s))

    def course(self, effector: int, s: float) -> Course:
        """Where an end effector is at time s.

        Args:
            effector: its index.
            s: plan time [s].
        """
        s = float(np.clip(s, 0.0, self.duration))
        R = self._R[effector]
        p, v, a = (self._p(s, k)[effector] for k in range(3))
        return Course(p, R(s).as_matrix(), v, R(s, 1), a, R(s, 2))

    def wrench(self, effector: int, contact: int, s: float) -> np.ndarray:
        """(6,) planned moment about the contact point [N m] and force [N] on the robot, in the contact's frame.

        Args:
            effector: its index.
            contact: index of the contact that it holds.
            s: plan time [s].
        """
        key = (effector, contact)
        if key not in self._wrenches:
            self._wrenches[key] = self._averaged(effector, contact)
        middle, wrench = self._wrenches[key]
        return np.array([np.interp(s, middle, component) for component in wrench.T])

    @property
    def _centroidal(self) -> PlanCentroidal:
        assert self._plan.centroidal is not None
        return self._plan.centroidal

    def _poses(self, motion: PlanMotion) -> np.ndarray:
        """(T, E, 4, 4) of the end effectors in every frame."""
        frames = [self._plant.GetFrameByName(name) for name in self._plan.effectors]
        X_WE = np.empty((len(motion.t), len(frames), 4, 4))
        for k, q in enumerate(motion.q):
            self._plant.SetPositions(self._context, q)
            X_WE[k] = [frame.CalcPoseInWorld(self._context).GetAsMatrix4() for frame in frames]
        return X_WE

    def _averaged(self, effector: int, contact: int) -> tuple[np.ndarray, np.ndarray]:
        """(n,) middles of the intervals that hold a contact [s], and (n, 6) its wrench there.

        Planned wrenches jump from knot to knot: each is averaged with its neighbours, and they are joined by straight lines.
        """
        c, R_WC = self._centroidal, self._plan.contacts.X_WC[contact, :3, :3]
        force, cop = c.force_W[:, effector] @ R_WC, c.cop_C[:, effector]
        moment = np.cross(np.pad(cop, ((0, 0), (0, 1))), force)
        moment[:, 2] += c.torque_n[:, effector]
        wrench = np.hstack([moment, force])
        held = np.flatnonzero(c.contact[:-1, effector] == contact)
        averaged = np.empty((len(held), 6))
        for row, n in enumerate(held):
            near = range(max(n - AROUND, 0), min(n + AROUND + 1, len(wrench) - 1))
            averaged[row] = wrench[[m for m in near if np.array_equal(c.contact[m], c.contact[n])]].mean(axis=0)
        return 0.5 * (c.t[held] + c.t[held + 1]), averaged
