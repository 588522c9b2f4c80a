"""Whole-body inverse kinematics in microseconds: a posture that holds contacts and keeps its CoM in a polygon.

    min   w_posture^2 |joints - nominal|^2 + w_upright^2 |base turned from upright, facing the feet's heading|^2
    s.t.  X_WE = target                          for every active end effector
          centre of mass (x, y) in a convex polygon, and, if asked for, at a point
          lower <= joints <= upper,  capsules of the body keep apart

by Levenberg-Marquardt on the penalised problem. Each step is a quadratic program with bounds (joint limits and a trust
region) whose inequalities are the polygon's edges and the close capsules, so what only touches does not pull. A posture
counts as found as soon as it is within the tolerances; the posture cost need not be at its optimum. What is not found
may still exist: callers treat a failure as a reject, not as a proof. No answer is ok that does not pass the tolerances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from optimization.convex.box_qp import solve_box_qp
from optimization.inverse_kinematics.ik_tasks import make_program, predicted_gain
from optimization.inverse_kinematics.posture_guess import guess_posture, upright_base
from optimization.inverse_kinematics.stance_task import (
    MAX_ROWS,
    IkOptions,
    Shortfall,
    StanceTask,
    WholeBodyModel,
    build_step,
    is_held,
    make_posture,
    measure,
)
from optimization.multibody.body_capsules import read_capsules
from optimization.multibody.kinematic_tree import KinematicTree, integrate
from optimization.multibody.kinematics import Kinematics
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import Robot

__all__ = ["IkAnswer", "IkOptions", "Shortfall", "StanceTask", "WholeBodyIK", "WholeBodyModel", "solve_stance"]

# What is only preferred counts for less from step to step, or it would hold back a leg that is almost straight.
_FADE, _FAINTEST = 0.6, 0.05
_TRUSTED_TURN, _TRUSTED_MOVE, _TRUSTED_JOINT = 0.6, 0.4, 0.8  # [rad, m, rad] greatest change in one step


@njit(cache=True)
def _copy(source: np.ndarray, target: np.ndarray) -> None:
    for i in range(source.shape[0]):
        target[i] = source[i]


@njit(cache=True)
def _keep_limits(tree: KinematicTree, q: np.ndarray) -> None:
    for j in range(tree.lower.shape[0]):
        q[7 + j] = min(max(q[7 + j], tree.lower[j]), tree.upper[j])


@njit(cache=True)
def _step_length(v: np.ndarray, num_velocities: int) -> float:
    """The part of a step v that the linearisation is trusted for, at most 1."""
    turn = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    move = np.sqrt(v[3] * v[3] + v[4] * v[4] + v[5] * v[5])
    furthest = max(turn / _TRUSTED_TURN, move / _TRUSTED_MOVE)
    for i in range(6, num_velocities):
        furthest = max(furthest, abs(v[i]) / _TRUSTED_JOINT)
    return 1.0 / max(furthest, 1.0)


@njit(cache=True)
def _descend(model: WholeBodyModel, task: StanceTask, options: IkOptions, q: np.ndarray) -> tuple[bool, Shortfall, int]:
    """Levenberg-Marquardt from q, which becomes the answer; returns ok, the shortfall and the iterations."""
    tree = model.tree
    nv = q.shape[0] - 1
    R_upright = upright_base(model, task, q)
    pose, trial = make_posture(model), make_posture(model)
    program = make_program(nv, MAX_ROWS)
    J_com = np.empty((3, nv))
    _copy(q, pose.q)
    _keep_limits(tree, pose.q)
    shortfall, close = measure(model, task, options, R_upright, pose)
    damping, preference, slow, iterations = 1e-3, 1.0, 0, 0
    while not is_held(shortfall, options) and iterations < options.max_iterations and slow < 4:
        iterations += 1
        m = build_step(model, task, options, pose, close, damping, preference, J_com, program)
        solve_box_qp(program.H, program.g, program.lower, program.upper, m, program.side, program.x, 40)
        length = _step_length(program.x, nv)
        promised = predicted_gain(program, nv, m, length)
        integrate(pose.q, program.x, length, trial.q)
        _keep_limits(tree, trial.q)
        short_trial, close_trial = measure(model, task, options, R_upright, trial)
        gain = shortfall.unmet - short_trial.unmet + preference**2 * (shortfall.strain - short_trial.strain)
        if not gain > 0.0:
            damping = max(8.0 * damping, 1e-4)
            slow += 1
            continue
        slow = slow + 1 if short_trial.unmet > 0.9 * shortfall.unmet else 0
        if gain > 0.75 * promised:
            damping = max(0.2 * damping, 1e-6)
        elif gain < 0.25 * promised:
            damping *= 4.0
        preference = max(_FADE * preference, _FAINTEST)
        pose, trial = trial, pose
        shortfall, close = short_trial, close_trial
    _copy(pose.q, q)
    return is_held(shortfall, options), shortfall, iterations


@njit(cache=True)
def solve_stance(
    model: WholeBodyModel, task: StanceTask, options: IkOptions, seeded: bool, q: np.ndarray
) -> tuple[bool, Shortfall, int]:
    """Finds a posture for a task; callable from other kernels, deterministic, keeps no state.

    Args:
        model: the robot, from `WholeBodyIK.model`.
        task: what to hold.
        options: tolerances and weights.
        seeded: whether q holds a posture to start from; otherwise only its heading and place matter, and those only
            when no foot is active.
        q: (nq,) start and answer; when nothing is found, the attempt that fell short the least.

    Returns:
        Whether it is held, by how much it falls short, and the iterations of all attempts.
    """
    best, best_q, total = Shortfall(np.inf, np.inf, np.inf, np.inf, -np.inf, np.inf, np.inf), q.copy(), 0
    attempts = 1 + options.restarts
    for k in range(attempts):
        trial = q.copy()
        if not (seeded and k == 0):
            n = k - seeded
            guess_posture(model, task, 0.12 * (n // 3), 0.5 * (n % 3), trial)
        ok, shortfall, iterations = _descend(model, task, options, trial)
        total += iterations
        if ok or shortfall.unmet < best.unmet:
            best = shortfall
            _copy(trial, best_q)
        if ok:
            break
    _copy(best_q, q)
    return is_held(best, options), best, total


@dataclass(frozen=True, eq=False)
class IkAnswer:
    """A posture and how well it holds.

    Attributes:
        ok: whether every tolerance is met.
        q: (nq,) the posture found, or the one that came closest.
        contact_error: greatest position error of an active contact [m].
        contact_angle: greatest orientation error of an active contact [rad].
        com_violation: how far the CoM is outside the polygon less its margin [m], 0 inside.
        com_error: distance of the CoM to its target [m], 0 without one.
        clearance: least distance between capsules of the body beyond what they must keep [m], at most 0.03.
        iterations: of all attempts together.
    """

    ok: bool
    q: np.ndarray
    contact_error: float
    contact_angle: float
    com_violation: float
    com_error: float
    clearance: float
    iterations: int


class WholeBodyIK:
    """Whole-body inverse kinematics of one robot.

    ```python
    ik = WholeBodyIK(load_robot("escher"))
    answer = ik.solve(X_WE, active=np.array([True, True, False, False]), region=polygon)
    if answer.ok: ...
    ```

    Attributes:
        robot: whose.
        kinematics: frames in the order of `EFFECTORS`.
        model: what `solve_stance` takes.
        options: defaults of `solve`.
    """

    def __init__(self, robot: Robot, options: IkOptions | None = None, *, clearance: float = 0.01) -> None:
        """Reads the robot; `clearance` [m] is what capsules of the body should keep between them."""
        built = build_plant(robot)
        self.robot = robot
        self.options = IkOptions() if options is None else options
        self.kinematics = Kinematics.from_plant(built.plant, [e.frame for e in robot.effectors])
        q_nominal = np.array(nominal_posture(robot))
        capsules = read_capsules(self.kinematics, built.plant, built.scene_graph, q_nominal, clearance)
        self.model = WholeBodyModel(
            self.kinematics.tree, capsules, q_nominal, np.array(robot.hip), 0.98 * robot.leg_reach[1]
        )

    def solve(
        self,
        X_WE: np.ndarray,
        active: np.ndarray,
        region: np.ndarray | None = None,
        q_seed: np.ndarray | None = None,
        *,
        com_target: np.ndarray | None = None,
        options: IkOptions | None = None,
    ) -> IkAnswer:
        """Finds a posture.

        Args:
            X_WE: (E, 4, 4) target poses of the end effectors in W [m]; rows that are not active are ignored.
            active: (E,) which end effectors hold their target.
            region: (V, 2) convex polygon for the CoM in x and y [m], counter-clockwise, V >= 3; None: anywhere.
            q_seed: (nq,) posture to start from; None: one over the feet.
            com_target: (3,) where the CoM should be [m]; NaN leaves a coordinate free.
            options: instead of the object's own.

        Raises:
            ValueError: arrays of the wrong shape, or NaN among what is active.
        """
        options = self.options if options is None else options
        task = self.task(X_WE, active, region, com_target)
        nq = self.kinematics.num_positions
        q = self.model.q_nominal.copy() if q_seed is None else np.array(q_seed, dtype=float)
        if q.shape != (nq,) or not np.isfinite(q).all():
            raise ValueError(f"q_seed must be {nq} finite numbers")
        ok, short, iterations = solve_stance(self.model, task, options, q_seed is not None, q)
        return IkAnswer(
            ok, q, short.position, short.angle, short.com_violation, short.com_error, short.clearance, iterations
        )

    def task(
        self, X_WE: np.ndarray, active: np.ndarray, region: np.ndarray | None, com_target: np.ndarray | None
    ) -> StanceTask:
        """The checked task that `solve_stance` takes; arguments as in `solve`.

        Args:
            X_WE: (E, 4, 4) target poses in W [m].
            active: (E,) which of them are held.
            region: (V, 2) convex polygon for the CoM, counter-clockwise [m]; None for anywhere.
            com_target: (3,) where the CoM should be in W [m], NaN where free; None for free.
        """
        E = len(self.kinematics.frames)
        # Copies: to numba a read-only array is of another type, and would be compiled anew.
        X_WE, active = np.array(X_WE, dtype=float), np.array(active, dtype=np.bool_)
        if X_WE.shape != (E, 4, 4) or active.shape != (E,) or not np.isfinite(X_WE[active]).all():
            raise ValueError(f"X_WE must be ({E}, 4, 4), finite where active, and active ({E},)")
        region = np.empty((0, 2)) if region is None else np.array(region, dtype=float)
        if region.ndim != 2 or region.shape[1] != 2 or len(region) in (1, 2) or not np.isfinite(region).all():
            raise ValueError("region must be at least three finite (x, y)")
        target = np.full(3, np.nan) if com_target is None else np.array(com_target, dtype=float)
        return StanceTask(X_WE, active, region, len(region), target)
