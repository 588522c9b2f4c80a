"""Configurations that hold contacts, follow a CoM and otherwise stay near a reference posture, frame by frame.

Each frame minimises over q

    sum_e w_e^2 |p_e - p_e*|^2 + u_e^2 |angle(R_e, R_e*)|^2     end effectors: held (w large), swinging, free (w = 0)
    + |W_com (com - com*)|^2                                    centre of mass
    + |W_q (q - q_ref)|^2                                       posture, base orientation included
    + sum_r w_r^2 max(0, d_r* - d_r)^2                          pairs of bodies that must keep a distance
    s.t.   joint limits

by Gauss-Newton with the bounds kept in every step (`box_qp`). The optimum does not depend on the frames before it, only
on q_ref, so a motion neither drifts nor jerks where targets and q_ref are smooth: weighted inverse kinematics (Nakamura
1991, ch. 4) solved to convergence in each frame instead of one velocity step.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.box_qp import solve_box_qp
from optimization.kinematic_tree import (
    KinematicTree,
    com_jacobian,
    difference,
    forward,
    frame_jacobian,
    frame_pose,
    integrate,
    point_jacobian,
    rotation_error,
)

LEVER = 0.3  # [m] an angle of 1 rad counts as this distance in errors
STEP = 0.4  # [rad, m] greatest change of any unknown in one Gauss-Newton step
DAMPING = 1e-6  # keeps the normal equations positive definite where no term sees an unknown
CONVERGED = 2e-5  # [rad, m] a step this small ends a frame


class DistanceRows(NamedTuple):
    """Pairs of points that must keep a distance, in CSR form: frame t owns rows start[t] to start[t + 1].

    Fields: start (T + 1,); link (R, 2) the links that carry the points, -1 for the world; point (R, 2, 3) in those
    links' frames, or in W [m]; normal (R, 3) unit vector in W from the second body to the first; wanted (R,) [m];
    weight (R,) [1/m].
    """

    start: np.ndarray
    link: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    wanted: np.ndarray
    weight: np.ndarray


class _Frame(NamedTuple):
    """What one frame should do; see `TrackingTargets`. Rows `first` to `last` - 1 of the distances are its own."""

    X_WE: np.ndarray
    effector_weight: np.ndarray
    com: np.ndarray
    com_weight: np.ndarray
    q_ref: np.ndarray
    posture_weight: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    rows: DistanceRows
    first: int
    last: int


class _Errors(NamedTuple):
    """What is left of one frame's tasks: effector (E,) [m] and com (3,) [m], written by the solver."""

    effector: np.ndarray
    com: np.ndarray


def no_rows(num_frames: int) -> DistanceRows:
    """No pair to keep apart in any frame."""
    start = np.zeros(num_frames + 1, np.int64)
    return DistanceRows(
        start, np.zeros((0, 2), np.int64), np.zeros((0, 2, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0)
    )


@dataclass(frozen=True, eq=False)
class TrackingTargets:
    """What T frames should do.

    Attributes:
        X_WE: (T, E, 4, 4) poses wanted of the end effectors.
        place_weight: (T, E) of their positions [1/m], 0 where an end effector is free.
        turn_weight: (T, E) of their orientations [1/rad].
        com: (T, 3) centre of mass wanted [m].
        com_weight: (T, 3).
        q_ref: (T, nq) posture wanted.
        posture_weight: (nv,) of the base's orientation, its position and the joints.
        lower, upper: (nv - 6,) limits of the joints.
        rows: distances to keep.
    """

    X_WE: np.ndarray
    place_weight: np.ndarray
    turn_weight: np.ndarray
    com: np.ndarray
    com_weight: np.ndarray
    q_ref: np.ndarray
    posture_weight: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    rows: DistanceRows = field(default_factory=lambda: no_rows(0))


def frame_targets(targets: TrackingTargets, f: int) -> TrackingTargets:
    """The targets of frame f alone, without distances to keep."""
    one = slice(f, f + 1)
    return TrackingTargets(
        targets.X_WE[one], targets.place_weight[one], targets.turn_weight[one], targets.com[one],
        targets.com_weight[one], targets.q_ref[one], targets.posture_weight, targets.lower, targets.upper,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class TrackedPostures:
    """Answer of `track_postures`.

    Attributes:
        q: (T, nq).
        effector_error: (T, E) distance of each weighted end effector from its target, an angle counting `LEVER` [m].
        com_error: (T, 3) com - com* [m].
        iterations: (T,) Gauss-Newton steps.
    """

    q: np.ndarray
    effector_error: np.ndarray
    com_error: np.ndarray
    iterations: np.ndarray


def track_postures(
    tree: KinematicTree,
    targets: TrackingTargets,
    q: np.ndarray,
    *,
    solve: np.ndarray | None = None,
    chained: bool = True,
    max_iterations: int = 10,
) -> TrackedPostures:
    """Solves every frame.

    Args:
        tree: the robot.
        q: (T, nq) guesses; only the first is used where `chained`.
        solve: (T,) bool, frames to solve; the others keep q and are only judged. None solves all.
        chained: whether a frame that is solved starts from the one before it, moved as q_ref moves.
        max_iterations: of Gauss-Newton, a frame.
    """
    q = np.array(q, dtype=float)
    T, E = targets.place_weight.shape
    rows = targets.rows if len(targets.rows.start) == T + 1 else no_rows(T)
    answer = TrackedPostures(q, np.zeros((T, E)), np.zeros((T, 3)), np.zeros(T, np.int64))
    weight = np.stack([targets.place_weight, targets.turn_weight], axis=2)
    all_frames = _Frame(
        _packed(targets.X_WE),
        _packed(weight),
        _packed(targets.com),
        _packed(targets.com_weight),
        _packed(targets.q_ref),
        _packed(targets.posture_weight),
        _packed(targets.lower),
        _packed(targets.upper),
        rows,
        0,
        0,
    )
    chosen = np.ones(T, np.bool_) if solve is None else np.asarray(solve, dtype=np.bool_)
    _track(
        tree, all_frames, chosen, chained, max_iterations, q, answer.effector_error, answer.com_error, answer.iterations
    )
    return answer


def _packed(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, dtype=float)


@njit(cache=True)
def _add_row(H: np.ndarray, g: np.ndarray, row: np.ndarray, residual: float, columns: np.ndarray) -> None:
    """Adds row^T row to the upper triangle of H and row^T residual to g."""
    n = 0
    for i in range(row.shape[0]):
        if row[i] != 0.0:
            columns[n] = i
            n += 1
    for a in range(n):
        i = columns[a]
        x = row[i]
        g[i] += x * residual
        target = H[i]
        for b in range(a, n):
            target[columns[b]] += x * row[columns[b]]


@njit(cache=True)
def _pair_distance(
    tree: KinematicTree, R: np.ndarray, p: np.ndarray, link: np.ndarray, point: np.ndarray, normal: np.ndarray,
    at: np.ndarray,
) -> float:  # fmt: skip
    """Distance of the two points along the normal [m]; writes where they are in W, at (2, 3)."""
    d = 0.0
    for s in range(2):
        k = link[s]
        for a in range(3):
            at[s, a] = point[s, a]
            if k >= 0:
                at[s, a] = p[k, a] + R[k, a, 0] * point[s, 0] + R[k, a, 1] * point[s, 1] + R[k, a, 2] * point[s, 2]
            d += normal[a] * at[s, a] * (1.0 if s == 0 else -1.0)
    return d


@njit(cache=True)
def _add_effectors(
    tree: KinematicTree, frame: _Frame, R: np.ndarray, p: np.ndarray, row: np.ndarray, columns: np.ndarray,
    H: np.ndarray, g: np.ndarray, error: np.ndarray,
) -> None:  # fmt: skip
    """Position and orientation of every end effector that has a weight."""
    nv = frame.posture_weight.shape[0]
    J, R_WE, p_WE, turn = np.empty((6, nv)), np.empty((3, 3)), np.empty(3), np.empty(3)
    for e in range(frame.effector_weight.shape[0]):
        w, u = frame.effector_weight[e, 0], frame.effector_weight[e, 1]
        error[e] = 0.0
        if w <= 0.0:
            continue
        frame_pose(tree, R, p, e, R_WE, p_WE)
        angle = rotation_error(R_WE, frame.X_WE[e, :3, :3], turn)
        frame_jacobian(tree, R, p, e, J)
        away = 0.0
        for a in range(3):
            gap = frame.X_WE[e, a, 3] - p_WE[a]
            away += gap * gap
            for i in range(nv):
                row[i] = u * J[a, i]
            _add_row(H, g, row, u * turn[a], columns)
            for i in range(nv):
                row[i] = w * J[3 + a, i]
            _add_row(H, g, row, w * gap, columns)
        error[e] = np.sqrt(away + (LEVER * angle) ** 2)


@njit(cache=True)
def _add_distances(
    tree: KinematicTree, frame: _Frame, R: np.ndarray, p: np.ndarray, row: np.ndarray, columns: np.ndarray,
    H: np.ndarray, g: np.ndarray,
) -> None:  # fmt: skip
    """Inequalities d + J v >= wanted as equalities d + J v - slack = wanted, slack >= 0, in the least-squares sense."""
    nv = frame.posture_weight.shape[0]
    J, at, rows = np.empty((6, nv)), np.empty((2, 3)), frame.rows
    for r in range(frame.first, frame.last):
        d = _pair_distance(tree, R, p, rows.link[r], rows.point[r], rows.normal[r], at)
        w = rows.weight[r]
        row[:] = 0.0
        row[nv + r - frame.first] = -w
        for s in range(2):
            if rows.link[r, s] < 0:
                continue
            point_jacobian(tree, R, p, rows.link[r, s], at[s, 0], at[s, 1], at[s, 2], J)
            sign = w if s == 0 else -w
            for i in range(nv):
                for a in range(3):
                    row[i] += sign * rows.normal[r, a] * J[3 + a, i]
        _add_row(H, g, row, w * (rows.wanted[r] - d), columns)


@njit(cache=True)
def _normal_equations(
    tree: KinematicTree, frame: _Frame, R: np.ndarray, p: np.ndarray, q: np.ndarray, H: np.ndarray, g: np.ndarray,
    errors: _Errors,
) -> None:  # fmt: skip
    """Gauss-Newton's H (upper triangle) and g at q, the slacks of the distances last, and the errors there."""
    nv = frame.posture_weight.shape[0]
    H[:] = 0.0
    g[:] = 0.0
    row, columns = np.zeros(g.shape[0]), np.empty(g.shape[0], np.int64)
    _add_effectors(tree, frame, R, p, row, columns, H, g, errors.effector)
    J, com = np.zeros((3, nv)), np.empty(3)
    com_jacobian(tree, R, p, com, J)
    for a in range(3):
        errors.com[a] = com[a] - frame.com[a]
        w = frame.com_weight[a]
        if w > 0.0:
            for i in range(nv):
                row[i] = w * J[a, i]
            _add_row(H, g, row, -w * errors.com[a], columns)
    difference(q, frame.q_ref, row)
    for i in range(nv):
        H[i, i] += frame.posture_weight[i] ** 2 + DAMPING
        g[i] += frame.posture_weight[i] ** 2 * row[i]
    _add_distances(tree, frame, R, p, row, columns, H, g)


@njit(cache=True)
def _solve_frame(tree: KinematicTree, frame: _Frame, q: np.ndarray, max_iterations: int, errors: _Errors) -> int:
    """Gauss-Newton from q, in place; returns the steps taken. Errors are those before the last, converged step."""
    nv, n = frame.posture_weight.shape[0], tree.parent.shape[0]
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    m = nv + frame.last - frame.first  # a slack for each distance
    H, g, dv = np.empty((m, m)), np.empty(m), np.zeros(m)
    low, high, side = np.zeros(m), np.full(m, np.inf), np.zeros(m, np.int64)
    for it in range(max_iterations + 1):
        forward(tree, q, R, p)
        _normal_equations(tree, frame, R, p, q, H, g, errors)
        if it == max_iterations:
            return it
        for i in range(nv):
            low[i], high[i] = -STEP, STEP
            if i >= 6:
                low[i] = min(max(low[i], frame.lower[i - 6] - q[i + 1]), STEP)
                high[i] = max(min(high[i], frame.upper[i - 6] - q[i + 1]), low[i])
        if solve_box_qp(H, g, low, high, m, side, dv, 80) < 0:
            side[:] = 0
        integrate(q, dv, 1.0, q)
        biggest = 0.0
        for i in range(nv):
            biggest = max(biggest, abs(dv[i]))
        _clamp(q, frame.lower, frame.upper)
        if biggest < CONVERGED:
            return it + 1
    return max_iterations


@njit(cache=True)
def _clamp(q: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
    """Puts the joints of q within their limits."""
    for i in range(lower.shape[0]):
        q[7 + i] = min(max(q[7 + i], lower[i]), upper[i])


@njit(cache=True)
def _track(
    tree: KinematicTree, frames: _Frame, solve: np.ndarray, chained: bool, max_iterations: int, q: np.ndarray,
    effector_error: np.ndarray, com_error: np.ndarray, iterations: np.ndarray,
) -> None:  # fmt: skip
    """All frames; the fields of `frames` have one more dimension in front, but for the weights and limits of joints."""
    ahead = np.empty(frames.posture_weight.shape[0])
    for t in range(q.shape[0]):
        if solve[t] and chained and t > 0:
            difference(frames.q_ref[t - 1], frames.q_ref[t], ahead)
            integrate(q[t - 1], ahead, 1.0, q[t])
            _clamp(q[t], frames.lower, frames.upper)
        frame = _Frame(
            frames.X_WE[t], frames.effector_weight[t], frames.com[t], frames.com_weight[t], frames.q_ref[t],
            frames.posture_weight, frames.lower, frames.upper, frames.rows, frames.rows.start[t],
            frames.rows.start[t + 1],
        )  # fmt: skip
        errors = _Errors(effector_error[t], com_error[t])
        iterations[t] = _solve_frame(tree, frame, q[t], max_iterations if solve[t] else 0, errors)
