"""A proof that nobody can stand at a goal: no two soles fit around it, wherever and however they are turned.

A sole that fits somewhere contains a smaller one at the nearest place and heading of a fine pattern. Where not even the
smaller sole fits in the pattern, no sole does in between.
"""

from __future__ import annotations

import numpy as np

from scenes.footholds.projection import FOOT_CLEARANCE, PatchShape, no_placements, project_feet
from scenes.footholds.start_stance import feet_down
from scenes.footholds.what_stands import what_stands
from scenes.robots.robot import Robot
from scenes.scene import GOAL_HEIGHT, Goal
from scenes.terrain.packed_terrain import PackedTerrain
from scenes.terrain.terrain import Terrain

SPACING = 0.02  # [m] of the pattern
HEADINGS = 16  # of the pattern, over half a turn: a sole is the same backwards
WIDEST = 1.0  # [m] larger goals are not looked at


def nobody_fits(
    terrain: Terrain, packed: PackedTerrain, robot: Robot, goal: Goal, apart: float, full_soles: bool = True
) -> str:
    """Why no two soles fit with their mean at the goal, "" where that is not proved.

    Args:
        terrain: has the names.
        packed: the same, packed.
        robot: whose soles.
        goal: region and floor.
        apart: greatest distance of the feet in the plan view [m].
        full_soles: whether all of each sole has to rest on something; else ground under some point of it is enough.
    """
    x, y, z = goal.xyz
    window = (z - GOAL_HEIGHT - robot.max_step_height, z + GOAL_HEIGHT + robot.max_step_height)
    if goal.radius > WIDEST or not np.isfinite(z):
        return ""
    if any(
        feet_down(packed, robot, (x, y, yaw), window, full_soles)
        for yaw in (goal.yaw or 0.0) + np.pi / 4 * np.arange(4)
    ):
        return ""
    shift = SPACING / np.sqrt(2.0)
    if not full_soles:  # the ground may be anywhere under the sole
        shift += float(np.hypot(*robot.effectors[0].half_extent))
    left, right = (_places(packed, robot, e, (x, y), goal.radius + 0.5 * apart + shift, window, shift) for e in (0, 1))
    for p in left:
        near = right[np.hypot(*(right - p).T) <= apart + 2 * shift]
        if len(near) and (np.hypot(*(0.5 * (near + p) - (x, y)).T) <= goal.radius + shift).any():
            return ""
    angle = 2 * np.pi / 12 * np.arange(12)
    points = [
        (x, y),
        *((x + r * np.cos(a), y + r * np.sin(a)) for r in (0.5 * goal.radius, goal.radius) for a in angle),
    ]
    standing = what_stands(terrain, packed, points, z)
    return f"no foothold within the radius: {f'{standing} stands there' if standing else 'no two soles fit there'}"


def _places(
    packed: PackedTerrain,
    robot: Robot,
    effector: int,
    centre: tuple[float, float],
    radius: float,
    window: tuple[float, float],
    shift: float,
) -> np.ndarray:
    """(n, 2) places of the pattern about a centre where a foot's smaller sole fits at some heading [m]."""
    half_length, half_width = robot.effectors[effector].half_extent
    turned = 0.5 * np.pi / HEADINGS * np.hypot(half_length, half_width)  # how far a corner moves between headings
    if min(half_length, half_width) <= shift + turned:
        smaller = PatchShape(1e-3, 1e-3, 0.0, 0.0, 0.0, FOOT_CLEARANCE)
    else:
        smaller = PatchShape(half_length - shift - turned, half_width - shift - turned, 0.0, 0.0, 0.0, FOOT_CLEARANCE)
    ticks = np.arange(-radius, radius + SPACING, SPACING)
    grid = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    grid = grid[np.hypot(*grid.T) <= radius + SPACING] + centre
    yaw = np.pi / HEADINGS * np.arange(HEADINGS)
    places = np.column_stack([np.repeat(grid, HEADINGS, axis=0), np.tile(yaw, len(grid))])
    placed = no_placements(len(places))
    project_feet(packed, effector, places, window, smaller, placed)
    return grid[(placed.surface >= 0).reshape(len(grid), HEADINGS).any(axis=1)]
