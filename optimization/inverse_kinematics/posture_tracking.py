"""Configurations that hold contacts, follow a CoM and otherwise stay near a reference posture, frame by frame.

Each frame minimises over q

    sum_e w_e^2 |p_e - p_e*|^2 + u_e^2 |angle(R_e, R_e*)|^2     end effectors: held (w large), swinging, free (w = 0)
    + |W_com (com - com*)|^2                                    centre of mass
    + |W_q (q - q_ref)|^2                                       posture, base orientation included
    + sum_r w_r^2 max(0, d_r* - d_r)^2                          pairs of bodies that must keep a distance
    s.t.   joint limits

by Gauss-Newton with the bounds kept in every step (`hinge_qp`). The optimum does not depend on the frames before it, only
on q_ref, so a motion neither drifts nor jerks where targets and q_ref are smooth: weighted inverse kinematics (Nakamura
1991, ch. 4) solved to convergence in each frame instead of one velocity step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from optimization.convex.hinge_qp import HingeProgram, solve_hinge_qp
from optimization.inverse_kinematics.frame_task import (
    FrameErrors,
    FrameTask,
    TrackingTargets,
    frame_tasks,
    hinges,
    normal_equations,
    task_of_frame,
)
from optimization.multibody.kinematic_tree import KinematicTree, difference, forward, integrate

STEP = 0.4  # [rad, m] greatest change of any unknown in one Gauss-Newton step
PATIENCE = 6  # full steps without a better posture than the best so far, before damped ones
FIRST_DAMPING, MOST_DAMPING = 1e-3, 1e4  # relative to the diagonal, tenfold each time a step makes it worse
CONVERGED = 2e-5  # [rad, m] a step this small ends a frame


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
        targets: what each frame should do.
        q: (T, nq) guesses; only the first is used where `chained`.
        solve: (T,) bool, frames to solve; the others keep q and are only judged. None solves all.
        chained: whether a frame that is solved starts from the one before it, moved as q_ref moves.
        max_iterations: of Gauss-Newton, a frame.
    """
    q = np.array(q, dtype=float)
    T, E = targets.place_weight.shape
    answer = TrackedPostures(q, np.zeros((T, E)), np.zeros((T, 3)), np.zeros(T, np.int64))
    all_frames = frame_tasks(targets)
    chosen = np.ones(T, np.bool_) if solve is None else np.asarray(solve, dtype=np.bool_)
    _track(
        tree, all_frames, chosen, chained, max_iterations, q, answer.effector_error, answer.com_error, answer.iterations
    )
    return answer


@njit(cache=True)
def _solve_frame(tree: KinematicTree, frame: FrameTask, q: np.ndarray, max_iterations: int, errors: FrameErrors) -> int:
    """Gauss-Newton from q, in place; returns the steps taken. Errors are those before the last, converged step.

    Full steps may climb for a while: held contacts bend the way to the minimum (the watchdog of Chamberlain et al. 1982).
    Where `PATIENCE` of them bring nothing better, as near a stretched limb, the frame goes on from the best so far with
    damped steps that have to descend (Levenberg 1944, Marquardt 1963).
    """
    nv, n, num = frame.posture_weight.shape[0], tree.parent.shape[0], frame.last - frame.first
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    H, g, J, missing, dv = np.empty((nv, nv)), np.empty(nv), np.empty((num, nv)), np.empty(num), np.zeros(nv)
    best_H, best_g, best_J, best_missing, best_q = H.copy(), g.copy(), J.copy(), missing.copy(), q.copy()
    best, damping, climbing = np.inf, 0.0, 0
    low, high, side = np.zeros(nv), np.zeros(nv), np.zeros(nv, np.int64)
    if max_iterations > 0:
        _clamp(q, frame.lower, frame.upper)
    for it in range(max_iterations + 1):
        forward(tree, q, R, p)
        cost = normal_equations(tree, frame, R, p, q, H, g, errors) + hinges(tree, frame, R, p, J, missing)
        if cost < best:
            best_H[:], best_g[:], best_J[:], best_missing[:], best_q[:], best = H, g, J, missing, q, cost
            damping, climbing = (0.1 * damping if damping > FIRST_DAMPING else 0.0), 0
        else:
            climbing += 1
            if damping > 0.0 or climbing >= PATIENCE or it == max_iterations:
                damping = max(10.0 * damping, FIRST_DAMPING)
                H[:], g[:], J[:], missing[:], q[:] = best_H, best_g, best_J, best_missing, best_q
        if it == max_iterations or damping > MOST_DAMPING:
            if climbing > 0:
                forward(tree, q, R, p)
                normal_equations(tree, frame, R, p, q, H, g, errors)
            return it
        for i in range(nv):
            H[i, i] *= 1.0 + damping
            low[i], high[i] = -STEP, STEP
            if i >= 6:
                low[i] = min(max(low[i], frame.lower[i - 6] - q[i + 1]), 0.0)
                high[i] = max(min(high[i], frame.upper[i - 6] - q[i + 1]), 0.0)
        if solve_hinge_qp(HingeProgram(H, g, J, missing, low, high), side, dv, 80) < 0:
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
    tree: KinematicTree,
    frames: FrameTask,
    solve: np.ndarray,
    chained: bool,
    max_iterations: int,
    q: np.ndarray,
    effector_error: np.ndarray,
    com_error: np.ndarray,
    iterations: np.ndarray,
) -> None:
    """All frames; the fields of `frames` have one more dimension in front, but for the weights and limits of joints."""
    ahead = np.empty(frames.posture_weight.shape[0])
    for t in range(q.shape[0]):
        if solve[t] and chained and t > 0:
            difference(frames.q_ref[t - 1], frames.q_ref[t], ahead)
            integrate(q[t - 1], ahead, 1.0, q[t])
            _clamp(q[t], frames.lower, frames.upper)
        frame = task_of_frame(frames, t)
        errors = FrameErrors(effector_error[t], com_error[t])
        iterations[t] = _solve_frame(tree, frame, q[t], max_iterations if solve[t] else 0, errors)
