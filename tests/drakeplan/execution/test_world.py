"""Bodies under polygons: a sphere that touches near an edge is pushed up, never to the side."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.geometry import (
    Convex,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    ProximityProperties,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform

from drakeplan.execution.world import CORNER, SLAB, _body_under, _depth
from scenes.terrain.surface import Surface

KITE = np.array([[0.35, 0.0, 0.05], [0.05, 0.3, 0.0], [-0.3, 0.05, -0.06], [-0.02, -0.3, -0.01]])


def surface() -> Surface:
    """A polygon that is no rectangle, tilted by some degrees."""
    normal = np.cross(KITE[1] - KITE[0], KITE[2] - KITE[0])
    normal /= np.linalg.norm(normal)
    flat = KITE - ((KITE - KITE[0]) @ normal)[:, None] * normal
    return Surface("kite", flat)


def plan(points: list[np.ndarray], on: list[int]) -> SimpleNamespace:
    X_WC = np.array([RigidTransform(p).GetAsMatrix4() for p in points]).reshape(-1, 4, 4)
    corners = 0.05 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return SimpleNamespace(contacts=SimpleNamespace(surface=np.array(on), X_WC=X_WC, corners=lambda k: corners))


def pushes(ground: Surface, depth: float, inside: float, count: int) -> np.ndarray:
    """(n,) angles between Drake's contact normals and the surface's, for spheres that far from the edge [rad]."""
    graph, rng = SceneGraph(), np.random.default_rng(0)
    source = graph.RegisterSource("test")
    body = GeometryInstance(RigidTransform(), Convex(_body_under(ground, depth).T, "body"), "body")
    ball = GeometryInstance(RigidTransform(), Sphere(CORNER), "ball")
    for part in (body, ball):
        part.set_proximity_properties(ProximityProperties())
    graph.RegisterAnchoredGeometry(source, body)
    frame = graph.RegisterFrame(source, GeometryFrame("ball"))
    graph.RegisterGeometry(source, frame, ball)
    context = graph.CreateDefaultContext()
    angles, V = [], ground.vertices
    for _ in range(count):
        k = rng.integers(len(V))
        a, b = V[k], V[(k + 1) % len(V)]
        inward = np.cross(ground.normal, (b - a) / np.linalg.norm(b - a))
        touch = a + rng.uniform(0.1, 0.9) * (b - a) + inside * inward
        pose = FramePoseVector()
        pose.set_value(frame, RigidTransform(touch + (CORNER - rng.uniform(1e-4, 1e-3)) * ground.normal))
        graph.get_source_pose_port(source).FixValue(context, pose)
        (found,) = graph.get_query_output_port().Eval(context).ComputePointPairPenetration()
        angles.append(np.arccos(min(1.0, abs(found.nhat_BA_W @ ground.normal))))
    return np.array(angles)


def test_near_an_edge_a_deep_body_pushes_up_where_a_plate_pushes_aside() -> None:
    ground = surface()
    deep = _depth(ground, 0, plan([np.array([2.0, 0.0, 0.0])], [1]))
    assert pushes(ground, deep, 0.001, 300).max() < 1e-3
    assert pushes(ground, SLAB, 0.001, 300).max() > 0.5  # what the depth is for


@pytest.mark.parametrize(("below", "share"), [(0.14, 0.25), (0.3, 0.5), (0.5, 1.0), (5.0, 2.0)])
def test_a_body_ends_above_contacts_under_its_surface(below: float, share: float) -> None:
    ground = surface()
    radius = np.linalg.norm(ground.vertices - ground.vertices.mean(axis=0), axis=1).max()
    under = ground.vertices.mean(axis=0) - [0.0, 0.0, below]
    assert _depth(ground, 0, plan([under], [1])) == pytest.approx(share * radius)
    assert _depth(ground, 0, plan([under], [0])) == pytest.approx(2.0 * radius)  # its own contacts do not count


def test_under_a_contact_right_below_only_a_plate_is_left() -> None:
    ground = surface()
    under = ground.vertices.mean(axis=0) - [0.0, 0.0, 0.08]
    assert _depth(ground, 0, plan([under], [1])) == SLAB
