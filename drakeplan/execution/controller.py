"""Whole-body inverse dynamics: one quadratic program a step for accelerations and contact forces; torques follow.

    min   sum_i w_i |J_i vdot + Jdot_i v - a_i|^2 + sum_c w_f |S (G_c lambda_c - w_c)|^2 + w_l |lambda|^2
    s.t.  M vdot + h = sum_c J_c^T G_c lambda_c   in the six rows of the base          exact
          |tau| <= limit,  tau = M vdot + h - sum_c J_c^T G_c lambda_c in the joints' rows
          lambda >= 0,  1^T lambda_c <= greatest normal force
          joints stop before their limits

h holds Coriolis forces, gravity and the damping of the joints. The columns of G_c are forces along the edges of a pyramid
inside the friction cone at the corners of a contact's support, one edge along the planned tangential force. Tasks are the
CoM (whose capture point xi = c + cdot / omega returns at the rate omega kappa), angular momentum, the base's orientation, the
posture, contacts that hold still and end effectors that swing.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportReturnType=false, reportOperatorIssue=false
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from scipy.spatial.transform import Rotation

from drakeplan.execution.reference import Course, Sample
from optimization.balance.contact_wrench import skew
from optimization.convex import piqp_adapter
from optimization.multibody.inverse_dynamics import joint_damping
from scenes.gravity import GRAVITY
from scenes.input_error import InputError

V = JacobianWrtVariable.kV
GENERATORS = 8  # edges of the pyramid at each corner
HORIZON = 0.08  # [s] in which a joint stops before its limit
MOST = 200.0  # [rad/s^2] of a joint
UNLIMITED = 1e4  # [N m] of an actuator for which the model has no limit
ACCURACY = 1e-5


@dataclass(frozen=True)
class Gains:
    """Feedback and weights; pairs are stiffness [1/s^2] and damping [1/s].

    Attributes:
        capture: kappa, at how many times its own rate the capture point returns.
        com_height, swing, base, posture: feedback of these tasks.
        still: damping of a contact that holds [1/s].
        spin: decay of the error of the angular momentum [1/s].
        w_com, w_com_height, w_swing, w_base, w_spin, w_posture, w_still: weights of the tasks.
        w_force, w_moment, w_yaw, w_lambda: weights of forces, moments and yaw torques off the plan's, and of all forces, in
            units of M g.
        share: of the support, seen from its middle, in which the pressure stays.
        alarm: errors of the capture point [m] between which balance comes to outweigh everything else.
        alarmed: factors of w_com, of w_base and w_posture, and of w_spin at the greater of them.
    """

    capture: float = 3.0
    com_height: tuple[float, float] = (60.0, 14.0)
    swing: tuple[float, float] = (250.0, 30.0)
    base: tuple[float, float] = (100.0, 18.0)
    posture: tuple[float, float] = (60.0, 14.0)
    still: float = 10.0
    spin: float = 3.0
    w_com: float = 10.0
    w_com_height: float = 5.0
    w_swing: float = 20.0
    w_base: float = 2.0
    w_spin: float = 0.01
    w_posture: float = 0.1
    w_still: float = 300.0
    w_force: float = 1.0
    w_moment: float = 0.3
    w_yaw: float = 3.0
    w_lambda: float = 1e-2
    share: float = 0.9
    alarm: tuple[float, float] = (0.02, 0.05)
    alarmed: tuple[float, float, float] = (30.0, 0.1, 0.0)

    def when_off_balance(self, error: float) -> Gains:
        """These gains while the capture point is off by an error [m].

        A push that carries the capture point beyond the sole is met with angular momentum: trunk and arms turn, and the force
        on the CoM passes beside it (hip strategy; Stephens 2007). The pressure may use the whole support then.
        """
        z = float(np.clip((error - self.alarm[0]) / (self.alarm[1] - self.alarm[0]), 0.0, 1.0))
        if z == 0.0:
            return self
        com, upright, spin = (1.0 + z * (factor - 1.0) for factor in self.alarmed)
        return replace(
            self, w_com=com * self.w_com, w_base=upright * self.w_base, w_posture=upright * self.w_posture,
            w_spin=spin * self.w_spin, share=self.share + z * (1.0 - self.share),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Hold:
    """An end effector that stands or leans on something.

    Attributes:
        corners: (n, 2) of its support in its frame [m].
        friction: coefficient.
        wrench: (6,) planned moment [N m] and force [N] in its frame.
        most: normal force at most [N].
        emphasis: how much more its force counts than a foot's.
        grip: pose that it is drawn back to, position and rotation; None: it only stops.
        stiffness: of that [1/s^2].
        damping: of its motion [1/s]; None: that of the gains.
        drift: (3,) velocity in W at which it looks for its surface [m/s]; 0 where it carries.
    """

    corners: np.ndarray
    friction: float
    wrench: np.ndarray
    most: float
    emphasis: float = 1.0
    grip: tuple[np.ndarray, np.ndarray] | None = None
    stiffness: float = 0.0
    damping: float | None = None
    drift: np.ndarray = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True, eq=False)
class Swing:
    """An end effector on its way.

    Attributes:
        course: where it is to be.
        emphasis: of its task.
    """

    course: Course
    emphasis: float = 1.0


Task = Hold | Swing | None  # None: it hangs with its limb


class WholeBodyController:
    """Torques for one robot.

    Attributes:
        com, com_v: (3,) of the last state [m], [m/s].
        poses: position (3,) and rotation (3, 3) of each end effector in the last state.
        failures: states for which the program had no answer; the torques before were kept.
        unlimited: names of actuators without a torque limit in the model.
    """

    def __init__(
        self, plant: MultibodyPlant, effectors: Sequence[str], mass: float, gains: Gains | None = None
    ) -> None:
        """Prepares the controller.

        Args:
            plant: the robot alone, continuous.
            effectors: names of the end effectors' frames.
            mass: of the robot [kg].
            gains: see `Gains`.

        Raises:
            InputError: PIQP is not installed.
        """
        self._plant, self._context, self.gains = plant, plant.CreateDefaultContext(), gains or Gains()
        self._now = self.gains  # those of the last state
        self._weight, self._nv, self._world = mass * GRAVITY, plant.num_velocities(), plant.world_frame()
        self._frames = [plant.GetFrameByName(name) for name in effectors]
        self._select, self._damping = plant.MakeActuationMatrix()[6:], joint_damping(plant)
        effort = plant.GetEffortUpperLimits()
        names = [plant.get_joint_actuator(index).name() for index in plant.GetJointActuatorIndices()]
        self.unlimited = [name for name, most in zip(names, effort, strict=True) if not np.isfinite(most)]
        self._limit = np.abs(self._select) @ np.where(np.isfinite(effort), effort, UNLIMITED)
        self._limit[self._limit == 0.0] = UNLIMITED
        self._low, self._high = plant.GetPositionLowerLimits()[7:], plant.GetPositionUpperLimits()[7:]
        if not piqp_adapter.available():
            raise InputError("playing a plan in physics needs PIQP: pip install 'drakeplan[fast]'")
        self._piqp = importlib.import_module("piqp")  # optional: whoever only plans need not have it
        self._solvers: dict[tuple[int, int], Any] = {}
        self._tau = np.zeros(self._nv - 6)
        self.failures = 0
        self.com: np.ndarray = np.zeros(3)
        self.com_v: np.ndarray = np.zeros(3)
        self.poses: list[tuple[np.ndarray, np.ndarray]] = []

    def look(self, q: np.ndarray, v: np.ndarray) -> None:
        """Takes in a state, so that `com`, `com_v` and `poses` are those of it.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
        """
        plant, context = self._plant, self._context
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        self._q, self._v = q, v
        self.com = plant.CalcCenterOfMassPositionInWorld(context)
        self._J_com = plant.CalcJacobianCenterOfMassTranslationalVelocity(context, V, self._world, self._world)
        self.com_v = self._J_com @ v
        poses = [frame.CalcPoseInWorld(context) for frame in self._frames]
        self.poses = [(X.translation(), X.rotation().matrix()) for X in poses]

    def speed(self, effector: int) -> np.ndarray:
        """(3,) velocity of an end effector's frame in the last state [m/s]."""
        return self._frames[effector].CalcSpatialVelocityInWorld(self._context).translational()

    def torques(self, sample: Sample, rate: float, tasks: Sequence[Task]) -> np.ndarray:
        """(A,) torques of the actuators in the last state [N m].

        Args:
            sample: what the plan says.
            rate: seconds of the plan that pass in a second.
            tasks: what each end effector does.
        """
        plant, context, nv = self._plant, self._context, self._nv
        M = plant.CalcMassMatrix(context)
        h = plant.CalcBiasTerm(context)
        A, y, w = self._motion_tasks(sample, rate, tasks, M, h)
        h = h - plant.CalcGravityGeneralizedForces(context)
        h[6:] += self._damping * self._v[6:]  # much of what turns a light foot
        held = [(e, task) for e, task in enumerate(tasks) if isinstance(task, Hold)]
        generators = [self._generators(e, task) for e, task in held]
        size = nv + sum(G.shape[1] for G in generators)
        P, c = np.zeros((size, size), order="F"), np.zeros(size)
        P[:nv, :nv] = A.T @ (w[:, None] * A)
        P[np.arange(nv), np.arange(nv)] += 1e-5
        c[:nv] = -A.T @ (w * y)
        forces, caps, most = np.zeros((nv, size - nv)), np.zeros((len(held), size)), np.zeros(len(held))
        at = nv
        for row, ((e, task), G) in enumerate(zip(held, generators, strict=True)):
            columns = slice(at, at + G.shape[1])
            at = columns.stop
            R = self.poses[e][1]
            wrench_W = np.vstack([R @ G[:3], R @ G[3:]])
            forces[:, columns.start - nv : columns.stop - nv] = self._jacobian(e).T @ wrench_W
            arm, moment = np.abs(task.corners).max(axis=0) + 1e-3, self._now.w_moment
            scale = np.sqrt(task.emphasis) * np.concatenate(
                [
                    np.sqrt([moment, moment, self._now.w_yaw]) / np.array([arm[1], arm[0], arm.sum()]),
                    np.full(3, np.sqrt(self._now.w_force)),
                ]
            )
            S = scale[:, None] * G
            P[columns, columns] = S.T @ S + self._now.w_lambda * np.eye(G.shape[1])
            c[columns] = -S.T @ (scale * task.wrench / self._weight)
            caps[row, columns], most[row] = 1.0, task.most / self._weight
        forces *= self._weight
        equal = np.asfortranarray(np.hstack([M[:6], -forces[:6]]) / self._weight)
        limited = np.hstack([M[6:], -forces[6:]]) / self._limit[:, None]
        rows = np.asfortranarray(np.vstack([limited, caps]))
        offset = h[6:] / self._limit
        low = np.concatenate([-1.0 - offset, np.full(len(held), -np.inf)])
        high = np.concatenate([1.0 - offset, most])
        least, greatest = self._bounds(size)
        z = self._solve(P, c, equal, -h[:6] / self._weight, rows, low, high, least, greatest)
        if z is None:
            self.failures += 1
        else:
            tau = M[6:] @ z[:nv] + h[6:] - forces[6:] @ z[nv:]
            self._tau = np.clip(tau, -self._limit, self._limit)
        return self._select.T @ self._tau

    def share_of_limit(self) -> float:
        """The greatest of the last torques, as a share of its limit."""
        return float(np.abs(self._tau / self._limit).max())

    def _motion_tasks(
        self, sample: Sample, rate: float, tasks: Sequence[Task], M: np.ndarray, coriolis: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows A, wanted values y and weights w of all tasks on the accelerations."""
        plant, context, nv, v = self._plant, self._context, self._nv, self._v
        omega = np.sqrt(GRAVITY / max(self.com[2] - min(p[2] for p, _ in self.poses[:2]), 0.3))
        off, off_v = self.com - sample.com, self.com_v - rate * sample.com_v
        g = self._now = self.gains.when_off_balance(float(np.hypot(*(off + off_v / omega)[:2])))
        stiff = np.array([omega**2 * g.capture] * 2 + [g.com_height[0]])
        damped = np.array([omega * (1.0 + g.capture)] * 2 + [g.com_height[1]])
        bias = plant.CalcBiasCenterOfMassTranslationalAcceleration(context, V, self._world, self._world)
        wanted = rate**2 * sample.com_a - stiff * off - damped * off_v - bias
        rows = [(self._J_com, wanted, np.array([g.w_com, g.w_com, g.w_com_height]))]
        # The first six rows of M vdot + h are the rate of the momentum about the base's origin.
        arm = skew(self.com - self._q[4:7])
        J_spin, spin_bias = M[:3] - arm @ M[3:6], coriolis[:3] - arm @ coriolis[3:6]
        spin = g.spin * (rate * sample.angular - J_spin @ v) - spin_bias
        rows.append((J_spin, spin, np.full(3, g.w_spin)))
        turn = _between(_rotation(sample.q), _rotation(self._q))
        upright = np.zeros((3, nv))
        upright[:, :3] = np.eye(3)
        rows.append((upright, g.base[0] * turn + g.base[1] * (rate * sample.v[:3] - v[:3]), np.full(3, g.w_base)))
        joints = np.zeros((nv - 6, nv))
        joints[:, 6:] = np.eye(nv - 6)
        pull = g.posture[0] * (sample.q[7:] - self._q[7:]) + g.posture[1] * (rate * sample.v[6:] - v[6:])
        rows.append((joints, rate**2 * sample.a[6:] + pull, np.full(nv - 6, g.w_posture)))
        for e, task in enumerate(tasks):
            if task is None:
                continue
            J, bias = self._jacobian(e), self._bias(e)
            if isinstance(task, Swing):
                rows.append((J, self._follow(e, task.course, J @ v) - bias, np.full(6, g.w_swing * task.emphasis)))
                continue
            back = np.zeros(6)
            if task.grip is not None:
                p, R = self.poses[e]
                back = task.stiffness * np.concatenate([_between(task.grip[1], R), task.grip[0] - p])
            still = (g.still if task.damping is None else task.damping) * (
                np.concatenate([np.zeros(3), task.drift]) - J @ v
            )
            rows.append((J, back + still - bias, np.full(6, g.w_still)))
        A, y, w = zip(*rows, strict=True)
        return np.vstack(A), np.concatenate(y), np.concatenate(w)

    def _follow(self, e: int, course: Course, velocity: np.ndarray) -> np.ndarray:
        """(6,) acceleration that leads an end effector back to its course."""
        (p, R), (stiff, damped) = self.poses[e], self._now.swing
        turn = course.alpha + stiff * _between(course.R, R) + damped * (course.w - velocity[:3])
        return np.concatenate([turn, course.a + stiff * (course.p - p) + damped * (course.v - velocity[3:])])

    def _generators(self, e: int, task: Hold) -> np.ndarray:
        """(6, G) moment about the contact point and force, in the contact's frame, of a unit along each generator."""
        R, planned = self.poses[e][1], task.wrench[3:5]
        tangential = planned if np.hypot(*planned) > 0.05 * max(task.wrench[5], 20.0) else R[2, :2]  # else up the slope
        angle = np.arctan2(tangential[1], tangential[0]) + np.arange(GENERATORS) * 2.0 * np.pi / GENERATORS
        edges = np.vstack([task.friction * np.cos(angle), task.friction * np.sin(angle), np.ones(GENERATORS)])
        middle = task.corners.mean(axis=0)
        columns = []
        for corner in middle + self._now.share * (task.corners - middle):
            columns.append(np.vstack([skew(np.array([*corner, 0.0])) @ edges, edges]))
        return np.hstack(columns)

    def _jacobian(self, e: int) -> np.ndarray:
        frame, world = self._frames[e], self._world
        return self._plant.CalcJacobianSpatialVelocity(self._context, V, frame, np.zeros(3), world, world)

    def _bias(self, e: int) -> np.ndarray:
        frame, world = self._frames[e], self._world
        bias = self._plant.CalcBiasSpatialAcceleration(self._context, V, frame, np.zeros(3), world, world)
        return bias.get_coeffs()

    def _bounds(self, size: int) -> tuple[np.ndarray, np.ndarray]:
        """Bounds on accelerations, so that joints stop before their limits, and on forces."""
        q, v, t = self._q[7:], self._v[6:], HORIZON
        low, high = np.full(size, -np.inf), np.full(size, np.inf)
        low[self._nv :] = 0.0
        low[6 : self._nv] = np.clip(2.0 * (self._low + 0.005 - q - v * t) / t**2, -1e4, MOST)
        high[6 : self._nv] = np.clip(2.0 * (self._high - 0.005 - q - v * t) / t**2, -MOST, 1e4)
        return low, high

    def _solve(self, *program: np.ndarray) -> np.ndarray | None:
        """The program's answer, None where there is none; solvers are kept by size."""
        key = (len(program[1]), len(program[4]))
        solver = self._solvers.get(key)
        if solver is None:
            solver = self._solvers[key] = self._piqp.DenseSolver()
            solver.settings.verbose, solver.settings.max_iter = False, 60
            solver.settings.eps_abs, solver.settings.eps_rel = ACCURACY, 0.1 * ACCURACY
            solver.setup(*program)
        else:
            solver.update(*program)
        status = solver.solve()
        z = np.array(solver.result.x)
        good = status == self._piqp.PIQP_SOLVED or (np.isfinite(z).all() and solver.result.info.primal_res < 1e-3)
        return z if good else None


def _rotation(q: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(q[:4], scalar_first=True).as_matrix()


def _between(wanted: np.ndarray, R: np.ndarray) -> np.ndarray:
    """(3,) rotation vector in W that turns R to the wanted one [rad]."""
    return Rotation.from_matrix(wanted @ R.T).as_rotvec()
