"""Whole-body motion frame by frame: the next configuration that follows moving targets within joint and speed limits.

Frame by frame, with d = q_next - q in velocity coordinates (nv,),

    min   sum_e w_e^2 |X_WE - target|^2 + w_com^2 |CoM - target|^2                  what is held, what swings, the CoM
          + w_torso^2 |turn of the torso|^2 + w_posture^2 |joints - reference|^2    what is preferred
          + w_effort^2 |d|^2 + w_smooth^2 |d - dt v_previous|^2
    s.t.  lower <= joints <= upper,   |d| <= dt speed                               hard
          pairs of points and capsules of the body keep apart                       hard as far as weights go

by a few Gauss-Newton steps, each a quadratic program with bounds (`optimization.box_qp`). The order of the tasks is one
of weights, each some ten times the next: contacts, then CoM and swinging end effectors, then the rest. Bounds are never
left, so a target that moves too fast is followed late, and the answer says by how much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from optimization.body_capsules import read_capsules
from optimization.box_qp import solve_box_qp
from optimization.frame_task import (
    MAX_CLOSE_PAIRS,
    FrameTargets,
    PointPairs,
    TrackingErrors,
    TrackingModel,
    TrackingOptions,
    TriedFrame,
    add_tasks,
    bound_and_damp,
    make_frame,
    measure_frame,
)
from optimization.ik_tasks import clear_program, make_program
from optimization.kinematic_tree import integrate
from optimization.kinematics import Kinematics
from scenes.plant import build_plant
from scenes.robot import Robot

__all__ = [
    "DifferentialIK",
    "FrameTargets",
    "PointPairs",
    "TrackedFrame",
    "TrackingErrors",
    "TrackingModel",
    "TrackingOptions",
    "track_frame",
]

_FIRST_DAMPING = 1.0  # [1/rad^2] after a step that did not help


@njit(cache=True)
def track_frame(
    model: TrackingModel, targets: FrameTargets, options: TrackingOptions, dt: float, v_previous: np.ndarray,
    q: np.ndarray, q_next: np.ndarray, v: np.ndarray,
) -> TrackingErrors:  # fmt: skip
    """Moves one frame on; callable from other kernels, deterministic, keeps no state.

    Gauss-Newton; a step that does not lower the cost (a leg that is almost straight) is taken back and damped.

    Args:
        model: from `DifferentialIK.model`.
        targets: of the frame that is to be reached.
        options: weights.
        dt: from the last frame to this one [s].
        v_previous: (nv,) velocity of the last frame, for smoothness.
        q: (nq,) the last frame.
        q_next: (nq,) answer.
        v: (nv,) answer: integrate(q, v, dt) = q_next.
    """
    tree = model.tree
    nv = v.shape[0]
    program = make_program(nv, targets.apart.wanted.shape[0] + MAX_CLOSE_PAIRS)
    J_com = np.empty((3, nv))
    frame, trial = make_frame(tree), make_frame(tree)
    for i in range(nv + 1):
        frame.q[i] = q[i]
    cost, num_close = measure_frame(model, targets, options, dt, v_previous, q, frame)
    damping = 0.0
    for _ in range(options.max_steps):
        clear_program(program)
        num_rows = add_tasks(model, targets, options, frame, num_close, J_com, program)
        bound_and_damp(tree, options, dt, v_previous, damping, frame, program)
        solve_box_qp(program.H, program.g, program.lower, program.upper, nv + num_rows, program.side, program.x, 60)
        integrate(frame.q, program.x, 1.0, trial.q)
        cost_trial, close_trial = measure_frame(model, targets, options, dt, v_previous, q, trial)
        if cost_trial < cost:
            frame, trial = trial, frame
            settled = cost_trial > (1.0 - options.converged) * cost
            cost, num_close = cost_trial, close_trial
            damping *= 0.2
            if settled:
                break
        elif _longest(program.x, nv) < 1e-6:
            break
        else:
            damping = max(10.0 * damping, _FIRST_DAMPING)
    for i in range(nv + 1):
        q_next[i] = frame.q[i]
    return _finish(model, targets, dt, frame, v)


@njit(cache=True)
def _longest(x: np.ndarray, n: int) -> float:
    longest = 0.0
    for i in range(n):
        longest = max(longest, abs(x[i]))
    return longest


@njit(cache=True)
def _finish(model: TrackingModel, targets: FrameTargets, dt: float, f: TriedFrame, v: np.ndarray) -> TrackingErrors:
    """Writes v and says what the frame missed."""
    position, angle, swing, fast = 0.0, 0.0, 0.0, 0
    for e in range(targets.held.shape[0]):
        r = f.error[e]
        turn, move = np.sqrt(r[0] ** 2 + r[1] ** 2 + r[2] ** 2), np.sqrt(r[3] ** 2 + r[4] ** 2 + r[5] ** 2)
        if targets.held[e]:
            position, angle = max(position, move), max(angle, turn)
        elif targets.swing_linear[e] > 0.0:
            swing = max(swing, move)
    away2 = 0.0
    for a in range(3):
        if not np.isnan(targets.com[a]):
            away2 += (f.com[a] - targets.com[a]) ** 2
    for i in range(v.shape[0]):
        v[i] = f.moved[i] / dt
        fast += i >= 6 and abs(v[i]) >= model.tree.speed[i - 6] * (1.0 - 1e-9)
    return TrackingErrors(position, angle, swing, np.sqrt(away2), fast)


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """One frame of a motion.

    Attributes:
        q: (nq,) configuration.
        v: (nv,) velocity that leads to it from the frame before [rad/s, m/s].
        errors: what it missed.
    """

    q: np.ndarray
    v: np.ndarray
    errors: TrackingErrors


class DifferentialIK:
    """Follows targets frame by frame.

    ```python
    ik = DifferentialIK(load_robot("escher"))
    q, v = robot.q_nominal, np.zeros(33)
    X_WE = ik.poses(q)                                        # (5, 4, 4): feet, palms, torso
    for t in range(100):
        X_WE[1] = swing(t)                                    # the right foot swings, the left one is held
        frame = ik.track(
            q, X_WE, held=[True, False, False, False], com=com[t], dt=0.02,
            swing_linear=[0, 30, 0, 0], swing_angular=[0, 5, 0, 0], v_previous=v,
        )
        q, v = frame.q, frame.v
        assert frame.errors.held_position < 1e-3
    ```

    Attributes:
        robot: whose.
        kinematics: frames in the order of `EFFECTORS`, then the torso body.
        model: what `track_frame` takes.
        options: defaults of `track`.
    """

    def __init__(self, robot: Robot, options: TrackingOptions | None = None, *, clearance: float = 0.01) -> None:
        """Reads the robot; `clearance` [m] is what capsules of the body should keep between them."""
        built = build_plant(robot)
        self.robot = robot
        self.options = TrackingOptions() if options is None else options
        self.kinematics = Kinematics.from_plant(built.plant, [e.frame for e in robot.effectors] + [robot.torso_body])
        capsules = read_capsules(self.kinematics, built.plant, built.scene_graph, robot.q_nominal, clearance)
        self.model = TrackingModel(self.kinematics.tree, capsules)

    def poses(self, q: np.ndarray) -> np.ndarray:
        """(E + 1, 4, 4) poses of the end effectors and the torso in W [m]."""
        return self.kinematics.effector_poses(q)

    def point_pairs(
        self, pairs: Sequence[tuple[str, ArrayLike, str | None, ArrayLike, ArrayLike, float]]
    ) -> PointPairs:
        """Pairs of points to keep apart, for `track`.

        Args:
            pairs: (body A, point in A [m], body B or None for the world, point in B or W [m], unit normal in W from B
                to A, distance to keep along it [m]).
        """
        link, point = np.full((len(pairs), 2), -1), np.zeros((len(pairs), 2, 3))
        for k, pair in enumerate(pairs):
            for end, (body, p_BP) in enumerate((pair[:2], pair[2:4])):
                point[k, end] = p_BP
                if body is not None:
                    link[k, end], X_LB = self.kinematics.bodies[body]
                    point[k, end] = X_LB[:3, :3] @ point[k, end] + X_LB[:3, 3]
        normal = _array("normals", np.array([pair[4] for pair in pairs], dtype=float).reshape(-1, 3), (len(pairs), 3))
        return PointPairs(link, point, normal, _array("distances", [pair[5] for pair in pairs], (len(pairs),)))

    def track(
        self,
        q: np.ndarray,
        X_WE: np.ndarray,
        *,
        held: np.ndarray,
        dt: float,
        com: np.ndarray | None = None,
        swing_linear: np.ndarray | None = None,
        swing_angular: np.ndarray | None = None,
        q_reference: np.ndarray | None = None,
        v_previous: np.ndarray | None = None,
        apart: PointPairs | None = None,
        options: TrackingOptions | None = None,
    ) -> TrackedFrame:
        """The frame that follows q; arguments as in `FrameTargets` and `track_frame`.

        Without `com` the CoM is free, without swing weights end effectors that are not held are free, without
        `q_reference` the posture is drawn to the robot's nominal one.

        Raises:
            ValueError: an array of the wrong shape or with NaN where none is allowed.
        """
        E, nv = len(self.robot.effectors), self.kinematics.num_velocities
        targets = FrameTargets(
            _array("X_WE", X_WE, (E + 1, 4, 4)),
            np.array(held, dtype=np.bool_).reshape(E),
            _array("swing_linear", np.zeros(E) if swing_linear is None else swing_linear, (E,)),
            _array("swing_angular", np.zeros(E) if swing_angular is None else swing_angular, (E,)),
            np.full(3, np.nan) if com is None else np.array(com, dtype=float).reshape(3),
            _array("q_reference", self.robot.q_nominal if q_reference is None else q_reference, (nv + 1,)),
            self.point_pairs([]) if apart is None else apart,
        )
        q_next, v = np.empty(nv + 1), np.empty(nv)
        v_previous = _array("v_previous", np.zeros(nv) if v_previous is None else v_previous, (nv,))
        errors = track_frame(
            self.model, targets, self.options if options is None else options, float(dt), v_previous,
            _array("q", q, (nv + 1,)), q_next, v,
        )  # fmt: skip
        return TrackedFrame(q_next, v, errors)


def _array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    """A copy that is checked; to numba a read-only array is of another type, compiled anew."""
    array = np.array(value, dtype=float)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, of shape {shape}; got shape {array.shape}")
    return array
