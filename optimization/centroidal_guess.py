"""Where a centroidal program is linearised first: a smooth CoM path over the feet, and weight shared among them."""

from __future__ import annotations

import numpy as np

from optimization.centroidal_options import CentroidalOptions
from optimization.centroidal_problem import CentroidalProblem

WINDOW = 1.0  # [s] half width of the average over the feet
PALM_SHARE = 0.1  # [M g] guessed on a palm


def guess_com(problem: CentroidalProblem, options: CentroidalOptions) -> np.ndarray:
    """(N-1, 3) CoM at knots 1..N-1 [m]: the reference where there is one.

    Else the mean of the feet, averaged over two seconds, at the nominal height; it fades in from the initial CoM.
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
    return (1 - fade) * path + fade * problem.initial_com


def guess_loads(problem: CentroidalProblem, interval: np.ndarray, effector: np.ndarray) -> np.ndarray:
    """(J,) normal forces [M g] of the active contacts: the feet share the weight, palms carry a little.

    Args:
        problem: the data.
        interval: (J,) interval of each active contact.
        effector: (J,) its end effector.
    """
    feet = (effector < 2).astype(float)
    count = np.bincount(interval, feet, len(problem.schedule.dt))[interval]
    palms = np.bincount(interval, minlength=len(problem.schedule.dt))[interval]
    return np.where(count > 0, np.where(feet > 0, 1.0 / np.maximum(count, 1), PALM_SHARE), 1.0 / np.maximum(palms, 1))
