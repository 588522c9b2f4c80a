"""Which surfaces are one floor: coplanar, beside each other, with equal friction for the same end effectors.

Maps come in pieces: tiles, the polygons of a plane segmentation, the parts of a floor that is not convex. A sole does not
feel the seam between two of them. Each piece stays a surface of its own; a floor is a number that pieces share.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

FLUSH = 0.003  # [m] pieces of one floor lie this near one plane where they meet
LEVEL = np.cos(np.deg2rad(1.0))  # and their normals differ by at most a degree
# Pieces up to two joints apart are beside each other: every point between them is then as near to a piece as the point
# of a support has to be to the terrain. A wider gap is a gap.
JOINT = 0.003  # [m]
FLATTEST = np.cos(np.deg2rad(30.0))  # joints are looked for where a floor bends less than this
SLIVER = 1e-8  # [m^2] joints smaller than this are rounding


class Floors(NamedTuple):
    """What `floors_of` finds.

    Attributes:
        floor: (S,) number of each surface's floor, -1 for a surface that is alone.
        joint_start: (S + 1,) the joints beside surface k are joint_start[k] to joint_start[k + 1] of `joint`.
        joint: (J, 3, 3) triangles in W [m], counter-clockwise from outside, that fill the joints between pieces of a floor.
    """

    floor: np.ndarray
    joint_start: np.ndarray
    joint: np.ndarray


def floors_of(
    vertices: np.ndarray, count: np.ndarray, normal: np.ndarray, friction: np.ndarray, allowed: np.ndarray
) -> Floors:
    """The floors that S surfaces form, and the joints in them.

    Args:
        vertices: (S, K, 3) corners in W, padded with copies of the first one [m].
        count: (S,) how many are real.
        normal: (S, 3) outward unit normals in W.
        friction: (S,) Coulomb coefficients.
        allowed: (S, E) whether each end effector may touch the surface.
    """
    size = len(vertices)
    pairs = _coplanar_pairs(vertices, normal, friction, allowed)
    alone = Floors(np.full(size, -1), np.zeros(size + 1, np.int64), np.zeros((0, 3, 3)))
    if not len(pairs):
        return alone
    from scipy.sparse import coo_matrix  # 0.2 s that scenes without such floors do not need
    from scipy.sparse.csgraph import connected_components

    _, label = connected_components(coo_matrix((np.ones(len(pairs)), pairs.T), shape=(size, size)), directed=False)
    pieces = np.bincount(label)
    _, numbers = np.unique(np.where(pieces[label] > 1, label, -1), return_inverse=True)
    floor = numbers - 1 if (pieces == 1).any() else numbers
    beside: list[tuple[np.ndarray, np.ndarray]] = []  # per floor: surfaces, and the joints beside them
    for members in np.split(np.argsort(floor, kind="stable"), np.cumsum(np.bincount(floor + 1))[:-1])[1:]:
        beside += _joints(members, vertices, count, normal)
    if not beside:
        return alone._replace(floor=floor)
    owner = np.concatenate([o for o, _ in beside])
    joint = np.concatenate([j for _, j in beside])
    order = np.argsort(owner, kind="stable")
    return Floors(floor, np.searchsorted(owner[order], np.arange(size + 1)), joint[order])


def _coplanar_pairs(vertices: np.ndarray, normal: np.ndarray, friction: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """(N, 2) pairs of surfaces that are one floor where they meet."""
    usable = np.flatnonzero(allowed.any(axis=1))
    low, high = vertices.min(axis=1)[usable] - 2 * JOINT, vertices.max(axis=1)[usable] + 2 * JOINT
    if len(usable) < 2:
        return np.zeros((0, 2), np.int64)
    boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    a, b = shapely.STRtree(boxes).query(boxes)
    keep = (a < b) & (low[a, 2] <= high[b, 2]) & (low[b, 2] <= high[a, 2])
    a, b = usable[a[keep]], usable[b[keep]]
    keep = (normal[a] * normal[b]).sum(axis=1) >= LEVEL
    keep &= (friction[a] == friction[b]) & (allowed[a] == allowed[b]).all(axis=1)
    a, b = a[keep], b[keep]
    if not len(a):
        return np.zeros((0, 2), np.int64)
    # Both in the axes of the first one's plane; near it the second has to come within FLUSH of that plane.
    axes = _axes(normal[a])
    own = np.einsum("nij,nkj->nki", axes[:, :2], vertices[a] - vertices[a, :1])
    other = np.einsum("nij,nkj->nki", axes, vertices[b] - vertices[a, :1])
    first, second = shapely.polygons(own), shapely.polygons(other[..., :2])
    shared = shapely.intersection(shapely.buffer(first, 2 * JOINT, quad_segs=2), second)
    slope = np.einsum("nij,nj->ni", axes, normal[b])
    least, most = np.full(len(a), np.inf), np.full(len(a), -np.inf)
    points, index = shapely.get_coordinates(shared, return_index=True)
    if len(points):
        height = ((slope[index] * other[index, 0]).sum(axis=1) - (slope[index, :2] * points).sum(axis=1)) / slope[
            index, 2
        ]
        np.minimum.at(least, index, height)
        np.maximum.at(most, index, height)
    keep = (least <= FLUSH) & (most >= -FLUSH)
    return np.stack([a[keep], b[keep]], axis=1)


def _axes(normal: np.ndarray) -> np.ndarray:
    """(N, 3, 3) rows: two axes of each plane, and its normal (N, 3)."""
    level = np.stack([-normal[:, 1], normal[:, 0], np.zeros(len(normal))], axis=1)
    level[np.linalg.norm(level, axis=1) < 1e-6] = (1.0, 0.0, 0.0)
    level -= (level * normal).sum(axis=1, keepdims=True) * normal
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    return np.stack([level, np.cross(normal, level), normal], axis=1)


def _joints(
    members: np.ndarray, vertices: np.ndarray, count: np.ndarray, normal: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """(n,) surfaces and (n, 3, 3) joints of one floor that lie beside them; a joint is listed with each of its neighbours.

    Args:
        members: (M,) the floor's surfaces.
        vertices: (S, K, 3) of all surfaces [m].
        count: (S,) how many are real.
        normal: (S, 3) of all surfaces.
    """
    seed = members[np.argmax(np.linalg.norm(np.ptp(vertices[members], axis=1), axis=1))]
    if (normal[members] @ normal[seed]).min() < FLATTEST:
        return []
    axes, origin = _axes(normal[seed][None])[0], vertices[seed, 0]
    flat = (vertices[members] - origin) @ axes.T
    pieces = shapely.polygons(flat[..., :2])
    union = shapely.union_all(pieces)
    gaps = closed(union).difference(union)
    triangles = [
        shapely.get_coordinates(shapely.orient_polygons(triangle))[:3]
        for part in shapely.get_parts(gaps)
        if part.geom_type == "Polygon" and part.area > SLIVER
        for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(part))
    ]
    if not triangles:
        return []
    corners = np.array(triangles)
    row, piece = shapely.STRtree(pieces).query(shapely.polygons(corners), predicate="dwithin", distance=2 * JOINT)
    # On the plane of the piece it lies beside, a joint is as flush as the piece is.
    slope = normal[members[piece]] @ axes.T
    start = flat[piece, 0]
    fall = (slope[:, None, :2] * (corners[row] - start[:, None, :2])).sum(axis=2)
    height = start[:, None, 2] - fall / slope[:, None, 2]
    lifted = np.concatenate([corners[row], height[..., None]], axis=2)
    return [(members[piece], origin + lifted @ axes)]


def closed(union: BaseGeometry) -> BaseGeometry:
    """A region of the plane with its joints filled: everything that no square of side two joints, so oriented, fits beside."""
    with np.errstate(invalid="ignore"):  # GEOS tries intersections of parallel lines
        filled = union.buffer(JOINT, join_style="mitre").buffer(-JOINT, join_style="mitre")
    if shapely.is_valid(filled):
        return filled
    return union.buffer(JOINT).buffer(-JOINT)  # GEOS makes mitres of a needle's point cross each other
