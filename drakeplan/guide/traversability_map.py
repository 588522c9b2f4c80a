"""How hard each step of the torso is on one terrain, estimated near promising ways (Lin & Berenson 2017 sec. IV.H)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drakeplan.contact_planning.sequence_check import feet_heading
from drakeplan.contact_planning.torso_grid import TURNS, TorsoGrid, TorsoGridOptions
from drakeplan.context import QueryContext
from drakeplan.guide.ground_view import MODEL, GroundView, documented_steps
from drakeplan.guide.promising_paths import nodes_near, promising_paths
from drakeplan.guide.torso_graph import CELL, TorsoGraph, torso_graph, torso_poses
from learning.footstep_counts import PoseFeatures
from learning.traversability import Traversability, load_traversability
from scenes.stance import Stance

NEAR = 0.5  # [m] of a promising way that is looked at
TURN = np.deg2rad(60.0)  # how far from the way's direction headings are looked at


@dataclass(frozen=True, eq=False)
class TraversabilityMap:
    """A graph of torso poses with the traversability cost of every step.

    Attributes:
        graph: of the torso.
        row: (N,) row of `cost` of each node; the last row, all ones, is that of nodes that were not looked at.
        cost: (4, R, V) Delta g_tr by motion mode, row and translation.
        paths: (n, 3) points of each promising way [m].
        start: node of the start.
    """

    graph: TorsoGraph
    row: np.ndarray
    cost: np.ndarray
    paths: tuple[np.ndarray, ...]
    start: int


def guide_graph(context: QueryContext, translations: np.ndarray, feet: Stance) -> tuple[TorsoGraph, int] | None:
    """The graph of the torso and the node of some feet on it; None where the grid knows no way from there to the goal.

    Args:
        context: of the query.
        translations: (V, 2) of the torso by one footstep.
        feet: stance to start from.
    """
    grid = TorsoGrid(context.packed, context.robot, context.goal, TorsoGridOptions(cell=CELL))
    mean, yaw = feet.feet_mean(), feet_heading(feet)
    distance = float(grid.distance(*(np.array([a]) for a in (*mean, yaw)))[0])
    if not np.isfinite(distance):
        return None
    graph = torso_graph(grid, context.robot.max_step_height, translations, distance)
    return graph, nearest_node(graph, mean, yaw)


def nearest_node(graph: TorsoGraph, place: np.ndarray, yaw: float) -> int:
    """The node nearest to a torso pose; a heading of the grid counts as 0.1 m.

    Args:
        graph: of the torso.
        place: (3,) mean of the feet [m].
        yaw: heading [rad].
    """
    poses = torso_poses(graph, np.arange(len(graph.z)))
    turn = poses[:, 3] - yaw
    turned = np.abs(np.arctan2(np.sin(turn), np.cos(turn))) / (2 * np.pi / TURNS)
    return int(np.argmin(np.linalg.norm(poses[:, :3] - place, axis=1) + 0.1 * turned))


def traversability_map(
    context: QueryContext, modes: tuple[int, ...], kind: str = "network"
) -> TraversabilityMap | None:
    """The map between start and goal of a query; None where the grid knows no way.

    Args:
        context: of the query.
        modes: motion modes whose costs are asked for.
        kind: of regressor, `learning.traversability.KINDS`.

    Raises:
        WeightsError: no weights for this robot, or damaged ones.
    """
    model, steps = documented_steps(context.robot)
    traversability = load_traversability(context.robot, MODEL, kind)
    found = guide_graph(context, steps.translations, context.start)
    if found is None:
        return None
    graph, start = found
    paths = promising_paths(graph, start)
    near = nodes_near(graph, paths, NEAR, TURN)
    row = np.full(len(graph.z), len(near))
    row[near] = np.arange(len(near))
    cost = np.ones((4, len(near) + 1, len(steps.translations)), np.float32)
    if len(near):
        torso = torso_poses(graph, near)
        low, high = torso[:, :2].min(axis=0), torso[:, :2].max(axis=0)
        footholds = traversability.footholds
        view = GroundView(context.packed, context.robot, steps, model.rays, low, high, footholds)
        cost[list(modes), :-1] = _costs(view, torso, traversability, modes)
    return TraversabilityMap(graph, row, cost, tuple(paths), start)


def _costs(view: GroundView, torso: np.ndarray, traversability: Traversability, modes: tuple[int, ...]) -> np.ndarray:
    """(m, n, V) costs by mode, pose and translation."""
    if traversability.exact:
        (feet, palms), pairs = view.exact(torso), np.zeros(len(torso))
    else:
        feet, pairs = view.scores(torso)
        palms = view.palm_scores(torso) if any(modes) else np.zeros((len(torso), 4))
    seen = PoseFeatures(feet, pairs, palms)
    return np.stack([traversability.costs(mode, seen) for mode in modes])
