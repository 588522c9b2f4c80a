"""Durations of a plan's phases chosen for least effort, in the same time altogether (see `optimization.centroidal.timing`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drakeplan.plan.plan import Plan
from drakeplan.timing.phases import Schedule, make_schedule
from optimization.balance.friction import FrictionCone
from optimization.balance.reserve import ALL, Reserve
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from optimization.centroidal.timing import TimingOptions, optimise_timing
from optimization.centroidal.timing_step import whole_cost
from optimization.centroidal.trajectory import CentroidalTrajectory
from optimization.centroidal.transition_dynamics import transition_options
from scenes.footholds.start_stance import standing_com
from scenes.robots.robot import Robot

WORTH = 0.02  # relative decrease that is worth another step: durations are rounded to knots afterwards


def free_durations(
    robot: Robot,
    schedule: Schedule,
    cone: FrictionCone,
    dt: float,
    bounds: tuple[float, float],
    reserve: Reserve = ALL,
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Durations with which the momenta of a contact sequence take the least effort.

    Args:
        robot: mass, patches and limits.
        schedule: contacts with the durations to start from, multiples of `dt`.
        cone: friction cone.
        dt: knots' distance, whose multiples the durations are rounded to [s].
        bounds: least and greatest durations, as factors of the given ones; swings get no shorter.
        reserve: what is left unused of friction and supports.

    Returns:
        (S-1,) shift and (S-1,) swing times and the last phase's [s], together no longer than they were; None where no
        others are better.
    """
    t = schedule.times(dt)
    problem = _problem(robot, schedule, t)
    phase = schedule.phase_at(t[:-1])
    swings = np.array([schedule.phases[p].mover >= 0 for p in phase])
    group = problem.schedule.phases
    # limbs that swing faster turn the body more, of which the centroidal program knows nothing
    shortest = tuple(1.0 if swings[group == g].any() else bounds[0] for g in range(group.max() + 1))
    timing = TimingOptions(shortest=shortest, longest=bounds[1], tolerance=WORTH)
    timed = optimise_timing(problem, _options(robot, cone, reserve), timing)
    if not timed.estimate.feasible or not timed.objective < timed.fixed_objective:
        return None
    given, wanted = (np.bincount(phase, p.schedule.dt) for p in (problem, timed.problem))
    durations = round_to_grid(wanted, dt, float(given.sum()))
    return durations[0:-1:2], durations[1::2], float(durations[-1])


def round_to_grid(durations: np.ndarray, step: float, total: float) -> np.ndarray:
    """Durations rounded to multiples of a step, at least one step each, whose sum is at most a given total.

    Durations are rounded down; what is left of the total goes to those with the largest remainders.

    Args:
        durations: (n,) durations [s].
        step: the grid [s].
        total: greatest sum [s], a multiple of `step`.
    """
    steps = np.maximum(np.floor(durations / step + 1e-6), 1.0)
    left = round(total / step) - int(steps.sum())
    remainder = durations / step - steps
    for place in np.argsort(-remainder, kind="stable")[: max(left, 0)]:
        if remainder[place] > 1e-6:
            steps[place] += 1
    return np.round(steps * step, 9)


def effort(robot: Robot, schedule: Schedule, cone: FrictionCone, trajectory: CentroidalTrajectory) -> float:
    """Objective of a trajectory over these contacts (Lin 2020 sec. 6.3), without the term that tracks a reference.

    Args:
        robot: its mass and contact patches.
        schedule: the phases.
        cone: friction cone of every contact.
        trajectory: momenta and forces to evaluate.
    """
    program = CentroidalProgram(_problem(robot, schedule, trajectory.t), _options(robot, cone))
    return whole_cost(program.data, trajectory)


def planned_schedule(plan: Plan) -> Schedule:
    """The contacts of a plan over its phases.

    Raises:
        ValueError: a plan of contacts alone has none.
    """
    if plan.phases is None:
        raise ValueError(f"the plan of {plan.scene_name!r} has no phases")
    stances = plan.contact_sequence()
    durations = plan.phases.end - plan.phases.start
    return make_schedule(stances, shift=durations[0:-1:2], swing=durations[1::2], rest=float(durations[-1]))


def _problem(robot: Robot, schedule: Schedule, t: np.ndarray) -> CentroidalProblem:
    start = standing_com(robot, schedule.stances[0])
    contacts = ContactSchedule(schedule.contacts, schedule.contact_at(t[:-1]), np.diff(t))
    return CentroidalProblem(contacts, robot.mass, robot.half_extents, start)


def _options(robot: Robot, cone: FrictionCone, reserve: Reserve = ALL) -> CentroidalOptions:
    return replace(transition_options(robot, cone, reserve), rest_at_end=True)
