"""The rectangle on which a foot stands: the largest one on the flat of its sole, along the toes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.spatial import ConvexHull, QhullError

from drakeplan.robot_setup.link_tree import LinkTree
from drakeplan.robot_setup.symmetry import alike, mirror_pose
from scenes.input_error import InputError

FLAT = 0.004  # [m] points nearer to the sole's plane than this belong to it
LEVEL = 0.0015  # [m] a sole spreads over points as near as this: others are round
SAME_PLANE = 0.9986  # cosine of 3 deg between facets of one plane
STEEPEST = 0.82  # cosine of 35 deg of the sole from the horizontal at the zero posture
SPLAY = np.deg2rad(20.0)  # of a sole's long edge from the robot's heading
LEAST_HALF = (0.025, 0.012)  # [m] half length and half width below which a foot is a point or a line
LEAST_OVERHANG = 0.006  # [m] less than this beyond the rectangle is no overhang
TALL = 0.10  # [m] of the foot above its sole that must have room
CUTS = 60  # positions of the rectangle's ends that are tried


@dataclass(frozen=True, eq=False)
class Sole:
    """A rectangle that carries.

    Attributes:
        link: that it sits on.
        body: of the link, whose frame the pose is given in.
        X_BE: (4, 4) contact frame in the body: centre of the rectangle, z out of the ground, x to the toes.
        half_extent: half length and half width [m].
        overhang: how far the foot reaches beyond the rectangle to the front, to the back and to each side [m].
        tilt: angle between the sole and the ground at the zero posture [rad].
    """

    link: str
    body: str
    X_BE: np.ndarray
    half_extent: tuple[float, float]
    overhang: tuple[float, float, float]
    tilt: float


def heading(tree: LinkTree, feet: Sequence[str]) -> np.ndarray:
    """(3,) unit vector to the front at the zero posture, from right to left foot turned by a right angle.

    Args:
        tree: of the robot.
        feet: links of the left and the right foot.

    Raises:
        InputError: one foot stands in the other.
    """
    across = tree.origin(feet[0]) - tree.origin(feet[1])
    across[2] = 0.0
    if np.linalg.norm(across) < 1e-3:
        across = tree.origin(tree.way(feet[0])[1]) - tree.origin(tree.way(feet[1])[1])
        across[2] = 0.0
    if np.linalg.norm(across) < 1e-3:
        raise InputError(f"links {feet[0]!r} and {feet[1]!r}: one foot is in the other at the zero posture")
    across /= np.linalg.norm(across)
    return np.array([across[1], -across[0], 0.0])


def find_soles(tree: LinkTree, feet: Sequence[str]) -> tuple[Sole, Sole]:
    """The soles of both feet, with the same size.

    Args:
        tree: of the robot.
        feet: links of the left and the right foot.

    Raises:
        InputError: a foot has no shape, or no flat sole.
    """
    front = heading(tree, feet)
    left, right = (_sole(tree, foot, front) for foot in feet)
    size = np.minimum(left.half_extent, right.half_extent)
    overhang = np.maximum(left.overhang, right.overhang)
    shared = {"half_extent": (float(size[0]), float(size[1])), "overhang": tuple(float(v) for v in overhang)}
    left, right = (Sole(**{**vars(s), **shared}) for s in (left, right))
    X_WR = mirror_pose(tree.pose(left.body) @ left.X_BE, front)
    if alike(X_WR, tree.pose(right.body) @ right.X_BE):  # meshes of both sides differ by some millimetres
        right = replace(right, X_BE=np.linalg.inv(tree.pose(right.body)) @ X_WR)
    return left, right


def _sole(tree: LinkTree, foot: str, front: np.ndarray) -> Sole:
    points = np.concatenate([tree.links[n].points for n in tree.below(foot)])
    if len(points) < 3:
        raise InputError(f"link {foot!r}: the foot has no shape: give it a <collision>, or name another link")
    down = _normal(points, foot)
    flat = points[points @ down > (points @ down).max() - FLAT]
    up = -down
    x = front - (front @ up) * up
    x /= np.linalg.norm(x)
    R = np.column_stack([x, np.cross(up, x), up])
    outline = shapely.MultiPoint(flat @ R[:, :2]).convex_hull
    turn = _long_edge(outline)
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    R[:, :2] = R[:, :2] @ turned
    outline = shapely.MultiPoint(flat @ R[:, :2]).convex_hull
    if not isinstance(outline, shapely.Polygon):
        raise InputError(_no_sole(foot, np.ptp(flat @ R[:, :2], axis=0)))
    low, high = largest_rectangle(np.array(outline.exterior.coords)[:-1])
    half = 0.5 * (high - low)
    if half[0] < LEAST_HALF[0] or half[1] < LEAST_HALF[1]:
        raise InputError(_no_sole(foot, 2 * half))
    width = np.ptp(points[points @ down > (points @ down).max() - LEVEL] @ R[:, :2], axis=0)
    if (width < 2 * np.array(LEAST_HALF)).any():
        raise InputError(_no_sole(foot, width))
    low_part = (points - flat.mean(axis=0)) @ up < TALL
    reach = points[low_part] @ R[:, :2]
    beyond = np.concatenate([reach.max(axis=0) - high, low - reach.min(axis=0)])  # front, left, back, right
    overhang = [beyond[0], beyond[2], max(beyond[1], beyond[3])]
    X_WE = np.eye(4)
    X_WE[:3, :3] = R
    X_WE[:3, 3] = R @ np.array([*(0.5 * (low + high)), float((flat @ up).min())])
    X_WB = tree.pose(foot)
    return Sole(
        link=foot,
        body=foot,
        X_BE=np.linalg.inv(X_WB) @ X_WE,
        half_extent=(float(half[0]), float(half[1])),
        overhang=tuple(float(v) if v > LEAST_OVERHANG else 0.0 for v in overhang),  # type: ignore[arg-type]
        tilt=float(np.arccos(np.clip(up[2], -1, 1))),
    )


def _no_sole(foot: str, size: np.ndarray) -> str:
    return (
        f"link {foot!r}: its sole is {1e3 * size[0]:.0f} x {1e3 * size[1]:.0f} mm, a point or a line: plans need a flat sole of "
        f"at least {2e3 * LEAST_HALF[0]:.0f} x {2e3 * LEAST_HALF[1]:.0f} mm (name the foot with --left-foot LINK if this is "
        "another link)"
    )


def _normal(points: np.ndarray, foot: str) -> np.ndarray:
    """(3,) outward normal of the largest plane below the foot's hull."""
    try:
        hull = ConvexHull(points)
    except QhullError:
        centred = points - points.mean(axis=0)
        normal = np.linalg.svd(centred, full_matrices=False)[2][-1]
        if np.abs(centred @ normal).max() > FLAT:
            raise InputError(f"link {foot!r}: its shape is a point or a line: plans need a flat sole") from None
        return normal if normal[2] < 0 else -normal
    corners = points[hull.simplices]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    normals = hull.equations[:, :3]
    below = normals[:, 2] < -STEEPEST
    if not below.any():
        return np.array([0.0, 0.0, -1.0])
    together = (normals @ normals.T > SAME_PLANE) @ np.where(below, area, 0.0)
    best = np.argmax(np.where(below, together, -1.0))
    share = np.where((normals @ normals[best] > SAME_PLANE) & below, area, 0.0)
    mean = share @ normals
    return mean / np.linalg.norm(mean)


def _long_edge(outline: shapely.Geometry) -> float:
    """Angle of the outline's tightest rectangle from the heading, 0 where that is more than a foot splays [rad]."""
    box = shapely.minimum_rotated_rectangle(outline)
    if not isinstance(box, shapely.Polygon):
        return 0.0
    corners = np.array(box.exterior.coords)
    edges = np.diff(corners, axis=0)
    longest = edges[np.argmax(np.linalg.norm(edges, axis=1))]
    angle = float(np.arctan2(longest[1], longest[0]))
    angle = (angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    return angle if abs(angle) < SPLAY else 0.0


def largest_rectangle(polygon: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner, (2,) each, of the largest rectangle along the axes inside a convex polygon.

    Between two positions along x the polygon is as wide as at the narrower of them: its upper border is concave, its
    lower one convex.

    Args:
        polygon: (V, 2) corners in order.
    """
    xs = np.linspace(polygon[:, 0].min(), polygon[:, 0].max(), CUTS + 1)
    lower, upper = np.full(len(xs), np.inf), np.full(len(xs), -np.inf)
    for p, q in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        low, high = sorted((p[0], q[0]))
        inside = (xs >= low - 1e-12) & (xs <= high + 1e-12)
        if high - low < 1e-12:
            ends = np.array([[p[1], q[1]]] * int(inside.sum())).reshape(-1, 2)
        else:
            y = p[1] + (xs[inside] - p[0]) / (q[0] - p[0]) * (q[1] - p[1])
            ends = np.column_stack([y, y])
        lower[inside] = np.minimum(lower[inside], ends.min(axis=1))
        upper[inside] = np.maximum(upper[inside], ends.max(axis=1))
    i, j = np.triu_indices(len(xs), k=1)
    low, high = np.maximum(lower[i], lower[j]), np.minimum(upper[i], upper[j])
    area = (xs[j] - xs[i]) * np.maximum(high - low, 0.0)
    best = int(np.argmax(area))
    return np.array([xs[i[best]], low[best]]), np.array([xs[j[best]], high[best]])
