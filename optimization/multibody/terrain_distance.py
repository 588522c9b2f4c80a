"""Which of a robot's shapes come near the terrain in which postures: distance, nearest points and the way out, compiled.

The terrain is what `PackedTerrain` holds: faces of obstacles, as thin as paper, and plates, as deep as `depth` says.
Only polygons in the grid cells around a shape are looked at, so that a query costs what the terrain near
the robot costs, however large or fine the rest is.

Where shape and polygon overlap, the way out is the shortest of those along the polygon's outward normal and across its
edges, for a plate also through its back (the directions of its sides in the separating axis test), and of the one that
parts the two when they are shrunk (`way_out`), which is best where an edge lies across a shape's face: an upper bound on
the depth, exact where a side of the polygon is the nearest.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.multibody.convex_distance import hull_distance, way_out
from optimization.multibody.kinematic_tree import KinematicTree, forward
from optimization.multibody.robot_shapes import RobotShapes
from optimization.multibody.terrain_clearance import in_link, may_touch, place
from scenes.terrain.packed_terrain import PackedTerrain, cells_under, in_cells

SHALLOW = 0.002  # [m] overlaps of less need no better way out


class TerrainPairs(NamedTuple):
    """R pairs of a shape and a polygon that are near each other.

    Attributes:
        row: (R,) index of the posture.
        shape: (R,) index of the shape.
        polygon: (R,) index of the polygon.
        distance: (R,) signed [m], negative where they overlap.
        point: (R, 2, 3) the nearest points, on the shape in its link and on the polygon in W [m]; where they overlap,
            the deepest point of the shape and where it should be.
        normal: (R, 3) unit vector in W from the polygon to the shape.
    """

    row: np.ndarray
    shape: np.ndarray
    polygon: np.ndarray
    distance: np.ndarray
    point: np.ndarray
    normal: np.ndarray


def near_terrain(
    tree: KinematicTree, shapes: RobotShapes, packed: PackedTerrain, q: np.ndarray, distance: float
) -> TerrainPairs:
    """Every pair closer than a distance, in all postures.

    Args:
        tree: of the robot.
        shapes: its collision shapes.
        packed: the terrain.
        q: (T, nq) postures, Drake's order.
        distance: pairs nearer than this are returned [m].
    """
    room = max(64 * len(q), 256)
    while True:
        pairs = TerrainPairs(
            np.empty(room, np.int64),
            np.empty(room, np.int64),
            np.empty(room, np.int64),
            np.empty(room),
            np.empty((room, 2, 3)),
            np.empty((room, 3)),
        )
        found = _find(tree, shapes, packed, np.ascontiguousarray(q, float), float(distance), pairs)
        if found <= room:
            return TerrainPairs(*(array[:found] for array in pairs))
        room = found


@njit(cache=True)
def _find(
    tree: KinematicTree,
    shapes: RobotShapes,
    packed: PackedTerrain,
    q: np.ndarray,
    distance: float,
    pairs: TerrainPairs,
) -> int:
    """Fills `pairs` as far as it has room; how many there are."""
    num_links, width = tree.parent.shape[0], packed.vertices.shape[1]
    R, p = np.empty((num_links, 3, 3)), np.empty((num_links, 3))
    most = 1
    for s in range(shapes.link.shape[0]):
        most = max(most, shapes.first[s + 1] - shapes.first[s])
    A, B = np.empty((most, 3)), np.empty((2 * width, 3))
    c, p_A, p_B, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    seen = np.full(packed.count.shape[0], -1, np.int64)  # the last query that looked at each polygon
    found, query = 0, 0
    for t in range(q.shape[0]):
        forward(tree, q[t], R, p)
        for s in range(shapes.link.shape[0]):
            link, num_a = shapes.link[s], shapes.first[s + 1] - shapes.first[s]
            place(R[link], p[link], shapes.p_LC[s], c)
            reach = shapes.reach[s] + distance
            placed, query = False, query + 1
            rows, j0, j1 = cells_under(packed, c[0] - reach, c[1] - reach, c[0] + reach, c[1] + reach)
            for i in rows:
                for k in in_cells(packed, i, j0, j1):
                    if seen[k] == query or not packed.body[k] or not _may_touch(packed, k, c, reach):
                        continue
                    seen[k] = query
                    if not placed:
                        for m in range(num_a):
                            place(R[link], p[link], shapes.p_LP[shapes.first[s] + m], A[m])
                        placed = True
                    gap = shape_distance(packed, k, A, num_a, shapes.radius[s], distance, B, p_A, p_B, n)
                    if gap >= distance:
                        continue
                    if found < pairs.row.shape[0]:
                        pairs.row[found], pairs.shape[found], pairs.polygon[found] = t, s, k
                        pairs.distance[found] = gap
                        in_link(R[link], p[link], p_A, pairs.point[found, 0])
                        pairs.point[found, 1], pairs.normal[found] = p_B, n
                    found += 1
    return found


@njit(cache=True)
def _may_touch(packed: PackedTerrain, k: int, c: np.ndarray, reach: float) -> bool:
    return may_touch(packed, k, c, reach + packed.depth[k])


@njit(cache=True)
def shape_distance(
    packed: PackedTerrain,
    k: int,
    A: np.ndarray,
    num_a: int,
    radius: float,
    most: float,
    B: np.ndarray,
    p_A: np.ndarray,
    p_B: np.ndarray,
    n: np.ndarray,
) -> float:
    """Signed distance between a shape and polygon k [m]; inf where it is more than `most`.

    Args:
        packed: the terrain.
        k: index of the polygon.
        A: (m, 3) points of the shape in W [m], the first `num_a` of them count.
        num_a: at least 1.
        radius: by which their hull is thickened [m].
        most: greatest distance that is of interest [m].
        B: (2 K, 3) scratch for polygons of K corners.
        p_A: (3,) is written: nearest point of the shape in W [m].
        p_B: (3,) is written: nearest point of the polygon in W [m].
        n: (3,) is written: unit vector from the polygon to the shape.
    """
    corners = packed.count[k]
    depth = packed.depth[k]
    for m in range(corners):
        for r in range(3):
            B[m, r] = packed.vertices[k, m, r]
            B[corners + m, r] = B[m, r] - depth * packed.normal[k, r]
    num_b = 2 * corners if depth > 0.0 else corners
    gap = hull_distance(A, num_a, B, num_b, most + radius, p_A, p_B)
    if gap == np.inf:
        return gap
    if gap > 0.0:
        for r in range(3):
            n[r] = (p_A[r] - p_B[r]) / gap
            p_A[r] -= radius * n[r]
        return gap - radius
    out = -_way_out_of(packed, k, A, num_a, radius, depth, p_A, p_B, n)
    if out > SHALLOW:
        other_A, other_B, u = np.empty(3), np.empty(3), np.empty(3)
        other = way_out(A, num_a, B, num_b, other_A, other_B, u) + radius
        if other < out:
            out = other
            for r in range(3):
                n[r] = u[r]
                p_A[r] = other_A[r] - radius * u[r]
                p_B[r] = p_A[r] + other * u[r]
    return -out


@njit(cache=True)
def _way_out_of(
    packed: PackedTerrain,
    k: int,
    A: np.ndarray,
    num_a: int,
    radius: float,
    depth: float,
    p_A: np.ndarray,
    p_B: np.ndarray,
    n: np.ndarray,
) -> float:
    """Minus the way that a shape which overlaps polygon k has to go at least, in the best direction."""
    best, lowest = np.inf, 0
    for side in range(packed.count[k] + 2):
        sign = 1.0
        if side < packed.count[k]:
            x, y, z = packed.edge_normal[k, side]
            level = packed.edge_offset[k, side]
            if x * x + y * y + z * z < 0.5:
                continue  # an edge without length
        else:
            if side > packed.count[k]:
                if depth == 0.0:
                    continue
                sign = -1.0
            x, y, z = sign * packed.normal[k, 0], sign * packed.normal[k, 1], sign * packed.normal[k, 2]
            level = packed.offset[k] if sign > 0.0 else depth - packed.offset[k]
        least, deepest = np.inf, 0
        for m in range(num_a):
            d = x * A[m, 0] + y * A[m, 1] + z * A[m, 2]
            if d < least:
                least, deepest = d, m
        way = level - least + radius
        if way < best:
            best, lowest = way, deepest
            n[0], n[1], n[2] = x, y, z
    for r in range(3):
        p_A[r] = A[lowest, r] - radius * n[r]
        p_B[r] = p_A[r] + best * n[r]
    return -best
