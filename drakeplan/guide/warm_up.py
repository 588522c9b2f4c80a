"""Loads the compiled kernels of traversability, guiding path and adaptation."""

from __future__ import annotations

import numpy as np

from drakeplan.context import QueryContext
from drakeplan.experience import adapt_planner
from drakeplan.guide.ground_view import GroundView, documented_steps
from drakeplan.guide.guiding_path import guiding_path
from drakeplan.guide.traversability_grid import traversability_grid
from drakeplan.guide.traversability_map import traversability_map
from learning.weights import WeightsError
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.library import rubble_corridor
from scenes.robots.robot import Robot


def warm_up(robot: Robot, ik: WholeBodyIK) -> None:
    """Loads kernels, or compiles them where this machine has not run them before.

    Args:
        robot: whose kernels are loaded.
        ik: its inverse kinematics.
    """
    adapt_planner.warm_up(robot, ik)
    context = QueryContext(rubble_corridor.named(0), robot, ik)
    model, steps = documented_steps(robot)
    place = context.start.feet_mean()
    torso = np.array([[*place, 0.0]])
    view = GroundView(context.packed, robot, steps, model.rays, place[:2], place[:2])
    view.exact(torso)
    try:
        for kind in ("network", "acc-svr"):
            known = traversability_map(context, (0, 1, 2, 3), kind)
        traversability_grid(context, True, 1.0, 1.0, "network").distance(*(np.zeros(1) for _ in range(4)))
        if known is not None:
            guiding_path(known, (0,))
    except WeightsError:  # a robot without weights: the planner says so
        pass
