"""A robot's collision shapes as hulls of points with a radius, for compiled distance queries.

A sphere is one point, a capsule two, a box its eight corners, a convex mesh its hull's. Shapes without a core of few points
are drawn a little too large, so that distances to them come out too small, never too large: a cylinder becomes a prism
around it, an ellipsoid the box around it, a mesh of many corners the hull of some of them, thickened.
"""

from __future__ import annotations

import heapq
from itertools import product
from typing import NamedTuple

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    Mesh,
    Role,
    SceneGraphInspector,
    Sphere,
)

from optimization.multibody.convex_distance import hull_distance
from optimization.multibody.kinematics import Kinematics
from scenes.effector import EFFECTORS
from scenes.robots.plant import RobotPlant

MANY = 64  # corners of a mesh up to which all are kept; end effectors keep all
THICKER = 1e-3  # [m] by which a mesh with some of its corners is thickened: all others lie within
SIDES = 32  # of the prism around a cylinder; its edges stand out by 0.5 % of the radius


class RobotShapes(NamedTuple):
    """S shapes with N points.

    Attributes:
        link: (S,) the link of the kinematic tree that carries each shape.
        first: (S + 1,) shape s owns points first[s] to first[s + 1] - 1.
        p_LP: (N, 3) points in the link [m].
        radius: (S,) by which the hull of the points is thickened [m].
        p_LC: (S, 3) centre of a ball around each shape, in the link [m].
        reach: (S,) its radius [m].
        thicker: (S,) by how much a mesh was thickened in place of its other corners [m].
        effector: (S,) index of the end effector whose foot or hand the shape is, -1 for none.
        pair: (P, 2) shapes that may not meet, ascending: those that Drake would check against each other.
    """

    link: np.ndarray
    first: np.ndarray
    p_LP: np.ndarray
    radius: np.ndarray
    p_LC: np.ndarray
    reach: np.ndarray
    thicker: np.ndarray
    effector: np.ndarray
    pair: np.ndarray


def read_shapes(robot_plant: RobotPlant, kinematics: Kinematics) -> tuple[RobotShapes, tuple[str, ...]]:
    """The collision shapes of a robot, and the names of the bodies that they belong to.

    Args:
        robot_plant: Drake's model of the robot, with or without terrain.
        kinematics: of the same robot.

    Raises:
        ValueError: a shape of another kind than Drake's primitives and meshes.
    """
    inspector, plant = robot_plant.scene_graph.model_inspector(), robot_plant.plant
    link, points, radius, thicker, effector, names = [], [], [], [], [], []
    number: dict[GeometryId, int] = {}
    for geometry in sorted(inspector.GetAllGeometryIds(Role.kProximity), key=GeometryId.get_value):
        if geometry in robot_plant.terrain_geometry:
            continue
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).name()
        number[geometry] = len(names)
        own_link, X_LB = kinematics.bodies[body]
        X_LG = X_LB @ inspector.GetPoseInFrame(geometry).GetAsMatrix4()
        p_GP, rounding = _points(inspector, geometry)
        touching = next((e for e in range(len(EFFECTORS)) if geometry in robot_plant.effector_geometry[e]), -1)
        many = touching < 0 and len(p_GP) > MANY
        if many:
            p_GP, rounding = some_corners(p_GP, THICKER), THICKER
        link.append(own_link)
        points.append(p_GP @ X_LG[:3, :3].T + X_LG[:3, 3])
        radius.append(rounding)
        thicker.append(THICKER if many else 0.0)
        effector.append(touching)
        names.append(body)
    centre = np.array([0.5 * (p.min(axis=0) + p.max(axis=0)) for p in points]).reshape(-1, 3)
    reach = [np.linalg.norm(p - c, axis=1).max() + r for p, c, r in zip(points, centre, radius, strict=True)]
    shapes = RobotShapes(
        np.array(link, np.int64),
        np.cumsum([0] + [len(p) for p in points]),
        np.concatenate([*points, np.empty((0, 3))]),
        np.array(radius, float),
        centre,
        np.array(reach, float),
        np.array(thicker, float),
        np.array(effector, np.int64),
        _pairs(inspector, number),
    )
    return shapes, tuple(names)


def _pairs(inspector: SceneGraphInspector, number: dict[GeometryId, int]) -> np.ndarray:
    """(P, 2) pairs of numbered shapes that no collision filter excludes."""
    candidates = [pair for pair in inspector.GetCollisionCandidates() if pair[0] in number and pair[1] in number]
    return np.array(sorted(sorted((number[a], number[b])) for a, b in candidates), np.int64).reshape(-1, 2)


def _points(inspector: SceneGraphInspector, geometry: GeometryId) -> tuple[np.ndarray, float]:
    """(n, 3) points in the geometry's frame and the radius that thickens their hull [m]."""
    shape = inspector.GetShape(geometry)
    if isinstance(shape, Sphere):
        return np.zeros((1, 3)), shape.radius()
    if isinstance(shape, Capsule):
        half = 0.5 * shape.length()
        return np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]), shape.radius()
    if isinstance(shape, Box):
        return _corners(0.5 * np.array(shape.size(), float)), 0.0
    if isinstance(shape, Cylinder):
        turn = 2 * np.pi * np.arange(SIDES) / SIDES
        ring = shape.radius() / np.cos(np.pi / SIDES) * np.column_stack([np.cos(turn), np.sin(turn)])
        half = np.full((SIDES, 1), 0.5 * shape.length())
        return np.concatenate([np.hstack([ring, -half]), np.hstack([ring, half])]), 0.0
    if isinstance(shape, Ellipsoid):
        return _corners(np.array([shape.a(), shape.b(), shape.c()])), 0.0
    if isinstance(shape, (Convex, Mesh)):
        hull = inspector.GetConvexHull(geometry)
        return np.array([hull.vertex(k) for k in range(hull.num_vertices())]), 0.0
    raise ValueError(f"no distances are known for a collision shape of kind {type(shape).__name__}")


def some_corners(p: np.ndarray, away: float) -> np.ndarray:
    """(m, 3) so many of the points (n, 3) that no other is farther than `away` [m] from their hull.

    The farthest is added until none is left. Distances only fall when points are added, so old ones are upper bounds,
    and only that of the next point has to be up to date.

    Args:
        p: (n, 3) points [m].
        away: greatest distance that may remain [m].
    """
    near_p, near_hull = np.empty(3), np.empty(3)

    def distance(k: int) -> float:
        return hull_distance(p[k : k + 1], 1, hull, len(hull), np.inf, near_p, near_hull)

    hull = p[np.unique(np.concatenate([p.argmin(axis=0), p.argmax(axis=0)]))]
    farthest = [(-distance(k), k) for k in range(len(p))]
    heapq.heapify(farthest)
    while -farthest[0][0] > away:
        _, k = farthest[0]
        now = distance(k)
        if now > away and now >= -min(farthest[1:3])[0]:
            hull = np.concatenate([hull, p[k : k + 1]])
            now = 0.0
        heapq.heapreplace(farthest, (-now, k))
    return hull


def _corners(half: np.ndarray) -> np.ndarray:
    """(8, 3) corners of a box about the origin, from its half edges (3,) [m]."""
    return np.array(list(product((-1.0, 1.0), repeat=3))) * half
