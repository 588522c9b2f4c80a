"""Circles that an end effector's centre may be in: against polygons, brute force and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes.contact import contact_rotation
from scenes.footholds.circle_cover import cover_free_space, free_radius, polygon_distance
from scenes.footholds.contact_regions import ContactRegions, cover_terrain
from scenes.footholds.free_space import FreeSpace
from scenes.library.plates import level_plate, rectangle, tilted_plate
from scenes.pose import rpy_rotation
from scenes.robots.robot import EffectorSpec
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.polygon import convex_hull
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain, terrain_from

FOOT = EffectorSpec("left_foot", "left_foot", (0.11, 0.05))
PALM = EffectorSpec("right_palm", "right_palm", (0.045, 0.045))
ATOL = 1e-9
ANGLES = np.linspace(0.0, 2.0 * np.pi, 13)
tilts = st.floats(-0.4, 0.4)


def corners(X_WC: np.ndarray, spec: EffectorSpec, turn: float) -> np.ndarray:
    """(n, 4, 3) corners of patches at poses (n, 4, 4), turned about their normals."""
    hx, hy = spec.half_extent
    flat = np.array([[hx, hy, 0], [-hx, hy, 0], [-hx, -hy, 0], [hx, -hy, 0]])
    c, s = np.cos(turn), np.sin(turn)
    flat = flat @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return X_WC[:, None, :3, 3] + np.einsum("nij,fj->nfi", X_WC[:, :3, :3], flat)


def least_inside(surface: Surface, points: np.ndarray) -> float:
    """How far the outermost of some points (..., 3) of a surface's plane is inside its edges [m]."""
    edges = np.roll(surface.vertices, -1, axis=0) - surface.vertices
    inward = np.cross(surface.normal, edges / np.linalg.norm(edges, axis=1, keepdims=True))
    return float((((points[..., None, :] - surface.vertices) * inward).sum(axis=-1)).min())


def on_rims(regions: ContactRegions) -> np.ndarray:
    """(K, A, 4, 4) poses of each region's frame moved around its rim."""
    poses = np.tile(regions.X_WR[:, None], (1, len(ANGLES), 1, 1))
    rim = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
    offset = np.einsum("kij,aj->kai", regions.X_WR[:, :3, :2], rim) * regions.radius[:, None, None]
    poses[:, :, :3, 3] += offset
    return poses


@settings(max_examples=8, deadline=None)
@given(tilts, tilts, st.floats(-3.0, 3.0), st.floats(0.25, 0.7), st.floats(0.12, 0.6))
def test_wherever_the_centre_is_in_a_circle_the_patch_is_on_the_surface(
    roll: float, pitch: float, yaw: float, length: float, width: float
) -> None:
    surface = tilted_plate("stone", (0.3, -0.2, 0.1), rectangle(length, width), roll, pitch, yaw)
    packed = pack_terrain(terrain_from([surface]))
    for heading, turn, turns in ((None, 0.0, ANGLES), (0.7, 0.0, [0.0]), (-0.4, 0.3, np.linspace(-0.3, 0.3, 7))):
        regions = cover_terrain(packed, FOOT, heading=heading, turn=turn)
        for angle in turns if len(regions) else ():
            patches = corners(on_rims(regions).reshape(-1, 4, 4), FOOT, angle)
            assert np.abs((patches - surface.vertices[0]) @ surface.normal).max() < 1e-9
            assert least_inside(surface, patches) > 0.0


def test_a_frame_has_the_axes_of_a_contact_with_that_heading() -> None:
    surface = tilted_plate("stone", (0.0, 0.0, 0.0), rectangle(0.5, 0.5), 0.2, -0.3, 0.4)
    regions = cover_terrain(pack_terrain(terrain_from([surface])), FOOT, heading=1.1)
    expected = contact_rotation("left_foot", surface.normal, 1.1)
    np.testing.assert_allclose(regions.X_WR[:, :3, :3] - expected, 0.0, atol=ATOL)


def test_the_cover_of_a_rectangle_is_almost_all_of_where_the_centre_may_be() -> None:
    packed = pack_terrain(terrain_from([level_plate("stone", (-0.2, 0.2), (-0.15, 0.15))]))
    half = np.array([0.2 - 0.11, 0.15 - 0.05])  # heading along x: a rectangle shrunk by a rectangle
    x = np.random.default_rng(0).uniform(-half, half, (20000, 2))

    def fraction(finest: float) -> float:
        regions = cover_terrain(packed, FOOT, heading=0.0, finest=finest)
        away = np.linalg.norm(x[:, None] - regions.X_WR[None, :, :2, 3], axis=2)
        return float((away <= regions.radius).any(axis=1).mean())

    coarse, fine = fraction(0.04), fraction(0.01)
    assert coarse < fine
    assert fine > 0.94


def test_no_rotation_asked_for_leaves_the_rectangle_less_the_circle_around_the_patch() -> None:
    packed = pack_terrain(terrain_from([level_plate("stone", (-0.3, 0.3), (-0.2, 0.2))]))
    regions = cover_terrain(packed, FOOT)
    assert regions.radius.max() == pytest.approx(0.2 - np.hypot(0.11, 0.05), abs=2e-4)
    reach = np.abs(regions.X_WR[:, :2, 3]) + regions.radius[:, None]
    assert (reach.max(axis=0) <= np.array([0.3, 0.2]) - np.hypot(0.11, 0.05) + ATOL).all()


def test_no_circle_lies_within_another() -> None:
    packed = pack_terrain(terrain_from([level_plate("stone", (-0.2, 0.2), (-0.2, 0.2))]))
    regions = cover_terrain(packed, FOOT)
    p, r = regions.X_WR[:, :3, 3], regions.radius
    for k in range(1, len(regions)):
        assert (np.linalg.norm(p[:k] - p[k], axis=1) + r[k] > 0.998 * r[:k]).all()


def test_what_stands_above_a_surface_is_kept_clear_of_by_the_whole_foot() -> None:
    ground = level_plate("ground", (-1.0, 1.0), (-1.0, 1.0))
    step = level_plate("step", (0.2, 1.0), (-1.0, 1.0), z=0.05)
    ceiling = level_plate("ceiling", (-1.0, 1.0), (0.5, 1.0), z=0.5)  # too high to matter
    packed = pack_terrain(terrain_from([ground, step, ceiling]))
    regions = cover_terrain(packed, FOOT, heading=0.0, surfaces=[0])
    furthest = (regions.X_WR[:, 0, 3] + regions.radius).max()
    assert 0.2 - 0.11 - 0.01 < furthest <= 0.2 - 0.11 + ATOL
    assert (regions.X_WR[:, 1, 3] + regions.radius).max() > 0.9
    clumsy = EffectorSpec("left_foot", "left_foot", (0.11, 0.05), overhang=(0.06, 0.0, 0.0))
    furthest = (lambda r: (r.X_WR[:, 0, 3] + r.radius).max())(cover_terrain(packed, clumsy, heading=0.0, surfaces=[0]))
    assert furthest <= 0.2 - 0.17 + ATOL


def test_obstacles_keep_their_distance_for_every_rotation() -> None:
    ground = level_plate("ground", (-1.0, 1.0), (-1.0, 1.0))
    pillar = Box("pillar", np.array([0.2, 0.2, 1.0]), np.eye(4))
    regions = cover_terrain(pack_terrain(Terrain((ground,), (pillar,))), FOOT)
    square = shapely.box(-0.1, -0.1, 0.1, 0.1)
    gaps = np.array([square.distance(shapely.Point(X[:2, 3])) for X in regions.X_WR])
    assert (gaps >= regions.radius + np.hypot(0.11, 0.05) - 1e-9).all()


def test_a_window_keeps_the_circles_about_a_point_and_covers_as_much_there() -> None:
    ground = tilted_plate("ground", (0.0, 0.0, 0.0), rectangle(3.0, 3.0), 0.2, 0.1)
    step = level_plate("step", (0.2, 1.0), (-1.0, 1.0), z=0.2)
    packed = pack_terrain(terrain_from([ground, step]))
    point = np.array([0.1, 0.2, 0.05])
    regions = cover_terrain(packed, FOOT, heading=0.0, surfaces=[0], around=point, reach=0.3)
    everywhere = cover_terrain(packed, FOOT, heading=0.0, surfaces=[0])
    local = (regions.X_WR[:, :3, 3] - point) @ regions.X_WR[0, :3, :2]
    assert (np.abs(local).max(axis=1) + regions.radius).max() <= 0.3 + ATOL
    x = np.random.default_rng(0).uniform(-0.29, 0.29, (4000, 2))
    onto = point - ((point - ground.centroid) @ ground.normal) * ground.normal
    samples = onto + x @ regions.X_WR[0, :3, :2].T

    def held(r: ContactRegions) -> np.ndarray:
        return (np.linalg.norm(samples[:, None] - r.X_WR[None, :, :3, 3], axis=2) <= r.radius).any(axis=1)

    assert held(regions).mean() > 0.97 * held(everywhere).mean() > 0.1
    assert not (held(regions) & ~held(everywhere)).mean() > 0.03


def test_palms_get_walls_and_feet_get_ground() -> None:
    ground = level_plate("ground", (-0.5, 0.5), (-0.5, 0.5))
    wall = tilted_plate("wall", (0.0, 1.0, 1.5), rectangle(0.4, 0.4), np.pi / 2, 0.0)
    packed = pack_terrain(terrain_from([ground, wall]))
    assert set(cover_terrain(packed, FOOT).surface) == {0}
    assert set(cover_terrain(packed, PALM).surface) == {1}


def test_a_surface_smaller_than_the_patch_has_no_region() -> None:
    regions = cover_terrain(
        pack_terrain(terrain_from([level_plate("chip", (0.0, 0.15), (0.0, 0.3))])), FOOT, heading=0.0
    )
    assert len(regions) == 0
    assert regions.nearest(np.eye(4)) == (-1, np.inf)


# ---- distance, eq. 4.4


def one_region(radius: float = 0.1) -> ContactRegions:
    X_WR = np.eye(4)
    X_WR[:3, :3], X_WR[:3, 3] = rpy_rotation([0.2, -0.3, 0.5]), [0.4, 0.1, -0.2]
    return ContactRegions(np.array([3]), X_WR[None], np.array([radius]))


def seen_from(regions: ContactRegions, p_R: tuple[float, float, float], rpy: tuple[float, float, float]) -> np.ndarray:
    X_RC = np.eye(4)
    X_RC[:3, :3], X_RC[:3, 3] = rpy_rotation(rpy), p_R
    return regions.X_WR[0] @ X_RC


def test_the_distance_is_that_of_the_document() -> None:
    regions = one_region()
    assert regions.distance(seen_from(regions, (0.06, 0.0, 0.0), (0, 0, 2.0)))[0] == pytest.approx(0.0, abs=ATOL)
    assert regions.distance(seen_from(regions, (0.0, 0.4, 0.0), (0, 0, 0)))[0] == pytest.approx(0.3)
    assert regions.distance(seen_from(regions, (0.0, 0.5, -0.3), (0, 0, 0)))[0] == pytest.approx(0.5)
    tipped = seen_from(regions, (0.4, 0.0, 0.0), (0.6, 0, 0))
    assert regions.distance(tipped)[0] == pytest.approx(0.3 + 0.5 * (1.0 - np.cos(0.6)))
    assert regions.distance(tipped, tilt_weight=2.0)[0] == pytest.approx(0.3 + 2.0 * (1.0 - np.cos(0.6)))


pose_numbers = st.tuples(*[st.floats(-0.5, 0.5)] * 3, *[st.floats(-3.0, 3.0)] * 3)


@settings(max_examples=60, deadline=None)
@given(pose_numbers, pose_numbers)
def test_distance_does_not_change_when_everything_moves_together(first: tuple, second: tuple) -> None:
    regions = one_region()
    X_WC, X_WN = (seen_from(regions, n[:3], n[3:]) for n in (first, second))
    moved = ContactRegions(regions.surface, X_WN @ regions.X_WR, regions.radius)
    assert moved.distance(X_WN @ X_WC)[0] == pytest.approx(regions.distance(X_WC)[0], abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(pose_numbers)
def test_projecting_gives_a_contact_of_the_region_by_the_shortest_way(numbers: tuple) -> None:
    regions = one_region()
    X_WC = seen_from(regions, numbers[:3], numbers[3:])
    projected = regions.project(X_WC, 0)
    assert regions.distance(projected)[0] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(regions.project(projected, 0), projected, atol=1e-9)
    np.testing.assert_allclose(projected[:3, :3] @ projected[:3, :3].T, np.eye(3), atol=1e-9)
    assert np.linalg.det(projected[:3, :3]) == pytest.approx(1.0)
    moved = np.linalg.norm(projected[:3, 3] - X_WC[:3, 3])
    assert moved == pytest.approx(regions.distance(X_WC, tilt_weight=0.0)[0], abs=1e-9)
    turn = 0.5 * (np.trace(projected[:3, :3] @ X_WC[:3, :3].T) - 1.0)
    assert turn == pytest.approx(X_WC[:3, 2] @ regions.X_WR[0, :3, 2], abs=1e-9)


def test_the_nearest_of_several_that_hold_a_contact_is_the_one_with_most_room() -> None:
    packed = pack_terrain(terrain_from([level_plate("stone", (-0.3, 0.3), (-0.3, 0.3))]))
    regions = cover_terrain(packed, FOOT)
    X_WC = np.eye(4)
    X_WC[:2, 3] = 0.02, -0.01
    index, distance = regions.nearest(X_WC)
    room = regions.radius - np.linalg.norm(regions.X_WR[:, :2, 3] - X_WC[:2, 3], axis=1)
    assert distance == 0.0
    assert room[index] == room.max()


# ---- the cover itself


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_free_radius_is_the_distance_to_what_bounds_the_free_part(seed: int) -> None:
    rng = np.random.default_rng(seed)
    blocker = convex_hull(rng.uniform(-0.3, 0.3, (5, 2)))
    square = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    free = shapely.box(-0.5, -0.5, 0.5, 0.5).difference(shapely.Polygon(blocker))
    x = rng.uniform(-0.5, 0.5, 2)
    radius = free_radius(x, FreeSpace(square, blocker, np.array([0, len(blocker)]), True))
    point = shapely.Point(x)
    if free.contains(point):
        assert radius == pytest.approx(free.boundary.distance(point), abs=1e-9)
    else:
        assert radius <= 0.0
    assert polygon_distance(x, blocker, len(blocker)) == pytest.approx(
        shapely.Polygon(blocker).distance(point) or -shapely.Polygon(blocker).exterior.distance(point), abs=1e-9
    )


def test_an_empty_free_part_has_no_circles() -> None:
    nothing = FreeSpace(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(1, np.int64), True)
    assert len(cover_free_space(nothing, 0.08, 0.01)) == 0


def test_a_hull_of_points_on_a_line_is_a_segment_and_of_one_point_a_point() -> None:
    line = np.linspace([0.0, 1.0], [2.0, 3.0], 5)
    assert len(convex_hull(line)) == 2
    assert len(convex_hull(np.ones((4, 2)))) == 1
