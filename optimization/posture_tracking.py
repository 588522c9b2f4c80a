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
    effector_error, com_error, iterations = np.zeros((T, E)), np.zeros((T, 3)), np.zeros(T, np.int64)
    _track(
        tree,
        np.ascontiguousarray(targets.X_WE, dtype=float),
        np.ascontiguousarray(np.stack([targets.place_weight, targets.turn_weight], axis=2), dtype=float),
        np.ascontiguousarray(targets.com, dtype=float),
        np.ascontiguousarray(targets.com_weight, dtype=float),
        np.ascontiguousarray(targets.q_ref, dtype=float),
        np.ascontiguousarray(targets.posture_weight, dtype=float),
        np.ascontiguousarray(targets.lower, dtype=float),
        np.ascontiguousarray(targets.upper, dtype=float),
        rows,
        np.ones(T, np.bool_) if solve is None else np.asarray(solve, dtype=np.bool_),
        chained,
        max_iterations,
        q,
        effector_error,
        com_error,
        iterations,
    )
    return TrackedPostures(q, effector_error, com_error, iterations)


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
                at[s, a] = (
                    p[k, a] + R[k, a, 0] * point[s, 0] + R[k, a, 1] * point[s, 1] + R[k, a, 2] * point[s, 2]
                )
            d += normal[a] * at[s, a] * (1.0 if s == 0 else -1.0)
    return d


@njit(cache=True)
def _normal_equations(
    tree, R, p, q, X_WE, effector_weight, com, com_weight, q_ref, posture_weight, rows, first, last, H, g,
    effector_error, com_error,
) -> None:  # fmt: skip
    """Gauss-Newton's H (upper triangle) and g at q, the slacks of the distances last, and the errors there."""
    nv = posture_weight.shape[0]
    H[:] = 0.0
    g[:] = 0.0
    J, Jc, row = np.empty((6, nv)), np.zeros((3, nv)), np.zeros(g.shape[0])
    R_WE, p_WE, turn, c = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    columns = np.empty(g.shape[0], np.int64)
    for e in range(effector_weight.shape[0]):
        w, u = effector_weight[e, 0], effector_weight[e, 1]
        effector_error[e] = 0.0
        if w <= 0.0:
            continue
        frame_pose(tree, R, p, e, R_WE, p_WE)
        angle = rotation_error(R_WE, X_WE[e, :3, :3], turn)
        frame_jacobian(tree, R, p, e, J)
        away = 0.0
        for a in range(3):
            away += (X_WE[e, a, 3] - p_WE[a]) ** 2
            for i in range(nv):
                row[i] = u * J[a, i]
            _add_row(H, g, row, u * turn[a], columns)
            for i in range(nv):
                row[i] = w * J[3 + a, i]
            _add_row(H, g, row, w * (X_WE[e, a, 3] - p_WE[a]), columns)
        effector_error[e] = np.sqrt(away + (LEVER * angle) ** 2)
    com_jacobian(tree, R, p, c, Jc)
    for a in range(3):
        com_error[a] = c[a] - com[a]
        if com_weight[a] > 0.0:
            for i in range(nv):
                row[i] = com_weight[a] * Jc[a, i]
            _add_row(H, g, row, -com_weight[a] * com_error[a], columns)
    difference(q, q_ref, row)
    for i in range(nv):
        H[i, i] += posture_weight[i] ** 2 + DAMPING
        g[i] += posture_weight[i] ** 2 * row[i]
    at = np.empty((2, 3))
    for r in range(first, last):
        # An inequality d + J v >= wanted as the equality d + J v - slack = wanted, slack >= 0, in the least-squares sense.
        d = _pair_distance(tree, R, p, rows.link[r], rows.point[r], rows.normal[r], at)
        row[:] = 0.0
        w = rows.weight[r]
        row[nv + r - first] = -w
        for s in range(2):
            if rows.link[r, s] < 0:
                continue
            point_jacobian(tree, R, p, rows.link[r, s], at[s, 0], at[s, 1], at[s, 2], J)
            for i in range(nv):
                for a in range(3):
                    row[i] += (1.0 if s == 0 else -1.0) * w * rows.normal[r, a] * J[3 + a, i]
        _add_row(H, g, row, w * (rows.wanted[r] - d), columns)


@njit(cache=True)
def _solve_frame(
    tree, q, X_WE, effector_weight, com, com_weight, q_ref, posture_weight, lower, upper, rows, first, last,
    max_iterations, effector_error, com_error,
) -> int:  # fmt: skip
    """Gauss-Newton from q, in place; returns the steps taken. Errors are those before the last, converged step."""
    nv = posture_weight.shape[0]
    n = tree.parent.shape[0]
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    m = nv + last - first  # a slack for each distance
    H, g, dv = np.empty((m, m)), np.empty(m), np.zeros(m)
    low, high, side = np.zeros(m), np.full(m, np.inf), np.zeros(m, np.int64)
    for it in range(max_iterations + 1):
        forward(tree, q, R, p)
        _normal_equations(
            tree, R, p, q, X_WE, effector_weight, com, com_weight, q_ref, posture_weight, rows, first, last,
            H, g, effector_error, com_error,
        )  # fmt: skip
        if it == max_iterations:
            return it
        for i in range(nv):
            low[i], high[i] = -STEP, STEP
            if i >= 6:
                low[i] = min(max(low[i], lower[i - 6] - q[i + 1]), STEP)
                high[i] = max(min(high[i], upper[i - 6] - q[i + 1]), low[i])
        if solve_box_qp(H, g, low, high, m, side, dv, 80) < 0:
            side[:] = 0
        integrate(q, dv, 1.0, q)
        biggest = 0.0
        for i in range(nv):
            biggest = max(biggest, abs(dv[i]))
            if i >= 6:
                q[i + 1] = min(max(q[i + 1], lower[i - 6]), upper[i - 6])
        if biggest < CONVERGED:
            return it + 1
    return max_iterations


@njit(cache=True)
def _track(
    tree, X_WE, effector_weight, com, com_weight, q_ref, posture_weight, lower, upper, rows, solve, chained,
    max_iterations, q, effector_error, com_error, iterations,
) -> None:  # fmt: skip
    nv = posture_weight.shape[0]
    ahead = np.empty(nv)
    for t in range(q.shape[0]):
        steps = 0
        if solve[t]:
            steps = max_iterations
            if chained and t > 0:
                difference(q_ref[t - 1], q_ref[t], ahead)
                integrate(q[t - 1], ahead, 1.0, q[t])
                for i in range(6, nv):
                    q[t, i + 1] = min(max(q[t, i + 1], lower[i - 6]), upper[i - 6])
        iterations[t] = _solve_frame(
            tree, q[t], X_WE[t], effector_weight[t], com[t], com_weight[t], q_ref[t], posture_weight, lower, upper,
            rows, rows.start[t], rows.start[t + 1], steps, effector_error[t], com_error[t],
        )  # fmt: skip
