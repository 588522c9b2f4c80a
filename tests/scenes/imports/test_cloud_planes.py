"""Point clouds: planes, outlines and sides, against ground whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes.imports.cloud_outlines import outlines_of
from scenes.imports.cloud_planes import planes_of
from scenes.imports.cloud_terrain import CloudTerrain, cloud_terrain
from scenes.imports.leftover_boxes import leftover_boxes
from scenes.imports.surfels import STEPS, surfels_of
from scenes.imports.trimmed_walls import trimmed_wall
from scenes.pose import rpy_rotation
from scenes.terrain.usable_area import covered_area

NOISE = 0.003  # [m]
DENSITY = 12_000  # points in a square metre


def patch(corner: tuple, along: tuple, across: tuple, rng: np.random.Generator, density: float = DENSITY) -> np.ndarray:
    """(N, 3) points drawn evenly on a parallelogram, with noise."""
    area = np.linalg.norm(np.cross(along, across))
    share = rng.random((int(density * area), 2))
    return np.array(corner) + share @ np.array([along, across]) + NOISE * rng.standard_normal((len(share), 3))


def stairs(rng: np.random.Generator) -> np.ndarray:
    """Two steps of 0.15 m between floors, 1 m wide."""
    parts = [patch((-1, 0, 0), (1, 0, 0), (0, 1, 0), rng)]
    for k in range(2):
        parts.append(patch((0.3 * k, 0, 0.15 * k), (0, 1, 0), (0, 0, 0.15), rng))
        parts.append(patch((0.3 * k, 0, 0.15 * (k + 1)), (0.3 if k == 0 else 0.8, 0, 0), (0, 1, 0), rng))
    return np.concatenate(parts)


@pytest.fixture(scope="module")
def steps() -> CloudTerrain:
    return cloud_terrain(stairs(np.random.default_rng(0)), friction=0.6, close=0.05)


def test_stairs_come_out_with_their_heights_normals_and_edges(steps: CloudTerrain) -> None:
    """Normals within a degree and edges within 2 cm, at 3 mm noise."""
    level = sorted((s for s in steps.surfaces if s.tilt < 0.5), key=lambda s: s.centroid[2])
    upright = [s for s in steps.surfaces if s.tilt > 1.0]
    assert covered_area(level) == pytest.approx(1.0 + 0.3 + 0.8, rel=0.05)
    assert covered_area(upright) == pytest.approx(0.3, rel=0.12)
    assert not steps.boxes
    heights = np.round(np.array([s.centroid[2] for s in level]) / 0.15).astype(int)
    assert set(heights) == {0, 1, 2}
    spans = {0: (-1.0, 0.0), 1: (0.0, 0.3), 2: (0.3, 1.1)}
    for surface, k in zip(level, heights, strict=True):
        assert surface.tilt < np.deg2rad(1.0)
        assert np.abs(surface.vertices[:, 2] - 0.15 * k).max() < 0.002
        assert surface.vertices[:, 0].min() > spans[k][0] - 0.02
        assert surface.vertices[:, 0].max() < spans[k][1] + 0.02
    for k, (low, high) in spans.items():
        corners = np.concatenate([s.vertices for s, h in zip(level, heights, strict=True) if h == k])
        np.testing.assert_allclose(
            [*corners[:, :2].min(axis=0), *corners[:, :2].max(axis=0)], [low, 0, high, 1], atol=0.02
        )


def test_risers_face_the_ground_at_their_foot_and_end_at_the_tread_above(steps: CloudTerrain) -> None:
    upright = [s for s in steps.surfaces if s.tilt > 1.0]
    assert {round(s.centroid[0] / 0.3) for s in upright} == {0, 1}
    for surface in upright:
        assert surface.normal[0] < -np.cos(np.deg2rad(1.0))
        top = 0.15 * (round(surface.centroid[0] / 0.3) + 1)
        assert surface.vertices[:, 2].max() < top + 0.001


def test_planes_do_not_depend_on_where_the_cloud_lies_and_how_it_is_turned() -> None:
    points = stairs(np.random.default_rng(1))[::4]
    R, moved = rpy_rotation((0.2, -0.1, 0.7)), np.array([120.0, -80.0, 15.0])
    one, two = planes_of(points, 0.04), planes_of(points @ R.T + moved, 0.04)
    for found in (one, two):
        big = np.bincount(found.plane[found.plane >= 0]) > 200
        assert big.sum() == 5
    for normal in one.axes[np.bincount(one.plane[one.plane >= 0], minlength=len(one.origin)) > 200, 2]:
        assert np.abs(two.axes[:, 2] @ (R @ normal)).max() > np.cos(np.deg2rad(0.5))


def test_two_floors_over_each_other_and_a_wall_between_them_are_found() -> None:
    rng = np.random.default_rng(2)
    points = np.concatenate([
        patch((0, 0, 0), (2, 0, 0), (0, 1, 0), rng),
        patch((0, 0, 2.2), (2, 0, 0), (0, 1, 0), rng),
        patch((2, 0, 0), (0, 1, 0), (0, 0, 2.2), rng),
    ])  # fmt: skip
    surfaces = cloud_terrain(points, friction=0.5, close=0.05).surfaces
    level = {round(s.centroid[2], 1) for s in surfaces if s.tilt < 0.5}
    assert level == {0.0, 2.2}
    assert all(s.normal[0] < -0.99 for s in surfaces if s.tilt > 1.0)


def test_normals_of_the_file_or_the_place_of_the_sensor_tell_the_outer_side() -> None:
    points = patch((0, 0, 2), (2, 0, 0), (0, 2, 0), np.random.default_rng(3))
    up = cloud_terrain(points, friction=0.5, close=0.05).surfaces
    below = cloud_terrain(points, friction=0.5, close=0.05, viewpoint=np.array([1.0, 1.0, 0.5])).surfaces
    said = cloud_terrain(points, friction=0.5, close=0.05, normals=np.tile([0.0, 0.0, -1.0], (len(points), 1))).surfaces
    assert all(s.normal[2] > 0.99 for s in up)
    assert all(s.normal[2] < -0.99 and s.name.startswith("ceiling") for s in (*below, *said))


def test_shallow_blocks_on_a_floor_keep_their_tops_though_planes_cross_in_wide_strips() -> None:
    rng = np.random.default_rng(4)
    tops = []
    parts = [patch((-0.5, -0.5, 0), (2, 0, 0), (0, 1, 0), rng, 8000)]
    for k in range(3):
        R = rpy_rotation((0.12 * (-1) ** k, 0.1, 0.0))
        corner = np.array([-0.4 + 0.6 * k, -0.2, 0.12])
        tops.append(R[:, 2])
        parts.append(patch(tuple(corner), tuple(0.4 * R[:, 0]), tuple(0.4 * R[:, 1]), rng, 8000))
    found = planes_of(np.concatenate(parts), 0.025)
    starts = np.cumsum([0, *map(len, parts)])
    for k, normal in enumerate(tops, 1):
        own = found.plane[starts[k] : starts[k + 1]]
        main = np.bincount(own[own >= 0]).argmax()
        assert (own == main).mean() > 0.93
        assert found.axes[main, 2] @ normal > np.cos(np.deg2rad(1.0))


def test_a_pole_becomes_boxes_that_hold_it_and_scattered_points_become_nothing() -> None:
    rng = np.random.default_rng(5)
    angle = rng.uniform(0, 2 * np.pi, 1500)
    pole = np.stack([0.5 + 0.015 * np.cos(angle), 0.5 + 0.015 * np.sin(angle), rng.uniform(0.0, 1.5, 1500)], axis=1)
    stray = rng.uniform((0, 0, 0.3), (1, 1, 1.5), (60, 3))
    points = np.concatenate([patch((0, 0, 0), (1, 0, 0), (0, 1, 0), rng), pole, stray])
    found = cloud_terrain(points, friction=0.5, close=0.05)
    assert covered_area(s for s in found.surfaces if s.tilt < 0.5) == pytest.approx(1.0, rel=0.05)
    solid = np.concatenate(
        [b.triangles().reshape(-1, 3) for b in found.boxes] + [s.vertices for s in found.surfaces if s.tilt > 0.5]
    )
    assert np.linalg.norm(solid[:, :2] - 0.5, axis=1).max() < 0.05
    assert 1.4 < solid[:, 2].max() < 1.52
    assert found.noise <= 60


def test_small_holes_are_filled_and_large_ones_stay() -> None:
    rng = np.random.default_rng(6)
    flat = rng.random((20_000, 2))
    flat = flat[(np.linalg.norm(flat - 0.25, axis=1) > 0.02) & (np.linalg.norm(flat - 0.7, axis=1) > 0.12)]
    (shape,), filled = outlines_of(flat, 20_000, close=0.05)
    assert len(shape.interiors) == 1
    assert filled == pytest.approx(np.pi * 0.02**2, rel=0.5)
    hole = shapely.Polygon(shape.interiors[0])
    assert hole.centroid.distance(shapely.Point(0.7, 0.7)) < 0.01
    assert hole.area == pytest.approx(np.pi * 0.12**2, rel=0.25)
    assert shape.exterior.envelope.area == pytest.approx(1.0, rel=0.03)


@settings(max_examples=8)
@given(
    turn=st.floats(-3.0, 3.0),
    size=st.tuples(st.floats(0.15, 1.5), st.floats(0.15, 1.5)),
    density=st.floats(3_000, 40_000),
    seed=st.integers(0, 1000),
)
def test_a_rectangle_keeps_four_edges_within_two_cells_whatever_way_it_lies(
    turn: float, size: tuple[float, float], density: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    points = rng.random((int(density * size[0] * size[1]), 2)) * size @ R.T
    true = shapely.Polygon(np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size @ R.T)
    (shape,), _ = outlines_of(points, density, close=0.0)
    cell = max(np.sqrt(4 / density), 0.008)
    assert shapely.hausdorff_distance(shape.exterior, true.exterior) < 3.5 * cell
    assert shape.area == pytest.approx(true.area, abs=true.length * cell)


def test_surfels_hold_every_point_once_and_know_their_neighbours() -> None:
    points = np.random.default_rng(7).uniform(-1, 1, (3000, 3))
    surfels = surfels_of(points, 0.2)
    assert surfels.count.sum() == len(points)
    np.testing.assert_allclose(surfels.count @ surfels.points, points.sum(axis=0))
    middle = np.floor((surfels.points - points.min(axis=0)) / 0.2)
    row, step = np.nonzero(surfels.around >= 0)
    np.testing.assert_array_equal(middle[surfels.around[row, step]] - middle[row], STEPS[step])
    graph = surfels.graph()
    assert abs(graph - graph.T).sum() == 0


def test_boxes_hold_all_points_that_are_no_noise_and_no_more_space_than_their_cells() -> None:
    rng = np.random.default_rng(8)
    points = np.concatenate([rng.uniform(0, 0.48, (30_000, 3)), [[3.0, 3.0, 3.0]]])
    boxes, noise, _ = leftover_boxes(points)
    assert noise == 1
    inside = ((points[:, None] >= boxes[:, 0] - 1e-9) & (points[:, None] <= boxes[:, 1] + 1e-9)).all(axis=2).any(axis=1)
    assert inside[:-1].all() and not inside[-1]
    assert np.prod(boxes[:, 1] - boxes[:, 0], axis=1).sum() <= 0.48**3
    assert len(boxes) < 20
    assert leftover_boxes(np.zeros((0, 3)))[0].shape == (0, 2, 3)


def test_a_wall_is_cut_at_the_ground_above_it_but_not_where_it_goes_on() -> None:
    """A wall in the plane x = 0, 2 m wide: to 0.16 m on its left half, to 0.5 m on the right; ground at 0.15 m behind it."""
    R_W = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # axes y and z, normal x
    wall = shapely.Polygon([(0, 0), (2, 0), (2, 0.5), (1, 0.5), (1, 0.16), (0, 0.16)])
    ground = shapely.Polygon([(0.005, 0), (1, 0), (1, 2), (0.005, 2)])
    cut = trimmed_wall(wall, (np.zeros(3), R_W), ground, (np.array([0.0, 0.0, 0.15]), np.eye(3)))
    expected = shapely.Polygon([(0, 0), (2, 0), (2, 0.5), (1, 0.5), (1, 0.15), (0, 0.15)])
    assert cut.symmetric_difference(expected).area < 1e-5
    far = shapely.transform(ground, lambda xy: xy + np.array([0.5, 0.0]))
    assert (
        trimmed_wall(wall, (np.zeros(3), R_W), far, (np.array([0.0, 0.0, 0.15]), np.eye(3)))
        .symmetric_difference(wall)
        .area
        < 1e-9
    )
