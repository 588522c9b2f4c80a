"""The momentum trajectory of a whole contact sequence, led through the CoM positions of its key postures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drakeplan.phases import Schedule
from drakeplan.swing import smooth_step
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


def com_course(schedule: Schedule, key_com: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(N, 3) CoM that passes the key postures' (P + 1, 3) at the phase boundaries, a smooth step in every phase [m]."""
    boundaries = schedule.boundaries
    phase = schedule.phase_at(t)
    start, end = boundaries[phase], boundaries[phase + 1]
    share = np.array([smooth_step(u) for u in (t - start) / (end - start)])
    return key_com[phase] + share[:, None] * (key_com[phase + 1] - key_com[phase])


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
