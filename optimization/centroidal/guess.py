"""Where a centroidal program is linearised first: a smooth CoM path over the feet, and weight shared among them."""

from __future__ import annotations

import numpy as np

from optimization.centroidal.options import UP, CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from scenes.effector import RIGHT_FOOT
from scenes.gravity import GRAVITY

WINDOW = 1.0  # [s] half width of the average over the feet
# How far least-effort answers to random transitions are carried along by their first velocity: v0 DRIFT (1 -
# exp(-t / STOPPING)) exp(-t / RETURN).
DRIFT, STOPPING, RETURN = 0.17, 0.2, 1.5  # [s]
GREATEST_PUSH = 0.5  # [M g] guessed beside the weight, per axis
PALM_SHARE = 0.1  # [M g] guessed on a palm
LEAST_SHARE = 0.1  # [M g] guessed on each of two feet


def guess_com(problem: CentroidalProblem, options: CentroidalOptions) -> np.ndarray:
    """(N-1, 3) CoM at knots 1..N-1 [m]: the reference where there is one.

    Else the mean of the feet, averaged over two seconds, at the nominal height; it fades in from the initial
    CoM, which its velocity carries along.

    Args:
        problem: the data, in SI.
        options: `com_height` over the feet [m].
    """
    if problem.com_reference is not None:
        return problem.com_reference[1:]
    feet = problem.schedule.feet_mean()
    times = problem.schedule.times[1:]
    known = np.isfinite(feet[:, 0])
    if not known.any():
        return np.tile(problem.initial_com, (len(times), 1))
    feet = np.stack([np.interp(times, times[known], feet[known, i]) for i in range(3)], axis=1)
    sums = np.vstack([np.zeros(3), np.cumsum(feet, axis=0)])
    first = np.searchsorted(times, times - WINDOW)
    last = np.searchsorted(times, times + WINDOW, side="right")
    path = (sums[last] - sums[first]) / (last - first)[:, None]
    path[:, 2] += options.com_height[1]
    fade = np.exp(-times)[:, None]
    velocity = problem.initial_linear_momentum / problem.mass
    drift = DRIFT * (1 - np.exp(-times / STOPPING)) * np.exp(-times / RETURN)
    return (1 - fade) * path + fade * problem.initial_com + drift[:, None] * velocity


def guess_total_force(problem: CentroidalProblem, com: np.ndarray) -> np.ndarray:
    """(N-1, 3) total contact force [M g] that moves the CoM along `com` (N-1, 3), within bounds; none in flight.

    Args:
        problem: the data, in SI.
        com: (N-1, 3) CoM at knots 1..N-1 [m].
    """
    dt = problem.schedule.dt[:, None]
    velocity = np.diff(com, axis=0, prepend=problem.initial_com[None]) / dt
    initial = problem.initial_linear_momentum[None] / problem.mass
    push = np.diff(velocity, axis=0, prepend=initial) / (dt * GRAVITY)
    held = (problem.schedule.active >= 0).any(axis=1, keepdims=True)
    return np.where(held, UP + np.clip(push, -GREATEST_PUSH, GREATEST_PUSH), 0.0)


def guess_forces(problem: CentroidalProblem, com: np.ndarray, interval: np.ndarray, effector: np.ndarray) -> np.ndarray:
    """(J, 3) forces [M g] of the active contacts in their frames.

    Two feet share the weight as the CoM stands between them, and push upwards; palms push a little along their normals.
    Without feet the palms share the weight.

    Args:
        problem: the data.
        com: (N-1, 3) CoM at the end of each interval [m].
        interval: (J,) interval of each active contact.
        effector: (J,) its end effector.
    """
    schedule = problem.schedule
    p_WC, _, _ = schedule.poses()
    share = np.zeros(schedule.active.shape)
    held = schedule.active >= 0
    both = held[:, 0] & held[:, 1]
    if both.any():
        left, right = (p_WC[schedule.active[both, foot], :2] for foot in (0, 1))
        across = left - right
        part = np.einsum("na,na->n", com[both, :2] - right, across) / np.maximum(np.sum(across**2, axis=1), 1e-9)
        share[both, 0] = np.clip(part, LEAST_SHARE, 1 - LEAST_SHARE)
        share[both, 1] = 1 - share[both, 0]
    single = held[:, :2].sum(axis=1) == 1
    share[single, :2] = held[single, :2]
    palms = held[:, 2:].sum(axis=1, keepdims=True)
    share[:, 2:] = np.where(held[:, :2].any(axis=1, keepdims=True), PALM_SHARE, 1.0 / np.maximum(palms, 1))
    load = share[interval, effector][:, None]
    _, R_WC, _ = schedule.poses()
    up = R_WC[schedule.active[interval, effector], 2] if len(R_WC) else np.zeros((0, 3))
    return load * np.where(effector[:, None] <= RIGHT_FOOT, up, UP)
