"""Loads all compiled kernels that a query needs, before its clock starts."""

from __future__ import annotations

import numpy as np

from drakeplan.contact_planning.contact_plan import DynamicsName, PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.motion.maker import MotionMaker
from drakeplan.query.first_compilation import COARSE
from drakeplan.search.ana_star import Limits
from learning.surrogate import load_surrogate
from learning.weights import WeightsError
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.footholds.partial_support import rest_down
from scenes.footholds.projection import patch_shape
from scenes.footholds.snap import Footholds, Snap
from scenes.robots.robot import Robot
from scenes.scene import Goal, Scene, Start
from scenes.stance import Stance
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain


def warm_up(robot: Robot, ik: WholeBodyIK) -> None:
    """Plans a few steps along a wall and moves one of them; the first time on a machine it compiles for a while.

    It plans with quasi-static balance, and with learned dynamics where weights exist: kernels compiled within a query
    would use up its deadline.

    Args:
        robot: whose kernels and networks are loaded.
        ik: its inverse kinematics.
    """
    floor = Surface("floor", np.array([[-1.0, -1, 0], [2, -1, 0], [2, 1, 0], [-1, 1, 0]]))
    height = robot.shoulder[2]
    corners = [[-1.0, 0.65, height - 0.5], [2, 0.65, height - 0.5], [2, 0.65, height + 0.5], [-1, 0.65, height + 0.5]]
    wall = Surface("wall", np.array(corners))
    X_WO = np.eye(4)
    X_WO[:3, 3] = [1.9, -0.9, 0.5]
    post = Box("post", np.array([0.1, 0.1, 1.0]), X_WO)
    terrain = Terrain((floor, wall if wall.normal[1] < 0 else wall.flipped()), (post,))
    scene = Scene("warm_up", terrain, Start((0.0, 0.0, 0.0)), Goal((0.5, 0.0, 0.0), 0.1))
    context = QueryContext(scene, robot, ik)
    rest_down(context.packed, robot.effectors[0], (-1.0, 0.0, 0.0), (-1.0, 1.0))  # half on the floor
    stances: tuple[Stance, ...] = ()
    for dynamics in _judges(robot):
        planner = SearchPlanner(context, PlannerOptions(dynamics=dynamics))
        if not planner.start_problem():
            for plan in planner.plans(Limits(expansions=30, improve=0.05)):
                stances = plan.stances[:2]
    _move_a_step(context, PlannerOptions())
    if len(stances) > 1:
        MotionMaker(context, COARSE).run(stances, lambda event: None)


def _move_a_step(context: QueryContext, options: PlannerOptions) -> None:
    """Moves a step that hangs over the floor's edge: where most steps fit, as they do here, the search moves none."""
    robot, edge = context.robot, float(context.packed.low[0, 0])
    wanted, stand = np.array([[edge, 0.0, 0.0]]), np.array([edge + 0.1, -0.2, 0.0])
    limits = options.step_limits(robot, options.model)
    Footholds(context.packed, 0.0, Snap()).place_feet(
        0, wanted, (-0.1, 0.1), patch_shape(robot.effectors[0]), stand, limits
    )


def _judges(robot: Robot) -> tuple[DynamicsName, ...]:
    try:
        load_surrogate(robot)
    except WeightsError:  # reported where they are requested
        return ("quasi-static",)
    return ("quasi-static", "learned")
