"""What each frame of a motion should do, and the least-squares rows that say so.

    sum_e w_e^2 |p_e - p_e*|^2 + u_e^2 |angle(R_e, R_e*)|^2     end effectors: held (w large), swinging, free (w = 0)
    + |W_com (com - com*)|^2                                    centre of mass
    + |W_q (q - q_ref)|^2                                       posture, base orientation included
    + sum_r w_r^2 max(0, d_r* - d_r)^2                          pairs of bodies that must keep a distance

`posture_tracking` solves each frame by itself, `momentum_tracking` all of them together.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.multibody.kinematic_tree import (
    KinematicTree,
    com_jacobian,
    difference,
    frame_jacobian,
    frame_pose,
    point_jacobian,
    rotation_error,
)

LEVER = 0.3  # [m] an angle of 1 rad counts as this distance in errors
DAMPING = 1e-6  # keeps the normal equations positive definite where no term sees an unknown


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


class FrameTask(NamedTuple):
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


class FrameErrors(NamedTuple):
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
    """The targets of frame f alone, without distances to keep.

    Args:
        targets: of all frames.
        f: number of the frame.
    """
    one = slice(f, f + 1)
    return TrackingTargets(
        targets.X_WE[one],
        targets.place_weight[one],
        targets.turn_weight[one],
        targets.com[one],
        targets.com_weight[one],
        targets.q_ref[one],
        targets.posture_weight,
        targets.lower,
        targets.upper,
    )


def window_targets(targets: TrackingTargets, first: int, last: int) -> TrackingTargets:
    """The targets of frames first to last - 1, with the distances that these frames keep.

    Args:
        targets: of all frames.
        first: number of the first frame.
        last: number after the last frame.
    """
    own, rows = slice(first, last), targets.rows
    if len(rows.start) == len(targets.com) + 1:
        kept = slice(rows.start[first], rows.start[last])
        start = rows.start[first : last + 1] - rows.start[first]
        rows = DistanceRows(start, *(array[kept] for array in rows[1:]))
    return replace(
        targets,
        X_WE=targets.X_WE[own],
        place_weight=targets.place_weight[own],
        turn_weight=targets.turn_weight[own],
        com=targets.com[own],
        com_weight=targets.com_weight[own],
        q_ref=targets.q_ref[own],
        rows=rows,
    )


def frame_tasks(targets: TrackingTargets) -> FrameTask:
    """All frames for a kernel: the arrays as they are, C-contiguous, with one more dimension in front."""
    T = len(targets.com)
    rows = targets.rows if len(targets.rows.start) == T + 1 else no_rows(T)
    weight = np.stack([targets.place_weight, targets.turn_weight], axis=2)
    arrays = (
        targets.X_WE,
        weight,
        targets.com,
        targets.com_weight,
        targets.q_ref,
        targets.posture_weight,
        targets.lower,
        targets.upper,
    )
    return FrameTask(*(np.array(array, dtype=float, order="C") for array in arrays), rows, 0, 0)  # type: ignore[call-arg]


@njit(cache=True)
def task_of_frame(frames: FrameTask, t: int) -> FrameTask:
    """Frame t of all frames; weights of the posture and limits of the joints are everybody's.

    Args:
        frames: tasks of all frames.
        t: number of the frame.
    """
    return FrameTask(
        frames.X_WE[t],
        frames.effector_weight[t],
        frames.com[t],
        frames.com_weight[t],
        frames.q_ref[t],
        frames.posture_weight,
        frames.lower,
        frames.upper,
        frames.rows,
        frames.rows.start[t],
        frames.rows.start[t + 1],
    )


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
def pair_distance(
    tree: KinematicTree,
    R: np.ndarray,
    p: np.ndarray,
    link: np.ndarray,
    point: np.ndarray,
    normal: np.ndarray,
    at: np.ndarray,
) -> float:
    """Distance of the two points along the normal [m]; writes where they are in W, at (2, 3).

    Args:
        tree: of the robot.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        link: (2,) links that carry the points, -1 for the world.
        point: (2, 3) points in those links' frames, or in W [m].
        normal: (3,) unit vector in W from the second point to the first.
        at: (2, 3) written, in W [m].
    """
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
    tree: KinematicTree,
    frame: FrameTask,
    R: np.ndarray,
    p: np.ndarray,
    row: np.ndarray,
    columns: np.ndarray,
    H: np.ndarray,
    g: np.ndarray,
    error: np.ndarray,
) -> float:
    """Position and orientation of every end effector that has a weight; returns their part of the cost."""
    nv = frame.posture_weight.shape[0]
    J, R_WE, p_WE, turn = np.empty((6, nv)), np.empty((3, 3)), np.empty(3), np.empty(3)
    cost = 0.0
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
        cost += w * w * away + u * u * angle * angle
    return cost


@njit(cache=True)
def distance_row(
    tree: KinematicTree, rows: DistanceRows, r: int, R: np.ndarray, p: np.ndarray, J: np.ndarray, row: np.ndarray
) -> float:
    """Writes row (nv,), the derivative of the distance of pair r, and returns it [m]; J (6, nv) is scratch.

    Args:
        tree: of the robot.
        rows: pairs of points.
        r: number of the pair.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        J: (6, nv) scratch.
        row: (nv,) written.
    """
    at = np.empty((2, 3))
    d = pair_distance(tree, R, p, rows.link[r], rows.point[r], rows.normal[r], at)
    for i in range(J.shape[1]):
        row[i] = 0.0
    for s in range(2):
        if rows.link[r, s] < 0:
            continue
        point_jacobian(tree, R, p, rows.link[r, s], at[s, 0], at[s, 1], at[s, 2], J)
        sign = 1.0 if s == 0 else -1.0
        for i in range(J.shape[1]):
            for a in range(3):
                row[i] += sign * rows.normal[r, a] * J[3 + a, i]
    return d


@njit(cache=True)
def hinges(
    tree: KinematicTree, frame: FrameTask, R: np.ndarray, p: np.ndarray, J_d: np.ndarray, missing: np.ndarray
) -> float:
    """Writes how the distances fall short, linearised: w (d* - d) - w J v; returns their part of the cost.

    Args:
        tree: of the robot.
        frame: what the frame should do.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        J_d: (num, nv) written: w J of each distance of the frame.
        missing: (num,) written: w (d* - d), negative where there is more than enough.
    """
    J, cost = np.empty((6, J_d.shape[1])), 0.0
    for r in range(frame.first, frame.last):
        k, w = r - frame.first, frame.rows.weight[r]
        d = distance_row(tree, frame.rows, r, R, p, J, J_d[k])
        J_d[k] *= w
        missing[k] = w * (frame.rows.wanted[r] - d)
        cost += max(missing[k], 0.0) ** 2
    return cost


@njit(cache=True)
def add_missing_distances(
    tree: KinematicTree, frame: FrameTask, R: np.ndarray, p: np.ndarray, H: np.ndarray, g: np.ndarray
) -> float:
    """The distances that fall short as they are, without slacks; returns their part of the cost.

    Args:
        tree: of the robot.
        frame: what the frame should do.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        H: (nv or more, nv or more) matrix of the normal equations; added to.
        g: (nv or more,) their right-hand side; added to.
    """
    nv = frame.posture_weight.shape[0]
    J, row, columns, at = np.empty((6, nv)), np.empty(nv), np.empty(nv, np.int64), np.empty((2, 3))
    rows, cost = frame.rows, 0.0
    for r in range(frame.first, frame.last):
        missing = rows.wanted[r] - pair_distance(tree, R, p, rows.link[r], rows.point[r], rows.normal[r], at)
        if missing > 0.0:
            distance_row(tree, rows, r, R, p, J, row)
            w = rows.weight[r]
            for i in range(nv):
                row[i] *= w
            _add_row(H, g, row, w * missing, columns)
            cost += (w * missing) ** 2
    return cost


@njit(cache=True)
def normal_equations(
    tree: KinematicTree,
    frame: FrameTask,
    R: np.ndarray,
    p: np.ndarray,
    q: np.ndarray,
    H: np.ndarray,
    g: np.ndarray,
    errors: FrameErrors,
) -> float:
    """Gauss-Newton's H (upper triangle) and g at q, the errors there, and the cost, all without distances.

    Args:
        tree: of the robot.
        frame: what the frame should do.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        q: (nq,) configuration.
        H: (nv or more, nv or more) written.
        g: (nv or more,) written.
        errors: written.
    """
    nv = frame.posture_weight.shape[0]
    H[:] = 0.0
    g[:] = 0.0
    row, columns = np.zeros(g.shape[0]), np.empty(g.shape[0], np.int64)
    cost = _add_effectors(tree, frame, R, p, row, columns, H, g, errors.effector)
    J, com = np.zeros((3, nv)), np.empty(3)
    com_jacobian(tree, R, p, com, J)
    for a in range(3):
        errors.com[a] = com[a] - frame.com[a]
        w = frame.com_weight[a]
        if w > 0.0:
            cost += (w * errors.com[a]) ** 2
            for i in range(nv):
                row[i] = w * J[a, i]
            _add_row(H, g, row, -w * errors.com[a], columns)
    difference(q, frame.q_ref, row)
    for i in range(nv):
        w = frame.posture_weight[i]
        H[i, i] += w * w + DAMPING
        g[i] += w * w * row[i]
        cost += (w * row[i]) ** 2
    return cost
