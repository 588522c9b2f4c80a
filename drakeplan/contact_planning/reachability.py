"""A proof that a goal cannot be reached: no chain of steps leads there, whatever the robot does with its body.

A step sets a foot down within the transition model's reach of the foot that stands, and no higher or lower than the
robot's greatest step. So feet stay on the surfaces that such steps connect, each taken as a whole, whether a sole fits or not.
"""

from __future__ import annotations

import numpy as np
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from scenes.robots.robot import Robot
from scenes.scene import GOAL_HEIGHT, Goal
from scenes.stance import Stance
from scenes.terrain.terrain import Terrain
from scenes.transition_model import TransitionModel

MOST_SURFACES = 20_000  # more take seconds: then nothing is proved
SLACK = 1e-3  # [m] rounding


def unreachable(terrain: Terrain, robot: Robot, model: TransitionModel, start: Stance, goal: Goal) -> str:
    """Why no chain of steps leads from the start to the goal, "" where that is not proved.

    Args:
        terrain: its surfaces.
        robot: gives the greatest height of a step.
        model: gives the reach of a step.
        start: the first stance.
        goal: region and floor.
    """
    feet = [k for k, s in enumerate(terrain.surfaces) if s.allows("left_foot") or s.allows("right_foot")]
    if len(feet) > MOST_SURFACES:
        return ""
    reach, rise = float(np.hypot(*model.steps[:, :2].T).max()), robot.max_step_height
    plans = np.array([shapely.convex_hull(shapely.multipoints(terrain.surfaces[k].vertices[:, :2])) for k in feet])
    heights = np.array([[np.min(z), np.max(z)] for z in (terrain.surfaces[k].vertices[:, 2] for k in feet)])
    reached = _connected(plans, heights, reach, rise, [feet.index(c.surface) for c in start.contacts[:2] if c])
    at_goal = _at_goal(plans, heights, goal, reach, rise)
    if (reached & at_goal).any():
        return ""
    name = terrain.surfaces
    beyond = np.flatnonzero(_connected(plans, heights, reach, rise, np.flatnonzero(at_goal)))
    if not len(beyond):
        return f"goal unreachable: no surface for feet within reach of it at z {goal.xyz[2]:.2f}"
    a, b, gap, climb = _nearest(plans, heights, np.flatnonzero(reached), beyond)
    return (
        f"goal unreachable: from {name[feet[a]].name!r} to {name[feet[b]].name!r} it is {gap:.2f} m across and "
        f"{climb:.2f} m up or down; a step of this transition model reaches {reach:.2f} m across and {rise:.2f} m up or down"
    )


def _connected(
    plans: np.ndarray, heights: np.ndarray, reach: float, rise: float, start: list[int] | np.ndarray
) -> np.ndarray:
    """(n,) bool, which surfaces chains of steps from some of them may lead to."""
    one, other = shapely.STRtree(plans).query(plans, predicate="dwithin", distance=reach + SLACK)
    keep = _climb(heights, one, other) <= rise + SLACK
    links = coo_matrix((np.ones(int(keep.sum())), (one[keep], other[keep])), shape=(len(plans), len(plans)))
    _, label = connected_components(links, directed=False)
    return np.isin(label, label[np.asarray(start, int)])


def _climb(heights: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(n,) least height between surfaces, from their lowest and highest points [m]."""
    up, down = heights[other, 0] - heights[one, 1], heights[one, 0] - heights[other, 1]
    return np.maximum(np.maximum(up, down), 0.0)


def _at_goal(plans: np.ndarray, heights: np.ndarray, goal: Goal, reach: float, rise: float) -> np.ndarray:
    """(n,) bool, surfaces that a foot may be on when the mean of the feet is at the goal: half a step away."""
    near = shapely.distance(plans, shapely.Point(goal.xyz[:2])) <= goal.radius + 0.5 * reach + SLACK
    if not np.isfinite(goal.xyz[2]):
        return near
    off = np.maximum(heights[:, 0] - goal.xyz[2], goal.xyz[2] - heights[:, 1])
    return near & (off <= GOAL_HEIGHT + 0.5 * rise + SLACK)


def _nearest(
    plans: np.ndarray, heights: np.ndarray, near: np.ndarray, far: np.ndarray
) -> tuple[int, int, float, float]:
    """The two surfaces, one of each group, that are the least apart, how far in the plan view and in height [m]."""
    best = (int(near[0]), int(far[0]), np.inf, np.inf)
    least = np.inf
    for a in near:
        gap, climb = shapely.distance(plans[a], plans[far]), _climb(heights, np.full(len(far), a), far)
        k = int(np.argmin(np.hypot(gap, climb)))
        if np.hypot(gap[k], climb[k]) < least:
            least, best = np.hypot(gap[k], climb[k]), (int(a), int(far[k]), float(gap[k]), float(climb[k]))
    return best
