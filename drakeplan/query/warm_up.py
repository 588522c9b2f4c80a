"""Loads all compiled kernels that a query needs, before its clock starts."""

from __future__ import annotations

from drakeplan.contact_planning.contact_plan import DynamicsName, PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.motion.maker import MotionMaker
from drakeplan.query.first_compilation import COARSE, move_a_step, small_scene
from drakeplan.search.ana_star import Limits
from learning.surrogate import load_surrogate
from learning.weights import WeightsError
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.footholds.partial_support import rest_down
from scenes.robots.robot import Robot
from scenes.stance import Stance


def warm_up(robot: Robot, ik: WholeBodyIK) -> None:
    """Plans a few steps along a wall and moves one of them; the first time on a machine it compiles for a while.

    It plans with quasi-static balance, and with learned dynamics where weights exist: kernels compiled within a query
    would use up its deadline.

    Args:
        robot: whose kernels and networks are loaded.
        ik: its inverse kinematics.
    """
    scene = small_scene(robot)
    context = QueryContext(scene, robot, ik)
    rest_down(context.packed, robot.effectors[0], (-1.0, 0.0, 0.0), (-1.0, 1.0))  # half on the floor
    stances: tuple[Stance, ...] = ()
    for dynamics in _judges(robot):
        planner = SearchPlanner(context, PlannerOptions(dynamics=dynamics))
        if not planner.start_problem():
            for plan in planner.plans(Limits(expansions=30, improve=0.05)):
                stances = plan.stances[:2]
    move_a_step(context)
    if len(stances) > 1:
        MotionMaker(context, COARSE).run(stances, lambda event: None)


def _judges(robot: Robot) -> tuple[DynamicsName, ...]:
    try:
        load_surrogate(robot)
    except WeightsError:  # reported where they are requested
        return ("quasi-static",)
    return ("quasi-static", "learned")
