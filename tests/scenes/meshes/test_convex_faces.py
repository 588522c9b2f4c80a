"""Triangles joined into convex polygons: same area, same planes, fewer pieces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from scenes.meshes.convex_faces import join_coplanar
from scenes.terrain.surface import polygon_normal
from scenes.terrain.terrain import Box


def area(polygon):
    rolled = np.roll(polygon, -1, axis=0)
    return 0.5 * np.linalg.norm(np.cross(polygon - polygon[0], rolled - polygon[0]).sum(axis=0))


def is_convex(polygon):
    normal = polygon_normal(polygon)
    before, after = polygon - np.roll(polygon, 1, axis=0), np.roll(polygon, -1, axis=0) - polygon
    return (np.cross(before, after) @ normal).min() > -1e-8


def grid(heights):
    """Triangles of a height field over the unit grid."""
    corners = [
        (np.array([[i, j], [i + 1, j], [i + 1, j + 1]]), np.array([[i, j], [i + 1, j + 1], [i, j + 1]]))
        for i in range(heights.shape[0] - 1)
        for j in range(heights.shape[1] - 1)
    ]
    return np.array([[[i, j, heights[i, j]] for i, j in triangle] for pair in corners for triangle in pair], float)


def test_a_box_has_six_faces():
    polygons = join_coplanar(Box("b", np.array([1.0, 2.0, 3.0]), np.eye(4)).triangles())
    assert sorted(round(area(p), 9) for p in polygons) == [2.0, 2.0, 3.0, 3.0, 6.0, 6.0]
    assert all(len(p) == 4 for p in polygons)


def test_no_triangles_no_polygons():
    assert join_coplanar(np.zeros((0, 3, 3))) == []


def test_triangles_of_opposite_winding_are_kept_apart():
    up = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]], float)
    down = np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0]], float)
    assert len(join_coplanar(np.array([up, down]))) == 2


def test_a_fold_is_kept():
    flat = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]], float)
    raised = np.array([[0, 0, 0], [1, 1, 0], [0, 1, 0.1]], float)
    assert len(join_coplanar(np.array([flat, raised]))) == 2


@given(st.lists(st.sampled_from([0.0, 0.0, 0.0, 0.3]), min_size=25, max_size=25))
def test_the_joined_faces_cover_what_the_triangles_cover(heights):
    triangles = grid(np.array(heights).reshape(5, 5))
    polygons = join_coplanar(triangles)
    assert len(polygons) <= len(triangles)
    assert sum(map(area, polygons)) == pytest.approx(sum(map(area, triangles)), rel=1e-9)
    for polygon in polygons:
        assert is_convex(polygon)
        assert np.abs((polygon - polygon[0]) @ polygon_normal(polygon)).max() < 1e-6
    # Every triangle's middle lies inside exactly one polygon of its plane (seen from above).
    for middle in triangles.mean(axis=1):
        inside = [_contains(p[:, :2], middle[:2]) for p in polygons]
        assert sum(inside) == 1


def test_flat_ground_becomes_few_pieces():
    assert len(join_coplanar(grid(np.zeros((5, 5))))) <= 6  # of 32 triangles


def _contains(polygon, point):
    hull = ConvexHull(polygon)
    return bool((hull.equations[:, :2] @ point + hull.equations[:, 2] < -1e-9).all())
