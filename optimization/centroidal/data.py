"""The numbers of a centroidal program in its own units: what its rows, its model and its explanation read.

Units: m, s, M g; moments M g ARM and angular momenta M g ARM s. Points are relative to `origin` where that is said.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optimization.balance.contact_wrench import SMALLEST, CornerForces
from optimization.centroidal.cost import cost_terms
from optimization.centroidal.force_limits import force_limits
from optimization.centroidal.options import ARM, CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.trajectory import WrenchIntegrator
from scenes.effector import EFFECTORS
from scenes.gravity import GRAVITY


@dataclass(frozen=True, eq=False)
class CentroidalData:
    """One problem's numbers, for N knots and J active contacts (each contact counts once in every interval it is held).

    Attributes:
        problem, options: what the numbers were made of.
        dt: (N-1,) lengths of the intervals [s].
        interval, effector: (J,) of each active contact.
        p_WC, R_WC: (J, 3) points [m] and (J, 3, 3) orientations of the active contacts in W.
        half, middle: (J, 2) half extents and centres of the boxes around their supports, less the reserve, in C [m].
        force_limit: (J,) greatest normal forces [M g].
        corners: their corner forces and cones [M g].
        integrator: gives the motion under contact wrenches.
        origin: (3,) initial CoM in W, that the variable com is relative to [m].
        v0: (3,) velocity of the CoM at knot 0 [m/s].
        k0: (3,) angular momentum at knot 0 [M g ARM s].
        momentum_limits: (3,) limits on |k| [M g ARM s] and on |kdot| [M g ARM].
        reach: (K,) knot less one, (K, 3) contact point in W [m] and (K,) greatest distance of the CoM [m].
        index: places of each variable among the `num_vars`, by its name.
        num_vars: number of variables.
        cost_diagonal, cost_target: (num_vars,) the scaled cost is sum cost_diagonal (x - cost_target)^2.
    """

    problem: CentroidalProblem
    options: CentroidalOptions
    dt: np.ndarray
    interval: np.ndarray
    effector: np.ndarray
    p_WC: np.ndarray
    R_WC: np.ndarray
    half: np.ndarray
    middle: np.ndarray
    force_limit: np.ndarray
    corners: CornerForces
    integrator: WrenchIntegrator
    origin: np.ndarray
    v0: np.ndarray
    k0: np.ndarray
    momentum_limits: tuple[np.ndarray, np.ndarray]
    reach: tuple[np.ndarray, np.ndarray, np.ndarray]
    index: dict[str, np.ndarray]
    num_vars: int
    cost_diagonal: np.ndarray
    cost_target: np.ndarray

    @classmethod
    def of(cls, problem: CentroidalProblem, options: CentroidalOptions) -> CentroidalData:
        """Reads a problem.

        Args:
            problem: in SI.
            options: cone, limits and weights, in SI.
        """
        schedule, unit = problem.schedule, problem.mass * GRAVITY * ARM
        v0, k0 = problem.initial_linear_momentum / problem.mass, problem.initial_angular_momentum / unit
        integrator = WrenchIntegrator(schedule, np.stack([problem.initial_com, v0, k0 * ARM]))
        interval, effector = integrator.interval, integrator.effector
        _, _, friction = schedule.poses()
        held = schedule.active[interval, effector]
        reserve = options.reserve
        supports = reserve.supports(problem.supports)[held]
        low, high = supports.min(axis=1), supports.max(axis=1)
        half, middle = 0.5 * (high - low), 0.5 * (high + low)
        index, num_vars = variable_places(len(schedule.dt), len(interval), supports.shape[1])
        diagonal, target = cost_terms(problem, options.weights, index, interval, num_vars)
        target[index["z"][:, :2]] = middle / (2 * np.maximum(half, SMALLEST))
        return cls(
            problem=problem,
            options=options,
            dt=schedule.dt,
            interval=interval,
            effector=effector,
            p_WC=integrator.p_WC,
            R_WC=integrator.R_WC,
            half=half,
            middle=middle,
            force_limit=force_limits(schedule, options)[interval, effector],
            corners=CornerForces(options.cone, reserve.friction * friction[held], supports, ARM),
            integrator=integrator,
            origin=np.array(problem.initial_com),
            v0=v0,
            k0=k0,
            momentum_limits=(
                np.asarray(options.angular_momentum_limit, float) / unit,
                np.asarray(options.angular_momentum_rate_limit, float) / unit,
            ),
            reach=_reach(problem, options, interval, effector),
            index=index,
            num_vars=num_vars,
            cost_diagonal=diagonal,
            cost_target=target,
        )


def variable_places(num_intervals: int, num_contacts: int, num_corners: int) -> tuple[dict[str, np.ndarray], int]:
    """Places of each variable of the program, by its name, and how many there are.

    Args:
        num_intervals: N - 1.
        num_contacts: J, active contacts over all intervals.
        num_corners: V, of each support.
    """
    N, J = num_intervals, num_contacts
    state = [(name, N, 3) for name in ("com", "v", "k", "a", "kdot")]
    slack = [("s", N, 1), ("s_end", 1, 1)]
    contact = [("wrench", J, 6), ("z", J, 3), ("force", J, 3 * num_corners)]
    index, count = {}, 0
    for name, rows, columns in state + slack + contact:
        index[name] = count + np.arange(rows * columns).reshape(rows, columns)
        count += rows * columns
    return index, count


def _reach(
    problem: CentroidalProblem, options: CentroidalOptions, interval: np.ndarray, effector: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(K,) knot less one, (K, 3) contact point and (K,) greatest distance [m]: contacts next to knots 1..N-1."""
    schedule = problem.schedule
    held = np.zeros((len(schedule.dt), len(schedule.contacts)), bool)
    held[interval, schedule.active[interval, effector]] = True
    held[:-1] |= held[1:]  # at the knot where a contact is made it must be within reach already
    knot, contact = np.nonzero(held)
    p_WC, _, _ = schedule.poses()
    reach = [options.com_reach[EFFECTORS.index(c.effector)] for c in schedule.contacts]
    return knot, p_WC[contact], np.array(reach, float)[contact]
