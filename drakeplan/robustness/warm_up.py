"""Loads the compiled kernels of planning against pushes."""

from __future__ import annotations

from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.search.ana_star import Limits
from drakeplan.timing.step_timing import WALKING
from learning.weights import WeightsError
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.library import rubble_with_wall
from scenes.robots.robot import Robot


def warm_up(robot: Robot, ik: WholeBodyIK) -> None:
    """Loads kernels, or compiles them where this machine has not run them before.

    Args:
        robot: whose kernels are loaded.
        ik: its inverse kinematics.
    """
    context = QueryContext(rubble_with_wall.named(0), robot, ik, full_soles=True)
    options = PlannerOptions(dynamics="learned", capture="worst-case", use_palms=False, timing=WALKING)
    try:
        for _ in SearchPlanner(context, options).plans(Limits(expansions=3)):
            pass
    except WeightsError:  # a robot without weights: the planner says so
        pass
