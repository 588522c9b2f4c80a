"""A robot's collision shapes as capsules, so that inverse kinematics can keep the body out of itself cheaply.

Capsules and spheres are taken as they are. A box, a cylinder or a convex mesh becomes parallel capsules that fill the
box around it: their flat sides touch its faces, their round edges leave its corners out by about 2 cm. So the
distances here are a proxy that steers; whether a posture collides is asked of Drake.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from pydrake.geometry import Box, Capsule, Cylinder, GeometryId, SceneGraph, SceneGraphInspector, Sphere
from pydrake.multibody.plant import MultibodyPlant

from optimization.multibody.kinematic_tree import KinematicTree
from optimization.multibody.kinematics import Kinematics

_THINNEST, _THICKEST = 0.025, 0.03  # [m] radii that stand for boxes: thick ones cut corners, thin ones are many
_HULL = 0.05  # [m] the same for hulls, whose corners the box around them overfills anyway
_TOUCHING = 0.01  # [m] pairs closer than this in the nominal posture are built that way: they may come as close again


class BodyCapsules(NamedTuple):
    """K capsules in S shapes, and the P pairs of shapes that may not meet.

    Attributes:
        link: (S,) the link that carries each shape.
        first: (S + 1,) shape s owns capsules first[s] to first[s + 1] - 1.
        p_LA, p_LB: (K, 3) ends of the capsules' axes in the link [m].
        radius: (K,) of the capsules [m].
        half: (K,) half the length of their axes [m].
        p_LC: (S, 3) centre of a sphere around each shape, in the link [m].
        reach: (S,) its radius [m].
        pair: (P, 2) shapes that are checked against each other.
        clearance: (P,) distance to keep [m], negative where the nominal posture overlaps.
    """

    link: np.ndarray
    first: np.ndarray
    p_LA: np.ndarray
    p_LB: np.ndarray
    radius: np.ndarray
    half: np.ndarray
    p_LC: np.ndarray
    reach: np.ndarray
    pair: np.ndarray
    clearance: np.ndarray


def read_capsules(
    kinematics: Kinematics, plant: MultibodyPlant, scene_graph: SceneGraph, q_nominal: np.ndarray, clearance: float
) -> BodyCapsules:
    """Reads the robot's collision shapes, and the pairs that Drake would check, out of a finalized plant.

    Args:
        kinematics: of the same plant.
        plant: finalized and registered with `scene_graph`.
        scene_graph: holds the shapes and the collision filters.
        q_nominal: (nq,) a posture that counts as free of collision.
        clearance: distance to keep between two shapes [m], where the nominal posture does.
    """
    inspector = scene_graph.model_inspector()
    shapes: dict[GeometryId, int] = {}
    links: list[int] = []
    capsules: list[np.ndarray] = []
    pairs: list[tuple[int, int]] = []
    for ids in sorted(inspector.GetCollisionCandidates(), key=lambda ids: (ids[0].get_value(), ids[1].get_value())):
        placed = [at for at in (_placed(kinematics, plant, inspector, g) for g in ids) if at is not None]
        if len(placed) < 2 or placed[0][0] == placed[1][0]:
            continue
        for g, (link, X_LG) in zip(ids, placed, strict=True):
            if g not in shapes:
                shapes[g] = len(links)
                links.append(link)
                capsules.append(_capsules(inspector, g, X_LG))
        pairs.append((shapes[ids[0]], shapes[ids[1]]))
    ends = np.concatenate([*capsules, np.empty((0, 7))])
    first = np.cumsum([0] + [len(c) for c in capsules])
    spheres = np.array([_sphere_around(c) for c in capsules]).reshape(-1, 4)
    body = BodyCapsules(
        np.array(links, np.int64),
        first.astype(np.int64),
        ends[:, :3].copy(),
        ends[:, 3:6].copy(),
        ends[:, 6].copy(),
        0.5 * np.linalg.norm(ends[:, 3:6] - ends[:, :3], axis=1),
        spheres[:, :3].copy(),
        spheres[:, 3].copy(),
        np.array(pairs, np.int64).reshape(-1, 2),
        np.zeros(len(pairs)),
    )
    R, p = kinematics.link_poses(q_nominal)
    rows = CapsuleRows(*(np.empty(shape, kind) for shape, kind in row_shapes(len(pairs))))
    for k in range(close_pairs(body, R, p, np.inf, rows)):
        body.clearance[rows.pair[k]] = min(clearance, rows.distance[k] - _TOUCHING)
    return body


def _placed(
    kinematics: Kinematics, plant: MultibodyPlant, inspector: SceneGraphInspector, geometry: GeometryId
) -> tuple[int, np.ndarray] | None:
    """Link and (4, 4) pose in it of a robot's geometry; None for one of the world."""
    body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
    if body.name() not in kinematics.bodies:
        return None
    link, X_LB = kinematics.bodies[body.name()]
    return link, X_LB @ inspector.GetPoseInFrame(geometry).GetAsMatrix4()


def _capsules(inspector: SceneGraphInspector, geometry: GeometryId, X_LG: np.ndarray) -> np.ndarray:
    """(k, 7) capsules that stand for a geometry: two ends in the link frame and a radius [m]."""
    shape = inspector.GetShape(geometry)
    if isinstance(shape, Sphere):
        local = np.array([[0, 0, 0, 0, 0, 0, shape.radius()]])
    elif isinstance(shape, Capsule):
        h = 0.5 * shape.length()
        local = np.array([[0, 0, -h, 0, 0, h, shape.radius()]])
    elif isinstance(shape, Box):
        local = _fill_box(np.zeros(3), 0.5 * np.array(shape.size()))
    elif isinstance(shape, Cylinder):
        local = _fill_box(np.zeros(3), np.array([shape.radius(), shape.radius(), 0.5 * shape.length()]))
    else:
        hull = inspector.GetConvexHull(geometry)
        points = np.array([hull.vertex(i) for i in range(hull.num_vertices())])
        local = _fill_box(0.5 * (points.max(axis=0) + points.min(axis=0)), 0.5 * np.ptp(points, axis=0), _HULL)
    ends = local[:, :6].reshape(-1, 2, 3) @ X_LG[:3, :3].T + X_LG[:3, 3]
    return np.hstack([ends.reshape(-1, 6), local[:, 6:]])


def _fill_box(centre: np.ndarray, half: np.ndarray, thickest: float = _THICKEST) -> np.ndarray:
    """(k, 7) capsules along the longest edge of a box of these half edges, side by side across the other two."""
    long, wide, thin = np.argsort(-half, kind="stable")
    r = float(np.clip(half[thin], _THINNEST, thickest))
    capsules = []
    for a in _spread(float(half[wide]), r):
        for b in _spread(float(half[thin]), r):
            ends = np.tile(centre, (2, 1)).astype(float)
            ends[:, wide] += a
            ends[:, thin] += b
            ends[:, long] += np.array([-1.0, 1.0]) * max(half[long] - r, 0.0)
            capsules.append(np.append(ends.ravel(), r))
    return np.array(capsules)


def _spread(half: float, r: float) -> np.ndarray:
    """Centres of circles of radius r that fill -half .. half with at most 2 r between neighbours."""
    room = half - r
    if room < 0.2 * r:
        return np.zeros(1)
    return np.linspace(-room, room, 1 + int(np.ceil(room / r)))


def _sphere_around(capsules: np.ndarray) -> np.ndarray:
    """(4,) centre and radius of a sphere that holds the capsules (k, 7)."""
    ends = capsules[:, :6].reshape(-1, 3)
    centre = 0.5 * (ends.max(axis=0) + ends.min(axis=0))
    radii = np.repeat(capsules[:, 6], 2)
    return np.append(centre, (np.linalg.norm(ends - centre, axis=1) + radii).max())


class CapsuleRows(NamedTuple):
    """Room for what `close_pairs` finds, an entry a pair of shapes that are close.

    Attributes:
        pair: (m,) index into the pairs.
        link: (m, 2) links of the two shapes.
        point: (m, 2, 3) nearest points of the two axes in W [m].
        normal: (m, 3) unit vector from the second point to the first.
        distance: (m,) between the surfaces [m].
    """

    pair: np.ndarray
    link: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    distance: np.ndarray


def row_shapes(m: int) -> tuple[tuple[tuple[int, ...], type], ...]:
    """Shapes and types of the arrays of a `CapsuleRows` with room for m pairs."""
    return ((m,), np.int64), ((m, 2), np.int64), ((m, 2, 3), float), ((m, 3), float), ((m,), float)


@njit(cache=True)
def make_rows(m: int) -> CapsuleRows:
    """A `CapsuleRows` with room for m pairs."""
    return CapsuleRows(
        np.empty(m, np.int64), np.empty((m, 2), np.int64), np.empty((m, 2, 3)), np.empty((m, 3)), np.empty(m)
    )


@njit(cache=True)
def _point_of_link(R: np.ndarray, p: np.ndarray, link: int, p_L: np.ndarray, out: np.ndarray) -> None:
    for a in range(3):
        out[a] = p[link, a] + R[link, a, 0] * p_L[0] + R[link, a, 1] * p_L[1] + R[link, a, 2] * p_L[2]


@njit(cache=True)
def closest_on_segments(
    a0: np.ndarray, a1: np.ndarray, b0: np.ndarray, b1: np.ndarray, a: np.ndarray, b: np.ndarray
) -> float:
    """Writes the nearest points a, b (3,) of two segments; returns their distance.

    Ericson, Real-Time Collision Detection, 2005, sec. 5.1.9.

    Args:
        a0, a1: (3,) ends of the first segment [m].
        b0, b1: (3,) ends of the second [m].
        a, b: (3,) written, in the same frame [m].
    """
    aa, bb, ab, ar, br = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        u, v, r = a1[k] - a0[k], b1[k] - b0[k], a0[k] - b0[k]
        aa += u * u
        bb += v * v
        ab += u * v
        ar += u * r
        br += v * r
    s, t = 0.0, 0.0
    if aa <= 1e-16 and bb > 1e-16:
        t = min(max(br / bb, 0.0), 1.0)
    elif bb <= 1e-16 and aa > 1e-16:
        s = min(max(-ar / aa, 0.0), 1.0)
    elif aa > 1e-16:
        denominator = aa * bb - ab * ab
        if denominator > 1e-12 * aa * bb:
            s = min(max((ab * br - ar * bb) / denominator, 0.0), 1.0)
        t = (ab * s + br) / bb
        if t < 0.0:
            t, s = 0.0, min(max(-ar / aa, 0.0), 1.0)
        elif t > 1.0:
            t, s = 1.0, min(max((ab - ar) / aa, 0.0), 1.0)
    squared = 0.0
    for k in range(3):
        a[k] = a0[k] + s * (a1[k] - a0[k])
        b[k] = b0[k] + t * (b1[k] - b0[k])
        squared += (a[k] - b[k]) ** 2
    return np.sqrt(squared)


@njit(cache=True)
def close_pairs(body: BodyCapsules, R: np.ndarray, p: np.ndarray, within: float, rows: CapsuleRows) -> int:
    """Finds the pairs of shapes closer than `within` [m] beyond their clearance, from the link poses of `forward`.

    Each gives one entry of `rows`, for the nearest two of its capsules. Returns how many; the rest is left out.

    Args:
        body: the shapes.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        within: [m].
        rows: written.
    """
    num_shapes, num_capsules = body.link.shape[0], body.radius.shape[0]
    centre = np.empty((num_shapes, 3))
    A, B = np.empty((num_capsules, 3)), np.empty((num_capsules, 3))
    placed = np.zeros(num_shapes, np.bool_)
    a, b = np.empty(3), np.empty(3)
    for s in range(num_shapes):
        _point_of_link(R, p, body.link[s], body.p_LC[s], centre[s])
    count = 0
    for k in range(body.pair.shape[0]):
        s, t = body.pair[k, 0], body.pair[k, 1]
        reach = body.reach[s] + body.reach[t] + body.clearance[k] + within
        dx, dy, dz = centre[s, 0] - centre[t, 0], centre[s, 1] - centre[t, 1], centre[s, 2] - centre[t, 2]
        if dx * dx + dy * dy + dz * dz > reach * reach or count == rows.pair.shape[0]:
            continue
        for shape in (s, t):
            link = int(body.link[shape])
            if not placed[shape]:
                placed[shape] = True
                for i in range(body.first[shape], body.first[shape + 1]):
                    _point_of_link(R, p, link, body.p_LA[i], A[i])
                    _point_of_link(R, p, link, body.p_LB[i], B[i])
        nearest = body.clearance[k] + within
        for i in range(body.first[s], body.first[s + 1]):
            for j in range(body.first[t], body.first[t + 1]):
                span = nearest + body.half[i] + body.half[j] + body.radius[i] + body.radius[j]
                if _between_middles(A[i], B[i], A[j], B[j]) > 4.0 * span * span:
                    continue
                length = closest_on_segments(A[i], B[i], A[j], B[j], a, b)
                if length - body.radius[i] - body.radius[j] < nearest:
                    nearest = length - body.radius[i] - body.radius[j]
                    _write_row(rows, count, k, int(body.link[s]), int(body.link[t]), a, b, length, nearest)
        if nearest < body.clearance[k] + within:
            count += 1
    return count


@njit(cache=True)
def _between_middles(a0: np.ndarray, a1: np.ndarray, b0: np.ndarray, b1: np.ndarray) -> float:
    """Four times the square of the distance between the middles of two segments."""
    x, y, z = a0[0] + a1[0] - b0[0] - b1[0], a0[1] + a1[1] - b0[1] - b1[1], a0[2] + a1[2] - b0[2] - b1[2]
    return x * x + y * y + z * z


@njit(cache=True)
def _write_row(
    rows: CapsuleRows,
    count: int,
    pair: int,
    link_a: int,
    link_b: int,
    a: np.ndarray,
    b: np.ndarray,
    length: float,
    distance: float,
) -> None:
    """Fills entry `count`: the nearest points a, b (3,) of the axes, `length` [m] apart."""
    rows.pair[count] = pair
    rows.link[count, 0], rows.link[count, 1] = link_a, link_b
    rows.distance[count] = distance
    for k in range(3):
        rows.point[count, 0, k], rows.point[count, 1, k] = a[k], b[k]
        # Axes that cross have no normal; any fixed one lets a step be made.
        rows.normal[count, k] = (a[k] - b[k]) / length if length > 1e-9 else 1.0 * (k == 2)


@njit(cache=True)
def distance_row(tree: KinematicTree, R: np.ndarray, p: np.ndarray, rows: CapsuleRows, k: int, row: np.ndarray) -> None:
    """Writes row (nv,), the derivative of distance k of `rows` with respect to v.

    The points' velocities differ along the normal only by the joints between the two links: the base moves both.

    Args:
        tree: of the robot.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        rows: from `close_pairs`.
        k: number of the distance.
        row: (nv,) written.
    """
    row[:] = 0.0
    n = rows.normal[k]
    for end in range(2):
        sign = 1.0 - 2.0 * end
        point = rows.point[k, end]
        i = rows.link[k, end]
        while i > 0:
            ax, ay, az = R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]
            if tree.prismatic[i]:
                row[5 + i] += sign * (n[0] * ax + n[1] * ay + n[2] * az)
            else:
                rx, ry, rz = point[0] - p[i, 0], point[1] - p[i, 1], point[2] - p[i, 2]
                row[5 + i] += sign * (
                    n[0] * (ay * rz - az * ry) + n[1] * (az * rx - ax * rz) + n[2] * (ax * ry - ay * rx)
                )
            i = tree.parent[i]
