"""A plan as smooth functions of plan time: postures, CoM, momentum, poses of the end effectors, contact wrenches."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from drakeplan.plan.plan import Plan, PlanCentroidal, PlanMotion
from scenes.input_error import InputError

EVERY = 5  # frames from one point of the CoM's spline to the next: its second derivative is fed forward


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
        self._angular = CubicSpline(centroidal.t, centroidal.angular_momentum)
        X_WE, com = self._poses(motion)
        every = np.unique(np.append(np.arange(0, len(motion.t), EVERY), len(motion.t) - 1))
        self._com = CubicSpline(motion.t[every], com[every], bc_type="clamped")
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

        Planned wrenches jump from knot to knot; here straight lines join the middles of the intervals.

        Args:
            effector: its index.
            contact: index of the contact that it holds.
            s: plan time [s].
        """
        key = (effector, contact)
        if key not in self._wrenches:
            self._wrenches[key] = self._at_middles(effector, contact)
        middle, wrench = self._wrenches[key]
        return np.array([np.interp(s, middle, component) for component in wrench.T])

    @property
    def _centroidal(self) -> PlanCentroidal:
        assert self._plan.centroidal is not None
        return self._plan.centroidal

    def _poses(self, motion: PlanMotion) -> tuple[np.ndarray, np.ndarray]:
        """(T, E, 4, 4) of the end effectors and (T, 3) CoM [m] in every frame.

        The CoM is that of the postures: the one of the momenta is up to a centimetre ahead of it, and tasks that pull apart tilt
        the body.
        """
        frames = [self._plant.GetFrameByName(name) for name in self._plan.effectors]
        X_WE, com = np.empty((len(motion.t), len(frames), 4, 4)), np.empty((len(motion.t), 3))
        for k, q in enumerate(motion.q):
            self._plant.SetPositions(self._context, q)
            X_WE[k] = [frame.CalcPoseInWorld(self._context).GetAsMatrix4() for frame in frames]
            com[k] = self._plant.CalcCenterOfMassPositionInWorld(self._context)
        return X_WE, com

    def _at_middles(self, effector: int, contact: int) -> tuple[np.ndarray, np.ndarray]:
        """(n,) middles of the intervals that hold a contact [s], and (n, 6) its wrench there, in the contact's frame."""
        c, R_WC = self._centroidal, self._plan.contacts.X_WC[contact, :3, :3]
        held = np.flatnonzero(c.contact[:-1, effector] == contact)
        force, cop = c.force_W[held, effector] @ R_WC, c.cop_C[held, effector]
        moment = np.cross(np.pad(cop, ((0, 0), (0, 1))), force)
        moment[:, 2] += c.torque_n[held, effector]
        return 0.5 * (c.t[held] + c.t[held + 1]), np.hstack([moment, force])
