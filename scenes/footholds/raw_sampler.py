"""Foot placements sampled on raw geometry (Grey 2017 sec. 4.2, algorithm 1), compiled.

    points where the reachable volume meets the geometry
    -> a random place in the volume, the points nearest to it, three of them span a plane
    -> a random pose on that plane; where geometry stands over the sole, its farthest point takes the place of the nearest
       of the three, and the plane rises until nothing does

The answer is a pose that `hold` accepts, or none: a foothold may exist where none was found.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.footholds.projection import PatchShape, contact_axes
from scenes.footholds.raw_placement import (
    Ball,
    Placement,
    geometry_points,
    highest_over,
    hold,
    make_placement,
    near_ball,
)
from scenes.terrain.packed_terrain import PackedTerrain

ALIKE = 2e-3  # [m] corners that several faces share count once
FLATTEST = 1e-6  # [m^2] three points that span less lie on a line


class SamplerOptions(NamedTuple):
    """How often algorithm 1 of Grey 2017 tries; the defaults are those of its fig. 4.10.

    Attributes:
        places: random places in the reachable volume.
        planes: triples of points at each place.
        poses: poses on each plane, which rises between them.
        neighbors: points nearest to a place that the triples are drawn from.
        cell: edge of the cells along which the geometry is cut [m].
        max_tilt: of a sole from level [rad].
        seeded: whether the first place is the middle of the volume, and the first pose on each plane is the middle of the
            three points with the wanted heading ("performance enhancements", ibid.).
    """

    places: int = 40
    planes: int = 10
    poses: int = 20
    neighbors: int = 10
    cell: float = 0.2
    max_tilt: float = float(np.deg2rad(25.0))
    seeded: bool = True


@njit(cache=True)
def sample_foothold(
    packed: PackedTerrain,
    effector: int,
    patch: PatchShape,
    ball: Ball,
    heading: float,
    options: SamplerOptions,
    rng: np.random.Generator,
) -> Placement:
    """One foot placement in a ball, or a placement without corners.

    Args:
        packed: the terrain.
        effector: index into `EFFECTORS`.
        patch: the room that the foot takes.
        ball: where its contact point may lie.
        heading: wanted yaw [rad].
        options: how often it tries.
        rng: source of the draws.
    """
    found = make_placement()
    around = near_ball(packed, ball, patch.half_length + patch.half_width + max(patch.front, patch.back) + patch.side)
    points = geometry_points(packed, around, ball, options.cell)
    num = min(options.neighbors, points.shape[0])
    if num < 3:
        return found
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    plane, higher, target, n = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    tries, least = 0, np.cos(options.max_tilt)
    for i in range(options.places):
        _place_in(ball, rng, options.seeded and i == 0, target)
        nearest = _nearest(points, target, num)
        for _ in range(options.planes if nearest.shape[0] >= 3 else 0):
            _draw_three(points, nearest, rng, plane)
            for k in range(options.poses):
                if not _plane_normal(plane, least, n):
                    break
                tries += 1
                middle = options.seeded and k == 0
                _point_between(plane, rng, middle, found.p)
                yaw = heading if middle else 2.0 * np.pi * rng.random()
                contact_axes(n, yaw, False, found.R)
                off = 0.0
                for a in range(3):
                    off += (found.p[a] - ball.centre[a]) ** 2
                if off <= ball.radius * ball.radius:
                    count, friction = hold(packed, effector, patch, around, found.p, found.R, found.corners, work)
                    if count > 0:
                        return Placement(found.p, found.R, yaw, found.corners, count, friction, tries)
                if highest_over(packed, around, patch, found.p, found.R, work, higher):
                    _swap_nearest(plane, higher)
    return Placement(found.p, found.R, 0.0, found.corners, 0, 0.0, tries)


@njit(cache=True)
def _place_in(ball: Ball, rng: np.random.Generator, middle: bool, target: np.ndarray) -> None:
    """Writes a place (3,) that is uniform in a ball, or its middle."""
    off = 2.0
    while off > 1.0:
        off = 0.0
        for a in range(3):
            target[a] = 0.0 if middle else 2.0 * rng.random() - 1.0
            off += target[a] * target[a]
    for a in range(3):
        target[a] = ball.centre[a] + ball.radius * target[a]


@njit(cache=True)
def _nearest(points: np.ndarray, target: np.ndarray, num: int) -> np.ndarray:
    """(n,) indices of at most `num` points nearest to a place; of points that are `ALIKE` the nearest one."""
    off = np.empty(points.shape[0])
    for k in range(points.shape[0]):
        off[k] = (points[k, 0] - target[0]) ** 2 + (points[k, 1] - target[1]) ** 2 + (points[k, 2] - target[2]) ** 2
    chosen, n = np.empty(num, np.int64), 0
    while n < num:
        k = int(np.argmin(off))
        if off[k] == np.inf:
            break
        chosen[n] = k
        n += 1
        for m in range(points.shape[0]):
            apart = 0.0
            for a in range(3):
                apart += (points[m, a] - points[k, a]) ** 2
            if apart < ALIKE * ALIKE:
                off[m] = np.inf
    return chosen[:n]


@njit(cache=True)
def _draw_three(points: np.ndarray, nearest: np.ndarray, rng: np.random.Generator, plane: np.ndarray) -> None:
    """Writes three different ones (3, 3) of the nearest points."""
    num = nearest.shape[0]
    a = min(int(rng.random() * num), num - 1)
    b = min(int(rng.random() * (num - 1)), num - 2)
    b += b >= a
    c = min(int(rng.random() * (num - 2)), num - 3)
    for lower in (min(a, b), max(a, b)):
        c += c >= lower
    plane[0], plane[1], plane[2] = points[nearest[a]], points[nearest[b]], points[nearest[c]]


@njit(cache=True)
def _plane_normal(plane: np.ndarray, least: float, n: np.ndarray) -> bool:
    """Writes the upward unit normal (3,) of three points; whether they span a plane no steeper than allowed."""
    u, v = plane[1] - plane[0], plane[2] - plane[0]
    n[0], n[1], n[2] = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
    length = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    if length < FLATTEST:
        return False
    sign = 1.0 if n[2] > 0.0 else -1.0
    for a in range(3):
        n[a] *= sign / length
    return n[2] >= least


@njit(cache=True)
def _point_between(plane: np.ndarray, rng: np.random.Generator, middle: bool, p: np.ndarray) -> None:
    """Writes a point (3,) that is uniform in a triangle, or its middle."""
    u, v = 1.0 / 3.0, 1.0 / 3.0
    if not middle:
        u, v = rng.random(), rng.random()
        if u + v > 1.0:
            u, v = 1.0 - u, 1.0 - v
    for a in range(3):
        p[a] = plane[0, a] + u * (plane[1, a] - plane[0, a]) + v * (plane[2, a] - plane[0, a])


@njit(cache=True)
def _swap_nearest(plane: np.ndarray, point: np.ndarray) -> None:
    """Puts a point in the place of the nearest of the three."""
    best, which = np.inf, 0
    for k in range(3):
        off = 0.0
        for a in range(3):
            off += (plane[k, a] - point[a]) ** 2
        if off < best:
            best, which = off, k
    plane[which] = point
