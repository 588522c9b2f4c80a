"""Dynamics of a whole contact sequence: the test of a search result whose steps were judged one by one.

Lin et al. 2019 sec. VI and VIII: the search judges every transition on its own; only what it returns goes through the program
over all contacts, from rest to rest.
"""

from __future__ import annotations

from collections.abc import Sequence

from drakeplan.timing.step_timing import Timing
from optimization.balance.friction import FrictionCone
from optimization.balance.reserve import ALL, Reserve
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.estimate import CentroidalEstimate
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from scenes.footholds.start_stance import standing_com
from scenes.robots.robot import Robot
from scenes.stance import Stance

REST = 1.0  # [s] on the last stance


def sequence_problem(robot: Robot, stances: Sequence[Stance], timing: Timing | None = None) -> CentroidalProblem:
    """The centroidal problem of a contact sequence, from rest to rest, with `REST` on the last stance.

    Args:
        robot: its mass, contact patches and standing height.
        stances: the sequence; consecutive ones differ in one end effector.
        timing: of every transition; None: the default one.
    """
    timing = timing or Timing()
    schedule = ContactSchedule.from_stances(
        stances, dt=timing.step or 0.2, shift_time=timing.shift, swing_time=timing.swing, settle_time=REST
    )
    return CentroidalProblem(
        schedule=schedule,
        mass=robot.mass,
        half_extent=robot.half_extents,
        initial_com=standing_com(robot, stances[0]),
    )


def sequence_dynamics(
    robot: Robot,
    stances: Sequence[Stance],
    cone: FrictionCone,
    timing: Timing | None = None,
    reserve: Reserve = ALL,
) -> CentroidalEstimate:
    """The least-effort dynamics of a contact sequence, from rest to rest (Lin 2020 sec. 6.3).

    Args:
        robot: mass, patches and limits.
        stances: consecutive ones differ in one end effector.
        cone: friction cone.
        timing: of every transition, by default that of Lin 2020 sec. 6.7.
        reserve: what is left unused of friction and supports.
    """
    timing = timing or Timing()
    options = timing.options(robot, cone, rest_at_end=True, reserve=reserve)
    return CentroidalProgram(sequence_problem(robot, stances, timing), options).solve()
