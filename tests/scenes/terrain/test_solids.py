"""Inside and outside of solids against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from scenes.footholds.projection import set_down
from scenes.pose import pose_matrix
from scenes.terrain.closed_bodies import solid_of_triangles
from scenes.terrain.free_boxes import box_is_free, nothing_near
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.solids import in_solid, solid_at, solid_columns, winding
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain, TriangleMesh

FLOOR = Surface("floor", np.array([[-3.0, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]]))
HALF_SOLE = (0.11, 0.05)


def box(name: str, size: tuple[float, float, float], xyz: tuple[float, float, float], rpy=(0.0, 0.0, 0.0)) -> Box:
    return Box(name, np.array(size), pose_matrix(xyz, rpy))


def packed(*obstacles: Box | TriangleMesh) -> PackedTerrain:
    return pack_terrain(Terrain((FLOOR,), obstacles))


def ball(radius: float, points: int = 200, seed: int = 0) -> np.ndarray:
    """(K, 3, 3) the outward triangles of a polyhedron inscribed in a ball."""
    p = np.random.default_rng(seed).normal(size=(points, 3))
    p *= radius / np.linalg.norm(p, axis=1, keepdims=True)
    triangles = p[ConvexHull(p).simplices]
    outward = np.einsum("ij,ij->i", np.cross(*(triangles[:, k] - triangles[:, 0] for k in (1, 2))), triangles[:, 0]) > 0
    triangles[~outward] = triangles[~outward][:, ::-1]
    return triangles


ANGLE = st.floats(-3.0, 3.0)


@settings(max_examples=200)
@given(ANGLE, ANGLE, ANGLE, st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3))
def test_a_point_is_in_a_turned_box_if_its_coordinates_there_are(
    roll: float, pitch: float, yaw: float, point: list
) -> None:
    size, X = np.array([1.0, 0.7, 1.9]), pose_matrix((0.2, -0.1, 0.3), (roll, pitch, yaw))
    local = X[:3, :3].T @ (np.array(point) - X[:3, 3])
    margin = np.abs(local) - size / 2
    if abs(margin.max()) < 1e-6:
        return
    assert in_solid(packed(Box("b", size, X)), *point) == bool(margin.max() < 0)


def test_points_over_corners_edges_and_diagonals_are_decided_without_a_tolerance() -> None:
    terrain = packed(box("b", (2.0, 2.0, 2.0), (0.0, 0.0, 0.0)))
    ticks = np.linspace(-0.75, 0.75, 7)  # multiples of 0.25: many lie on the diagonals of the faces
    assert all(in_solid(terrain, x, y, z) for x in ticks for y in ticks for z in ticks)
    outside = (-1.25, -1.0 - 1e-9, 1.0 + 1e-9, 1.25)
    assert not any(in_solid(terrain, x, y, 0.0) for x in outside for y in (*ticks, -1.0, 1.0))
    assert not any(in_solid(terrain, x, y, z) for x in ticks for y in ticks for z in (-1.25, 1.25))


def test_a_closed_mesh_has_an_inside_and_an_open_one_has_none() -> None:
    triangles = ball(1.0)
    closed, holed = packed(TriangleMesh("ball", triangles)), packed(TriangleMesh("bowl", triangles[1:]))
    rng = np.random.default_rng(1)
    for point in rng.uniform(-1.2, 1.2, (300, 3)):
        r = np.linalg.norm(point)
        if r < 0.8 or r > 1.0:  # the polyhedron's faces lie between
            assert in_solid(closed, *point) == (r < 0.8)
        assert not in_solid(holed, *point)


def test_a_cavity_is_outside_and_what_overlaps_is_inside() -> None:
    shell = TriangleMesh("shell", np.concatenate([ball(1.0), ball(0.5, seed=1)[:, ::-1]]))
    hollow, overlapping = packed(shell), packed(box("a", (1, 1, 1), (0, 0, 0)), box("b", (1, 1, 1), (0.5, 0, 0)))
    assert not in_solid(hollow, 0.0, 0.0, 0.0)
    assert in_solid(hollow, 0.0, 0.65, 0.0)
    assert winding(overlapping, 0.25, 0.1, 0.0, -1) == 2
    assert in_solid(overlapping, 0.25, 0.1, 0.0)


def test_only_closed_bodies_of_a_mesh_count() -> None:
    sheet = np.array([[[5.0, 5, 1], [6, 5, 1], [6, 6, 1]]])
    terrain = Terrain((FLOOR,), (box("b", (1, 1, 1), (0, 0, 0)), TriangleMesh("m", np.concatenate([ball(1.0), sheet]))))
    solid = solid_of_triangles(terrain)
    assert (solid[:12] == 0).all()
    assert (solid[12:-1] == 1).all()
    assert solid[-1] == -1


def test_the_solid_around_a_point_is_named() -> None:
    boxes = (box("crate", (1, 1, 1), (0, 0, 0.5)), box("block", (1, 1, 1), (2, 0, 0.5)))
    terrain = Terrain((FLOOR,), boxes)
    arrays = pack_terrain(terrain)
    assert solid_at(terrain, arrays, 0.2, 0.0, 0.1) == "box 'crate'"
    assert solid_at(terrain, arrays, 2.0, 0.0, 0.1) == "box 'block'"
    assert solid_at(terrain, arrays, 1.0, 0.0, 0.1) == ""


@pytest.mark.parametrize("size", [(0.9, 0.9, 0.6), (4.0, 4.0, 3.0), (0.3, 0.2, 0.1)])
def test_no_sole_fits_wholly_inside_a_box(size: tuple[float, float, float]) -> None:
    bare, covered = packed(), packed(box("crate", size, (0.0, 0.0, size[2] / 2)))
    assert set_down(bare, "left_foot", 0.0, 0.0, 0.3, HALF_SOLE) is not None
    assert set_down(covered, "left_foot", 0.0, 0.0, 0.3, HALF_SOLE) is None
    beside = 0.5 * np.hypot(*size[:2]) + 0.13
    assert (set_down(covered, "left_foot", beside, 0.0, 0.3, HALF_SOLE) is not None) == (beside < 2.8)


def test_no_sole_fits_inside_a_closed_mesh_and_one_fits_on_it() -> None:
    block = box("", (1.0, 1.0, 0.4), (0.0, 0.0, 0.2)).triangles()
    top = Surface("top", np.array([[-0.5, -0.5, 0.4], [0.5, -0.5, 0.4], [0.5, 0.5, 0.4], [-0.5, 0.5, 0.4]]))
    terrain = pack_terrain(Terrain((FLOOR, top), (TriangleMesh("block", block),), (False, True)))
    foot = set_down(terrain, "left_foot", 0.0, 0.0, 0.0, HALF_SOLE)
    assert foot is not None and foot.p_WC[2] == 0.4
    assert set_down(terrain, "left_foot", 0.0, 0.0, 0.0, HALF_SOLE, (-np.inf, 0.3)) is None


def test_the_torso_is_not_free_inside_what_is_larger_than_it() -> None:
    terrain = packed(box("hall", (8.0, 8.0, 8.0), (0.0, 0.0, 0.0)))
    centre, size = np.array([0.0, 0.0, 1.2]), np.array([0.24, 0.56, 0.9])
    assert not box_is_free(terrain, np.zeros(3), 0.4, centre, size)
    assert not nothing_near(terrain, 0.0, 0.0, 0.3, 0.8, 1.6)
    assert box_is_free(terrain, np.array([0.0, 0.0, 4.0]), 0.4, centre, size)


def test_a_column_is_solid_only_where_nothing_of_it_is_free() -> None:
    wall, table = box("wall", (0.2, 2.0, 2.0), (0.0, 0.0, 1.0)), box("table", (1.0, 1.0, 0.1), (2.0, 0.0, 0.7))
    x = np.array([0.0, 0.05, 0.3, 2.0])
    assert solid_columns(packed(wall, table), x, np.zeros(4), 0.2, 1.0).tolist() == [True, True, False, False]
