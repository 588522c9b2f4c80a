"""Whether a sole can be held at a pose over raw geometry, and the corners of the geometry near there, compiled.

Nothing says beforehand which faces are ground: what carries a sole is found under its pose (`support_under`), on one face
or on several, on faces or on edges.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.contact import MOST_CORNERS
from scenes.footholds.partial_support import support_under
from scenes.footholds.projection import PatchShape, has_room
from scenes.footholds.support_polygon import part_within
from scenes.terrain.packed_terrain import PackedTerrain, near


class Ball(NamedTuple):
    """Where the contact point of a sole may lie: an outer bound of what a leg reaches.

    Attributes:
        centre: (3,) in W [m].
        radius: [m].
    """

    centre: np.ndarray
    radius: float


class Placement(NamedTuple):
    """A sole held at a pose.

    Attributes:
        p: (3,) contact point in W [m].
        R: (3, 3) contact frame in W.
        heading: yaw [rad].
        corners: (8, 2) corners of the support in the contact frame [m].
        count: how many are real, 0 where no foothold was found.
        friction: least Coulomb coefficient of what touches.
        tries: poses that were judged until it was found.
    """

    p: np.ndarray
    R: np.ndarray
    heading: float
    corners: np.ndarray
    count: int
    friction: float
    tries: int


@njit(cache=True)
def make_placement() -> Placement:
    """No foothold; its arrays are there to be written."""
    return Placement(np.zeros(3), np.eye(3), 0.0, np.zeros((MOST_CORNERS, 2)), 0, 0.0, 0)


@njit(cache=True)
def near_ball(packed: PackedTerrain, ball: Ball, beyond: float) -> np.ndarray:
    """(m,) polygons in the plan view of a ball, ascending.

    Args:
        packed: the terrain.
        ball: in W.
        beyond: added to its radius [m].
    """
    x, y, reach = ball.centre[0], ball.centre[1], ball.radius + beyond
    return near(packed, x - reach, y - reach, x + reach, y + reach)


@njit(cache=True)
def hold(
    packed: PackedTerrain,
    effector: int,
    patch: PatchShape,
    around: np.ndarray,
    p: np.ndarray,
    R: np.ndarray,
    corners: np.ndarray,
    work: np.ndarray,
) -> tuple[int, float]:
    """How many corners the support of a sole at pose (p, R) has, 0 where it cannot be held, and its friction.

    Args:
        packed: the terrain.
        effector: index into `EFFECTORS`.
        patch: the room that the foot takes.
        around: (m,) polygons near there, ascending.
        p: (3,) contact point in W [m].
        R: (3, 3) contact frame in W.
        corners: (8, 2) written [m].
        work: (2, K + 8, 3) scratch.
    """
    for leaning in (False, True):
        count, _, friction = support_under(
            packed, effector, p, R, patch.half_length, patch.half_width, around, corners, leaning
        )
        if count > 0 and has_room(packed, -1, p, R, patch, around, work):
            return count, friction
    return 0, 0.0


@njit(cache=True)
def geometry_points(packed: PackedTerrain, around: np.ndarray, ball: Ball, cell: float) -> np.ndarray:
    """(N, 3) corners of polygons cut along cubic cells, those that lie in a ball [m]: intersections of the two (Grey 2017 sec. 4.2.2).

    Args:
        packed: the terrain.
        around: (m,) polygons near the ball.
        ball: in W.
        cell: edge of the cells [m].
    """
    points, n = np.empty((64, 3)), 0
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    axes, bound, middle = np.eye(3), np.full(3, 0.5 * cell), np.empty(3)
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for k in around:
        for a in range(3):
            first[a] = int(np.floor(max(packed.low[k, a], ball.centre[a] - ball.radius) / cell))
            last[a] = int(np.floor(min(packed.high[k, a], ball.centre[a] + ball.radius) / cell))
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                for h in range(first[2], last[2] + 1):
                    middle[0], middle[1], middle[2] = (i + 0.5) * cell, (j + 0.5) * cell, (h + 0.5) * cell
                    m, cur = part_within(packed.vertices[k], packed.count[k], middle, axes, bound, work)
                    for c in range(m):
                        off = 0.0
                        for a in range(3):
                            off += (middle[a] + work[cur, c, a] - ball.centre[a]) ** 2
                        if off > ball.radius * ball.radius:
                            continue
                        if n == points.shape[0]:
                            more = np.empty((2 * n, 3))
                            more[:n] = points
                            points = more
                        for a in range(3):
                            points[n, a] = middle[a] + work[cur, c, a]
                        n += 1
    return points[:n]


@njit(cache=True)
def highest_over(
    packed: PackedTerrain,
    around: np.ndarray,
    patch: PatchShape,
    p: np.ndarray,
    R: np.ndarray,
    work: np.ndarray,
    point: np.ndarray,
) -> bool:
    """Whether geometry stands over a thin sole at pose (p, R), and the point of it that is farthest from its plane.

    Args:
        packed: the terrain.
        around: (m,) polygons near there.
        patch: the sole, and how much room it needs above.
        p: (3,) contact point in W [m].
        R: (3, 3) contact frame in W.
        work: (2, K + 8, 3) scratch.
        point: (3,) written where there is one, in W [m].
    """
    bound = np.array([patch.half_length, patch.half_width, patch.clearance])
    reach, highest = np.sqrt(patch.half_length**2 + patch.half_width**2 + patch.clearance**2), 1e-6
    for k in around:
        apart = False
        for a in range(3):
            if packed.low[k, a] > p[a] + reach or packed.high[k, a] < p[a] - reach:
                apart = True
        if apart:
            continue
        m, cur = part_within(packed.vertices[k], packed.count[k], p, R, bound, work)
        for c in range(m):
            if work[cur, c, 2] > highest:
                highest = work[cur, c, 2]
                for a in range(3):
                    point[a] = p[a]
                    for b in range(3):
                        point[a] += R[a, b] * work[cur, c, b]
    return highest > 1e-6
