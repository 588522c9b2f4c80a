"""Rows that keep the capsules of a body away from the terrain: distance, witness point and normal, and their Jacobian.

The distance of a capsule from a polygon is that of its axis from the polygon less its radius. Where the axis passes
through the polygon, or has an end straight behind its face and not further than `WITHIN`, it is negative: minus the way out
along the polygon's outward normal, the radius included. So a limb inside a plate is pushed out to the side that the plate
may be touched from.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.multibody.body_capsules import BodyCapsules, closest_on_segments
from optimization.multibody.kinematic_tree import KinematicTree, point_jacobian
from optimization.multibody.terrain_clearance import may_touch, place
from scenes.terrain.packed_terrain import PackedTerrain, near, over_polygon

WITHIN = 0.04  # [m] behind a face: twice the thickness of a plate, since a foot may have come through it
BODY_REACH = 1.0  # [m] no part of a body is further from its base than this in plan view


class TerrainRows(NamedTuple):
    """Room for what `close_to_terrain` finds, an entry for a shape and a polygon that are close.

    Attributes:
        shape: (m,) index of the body's shape.
        polygon: (m,) index of the terrain's polygon.
        point: (m, 3) of the capsule's axis that is nearest, in W [m].
        normal: (m, 3) unit vector from the polygon to it.
        distance: (m,) between the surfaces [m].
    """

    shape: np.ndarray
    polygon: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    distance: np.ndarray


@njit(cache=True)
def make_terrain_rows(m: int) -> TerrainRows:
    """A `TerrainRows` with room for m entries."""
    return TerrainRows(np.empty(m, np.int64), np.empty(m, np.int64), np.empty((m, 3)), np.empty((m, 3)), np.empty(m))


@njit(cache=True)
def close_to_terrain(
    capsules: BodyCapsules,
    counted: np.ndarray,
    packed: PackedTerrain,
    R: np.ndarray,
    p: np.ndarray,
    within: float,
    rows: TerrainRows,
) -> int:
    """Finds the counted shapes that are closer than `within` [m] to polygons, nearest capsule each; returns how many.

    Where there are more than `rows` has room for, the nearest are kept.

    Args:
        capsules: shape of the robot.
        counted: (S,) bool, which shapes of `capsules` count.
        packed: the terrain.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m], from `forward`.
        within: distance that is looked for [m].
        rows: written.
    """
    around = near(packed, p[0, 0] - BODY_REACH, p[0, 1] - BODY_REACH, p[0, 0] + BODY_REACH, p[0, 1] + BODY_REACH)
    a, b, c, point, normal = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    count = 0
    for s in range(capsules.link.shape[0]):
        if not counted[s]:
            continue
        link = capsules.link[s]
        place(R[link], p[link], capsules.p_LC[s], c)
        for i in range(around.shape[0]):
            k = around[i]
            if not packed.body[k] or not may_touch(packed, k, c, capsules.reach[s] + within):
                continue
            nearest, slot = within, -1
            for m in range(capsules.first[s], capsules.first[s + 1]):
                place(R[link], p[link], capsules.p_LA[m], a)
                place(R[link], p[link], capsules.p_LB[m], b)
                distance = axis_to_polygon(packed, k, a, b, point, normal) - capsules.radius[m]
                if distance >= nearest:
                    continue
                nearest = distance
                if slot < 0:
                    slot, count = _slot(rows, count, distance)
                    if slot < 0:
                        break
                rows.shape[slot], rows.polygon[slot], rows.distance[slot] = s, k, distance
                for r in range(3):
                    rows.point[slot, r], rows.normal[slot, r] = point[r], normal[r]
    return count


@njit(cache=True)
def _slot(rows: TerrainRows, count: int, distance: float) -> tuple[int, int]:
    """Where to write an entry and how many there are then; -1 where all kept ones are nearer."""
    if count < rows.distance.shape[0]:
        return count, count + 1
    furthest = int(np.argmax(rows.distance[:count]))
    return (furthest, count) if distance < rows.distance[furthest] else (-1, count)


@njit(cache=True)
def axis_to_polygon(
    packed: PackedTerrain, k: int, a: np.ndarray, b: np.ndarray, point: np.ndarray, normal: np.ndarray
) -> float:
    """Distance of the segment from a to b from polygon k [m]; negative where it passes through.

    Writes the segment's point (3,) that it belongs to and the unit normal (3,) along which it grows.

    Args:
        packed: the terrain.
        k: index of the polygon.
        a, b: (3,) ends of the segment in W [m].
        point: (3,) written, in W [m].
        normal: (3,) written, in W.
    """
    n = packed.normal[k]
    height_a = n[0] * a[0] + n[1] * a[1] + n[2] * a[2] - packed.offset[k]
    height_b = n[0] * b[0] + n[1] * b[1] + n[2] * b[2] - packed.offset[k]
    deep = min(height_a, height_b)
    if deep < 0.0:
        x, other = (a, height_b) if height_a < height_b else (b, height_a)
        t = deep / (deep - other) if other > 0.0 else 0.0  # where the axis passes through the plane, from its deep end
        o = b if height_a < height_b else a
        through = other > 0.0 and over_polygon(
            packed, k, x[0] + t * (o[0] - x[0]), x[1] + t * (o[1] - x[1]), x[2] + t * (o[2] - x[2]), 0.0
        )
        if through or (deep > -WITHIN and over_polygon(packed, k, x[0], x[1], x[2], 0.0)):
            for r in range(3):
                point[r] = x[r]
                normal[r] = n[r]
            return deep
    best = np.inf
    for end in range(2):
        x, height = (a, height_a) if end == 0 else (b, height_b)
        if abs(height) < best and over_polygon(packed, k, x[0], x[1], x[2], 0.0):
            best = abs(height)
            for r in range(3):
                point[r] = x[r]
                normal[r] = n[r] if height >= 0.0 else -n[r]
    on_axis, on_edge = np.empty(3), np.empty(3)
    for e in range(packed.count[k]):
        after = e + 1 if e + 1 < packed.count[k] else 0
        length = closest_on_segments(a, b, packed.vertices[k, e], packed.vertices[k, after], on_axis, on_edge)
        if length < best:
            best = length
            for r in range(3):
                point[r] = on_axis[r]
                normal[r] = (on_axis[r] - on_edge[r]) / length if length > 1e-9 else n[r]
    return best


@njit(cache=True)
def terrain_row(
    tree: KinematicTree,
    capsules: BodyCapsules,
    R: np.ndarray,
    p: np.ndarray,
    rows: TerrainRows,
    k: int,
    J: np.ndarray,
    row: np.ndarray,
) -> None:
    """Writes row (nv,), the derivative of distance k of `rows` with respect to v; J (6, nv) is scratch.

    Args:
        tree: of the robot.
        capsules: its shape.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        rows: distances from the terrain.
        k: number of the distance.
        J: (6, nv) scratch.
        row: (nv,) written [m per unit of v].
    """
    x = rows.point[k]
    point_jacobian(tree, R, p, int(capsules.link[rows.shape[k]]), x[0], x[1], x[2], J)
    n = rows.normal[k]
    for i in range(row.shape[0]):
        row[i] = n[0] * J[3, i] + n[1] * J[4, i] + n[2] * J[5, i]
