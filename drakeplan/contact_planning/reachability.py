"""Proofs that a goal cannot be reached: no chain of steps leads there, or solids are between, whatever the body does.

A step sets a foot down within the transition model's reach of the foot that stands, and no higher or lower than the
robot's greatest step. So feet stay on the surfaces that such steps connect, each taken as a whole, whether a sole fits or not.

The pelvis stays within a leg's length of the feet. Where solids fill all heights that it can have, it cannot be; and since
it is wider than the diagonal of a cell, it passes only where neighbouring cells let their centres pass.
"""

from __future__ import annotations

import numpy as np
import shapely
from scipy.ndimage import label as label_regions
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from scenes.effector import FEET
from scenes.footholds.projection import PATCH_MARGIN
from scenes.robots.robot import Robot
from scenes.scene import GOAL_HEIGHT, Goal
from scenes.stance import Stance
from scenes.terrain.packed_terrain import PackedTerrain
from scenes.terrain.solids import solid_at, solid_columns
from scenes.terrain.terrain import Terrain

UNREACHABLE = "goal unreachable"  # begins what is proved, and nothing else
MOST_SURFACES = 20_000  # more take seconds: then nothing is proved
SLACK = 1e-3  # [m] rounding
CELL = 0.1  # [m] edge of a cell at most; where the hips are closer than this to the middle, that
LOWEST_PELVIS = 0.2  # [m] over the lowest ground
MOST_CELLS = 500_000  # more take seconds


def unreachable(
    terrain: Terrain,
    robot: Robot,
    reach: float,
    start: Stance,
    goal: Goal,
    full_soles: bool = True,
    packed: PackedTerrain | None = None,
) -> str:
    """Why no chain of steps leads from the start to the goal, "" where that is not proved.

    Args:
        terrain: its surfaces.
        robot: gives the greatest height of a step.
        reach: how far apart a step sets the feet at most, in the plan view [m].
        start: the first stance.
        goal: region and floor.
        full_soles: whether the middle of every sole is over its surface; else a part of the sole is.
        packed: the terrain, packed: surfaces that are alone and too small for a whole sole are then left out.
    """
    feet = terrain.surfaces_for(*FEET)
    if len(feet) > MOST_SURFACES:
        return ""
    on = [c.surface for c in start.contacts[:2] if c]
    small = _too_small(terrain, packed, robot, feet) if full_soles and packed is not None else []
    feet = [k for k in feet if k in on or k not in small]
    rise = robot.max_step_height
    if not full_soles:
        reach += 2 * float(np.hypot(*robot.effectors[0].half_extent))
    plans, heights = _plans(terrain, feet)
    reached = _connected(plans, heights, reach, rise, [feet.index(k) for k in on])
    at_goal = _at_goal(plans, heights, goal, reach, rise)
    if (reached & at_goal).any():
        return ""
    name = terrain.surfaces
    beyond = np.flatnonzero(_connected(plans, heights, reach, rise, np.flatnonzero(at_goal)))
    if not len(beyond):
        return f"{UNREACHABLE}: no surface for feet within reach of it at z {goal.xyz[2]:.2f}"
    a, b, gap, climb = _nearest(plans, heights, np.flatnonzero(reached), beyond)
    return (
        f"{UNREACHABLE}: from {name[feet[a]].name!r} to {name[feet[b]].name!r} it is {gap:.2f} m across and "
        f"{climb:.2f} m up or down; a step of this transition model reaches {reach:.2f} m across and {rise:.2f} m up or down"
        f"{_which_are_small(terrain, robot, small)}"
    )


def _too_small(terrain: Terrain, packed: PackedTerrain, robot: Robot, feet: list[int]) -> list[int]:
    """Those of some surfaces that are no piece of a floor and take no whole sole, however it is turned."""
    half = np.sort([e.half_extent for e in robot.effectors[:2]], axis=1).min(axis=0) + PATCH_MARGIN
    small = []
    for k in feet:
        if packed.floor[k] >= 0:
            continue
        vertices = terrain.surfaces[k].vertices
        edge = np.roll(vertices, -1, axis=0) - vertices
        inward = np.cross(terrain.surfaces[k].normal, edge)
        inward /= np.linalg.norm(inward, axis=1, keepdims=True)
        across = (inward @ vertices.T - (inward * vertices).sum(axis=1)[:, None]).max(axis=1)
        area = 0.5 * np.linalg.norm(np.cross(vertices - vertices[0], edge).sum(axis=0))
        longest = np.linalg.norm(vertices[:, None] - vertices, axis=2).max()
        if across.min() < 2 * half[0] or area < 4 * half.prod() or longest < 2 * np.hypot(*half):
            small.append(k)
    return small


def _which_are_small(terrain: Terrain, robot: Robot, small: list[int]) -> str:
    """Half a sentence on surfaces that were left out, "" where there are none."""
    if not small:
        return ""
    length, width = 200 * np.array(robot.effectors[0].half_extent)
    first = terrain.surfaces[small[0]].name
    others = f" and {len(small) - 1} more take" if len(small) > 1 else " takes"
    return f"; {first!r}{others} no whole sole of {length:.0f} x {width:.0f} cm, part of one would do (no --full-soles)"


def walled_off(
    terrain: Terrain,
    packed: PackedTerrain,
    robot: Robot,
    reach: float,
    start: Stance,
    goal: Goal,
    full_soles: bool = True,
) -> str:
    """Why solids keep the pelvis from the goal, "" where that is not proved.

    Args:
        terrain: its surfaces and obstacles.
        packed: the same, packed.
        robot: gives the length of the legs.
        reach: how far apart a step sets the feet at most, in the plan view [m].
        start: the first stance.
        goal: region and floor.
        full_soles: as for `unreachable`.
    """
    feet = terrain.surfaces_for(*FEET)
    if len(feet) > MOST_SURFACES or not terrain.obstacles:
        return ""
    leg, cell = robot.leg_reach[1], min(CELL, float(abs(robot.hip[1])))
    plans, heights = _plans(terrain, feet)
    if not full_soles:
        reach += 2 * float(np.hypot(*robot.effectors[0].half_extent))
    on = [feet.index(c.surface) for c in start.contacts[:2] if c]
    reached = np.flatnonzero(_connected(plans, heights, reach, robot.max_step_height, on))
    bounds = shapely.bounds(plans[reached]) + np.array([-leg, -leg, leg, leg])
    origin, extent = bounds[:, :2].min(axis=0), np.ptp(np.vstack([bounds[:, :2], bounds[:, 2:]]), axis=0)
    nx, ny = np.ceil(extent / cell).astype(int).tolist()
    if nx * ny > MOST_CELLS:
        return ""
    x, y = origin[0] + cell * (np.arange(nx) + 0.5), origin[1] + cell * (np.arange(ny) + 0.5)
    free = np.zeros((nx, ny), bool)
    for x0, y0, x1, y1 in bounds:
        free[np.ix_((x >= x0 - cell) & (x <= x1 + cell), (y >= y0 - cell) & (y <= y1 + cell))] = True
    low, high = heights[reached, 0].min() + LOWEST_PELVIS, heights[reached, 1].max() + leg + abs(robot.hip[1])
    columns = np.argwhere(free)
    free[tuple(columns.T)] = ~solid_columns(packed, x[columns[:, 0]], y[columns[:, 1]], float(low), float(high))
    regions = np.zeros(free.shape, np.int32)
    label_regions(free, structure=np.ones((3, 3)), output=regions)
    here, there = start.feet_mean()[:2], np.array(goal.xyz[:2])
    away = np.hypot(x[:, None] - there[0], y[None, :] - there[1]) <= goal.radius + leg
    home = np.hypot(x[:, None] - here[0], y[None, :] - here[1]) <= leg
    if np.intersect1d(regions[home & free], regions[away & free]).size:
        return ""
    line = here + np.linspace(0.0, 1.0, 200)[:, None] * (there - here)
    names = [solid_at(terrain, packed, float(x), float(y), 0.5 * (low + high)) for x, y in line]
    between = next((name for name in names if name), "solids")
    return f"{UNREACHABLE}: {between} is between it and the start, and leaves no way for the pelvis"


def surfaces_in_reach(
    terrain: Terrain, robot: Robot, reach: float, start: Stance, goal: Goal, feet: list[int], stretch: float
) -> bool:
    """Whether chains of steps over some surfaces alone may lead from the start to the goal.

    Args:
        terrain: has the surfaces.
        robot: gives the greatest height of a step.
        reach: how far apart a step sets the feet at most, in the plan view [m].
        start: the first stance; its surfaces are among those.
        goal: region and floor.
        feet: numbers of the surfaces that may be used.
        stretch: strides that a step between two of them may be long and high.
    """
    far, rise = stretch * reach, stretch * robot.max_step_height
    plans, heights = _plans(terrain, feet)
    reached = _connected(plans, heights, far, rise, [feet.index(c.surface) for c in start.contacts[:2] if c])
    return bool((reached & _at_goal(plans, heights, goal, reach, robot.max_step_height)).any())


def reached_surfaces(terrain: Terrain, robot: Robot, reach: float, start: Stance) -> tuple[np.ndarray, np.ndarray]:
    """(n,) outlines in the plan view of the surfaces that steps lead to, and (n, 2) their least and greatest heights [m].

    Args:
        terrain: its surfaces.
        robot: gives the greatest height of a step.
        reach: how far apart a step sets the feet at most, in the plan view [m].
        start: the first stance.
    """
    feet = [k for k, s in enumerate(terrain.surfaces) if s.allows("left_foot") or s.allows("right_foot")]
    plans, heights = _plans(terrain, feet)
    on = [feet.index(c.surface) for c in start.contacts[:2] if c]
    reached = _connected(plans, heights, reach, robot.max_step_height, on)
    return plans[reached], heights[reached]


def _plans(terrain: Terrain, feet: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """(n,) outlines of surfaces in the plan view and (n, 2) their least and greatest heights [m]."""
    vertices = [terrain.surfaces[k].vertices for k in feet]
    corners, surface = np.concatenate(vertices), np.repeat(np.arange(len(feet)), [len(v) for v in vertices])
    first = np.concatenate([[0], np.cumsum([len(v) for v in vertices])[:-1]])
    z = corners[:, 2]
    heights = np.column_stack([np.minimum.reduceat(z, first), np.maximum.reduceat(z, first)])
    return np.asarray(shapely.convex_hull(shapely.linestrings(corners[:, :2], indices=surface))), heights


def _connected(
    plans: np.ndarray, heights: np.ndarray, reach: float, rise: float, start: list[int] | np.ndarray
) -> np.ndarray:
    """(n,) bool, which surfaces chains of steps from some of them may lead to.

    Surfaces whose middles are in reach of each other are linked without a look at their outlines; outlines are measured
    only between surfaces that are not joined by then.
    """
    x0, y0, x1, y1 = shapely.bounds(plans).T
    one, other = shapely.STRtree(plans).query(shapely.box(x0 - reach, y0 - reach, x1 + reach, y1 + reach))
    keep = (one < other) & (_climb(heights, one, other) <= rise + SLACK)
    one, other = one[keep], other[keep]
    middle = shapely.get_coordinates(shapely.centroid(plans))
    near = np.linalg.norm(middle[one] - middle[other], axis=1) <= reach
    label = _labels(one[near], other[near], len(plans))
    apart = label[one] != label[other]
    one, other = one[apart], other[apart]
    linked = shapely.distance(plans[one], plans[other]) <= reach + SLACK
    label = _labels(label[one[linked]], label[other[linked]], len(plans))[label]
    return np.isin(label, label[np.asarray(start, int)])


def _labels(one: np.ndarray, other: np.ndarray, count: int) -> np.ndarray:
    """(count,) number of the group of each thing, where these pairs are joined."""
    links = coo_matrix((np.ones(len(one)), (one, other)), shape=(count, count))
    return connected_components(links, directed=False)[1]


def _climb(heights: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(n,) least height between surfaces, from their lowest and highest points [m]."""
    up, down = heights[other, 0] - heights[one, 1], heights[one, 0] - heights[other, 1]
    return np.maximum(np.maximum(up, down), 0.0)


def _at_goal(plans: np.ndarray, heights: np.ndarray, goal: Goal, reach: float, rise: float) -> np.ndarray:
    """(n,) bool, surfaces that a foot may be on when the mean of the feet is at the goal: half a step away."""
    near = shapely.distance(plans, shapely.Point(goal.xyz[:2])) <= goal.radius + 0.5 * reach + SLACK
    if not np.isfinite(goal.xyz[2]):
        return near
    low, high = heights[near].T
    other_high = _highest_within(low, high, high + rise + SLACK)
    other_low = -_highest_within(-high, -low, -low + rise + SLACK)
    off = np.maximum(0.5 * (low + other_low) - goal.xyz[2], goal.xyz[2] - 0.5 * (high + other_high))
    near[near] = off <= GOAL_HEIGHT + SLACK
    return near


def _highest_within(low: np.ndarray, high: np.ndarray, top: np.ndarray) -> np.ndarray:
    """(n,) how high the surfaces reach that begin at or below each of n heights, cut off at that height [m].

    Args:
        low: (m,) least height of each surface [m].
        high: (m,) greatest height of each surface [m].
        top: (n,) heights at or above the least of `low` [m].
    """
    order = np.argsort(low)
    highest = np.maximum.accumulate(high[order])
    return np.minimum(highest[np.searchsorted(low[order], top, side="right") - 1], top)


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
