"""Windows of a motion: frames that are solved together while the others stay as they are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from optimization.inverse_kinematics.frame_task import TrackingTargets, window_targets
from optimization.kinodynamic.momentum_tracking import MomentumTargets, track_momentum
from optimization.multibody.kinematic_tree import KinematicTree

JOIN = 2  # frames on either side of a window that join it to what stays: as many as an acceleration reaches


def track_windows(
    tree: KinematicTree,
    targets: TrackingTargets,
    links: MomentumTargets,
    q: np.ndarray,
    where: np.ndarray,
    *,
    max_iterations: int,
    tolerance: float,
    check: Callable[[], None] = lambda: None,
) -> np.ndarray:
    """(T, nq) the motion, with the marked frames solved; each stretch of them is a program of its own.

    Args:
        tree: the robot.
        targets: what each of the T frames should do.
        links: what joins them.
        q: (T, nq) motion to start from.
        where: (T,) bool, the frames to solve.
        max_iterations: of Gauss-Newton, each stretch.
        tolerance: relative decrease of the cost at which it ends.
        check: called now and then; it may raise.
    """
    q = q.copy()
    for first, last in stretches(where):
        a, b = max(first - JOIN, 0), min(last + JOIN, len(q))
        fixed = ~where[a:b]
        part, joints = window_targets(targets, a, b), links.window(a, b, fixed)
        solved = track_momentum(
            tree, part, joints, q[a:b], max_iterations=max_iterations, tolerance=tolerance, check=check
        )
        q[a:b] = solved.q
    return q


def stretches(marked: np.ndarray, around: int = 0) -> list[tuple[int, int]]:
    """Half-open ranges that cover the marked frames and `around` more on either side.

    Args:
        marked: (T,) bool.
        around: number of frames.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], widened(marked, around), [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def widened(marked: np.ndarray, around: int) -> np.ndarray:
    """(T,) bool, the marked frames and `around` more on either side.

    Args:
        marked: (T,) bool.
        around: number of frames.
    """
    return np.convolve(marked, np.ones(2 * around + 1), mode="same") > 0.5
