"""Where a strip is: its configurations and contacts, a step of them, and the course of what is in the air between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optimization.elastic_strip.check import frame_error, rotation_about
from optimization.elastic_strip.problem import StripProblem
from optimization.multibody.kinematic_tree import KinematicTree, integrate
from scenes.footholds.contact_regions import ContactRegions


@dataclass(frozen=True, eq=False)
class StripState:
    """A strip between two iterations.

    Attributes:
        q: (N, nq).
        X_WC: (C, 4, 4) poses of the contacts.
        turned: (C,) how far each has turned about its normal [rad].
        way: (C, 3) how each moved in the last step [m].
    """

    q: np.ndarray
    X_WC: np.ndarray
    turned: np.ndarray
    way: np.ndarray


def first_state(problem: StripProblem) -> StripState:
    """The planned configurations, and the contacts in their places on the new terrain."""
    X_WC = np.array([c.X_WC for c in problem.contacts]).reshape(-1, 4, 4)
    return StripState(np.array(problem.q, dtype=float), X_WC, np.zeros(len(X_WC)), np.zeros((len(X_WC), 3)))


def moved_state(
    state: StripState,
    dq: np.ndarray,
    dc: np.ndarray,
    tree: KinematicTree,
    regions: Sequence[ContactRegions],
    circle: np.ndarray,
) -> StripState:
    """The state after a step.

    Args:
        state: before the step.
        dq: (N, nv) of the configurations [rad, m].
        dc: (C, 3) of the contacts in their frames: x, y [m] and turn about z [rad].
        tree: of the robot.
        regions: of each contact.
        circle: (C,) which of them it must not leave; rounding is taken back.
    """
    q, X_WC = state.q.copy(), state.X_WC.copy()
    for n in range(len(q)):
        integrate(q[n], np.ascontiguousarray(dq[n]), 1.0, q[n])
    q[:, 7:] = np.clip(q[:, 7:], tree.lower, tree.upper)
    for c in range(len(X_WC)):
        X_WC[c, :3, 3] += X_WC[c, :3, :2] @ dc[c, :2]
        X_WC[c, :3, 3] = regions[c].project(X_WC[c], int(circle[c]))[:3, 3]
        X_WC[c, :3, :3] = X_WC[c, :3, :3] @ rotation_about(np.array([0.0, 0.0, dc[c, 2]]))
    return StripState(q, X_WC, state.turned + dc[:, 2], X_WC[:, :3, 3] - state.X_WC[:, :3, 3])


def course_pose(problem: StripProblem, state: StripState, n: int, e: int, X_WE: np.ndarray) -> np.ndarray:
    """(4, 4) where an end effector in the air would be, had it moved with the contacts that it goes between.

    Args:
        problem: the strip's, with the contacts as planned.
        state: with the contacts as they are now.
        n, e: configuration and end effector.
        X_WE: (4, 4) where it was planned, in W [m].
    """
    share, turn, move = problem.share[n], np.zeros(3), np.zeros(3)
    for c, weight in zip(problem.swing[n, e], (1.0 - share, share), strict=True):
        if c >= 0:
            planned = problem.planned[c]
            error = frame_error(planned.R_WC, planned.p_WC, state.X_WC[c])
            turn, move = turn + weight * error[:3], move + weight * error[3:]
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = rotation_about(turn) @ X_WE[:3, :3], X_WE[:3, 3] + move
    return X
