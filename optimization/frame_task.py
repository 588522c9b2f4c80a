"""What one frame of a motion should reach, what a configuration misses of it, and the step that brings it closer.

The terms are those of `optimization.differential_ik`; nothing here chooses steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.body_capsules import BodyCapsules, CapsuleRows, close_pairs, distance_row, make_rows
from optimization.ik_tasks import StepProgram, add_diagonal, add_frame_task, add_inequality, add_row, frame_error
from optimization.kinematic_tree import KinematicTree, center_of_mass, com_jacobian, difference, forward, point_jacobian

MAX_CLOSE_PAIRS = 12  # pairs of body parts that a step looks at
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
        row_weight: of pairs of points that must keep a distance.
        base_speed: greatest speed of the base, each coordinate [rad/s, m/s].
        distance_weight: of the capsules' distances; 0 leaves self-collision out.
        max_steps: Gauss-Newton steps a frame, those that are taken back included.
        converged: a step that lowers the cost by less than this part ends a frame.
    """

    held_weight: float = 300.0
    com_weight: float = 30.0
    torso_weight: float = 2.0
    posture_weight: float = 0.3
    effort_weight: float = 0.1
    smooth_weight: float = 0.0
    row_weight: float = 1000.0
    base_speed: float = 5.0
    distance_weight: float = 300.0
    max_steps: int = 12
    converged: float = 1e-4


class PointPairs(NamedTuple):
    """K pairs of points, each to keep normal . (p_WA - p_WB) >= wanted.

    Attributes:
        link: (K, 2) int64 links that carry A and B, -1 for the world (see `Kinematics.bodies`).
        point: (K, 2, 3) A and B in their links' frames, or in W [m].
        normal: (K, 3) unit vector in W, from B to A.
        wanted: (K,) distance along it [m].
    """

    link: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    wanted: np.ndarray


class FrameTargets(NamedTuple):
    """What one frame should reach.

    Attributes:
        X_WE: (E + 1, 4, 4) poses of the end effectors and, last, the torso, whose position does not matter [m].
        held: (E,) contacts to hold; they count `held_weight`.
        swing_linear, swing_angular: (E,) weights of end effectors that move, per metre and per radian; 0: free.
        com: (3,) centre of mass [m], NaN where a coordinate is free.
        q_reference: (nq,) preferred posture; only its joints count.
        apart: pairs of points that must keep a distance.
    """

    X_WE: np.ndarray
    held: np.ndarray
    swing_linear: np.ndarray
    swing_angular: np.ndarray
    com: np.ndarray
    q_reference: np.ndarray
    apart: PointPairs


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


class TriedFrame(NamedTuple):
    """A configuration tried for a frame, and what the tasks measure on it.

    Attributes:
        q: (nq,) configuration.
        moved: (nv,) displacement from the last frame.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        com: (3,) centre of mass [m].
        error: (E + 1, 6) what `frame_error` says.
        close: pairs of capsules that are close.
    """

    q: np.ndarray
    moved: np.ndarray
    R: np.ndarray
    p: np.ndarray
    com: np.ndarray
    error: np.ndarray
    close: CapsuleRows


@njit(cache=True)
def make_frame(tree: KinematicTree) -> TriedFrame:
    n = tree.parent.shape[0]
    return TriedFrame(
        np.empty(6 + n), np.empty(5 + n), np.empty((n, 3, 3)), np.empty((n, 3)), np.empty(3),
        np.empty((tree.frame_link.shape[0], 6)), make_rows(MAX_CLOSE_PAIRS),
    )  # fmt: skip


@njit(cache=True)
def _weights(targets: FrameTargets, options: TrackingOptions, e: int) -> tuple[float, float]:
    """Angular and linear weight of end effector e, or of the torso, the last."""
    if e == targets.held.shape[0]:
        return options.torso_weight, 0.0
    if targets.held[e]:
        return 0.3 * options.held_weight, options.held_weight
    return targets.swing_angular[e], targets.swing_linear[e]


@njit(cache=True)
def measure_frame(
    model: TrackingModel, targets: FrameTargets, options: TrackingOptions, dt: float, v_previous: np.ndarray,
    q_last: np.ndarray, f: TriedFrame,
) -> tuple[float, int]:  # fmt: skip
    """Fills a frame from its q; returns the cost of the program in the file's first lines, and the close pairs."""
    tree = model.tree
    difference(q_last, f.q, f.moved)
    forward(tree, f.q, f.R, f.p)
    center_of_mass(tree, f.R, f.p, f.com)
    cost = 0.0
    for e in range(targets.X_WE.shape[0]):
        frame_error(tree, f.R, f.p, e, targets.X_WE[e], f.error[e])
        angular, linear = _weights(targets, options, e)
        r = f.error[e]
        cost += angular**2 * (r[0] ** 2 + r[1] ** 2 + r[2] ** 2) + linear**2 * (r[3] ** 2 + r[4] ** 2 + r[5] ** 2)
    for a in range(3):
        if not np.isnan(targets.com[a]):
            cost += options.com_weight**2 * (f.com[a] - targets.com[a]) ** 2
    for i in range(f.moved.shape[0]):
        cost += options.effort_weight**2 * f.moved[i] ** 2
        if options.smooth_weight > 0.0:
            cost += options.smooth_weight**2 * (f.moved[i] - dt * v_previous[i]) ** 2
        if i >= 6:
            cost += options.posture_weight**2 * (f.q[i + 1] - targets.q_reference[i + 1]) ** 2
    point = np.empty(3)
    for k in range(targets.apart.wanted.shape[0]):
        cost += options.row_weight**2 * max(0.0, _missing(targets.apart, k, f, point)) ** 2
    num_close = close_pairs(model.capsules, f.R, f.p, _NEAR, f.close) if options.distance_weight > 0.0 else 0
    for k in range(num_close):
        gap = f.close.distance[k] - model.capsules.clearance[f.close.pair[k]]
        cost += options.distance_weight**2 * min(0.0, gap) ** 2
    return cost, num_close


@njit(cache=True)
def _place(apart: PointPairs, k: int, end: int, f: TriedFrame, point: np.ndarray) -> int:
    """Writes where in W [m] an end of pair k is; returns its link."""
    link = apart.link[k, end]
    o = apart.point[k, end]
    for a in range(3):
        point[a] = o[a]
        if link >= 0:
            point[a] = f.p[link, a] + f.R[link, a, 0] * o[0] + f.R[link, a, 1] * o[1] + f.R[link, a, 2] * o[2]
    return link


@njit(cache=True)
def _missing(apart: PointPairs, k: int, f: TriedFrame, point: np.ndarray) -> float:
    """How much pair k falls short of the distance it should keep [m]."""
    missing = apart.wanted[k]
    for end in range(2):
        _place(apart, k, end, f, point)
        for a in range(3):
            missing -= (1.0 - 2.0 * end) * apart.normal[k, a] * point[a]
    return missing


@njit(cache=True)
def _pair_row(
    tree: KinematicTree, apart: PointPairs, k: int, f: TriedFrame, J: np.ndarray, point: np.ndarray, row: np.ndarray
) -> None:
    """Writes row (nv,), the derivative of pair k's distance; J (6, nv) and point (3,) are scratch."""
    for i in range(row.shape[0]):
        row[i] = 0.0
    for end in range(2):
        link = _place(apart, k, end, f, point)
        if link >= 0:
            point_jacobian(tree, f.R, f.p, link, point[0], point[1], point[2], J)
            for i in range(row.shape[0]):
                for a in range(3):
                    row[i] += (1.0 - 2.0 * end) * apart.normal[k, a] * J[3 + a, i]


@njit(cache=True)
def add_tasks(
    model: TrackingModel, targets: FrameTargets, options: TrackingOptions, f: TriedFrame, num_close: int,
    J_com: np.ndarray, program: StepProgram,
) -> int:  # fmt: skip
    """Adds everything that depends on where the robot is; returns the number of inequality rows."""
    tree = model.tree
    nv = f.moved.shape[0]
    for e in range(targets.X_WE.shape[0]):
        angular, linear = _weights(targets, options, e)
        if angular > 0.0 or linear > 0.0:
            add_frame_task(tree, f.R, f.p, e, f.error[e], angular, linear, program)
    com_jacobian(tree, f.R, f.p, f.com, J_com)
    for a in range(3):
        if not np.isnan(targets.com[a]):
            add_row(J_com[a], targets.com[a] - f.com[a], options.com_weight, program)
    for j in range(nv - 6):
        add_diagonal(6 + j, targets.q_reference[7 + j] - f.q[7 + j], options.posture_weight, program)
    num_rows = 0
    row, point, J = np.empty(nv), np.empty(3), np.empty((6, nv))
    for k in range(targets.apart.wanted.shape[0]):
        missing = _missing(targets.apart, k, f, point)
        _pair_row(tree, targets.apart, k, f, J, point, row)
        num_rows = add_inequality(row, missing, options.row_weight, num_rows, program)
    for k in range(num_close):
        distance_row(tree, f.R, f.p, f.close, k, row)
        gap = f.close.distance[k] - model.capsules.clearance[f.close.pair[k]]
        num_rows = add_inequality(row, -gap, options.distance_weight, num_rows, program)
    return num_rows


@njit(cache=True)
def bound_and_damp(
    tree: KinematicTree, options: TrackingOptions, dt: float, v_previous: np.ndarray, damping: float, f: TriedFrame,
    program: StepProgram,
) -> None:  # fmt: skip
    """Adds what belongs to the whole displacement since the last frame: effort, smoothness, and the hard bounds."""
    for i in range(f.moved.shape[0]):
        add_diagonal(i, -f.moved[i], options.effort_weight, program)
        if options.smooth_weight > 0.0:
            add_diagonal(i, dt * v_previous[i] - f.moved[i], options.smooth_weight, program)
        program.H[i, i] += damping
        reach = dt * (options.base_speed if i < 6 else tree.speed[i - 6])
        down, up = -reach - f.moved[i], reach - f.moved[i]
        program.lower[i], program.upper[i] = down, up
        if i >= 6:
            j = i - 6
            # Where a limit was broken before the frame began, the way back is as fast as the speed limit allows.
            program.lower[i] = min(max(down, tree.lower[j] - f.q[7 + j]), up)
            program.upper[i] = max(min(up, tree.upper[j] - f.q[7 + j]), down)
