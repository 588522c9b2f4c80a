"""The way of the torso to the goal, and its straight pieces: what stored plans are asked to cover one after the other.

The way is that of the torso grid (Lin 2020 fig. 6.3): from cell to cell, always to the neighbour nearest to the goal. A piece
of it is as long as the torso can go straight on, since stored plans lead straight ahead (sec. 5.8.2 takes the first pose of
the guiding path that is as far away as the plan is long).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from drakeplan.contact_planning.sequence_check import feet_heading
from drakeplan.context import QueryContext

NEIGHBOURS = 0.16  # [m] between neighbouring cells of the grid, diagonals included
RISE = 0.35  # [m] between the floors of neighbouring cells at most
LEANS = 0.6  # [m] how far from ground right below the grid's torso may be
SHORTEST = 0.8  # [m] of a piece, wherever the straight line leads: some steps of a plan
TURNS = (0.0, np.pi / 6, -np.pi / 6)  # [rad] off the line that the torso may be turned on it
SPACING = 0.15  # [m] at which a straight line is looked at
LONGEST = 4.8  # [m] of a piece: as far as the longest stored plans lead
MOST_CELLS = 2000


def torso_way(context: QueryContext) -> np.ndarray:
    """(K, 3) the way from the start to the goal; these two alone where the grid knows none [m].

    Args:
        context: of the query.
    """
    start, goal = context.start.feet_mean(), np.array(context.goal.xyz)
    heading = np.array([feet_heading(context.start)])
    known = context.torso_grid.distance(start[:1], start[1:2], start[2:], heading)
    if not np.isfinite(known[0]):
        return np.array([start, goal])
    places, cost, over_ground = context.torso_grid.settled_places()
    tree = KDTree(places[:, :2])
    way, here = [start], start
    left = np.inf
    for _ in range(MOST_CELLS):
        near = np.array(tree.query_ball_point(here[:2], NEIGHBOURS), dtype=int)
        near = near[np.abs(places[near, 2] - here[2]) <= RISE] if len(near) else near
        near = near[cost[near] < left]
        if not len(near):
            break
        best = near[np.argmin(cost[near])]
        here, left = places[best], float(cost[best])
        way.append(here)
    return np.array([start, *_over_ground(np.array(way[1:]).reshape(-1, 3), places[over_ground]), goal])


def _over_ground(way: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(K, 3) the way moved to places with ground right below: the torso may lean out over an edge, where no foot stands.

    Args:
        way: (K, 3) [m].
        places: (n, 3) cells over ground [m].
    """
    if not len(way) or not len(places):
        return way
    off, nearest = KDTree(places).query(way)
    return np.where((off < LEANS)[:, None], places[nearest], way)


def next_place(context: QueryContext, way: np.ndarray, here: np.ndarray) -> tuple[np.ndarray, bool]:
    """(3,) the farthest place ahead that the torso can reach straight, and whether it is the end of the way [m].

    Args:
        context: of the query.
        way: (K, 3) [m].
        here: (3,) where the feet are [m].
    """
    first = int(np.argmin(np.linalg.norm(way - here, axis=1)))
    along = np.linalg.norm(np.diff(way[first:, :2], axis=0), axis=1).cumsum()
    near = min(first + 1 + int(np.searchsorted(along, SHORTEST)), len(way) - 1)
    for k in range(len(way) - 1, near, -1):
        if np.hypot(*(way[k] - here)[:2]) <= LONGEST and _is_free(context, here, way[k]):
            return way[k], k == len(way) - 1
    return way[near], near == len(way) - 1


def _is_free(context: QueryContext, here: np.ndarray, there: np.ndarray) -> bool:
    """Whether the torso grid knows a way from everywhere on the straight line."""
    count = max(int(np.ceil(np.hypot(*(there - here)[:2]) / SPACING)), 1)
    share = np.linspace(0.0, 1.0, count + 1)[:, None]
    x, y, z = (here + share * (there - here)).T
    heading = np.arctan2(there[1] - here[1], there[0] - here[0])
    known = [context.torso_grid.distance(x, y, z, np.full(count + 1, heading + turn)) for turn in TURNS]
    return bool(np.isfinite(known).any(axis=0).all())
