"""Where the CoM may be: over the feet in contact, and at the end."""

from __future__ import annotations

import numpy as np

from optimization.centroidal.options import UP, CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem


def height_bounds(problem: CentroidalProblem, options: CentroidalOptions) -> tuple[np.ndarray, np.ndarray]:
    """(N-1,) least and greatest CoM height at knots 1..N-1 [m]; infinite while no foot is in contact.

    Args:
        problem: its schedule says where the feet are.
        options: `com_height` over the feet [m].
    """
    ground = problem.schedule.feet_mean()[:, 2]
    low, _, high = options.com_height
    known = np.isfinite(ground)
    return np.where(known, ground + low, -np.inf), np.where(known, ground + high, np.inf)


def final_box(problem: CentroidalProblem, options: CentroidalOptions) -> tuple[np.ndarray, np.ndarray] | None:
    """(3,) lower and upper corner of the box in which the CoM must end [m], or None.

    It lies around the mean of the last feet in contact, at the nominal height.

    Args:
        problem: its schedule says where the feet are.
        options: `com_height` and `final_half_width` [m].
    """
    feet = problem.schedule.feet_mean()
    known = np.flatnonzero(np.isfinite(feet[:, 0]))
    if options.final_half_width is None or not len(known):
        return None
    centre = feet[known[-1]] + options.com_height[1] * UP
    return centre - np.asarray(options.final_half_width), centre + np.asarray(options.final_half_width)
