"""Traversability of a wall for palms: the same scores, features and network as for feet on the ground (Lin 2020 sec. 5.10)."""

from __future__ import annotations

import numpy as np

from drakeplan.bracing.wall_frame import MODEL, transition_model_of_palms
from drakeplan.contact_planning.contact_domain import PlannerWeights, cost_per_metre
from drakeplan.contact_planning.domain_parts import DistanceToGo
from drakeplan.contact_planning.torso_grid import TorsoGrid, TorsoGridOptions
from drakeplan.guide.ground_view import GroundView
from drakeplan.guide.torso_graph import CELL, StepWeights, torso_graph, torso_poses
from drakeplan.guide.torso_steps import TorsoSteps, torso_steps
from drakeplan.guide.traversability_grid import FOOT_PER_TORSO, TraversabilityGrid
from drakeplan.guide.traversability_map import TraversabilityMap, nearest_node
from learning.footstep_counts import PoseFeatures
from learning.traversability import load_traversability
from scenes.robots.robot import Robot
from scenes.scene import Goal
from scenes.terrain.packed_terrain import PackedTerrain

WEIGHT = 10.0  # w_tr beside w_s = 3, Lin 2020 sec. 5.10
FEET = 0  # the only motion mode: palms are feet here


def palm_steps(robot: Robot) -> TorsoSteps:
    """The steps of both palms about their mean."""
    return torso_steps(transition_model_of_palms(), robot.max_foot_translation)


def wall_distances(packed: PackedTerrain, robot: Robot, goal: Goal, start: np.ndarray) -> DistanceToGo:
    """Distances to the goal on a wall that count how hard it is; the plain ones where there is no way.

    Args:
        packed: the wall in frame G.
        robot: on it.
        goal: in frame G.
        start: (3,) mean of the palms in G [m].

    Raises:
        WeightsError: no traversability weights of the bracer.
    """
    known, steps = load_traversability(robot, MODEL, "network-fixed"), palm_steps(robot)
    grid = TorsoGrid(packed, robot, goal, TorsoGridOptions(cell=CELL))
    distance = float(grid.distance(*(np.array([a]) for a in (*start, 0.0)))[0])
    if not np.isfinite(distance):
        return TorsoGrid(packed, robot, goal)
    graph = torso_graph(grid, robot.max_step_height, steps.translations, distance)
    level = np.flatnonzero(graph.place[:, 2] == 0)
    row = np.full(len(graph.z), len(level))
    row[level] = np.arange(len(level))
    torso = torso_poses(graph, level)
    view = GroundView(
        packed, robot, steps, np.zeros((0, 3)), torso[:, :2].min(axis=0), torso[:, :2].max(axis=0), known.footholds
    )
    feet, pairs = view.scores(torso)
    cost = np.ones((4, len(level) + 1, len(steps.translations)), np.float32)
    cost[FEET, :-1] = known.costs(FEET, PoseFeatures(feet, pairs, np.zeros((len(level), 4))))
    weights = PlannerWeights()
    charted = TraversabilityMap(graph, row, cost, (), nearest_node(graph, start, 0.0))
    return TraversabilityGrid(
        charted, (FEET,), StepWeights(FOOT_PER_TORSO, weights.step, WEIGHT),
        cost_per_metre(weights, robot.max_foot_translation),
    )  # fmt: skip
