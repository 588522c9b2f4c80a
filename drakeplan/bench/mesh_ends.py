"""One start and one goal for any mesh, by one rule: two ends of the ground on which a robot can stand."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from scenes.footholds.floors import floors_at
from scenes.footholds.start_stance import feet_down
from scenes.robots.robot import Robot
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.terrain import Terrain

MOST_PLACES = 600  # looked at, on a square pattern
FINEST = 0.1  # [m] the pattern's spacing at least
ACROSS = 0.9  # [m] places that are no further apart may be joined by steps of some robot
RISE = 0.5  # [m] and no higher or lower than this
FARTHEST = 5.0  # [m] from start to goal
NEAREST = 0.5  # [m] a goal nearer than this is none

Ends = tuple[tuple[float, float, float, float], tuple[float, float, float]]


def ends_of(terrain: Terrain, robot: Robot) -> Ends | None:
    """Start (x, y, yaw, z) and goal (x, y, z); None where the robot cannot stand, or nowhere to go from there [m, rad].

    Places where both soles fit under head room are joined where they lie within `ACROSS` and `RISE`: gaps and steps do not
    part them, walls and storeys do. Of the largest group the start is the place farthest back along the group's longer
    axis, and the goal the one farthest along it up to `FARTHEST` away; both as near to the middle of the other axis as
    the ground there allows. So the way leads through what the mesh has, whether the robot can take it or not.

    Args:
        terrain: of the mesh.
        robot: who stands there.
    """
    found = _places(terrain, robot)
    if len(found) < 2:
        return None
    one, other = KDTree(found[:, :2]).query_pairs(ACROSS, output_type="ndarray").T
    near = np.abs(found[one, 2] - found[other, 2]) <= RISE
    links = coo_matrix((np.ones(int(near.sum())), (one[near], other[near])), shape=(len(found),) * 2)
    _, label = connected_components(links, directed=False)
    group = found[label == np.argmax(np.bincount(label))]
    axis = int(np.argmax(np.ptp(group[:, :2], axis=0)))
    back = group[:, axis] <= group[:, axis].min() + FINEST
    start = _middle(group[back], group, axis)
    away = np.hypot(*(group[:, :2] - start[:2]).T)
    ahead = group[(away <= FARTHEST) & (away >= NEAREST)]
    if not len(ahead):
        return None
    front = ahead[:, axis] >= ahead[:, axis].max() - FINEST
    goal = _middle(ahead[front], group, axis)
    yaw = 0.0 if axis == 0 else 0.5 * np.pi
    x, y, z = start.tolist()
    return (x, y, yaw, z), (float(goal[0]), float(goal[1]), float(goal[2]))


def _middle(places: np.ndarray, group: np.ndarray, axis: int) -> np.ndarray:
    """The place nearest to the middle of the group across the axis."""
    across = 1 - axis
    return places[np.argmin(np.abs(places[:, across] - np.median(group[:, across])))]


def _places(terrain: Terrain, robot: Robot) -> np.ndarray:
    """(n, 3) places of a square pattern where both soles fit, facing along x and along y, under head room [m]."""
    packed = pack_terrain(terrain)
    ground = [s.vertices for s in terrain.surfaces if s.allows("left_foot")]
    if not ground:
        return np.zeros((0, 3))
    low, high = np.min([v.min(axis=0) for v in ground], axis=0)[:2], np.max([v.max(axis=0) for v in ground], axis=0)[:2]
    spacing = max(FINEST, float(np.sqrt(np.prod(np.maximum(high - low, FINEST)) / MOST_PLACES)))
    found = []
    for x in np.arange(low[0] + 0.5 * spacing, high[0], spacing):
        for y in np.arange(low[1] + 0.5 * spacing, high[1], spacing):
            for floor in floors_at(packed, robot, x, y, 0.0):
                window = floor.window(floor.z)
                if floor.head_room and all(feet_down(packed, robot, (x, y, yaw), window) for yaw in (0.0, 0.5 * np.pi)):
                    found.append((x, y, floor.z))
    return np.array(found).reshape(-1, 3)
