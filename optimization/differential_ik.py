"""Whole-body motion frame by frame: the next configuration that follows moving targets within joint and speed limits.

Frame by frame, with d = q_next - q in velocity coordinates (nv,),

    min   sum_e w_e^2 |X_WE - target|^2 + w_com^2 |CoM - target|^2                  what is held, what swings, the CoM
          + w_torso^2 |turn of the torso|^2 + w_posture^2 |joints - reference|^2    what is preferred
          + w_effort^2 |d|^2 + w_smooth^2 |d - dt v_previous|^2
    s.t.  lower <= joints <= upper,   |d_joint| <= dt speed                         hard
          rows d >= bounds,   capsules of the body keep apart                       hard as far as weights go

by a few Gauss-Newton steps, each a quadratic program with bounds (`optimization.box_qp`). The order of the tasks is one
of weights, each some ten times the next: contacts, then CoM and swinging end effectors, then the rest. Bounds are never
left, so a target that moves too fast is followed late, and the answer says by how much.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.body_capsules import BodyCapsules, CapsuleRows, close_pairs, distance_row, make_rows, read_capsules
from optimization.box_qp import solve_box_qp
from optimization.ik_tasks import (
    StepProgram,
    add_diagonal,
    add_frame_task,
    add_inequality,
    add_row,
    clear_program,
    frame_error,
    make_program,
)
from optimization.kinematic_tree import KinematicTree, center_of_mass, com_jacobian, difference, forward, integrate
from optimization.kinematics import Kinematics
from scenes.plant import build_plant
from scenes.robot import Robot

_MAX_CLOSE_PAIRS = 12  # pairs of body parts that a step looks at
_NEAR = 0.02  # [m] capsules closer than this beyond what they must keep take part


class TrackingOptions(NamedTuple):
    """Weights of the tasks and when a frame is done; a weight is per metre, or per radian where an angle is meant.

    Attributes:
        held_weight: of contacts that are held, per metre; their angles count 0.3 m per rad.
        com_weight: of the CoM.
        torso_weight: of the torso's orientation.
        posture_weight: of the joints' distance from the reference.
        effort_weight: of moving at all.
        smooth_weight: of changing the velocity from frame to frame.
        row_weight: of the inequality rows.
        distance_weight: of the capsules' distances; 0 leaves self-collision out.
        max_steps: Gauss-Newton steps a frame.
        converged: a step shorter than this ends a frame [rad, m].
    """

    held_weight: float = 300.0
    com_weight: float = 30.0
    torso_weight: float = 2.0
    posture_weight: float = 0.3
    effort_weight: float = 0.1
    smooth_weight: float = 0.0
    row_weight: float = 100.0
    distance_weight: float = 100.0
    max_steps: int = 4
    converged: float = 1e-5


class FrameTargets(NamedTuple):
    """What one frame should reach.

    Attributes:
        X_WE: (E + 1, 4, 4) poses of the end effectors and, last, the torso, whose position does not matter [m].
        held: (E,) contacts to hold; they count `held_weight`.
        swing_linear, swing_angular: (E,) weights of end effectors that move, per metre and per radian; 0: free.
        com: (3,) centre of mass [m], NaN where a coordinate is free.
        q_reference: (nq,) preferred posture; only its joints count.
        rows: (K, nv), bounds: (K,): rows @ difference(q, q_next) >= bounds, linearised at the previous frame's q, say
            n . dp >= d for a point that must stay in front of a plane.
    """

    X_WE: np.ndarray
    held: np.ndarray
    swing_linear: np.ndarray
    swing_angular: np.ndarray
    com: np.ndarray
    q_reference: np.ndarray
    rows: np.ndarray
    bounds: np.ndarray


class TrackingErrors(NamedTuple):
    """What a frame missed.

    Attributes:
        held_position: greatest position error of a held contact [m].
        held_angle: greatest orientation error of a held contact [rad].
        swing_position: greatest position error of a swinging end effector [m].
        com: distance of the CoM to its target [m].
        at_speed_limit: number of joints that move as fast as they may.
    """

    held_position: float
    held_angle: float
    swing_position: float
    com: float
    at_speed_limit: int


class TrackingModel(NamedTuple):
    """What `track_frame` needs of a robot: tree, with the torso as its last named frame, and capsules."""

    tree: KinematicTree
    capsules: BodyCapsules


class _Scratch(NamedTuple):
    """Arrays of one frame: link poses R (n, 3, 3), p (n, 3); com (3,); error (E + 1, 6); J_com (3, nv); moved (nv,)."""

    R: np.ndarray
    p: np.ndarray
    com: np.ndarray
    error: np.ndarray
    J_com: np.ndarray
    moved: np.ndarray
    row: np.ndarray
    close: CapsuleRows


@njit(cache=True)
def _weights(targets: FrameTargets, options: TrackingOptions, e: int) -> tuple[float, float]:
    """Angular and linear weight of end effector e, or of the torso, the last."""
    if e == targets.held.shape[0]:
        return options.torso_weight, 0.0
    if targets.held[e]:
        return 0.3 * options.held_weight, options.held_weight
    return targets.swing_angular[e], targets.swing_linear[e]


@njit(cache=True)
def _measure(model: TrackingModel, targets: FrameTargets, q: np.ndarray, s: _Scratch) -> None:
    forward(model.tree, q, s.R, s.p)
    for e in range(targets.X_WE.shape[0]):
        frame_error(model.tree, s.R, s.p, e, targets.X_WE[e], s.error[e])


@njit(cache=True)
def _add_tasks(
    model: TrackingModel, targets: FrameTargets, options: TrackingOptions, q: np.ndarray, s: _Scratch,
    program: StepProgram,
) -> int:  # fmt: skip
    """Adds everything that depends on where the robot is; returns the number of inequality rows."""
    tree = model.tree
    nv = s.moved.shape[0]
    for e in range(targets.X_WE.shape[0]):
        angular, linear = _weights(targets, options, e)
        if angular > 0.0 or linear > 0.0:
            add_frame_task(tree, s.R, s.p, e, s.error[e], angular, linear, program)
    com_jacobian(tree, s.R, s.p, s.com, s.J_com)
    for a in range(3):
        if not np.isnan(targets.com[a]):
            add_row(s.J_com[a], targets.com[a] - s.com[a], options.com_weight, program)
    for j in range(nv - 6):
        add_diagonal(6 + j, targets.q_reference[7 + j] - q[7 + j], options.posture_weight, program)
    num_rows = 0
    for k in range(targets.rows.shape[0]):
        done = 0.0
        for i in range(nv):
            done += targets.rows[k, i] * s.moved[i]
        num_rows = add_inequality(targets.rows[k], targets.bounds[k] - done, options.row_weight, num_rows, program)
    if options.distance_weight > 0.0:
        for k in range(close_pairs(model.capsules, s.R, s.p, _NEAR, s.close)):
            distance_row(tree, s.R, s.p, s.close, k, s.row)
            gap = s.close.distance[k] - model.capsules.clearance[s.close.pair[k]]
            num_rows = add_inequality(s.row, -gap, options.distance_weight, num_rows, program)
    return num_rows


@njit(cache=True)
def _bound_and_damp(
    tree: KinematicTree, options: TrackingOptions, v_previous: np.ndarray, dt: float, q: np.ndarray, s: _Scratch,
    program: StepProgram,
) -> None:  # fmt: skip
    """Adds what belongs to the whole displacement since the last frame: effort, smoothness, and the hard bounds."""
    for i in range(s.moved.shape[0]):
        add_diagonal(i, -s.moved[i], options.effort_weight, program)
        if options.smooth_weight > 0.0:
            add_diagonal(i, dt * v_previous[i] - s.moved[i], options.smooth_weight, program)
        program.lower[i], program.upper[i] = -np.inf, np.inf
        if i >= 6:
            j = i - 6
            # Where a limit was broken before the frame began, the way back is as fast as the speed limit allows.
            reach = dt * tree.speed[j]
            down, up = -reach - s.moved[i], reach - s.moved[i]
            program.lower[i] = min(max(down, tree.lower[j] - q[7 + j]), up)
            program.upper[i] = max(min(up, tree.upper[j] - q[7 + j]), down)


@njit(cache=True)
def track_frame(
    model: TrackingModel, targets: FrameTargets, options: TrackingOptions, dt: float, v_previous: np.ndarray,
    q: np.ndarray, q_next: np.ndarray, v: np.ndarray,
) -> TrackingErrors:  # fmt: skip
    """Moves one frame on; callable from other kernels, deterministic, keeps no state.

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
    nv, E = v.shape[0], targets.held.shape[0]
    n = tree.parent.shape[0]
    program = make_program(nv, targets.rows.shape[0] + _MAX_CLOSE_PAIRS)
    s = _Scratch(
        np.empty((n, 3, 3)), np.empty((n, 3)), np.empty(3), np.empty((E + 1, 6)), np.empty((3, nv)), np.zeros(nv),
        np.empty(nv), make_rows(_MAX_CLOSE_PAIRS),
    )  # fmt: skip
    for i in range(nv + 1):
        q_next[i] = q[i]
    _measure(model, targets, q_next, s)
    for _ in range(options.max_steps):
        clear_program(program)
        num_rows = _add_tasks(model, targets, options, q_next, s, program)
        _bound_and_damp(tree, options, v_previous, dt, q_next, s, program)
        solve_box_qp(program.H, program.g, program.lower, program.upper, nv + num_rows, program.side, program.x, 60)
        integrate(q_next, program.x, _first_order(program.x), q_next)
        difference(q, q_next, s.moved)
        _measure(model, targets, q_next, s)
        longest = 0.0
        for i in range(nv):
            longest = max(longest, abs(program.x[i]))
        if longest < options.converged:
            break
    return _finish(model, targets, dt, s, v)


@njit(cache=True)
def _first_order(x: np.ndarray) -> float:
    """The part of a step for which the base's turn stays small enough to be one."""
    largest = max(abs(x[0]), abs(x[1]), abs(x[2]))
    return 1.0 if largest < 0.5 else 0.5 / largest


@njit(cache=True)
def _finish(model: TrackingModel, targets: FrameTargets, dt: float, s: _Scratch, v: np.ndarray) -> TrackingErrors:
    """Writes v and says what the frame missed."""
    position, angle, swing, fast = 0.0, 0.0, 0.0, 0
    for e in range(targets.held.shape[0]):
        r = s.error[e]
        turn, move = np.sqrt(r[0] ** 2 + r[1] ** 2 + r[2] ** 2), np.sqrt(r[3] ** 2 + r[4] ** 2 + r[5] ** 2)
        if targets.held[e]:
            position, angle = max(position, move), max(angle, turn)
        elif targets.swing_linear[e] > 0.0:
            swing = max(swing, move)
    center_of_mass(model.tree, s.R, s.p, s.com)
    away2 = 0.0
    for a in range(3):
        if not np.isnan(targets.com[a]):
            away2 += (s.com[a] - targets.com[a]) ** 2
    for i in range(v.shape[0]):
        v[i] = s.moved[i] / dt
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
        rows: np.ndarray | None = None,
        bounds: np.ndarray | None = None,
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
            np.ascontiguousarray(held, dtype=np.bool_).reshape(E),
            _array("swing_linear", np.zeros(E) if swing_linear is None else swing_linear, (E,)),
            _array("swing_angular", np.zeros(E) if swing_angular is None else swing_angular, (E,)),
            np.full(3, np.nan) if com is None else np.ascontiguousarray(com, dtype=float).reshape(3),
            _array("q_reference", self.robot.q_nominal if q_reference is None else q_reference, (nv + 1,)).copy(),
            np.zeros((0, nv)) if rows is None else _array("rows", rows, (len(rows), nv)),
            np.zeros(0) if bounds is None else _array("bounds", bounds, (0 if rows is None else len(rows),)),
        )
        q_next, v = np.empty(nv + 1), np.empty(nv)
        v_previous = _array("v_previous", np.zeros(nv) if v_previous is None else v_previous, (nv,)).copy()
        errors = track_frame(
            self.model, targets, self.options if options is None else options, float(dt), v_previous,
            _array("q", q, (nv + 1,)).copy(), q_next, v,
        )  # fmt: skip
        return TrackedFrame(q_next, v, errors)


def _array(name: str, value: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    array = np.ascontiguousarray(value, dtype=float)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, of shape {shape}; got shape {array.shape}")
    return array
