"""A proof that nobody can stand at a goal: no two soles fit around it, wherever and however they are turned.

A sole that fits somewhere contains a smaller one at the nearest of some headings. Where smaller soles fit is known exactly;
whether two of them are near enough to each other and to the goal is asked of a fine pattern of squares, each a little enlarged.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
import shapely.affinity

from scenes.footholds.free_polygon import free_polygon, ground_near
from scenes.footholds.free_space import Footprint, box_sides, footprint_of
from scenes.footholds.projection import FOOT_CLEARANCE, PatchShape, contact_axes
from scenes.footholds.start_stance import feet_down
from scenes.footholds.what_stands import what_stands
from scenes.robots.robot import Robot
from scenes.scene import GOAL_HEIGHT, Goal
from scenes.terrain.packed_terrain import PackedTerrain, near
from scenes.terrain.solids import in_solid
from scenes.terrain.terrain import Terrain

SPACING = 0.02  # [m] of the pattern
HEADINGS = 32  # over half a turn
POINT = 1e-3  # [m] half edge of what stands for a point of ground
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
    radius = goal.radius + 0.5 * apart + shift
    left = right = _places(packed, robot, 0, (x, y), radius, window, full_soles)
    soles_differ = robot.effectors[0].half_extent != robot.effectors[1].half_extent
    if soles_differ or (packed.allowed[:, 0] != packed.allowed[:, 1]).any():
        right = _places(packed, robot, 1, (x, y), radius, window, full_soles)
    if left is None or right is None:
        return ""
    for p in left:
        close = right[np.hypot(*(right - p).T) <= apart + 2 * shift]
        if len(close) and (np.hypot(*(0.5 * (close + p) - (x, y)).T) <= goal.radius + shift).any():
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
    full_soles: bool,
) -> np.ndarray | None:
    """(n, 2) middles of the squares of a pattern about a centre in which a sole may be at some heading [m]; None: not known."""
    low, high = np.array([*np.subtract(centre, radius), window[0]]), np.array([*np.add(centre, radius), window[1]])
    around = near(packed, low[0] - SPACING, low[1] - SPACING, high[0] + SPACING, high[1] + SPACING)
    sides, regions = box_sides(low, high), []
    for heading, footprint in _smaller_soles(robot.effectors[effector].half_extent, full_soles):
        for k in ground_near(packed, effector, around):
            R_WC = np.empty((3, 3))
            contact_axes(packed.normal[k], heading, False, R_WC)
            region, complete = free_polygon(packed, k, R_WC, footprint, sides)
            if not complete:
                return None
            up = packed.offset[k] * R_WC[:, 2]
            for part in shapely.get_parts(region) if not region.is_empty else ():
                inside = R_WC[:, :2] @ shapely.get_coordinates(part.representative_point())[0] + up
                if not in_solid(packed, *(inside + 0.5 * FOOT_CLEARANCE * R_WC[:, 2])):
                    seen = [*R_WC[0, :2], *R_WC[1, :2], *up[:2]]
                    regions.append(shapely.affinity.affine_transform(part, seen))
    ticks = np.arange(-radius, radius + SPACING, SPACING)
    grid = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    grid = grid[np.hypot(*grid.T) <= radius + SPACING] + centre
    half = 0.5 * SPACING
    squares = shapely.box(*(grid - half).T, *(grid + half).T)
    return grid[np.unique(shapely.STRtree(squares).query(np.array(regions, object), predicate="intersects")[1])]


def _smaller_soles(half_extent: tuple[float, float], full_soles: bool) -> Iterator[tuple[float, Footprint]]:
    """Headings and soles of which each sole that lies somewhere holds one; points, where ground under some point is enough."""
    if not full_soles:
        yield 0.0, footprint_of(PatchShape(POINT, POINT, 0.0, 0.0, 0.0, FOOT_CLEARANCE))
        return
    turned = 0.5 * np.pi / HEADINGS * float(np.hypot(*half_extent))  # how far a corner moves between headings
    length, width = (max(half - turned, POINT) for half in half_extent)
    for heading in np.pi / HEADINGS * np.arange(HEADINGS):  # a sole is the same backwards
        yield float(heading), footprint_of(PatchShape(length, width, 0.0, 0.0, 0.0, FOOT_CLEARANCE))
