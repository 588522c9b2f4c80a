"""A proof that the torso has no room on the way: every chain of stances needs one whose torso box is in the terrain.

The search takes only stances whose torso box, lowered as far as the robot can, is free over the mean of the feet. One
transition moves a foot by its greatest stride, hence that mean by half of it. The mean is inside the convex hull of the
surfaces that steps reach. Wherever it is within a small cell, and however the box is turned, the box contains an upright
cylinder over the cell's middle: where that is in the terrain the whole cell is closed. What is proved is that cells
that are not closed do not lead from the start to the goal, even if each is joined to all within half a stride.
"""

from __future__ import annotations

import numpy as np
import shapely
from scipy.ndimage import distance_transform_edt
from scipy.ndimage import label as label_regions

from drakeplan.contact_planning.reachability import MOST_CELLS, MOST_SURFACES, reached_surfaces
from scenes.footholds.partial_support import INNER_RADIUS
from scenes.robots.robot import Robot
from scenes.scene import Goal
from scenes.stance import Stance
from scenes.terrain.free_boxes import boxes_are_free
from scenes.terrain.packed_terrain import PackedTerrain
from scenes.terrain.terrain import Terrain

FINEST, COARSEST = 0.01, 0.05  # [m] edge of a cell
LEAST_HEIGHT = 0.05  # [m] of a cylinder that is looked at
ON_LINE = 400  # points on the straight line from start to goal
THIN = 1e-3  # [m]


def torso_closed(
    terrain: Terrain,
    packed: PackedTerrain,
    robot: Robot,
    stride: float,
    reach: float,
    start: Stance,
    goal: Goal,
    full_soles: bool = True,
) -> np.ndarray | None:
    """(n, 3) middles of the closed columns on the straight line from start to goal; None where nothing is proved.

    Args:
        terrain: its surfaces and obstacles.
        packed: the same, packed.
        robot: gives the torso box.
        stride: how far a foot moves in one transition at most [m].
        reach: how far apart a step sets the feet at most, in the plan view [m].
        start: the first stance.
        goal: region and floor.
        full_soles: whether the middle of every sole is over its surface; else a part of the sole is.
    """
    if len(terrain.surfaces) > MOST_SURFACES:
        return None
    beside = 0.0 if full_soles else float(np.hypot(*robot.effectors[0].half_extent)) - 2.0 * INNER_RADIUS
    plans, heights = reached_surfaces(terrain, robot, reach + 2 * beside, start)
    ground = np.column_stack([shapely.bounds(plans) + reach * np.array([-1, -1, 1, 1]), heights])
    here, there = start.feet_mean()[:2], np.array(goal.xyz[:2])
    line = here + np.linspace(0.0, 1.0, ON_LINE)[:, None] * (there - here)
    closed, middle = _closed(packed, robot, line, _levels(ground, line), 0.0)
    runs = np.diff(np.flatnonzero(np.concatenate([[True], ~closed, [True]])))  # a stride passes over short ones
    if (runs.max() + 1) * np.linalg.norm(there - here) / (ON_LINE - 1) <= 0.5 * stride:
        return None  # the straight line is a way, as far as this proof sees
    hull = shapely.convex_hull(shapely.union_all(shapely.buffer(plans, beside)))
    x0, y0, x1, y1 = shapely.bounds(hull)
    cell = max(FINEST, float(np.sqrt((x1 - x0) * (y1 - y0) / MOST_CELLS)))
    if cell > COARSEST:
        return None
    nx, ny = int(np.ceil((x1 - x0) / cell)) + 1, int(np.ceil((y1 - y0) / cell)) + 1
    x, y = x0 + cell * np.arange(nx), y0 + cell * np.arange(ny)
    levels = np.tile([np.inf, -np.inf], (nx, ny, 1))
    for u0, v0, u1, v1, least, most in ground:
        near = np.ix_((x >= u0) & (x <= u1), (y >= v0) & (y <= v1))
        levels[..., 0][near] = np.minimum(levels[..., 0][near], least)
        levels[..., 1][near] = np.maximum(levels[..., 1][near], most)
    cells = np.argwhere(np.isfinite(levels[..., 0]))
    over = np.column_stack([x[cells[:, 0]], y[cells[:, 1]]])
    shapely.prepare(hull)
    own = shapely.dwithin(hull, shapely.points(over), cell / np.sqrt(2.0))
    cells, over = cells[own], over[own]
    free = np.zeros((nx, ny), bool)
    free[tuple(cells.T)] = ~_closed(packed, robot, over, levels[tuple(cells.T)], cell / np.sqrt(2.0))[0]
    home = np.hypot(x[:, None] - here[0], y[None, :] - here[1]) <= cell
    at_goal = np.hypot(x[:, None] - there[0], y[None, :] - there[1]) <= goal.radius + cell
    free |= home
    joined = 0.25 * stride + np.sqrt(2.0) * cell  # half of half a stride, and what cells hide
    regions = np.zeros(free.shape, np.int32)
    label_regions(np.asarray(distance_transform_edt(~free)) * cell <= joined, structure=np.ones((3, 3)), output=regions)
    if np.intersect1d(regions[home & free], regions[at_goal & free]).size:
        return None
    return np.column_stack([line, middle])[closed]


def _levels(ground: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 2) least and greatest height of the ground that feet may be on whose mean is over a point [m]."""
    x, y = points.T[:, :, None]
    near = (x >= ground[:, 0]) & (x <= ground[:, 2]) & (y >= ground[:, 1]) & (y <= ground[:, 3])
    least = np.where(near, ground[:, 4], np.inf).min(axis=1)
    return np.column_stack([least, np.where(near, ground[:, 5], -np.inf).max(axis=1)])


def _closed(
    packed: PackedTerrain, robot: Robot, points: np.ndarray, levels: np.ndarray, around: float
) -> tuple[np.ndarray, np.ndarray]:
    """(n,) whether the torso box is in the terrain, at any yaw, wherever the mean of the feet is within `around` of a point.

    And (n,) the heights of the middles of the cylinders that were looked at [m].
    """
    centre, size = robot.lowest_torso_box
    radius = float((0.5 * size[:2] - np.abs(centre[:2])).min()) - around
    bottom, top = float(centre[2] - 0.5 * size[2]), float(centre[2] + 0.5 * size[2])
    closed, middle = np.zeros(len(points), bool), np.zeros(len(points))
    if radius <= 0.0:
        return closed, middle
    inside = [(2 * radius, THIN), (THIN, 2 * radius), (np.sqrt(2.0) * radius, np.sqrt(2.0) * radius)]  # the cylinder
    spread = np.full(len(points), np.inf)
    known = np.isfinite(levels[:, 0])
    spread[known] = np.ceil((levels[known, 1] - levels[known, 0]) / 0.01 - 1e-9) * 0.01
    for more in np.unique(spread).tolist():  # the mean of the feet may be anywhere between these heights
        height = top - bottom - more
        if height < LEAST_HEIGHT:
            continue
        own = np.flatnonzero(spread == more)
        p = np.column_stack([points[own], levels[own, 1]])
        where = np.array([0.0, 0.0, bottom + 0.5 * height])
        middle[own] = p[:, 2] + where[2]
        clear = np.ones(len(own), bool)
        for length, width in inside:
            clear = boxes_are_free(packed, p, np.zeros(len(own)), where, np.array([length, width, height]), clear)
        closed[own] = ~clear
    return closed, middle
