"""The momentum trajectory of a whole contact sequence, led through the CoM positions of its key postures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from drakeplan.phases import Schedule
from optimization.centroidal import CentroidalEstimate, CentroidalProgram
from optimization.centroidal_options import CentroidalOptions, CentroidalWeights
from optimization.centroidal_problem import CentroidalProblem
from optimization.contact_schedule import ContactSchedule
from scenes.robot import Robot

# Lin 2020 sec. 6.7, with a pull towards the key postures that the documents do not have: without it the CoM takes
# the least effort over the feet, wherever the legs reach.
WEIGHTS = CentroidalWeights(com_tracking=2e4)
BOX = (0.10, 0.10, 0.035)  # [m] half widths around the key postures' course: what the legs give in general


def centroidal_options(robot: Robot, cone: str, dt: float) -> CentroidalOptions:
    """The limits of a robot as options of the centroidal program."""
    return CentroidalOptions(
        cone=cone,
        dt=dt,
        weights=WEIGHTS,
        com_height=robot.com_height,
        com_reach=tuple(robot.com_reach.tolist()),
        force_limit=tuple(robot.force_limit.tolist()),
        final_half_width=None,  # the last key posture says where the CoM ends
    )


def through(key_t: np.ndarray, key_x: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(N, m) continuously differentiable course through key_x (n, m) at key_t (n,), at rest at both ends.

    It does not overshoot: slopes are the harmonic mean of the secants where both go the same way, else zero (Fritsch &
    Butland 1984).
    """
    slope = np.zeros_like(key_x)
    secant = np.diff(key_x, axis=0) / np.diff(key_t)[:, None]
    before, after = secant[:-1], secant[1:]
    same = before * after > 0.0
    slope[1:-1][same] = (2.0 * before * after)[same] / (before + after)[same]
    return CubicHermiteSpline(key_t, key_x, slope)(t)


def solve_dynamics(
    robot: Robot,
    schedule: Schedule,
    options: CentroidalOptions,
    reference: np.ndarray,
    *,
    box: np.ndarray | tuple[float, float, float] = BOX,
) -> CentroidalEstimate:
    """Forces and momenta over the whole sequence, from rest to rest.

    Args:
        robot: mass and patches.
        schedule: contacts in time.
        options: as `centroidal_options` makes them; `dt` must divide every phase.
        reference: (N, 3) CoM at the knots to stay near [m]; its first row is where the robot starts.
        box: (N, 3) or (3,) half widths of the bounds around it [m].
    """
    t = schedule.times(options.dt)
    held = schedule.contact_at(t[:-1])
    problem = CentroidalProblem(
        schedule=ContactSchedule(schedule.contacts, held, np.diff(t)),
        mass=robot.mass,
        half_extent=robot.half_extents,
        initial_com=reference[0],
        com_reference=reference,
        com_box=np.broadcast_to(box, reference.shape),
    )
    return CentroidalProgram(problem, options).solve()


def relaxed(options: CentroidalOptions, factor: float) -> CentroidalOptions:
    """The same options with a CoM that is pulled `factor` times as hard to its reference."""
    weights = replace(options.weights, com_tracking=options.weights.com_tracking * factor)
    return replace(options, weights=weights)
