"""The objective of Lin 2020 sec. 6.3 and 6.7 as weights and targets of a centroidal program's variables."""

from __future__ import annotations

import numpy as np

from optimization.centroidal.options import ARM, COST_SCALE, REFERENCE_STEP, CentroidalWeights
from optimization.centroidal.problem import CentroidalProblem
from scenes.gravity import GRAVITY


def cost_terms(
    problem: CentroidalProblem,
    weights: CentroidalWeights,
    index: dict[str, np.ndarray],
    interval: np.ndarray,
    num_vars: int,
) -> tuple[np.ndarray, np.ndarray]:
    """(n,) weight and target of each variable: the scaled cost is sum weight (x - target)^2.

    Args:
        problem: the data.
        weights: the objective's.
        index: places of the variables com, v, a, k, kdot (N-1, 3), wrench (J, 6) and z (J, 3) among the n.
        interval: (J,) interval of each active contact.
        num_vars: n.
    """
    diagonal, target = np.zeros(num_vars), np.zeros(num_vars)
    dt, weight = problem.schedule.dt[:, None], problem.mass * GRAVITY
    step = COST_SCALE * (np.ones_like(dt) if weights.per_knot else dt / REFERENCE_STEP)
    moment = (weight * ARM) ** 2
    diagonal[index["v"]] = step * np.multiply(weights.linear_momentum, problem.mass**2)
    diagonal[index["a"]] = step * np.multiply(weights.linear_momentum_rate, weight**2)
    diagonal[index["k"]] = step * np.multiply(weights.angular_momentum, moment)
    diagonal[index["kdot"]] = step * np.multiply(weights.angular_momentum_rate, moment)
    if problem.angular_momentum_reference is not None:
        reference = problem.angular_momentum_reference / (weight * ARM)
        target[index["k"]] = reference[1:]
        target[index["kdot"]] = np.diff(reference, axis=0) / dt
    if problem.com_reference is not None:
        diagonal[index["com"]] = step * weights.com_tracking
        target[index["com"]] = problem.com_reference[1:] - problem.initial_com
    for name, final, unit in (
        ("v", weights.final_linear_momentum, problem.mass**2),
        ("k", weights.final_angular_momentum, moment),
        ("com", weights.final_com if problem.com_reference is not None else None, 1.0),
    ):
        if final is not None:
            diagonal[index[name][-1]] = COST_SCALE * np.multiply(final, unit)
    each = step[interval]
    lateral = weights.force + weights.lateral_force
    diagonal[index["wrench"]] = each * np.array([lateral, lateral, weights.force, 0, 0, 0])
    pressure = weights.pressure_centre
    diagonal[index["z"]] = each * np.array([pressure, pressure, weights.torque * moment])
    return diagonal, target
