"""Foot placements that bridge two edges of raw geometry, without sampling, compiled.

Where a sole has to rest on two bars that are nearly its length apart, poses that do are a thin set in SE(2): random ones miss it
(Grey 2017 sec. 4.2.3, fig. 4.10). Such a sole lies halfway between two edges. Its plane holds both, and along the way from
one to the other lies its length, its width, one of its diagonals, which is its longest reach, or halfway to that. It lies
in the middle, or reaches over one edge as far as it can and only touches the other: its support is then a triangle whose
inner radius is larger. These few poses are tried for every pair of edges near the place that is wanted.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit

from scenes.footholds.projection import PatchShape, contact_axes
from scenes.footholds.raw_placement import Ball, Placement, hold, make_placement, near_ball
from scenes.terrain.packed_terrain import PackedTerrain

SLIDES = 9  # places along two edges that face each other
SHORT = 0.002  # [m] edges shorter than this are corners
ALL_THE_WAY = 0.98  # share of what a sole is longer than the way by which it is shifted over one edge
PARALLEL = np.cos(np.deg2rad(20.0))  # edges that are turned from each other by more do not face each other


@njit(cache=True)
def bridge_edges(
    packed: PackedTerrain, effector: int, patch: PatchShape, ball: Ball, heading: float, max_tilt: float
) -> Placement:
    """The foot placement on two edges that is nearest to the middle of a ball, or a placement without corners.

    Args:
        packed: the terrain.
        effector: index into `EFFECTORS`.
        patch: the room that the foot takes.
        ball: where its contact point may lie.
        heading: wanted yaw [rad]: of two headings that differ by half a turn the nearer one is taken.
        max_tilt: of a sole from level [rad].
    """
    longest = 2.0 * np.sqrt(patch.half_length**2 + patch.half_width**2)
    around = near_ball(packed, ball, longest)
    edge = _edges(packed, effector, around, np.cos(max_tilt), ball, longest)
    best, tries, best_off = make_placement(), 0, np.inf
    middle, p, R, n, way = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(3), np.empty(3)
    corners = np.empty(best.corners.shape)
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    diagonal = np.arctan2(patch.half_width, patch.half_length)
    turns = diagonal * np.array([0.0, 0.5, -0.5, 1.0, -1.0, 0.5 * np.pi / diagonal])
    for i in range(edge.shape[0]):
        for j in range(i + 1, edge.shape[0]):
            low, high = _facing(edge[i], edge[j], longest)
            for s in range(SLIDES if high >= low else 0):
                along = low + (high - low) * (s + 0.5) / SLIDES
                apart = _between(edge[i], edge[j], along, middle, n, way)
                if n[2] < np.cos(max_tilt):
                    continue
                off = 0.0
                for r in range(3):
                    off += (middle[r] - ball.centre[r]) ** 2
                if off > ball.radius**2 or off >= best_off:
                    continue
                yaw = np.arctan2(way[1], way[0])
                for pose in range(3 * turns.shape[0]):
                    turn, side = turns[pose // 3], (0.0, 1.0, -1.0)[pose % 3]
                    longer = patch.half_length * abs(np.cos(turn)) + patch.half_width * abs(np.sin(turn)) - 0.5 * apart
                    if longer <= 0.0:
                        continue
                    tries += 1
                    wanted = yaw + turn if np.cos(yaw + turn - heading) >= 0.0 else yaw + turn + np.pi
                    for r in range(3):
                        p[r] = middle[r] + side * ALL_THE_WAY * longer * way[r]
                    contact_axes(n, wanted, False, R)
                    count, friction = hold(packed, effector, patch, around, p, R, corners, work)
                    if count > 0:
                        best_off = off
                        best = Placement(p.copy(), R.copy(), wanted, corners.copy(), count, friction, tries)
                        break
    return Placement(best.p, best.R, best.heading, best.corners, best.count, best.friction, tries)


@njit(cache=True)
def _edges(
    packed: PackedTerrain, effector: int, around: np.ndarray, level: float, ball: Ball, longest: float
) -> np.ndarray:
    """(N, 2, 3) ends of the edges near a ball of faces that a foot may touch and that are level enough [m]."""
    most = 0
    for k in around:
        most += packed.count[k]
    edge, n = np.empty((most, 2, 3)), 0
    for k in around:
        if k >= packed.num_surfaces or not packed.allowed[k, effector] or packed.normal[k, 2] < level:
            continue
        for e in range(packed.count[k]):
            a, b = packed.vertices[k, e], packed.vertices[k, (e + 1) % packed.count[k]]
            length, along, off = 0.0, 0.0, 0.0
            for r in range(3):
                length += (b[r] - a[r]) ** 2
                along += (b[r] - a[r]) * (ball.centre[r] - a[r])
            if length < SHORT * SHORT:
                continue
            share = min(max(along / length, 0.0), 1.0)
            for r in range(3):
                off += (a[r] + share * (b[r] - a[r]) - ball.centre[r]) ** 2
            if off <= (ball.radius + longest) ** 2:
                edge[n, 0], edge[n, 1] = a, b
                n += 1
    return edge[:n]


@njit(cache=True)
def _facing(one: np.ndarray, other: np.ndarray, longest: float) -> tuple[float, float]:
    """From where to where along the first edge [m] the other one faces it, no farther away than a sole; empty where nowhere."""
    u, v = one[1] - one[0], other[1] - other[0]
    length = np.sqrt(u[0] ** 2 + u[1] ** 2 + u[2] ** 2)
    other_length = np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    if abs(u[0] * v[0] + u[1] * v[1] + u[2] * v[2]) < PARALLEL * length * other_length:
        return 1.0, 0.0
    start = end = apart = 0.0
    for r in range(3):
        start += u[r] * (other[0, r] - one[0, r]) / length
        end += u[r] * (other[1, r] - one[0, r]) / length
    for r in range(3):
        apart += (other[0, r] - one[0, r] - start * u[r] / length) ** 2
    if apart > (longest + np.tan(np.deg2rad(20.0)) * other_length) ** 2 or apart < SHORT * SHORT:
        return 1.0, 0.0
    return max(min(start, end), 0.0), min(max(start, end), length)


@njit(cache=True)
def _between(
    one: np.ndarray, other: np.ndarray, along: float, middle: np.ndarray, n: np.ndarray, way: np.ndarray
) -> float:
    """The distance [m] from a point of the first edge to the nearest one of the other; writes halfway, normal and unit vector there."""
    u, v = one[1] - one[0], other[1] - other[0]
    length = np.sqrt(u[0] ** 2 + u[1] ** 2 + u[2] ** 2)
    square, share = 0.0, 0.0
    for r in range(3):
        middle[r] = one[0, r] + along / length * u[r]
        square += v[r] * v[r]
        share += v[r] * (middle[r] - other[0, r])
    apart, sign = 0.0, 1.0 if u[0] * v[0] + u[1] * v[1] + u[2] * v[2] > 0.0 else -1.0
    for r in range(3):
        way[r] = other[0, r] + share / square * v[r] - middle[r]
        apart += way[r] * way[r]
    apart = np.sqrt(apart)
    along_both = u / length + sign * v / np.sqrt(square)
    n[0] = way[1] * along_both[2] - way[2] * along_both[1]
    n[1] = way[2] * along_both[0] - way[0] * along_both[2]
    n[2] = way[0] * along_both[1] - way[1] * along_both[0]
    size = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
    if apart < SHORT or size == 0.0:
        n[2] = -1.0
        return 0.0
    size = size if n[2] >= 0.0 else -size
    for r in range(3):
        middle[r] += 0.5 * way[r]
        way[r] /= apart
        n[r] /= size
    return apart
