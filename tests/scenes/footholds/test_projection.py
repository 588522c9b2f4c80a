"""Candidates set down on terrain, against closed forms and shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes.contact import contact_rotation
from scenes.footholds.projection import (
    PALM_CLEARANCE,
    PatchShape,
    cast_ray,
    contact_axes,
    no_placements,
    project_palms,
    set_down,
)
from scenes.terrain.free_boxes import box_is_free, nothing_near
from scenes.terrain.packed_terrain import near, pack_terrain, polygon_meets_box
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

HALF = (0.11, 0.05)  # sole [m]
ATOL = 1e-12


def plate(
    name: str, x: tuple[float, float], y: tuple[float, float], slope: tuple[float, float] = (0, 0), z: float = 0.0
):
    corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
    return Surface(name, np.array([[a, b, z + slope[0] * a + slope[1] * b] for a, b in corners]))


def wall(name: str = "wall", y: float = 0.7) -> Surface:
    return Surface(name, np.array([[0, y, 0.5], [2, y, 0.5], [2, y, 2.0], [0, y, 2.0]]))


def test_a_sole_on_a_slope_lies_in_its_plane_and_points_along_its_heading() -> None:
    slope = (0.2, -0.1)
    packed = pack_terrain(Terrain((plate("slope", (-1, 1), (-1, 1), slope),)))
    contact = set_down(packed, "left_foot", 0.3, 0.2, 0.5, HALF)
    assert contact is not None
    assert contact.p_WC[2] == pytest.approx(slope[0] * 0.3 + slope[1] * 0.2, abs=ATOL)
    normal = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1 + slope[0] ** 2 + slope[1] ** 2)
    np.testing.assert_allclose(contact.R_WC[:, 2], normal, atol=ATOL)
    np.testing.assert_allclose(contact.R_WC, contact_rotation("left_foot", normal, 0.5), atol=ATOL)
    np.testing.assert_allclose(contact.R_WC.T @ contact.R_WC, np.eye(3), atol=ATOL)


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-np.pi, np.pi), st.booleans())
def test_compiled_and_plain_contact_frames_agree(nx: float, ny: float, heading: float, palm: bool) -> None:
    normal = np.array([nx, ny, 0.7])
    normal /= np.linalg.norm(normal)
    R = np.zeros((3, 3))
    contact_axes(normal, heading, palm, R)
    np.testing.assert_allclose(R, contact_rotation("left_palm" if palm else "left_foot", normal, heading), atol=ATOL)


@settings(max_examples=200)
@given(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), st.floats(-np.pi, np.pi))
def test_a_sole_fits_exactly_where_shapely_says_that_its_rectangle_is_inside(x: float, y: float, yaw: float) -> None:
    packed = pack_terrain(Terrain((plate("square", (-0.5, 0.5), (-0.4, 0.4)),)))
    c, s = np.cos(yaw), np.sin(yaw)
    corners = [(x + c * a - s * b, y + s * a + c * b) for a, b in
               ((HALF[0], HALF[1]), (-HALF[0], HALF[1]), (-HALF[0], -HALF[1]), (HALF[0], -HALF[1]))]  # fmt: skip
    inside = shapely.box(-0.5, -0.4, 0.5, 0.4)
    placed = set_down(packed, "left_foot", x, y, yaw, HALF) is not None
    sole = shapely.Polygon(corners)
    if inside.buffer(-1e-3).contains(sole):
        assert placed
    if not inside.contains(sole):
        assert not placed


def test_a_surface_under_another_one_is_not_contactable_where_it_is_covered() -> None:
    floor, step = plate("floor", (-1, 1), (-1, 1)), plate("step", (0, 1), (-1, 1), z=0.05)
    packed = pack_terrain(Terrain((floor, step)))
    on_step = set_down(packed, "left_foot", 0.5, 0.0, 0.0, HALF)
    assert on_step is not None and on_step.surface == 1
    assert set_down(packed, "left_foot", 0.0, 0.0, 0.0, HALF) is None  # half on, half off: a neighbour in the sole
    on_floor = set_down(packed, "left_foot", -0.5, 0.0, 0.0, HALF)
    assert on_floor is not None and on_floor.surface == 0


def test_an_obstacle_on_the_floor_takes_its_place() -> None:
    pillar = Box("pillar", np.array([0.2, 0.2, 1.0]), np.eye(4))
    packed = pack_terrain(Terrain((plate("floor", (-1, 1), (-1, 1)),), (pillar,)))
    assert set_down(packed, "left_foot", 0.0, 0.0, 0.0, HALF) is None
    assert set_down(packed, "left_foot", 0.25, 0.0, np.pi / 2, HALF) is not None


def test_a_foot_needs_room_but_no_ground_where_it_reaches_beyond_its_patch() -> None:
    overhang = (0.05, 0.03, 0.01)  # front, back, side [m]
    riser = Surface("riser", np.array([[0.5, -1, 0], [0.5, -1, 0.2], [0.5, 1, 0.2], [0.5, 1, 0]]))
    packed = pack_terrain(Terrain((plate("tread", (0, 0.5), (-1, 1)), riser)))
    toes, heel = 0.5 - HALF[0], HALF[0]  # x at which the patch ends at the riser, and at the edge behind
    for yaw, reach in ((0.0, overhang[0]), (np.pi, overhang[1])):  # toes, then heel to the riser
        assert set_down(packed, "left_foot", toes - reach - 1e-3, 0.0, yaw, HALF, overhang=overhang) is not None
        assert set_down(packed, "left_foot", toes - reach + 1e-3, 0.0, yaw, HALF, overhang=overhang) is None
        assert set_down(packed, "left_foot", toes - reach + 1e-3, 0.0, yaw, HALF) is not None
    assert set_down(packed, "left_foot", heel + 1e-3, 0.0, 0.0, HALF, overhang=overhang) is not None


def test_of_two_levels_the_window_picks() -> None:
    packed = pack_terrain(Terrain((plate("floor", (-1, 1), (-1, 1)), plate("table", (-1, 1), (-1, 1), z=1.0))))
    high, low = (set_down(packed, "left_foot", 0, 0, 0, HALF, window) for window in ((-9, 9), (-0.5, 0.5)))
    assert high is not None and low is not None
    assert (high.surface, low.surface) == (1, 0)


def cast(packed, rays, origin=(0.5, 0.2, 1.4)):
    placed, palm = no_placements(len(rays)), PatchShape(0.045, 0.045, 0.0, 0.0, 0.0, PALM_CLEARANCE)
    project_palms(packed, 2, np.array(origin), np.array(rays, float), 0.0, (0.2, 0.8), palm, placed)
    return placed


def test_a_palm_ray_meets_the_wall_and_the_fingers_point_up() -> None:
    packed = pack_terrain(Terrain((plate("floor", (0, 2), (-0.7, 0.7)), wall().flipped())))
    if packed.normal[1, 1] > 0:
        packed = pack_terrain(Terrain((plate("floor", (0, 2), (-0.7, 0.7)), wall())))
    p, R, surface = cast(packed, [[0, 1, 0], [0, -1, 0], [0.6, 0.8, 0]])
    assert surface.tolist() == [1, -1, 1]
    np.testing.assert_allclose(p[0], [0.5, 0.7, 1.4], atol=ATOL)
    np.testing.assert_allclose(p[2], [0.5 + 0.375, 0.7, 1.4], atol=ATOL)
    np.testing.assert_allclose(R[0], [[0, -1, 0], [0, 0, -1], [1, 0, 0]], atol=ATOL)


def test_an_obstacle_in_between_blocks_a_palm_ray() -> None:
    X_WO = np.eye(4)
    X_WO[:3, 3] = [0.5, 0.45, 1.4]
    facing = wall() if Surface("w", wall().vertices).normal[1] < 0 else wall().flipped()
    clear = pack_terrain(Terrain((facing,)))
    blocked = pack_terrain(Terrain((facing,), (Box("box", np.array([0.1, 0.1, 0.1]), X_WO),)))
    assert cast(clear, [[0, 1, 0]])[2][0] == 0
    assert cast(blocked, [[0, 1, 0]])[2][0] == -1


@settings(max_examples=150)
@given(st.integers(0, 10_000))
def test_a_ray_ends_at_the_first_polygon_and_counts_where_a_palm_may_touch_it(seed: int) -> None:
    """Against every plane in turn, and shapely for what lies inside its polygon."""
    rng, reach = np.random.default_rng(seed), (0.2, 0.9)
    X_WO = np.eye(4)
    X_WO[:3, 3] = rng.uniform(-0.6, 0.6, 3)
    surfaces = []
    for k in range(6):
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * rng.uniform(0.2, 0.5, 2)
        surfaces.append(Surface(f"s{k}", corners @ q[:, :2].T + rng.uniform(-0.6, 0.6, 3)))
    packed = pack_terrain(Terrain(tuple(surfaces), (Box("b", rng.uniform(0.05, 0.3, 3), X_WO),)))
    ray = rng.normal(size=3)
    ray /= np.linalg.norm(ray)
    met, nearest = -1, reach[1]
    for k in range(len(packed.count)):
        corners, along = packed.vertices[k, : packed.count[k]], packed.normal[k] @ ray
        t = packed.normal[k] @ corners[0] / along
        axes = np.linalg.svd(packed.normal[k : k + 1])[2][1:].T
        inside = shapely.Polygon(corners @ axes).contains(shapely.Point(t * ray @ axes))
        if 0.0 < t < nearest and inside:
            nearest = t
            usable = k < packed.num_surfaces and packed.allowed[k, 2] and along < -0.2
            met = k if usable and t >= reach[0] else -1
    surface, away = cast_ray(packed, 2, np.zeros(3), ray, reach, np.arange(len(packed.count)))
    assert surface == met
    assert away == pytest.approx(nearest, abs=1e-9)


def test_a_ray_ends_on_the_face_of_a_body_that_a_surface_lies_on() -> None:
    X_WO = np.eye(4)
    X_WO[:3, 3] = [0.5, 0.8, 1.25]
    facing = wall() if Surface("w", wall().vertices).normal[1] < 0 else wall().flipped()
    packed = pack_terrain(Terrain((facing,), (Box("body", np.array([4.0, 0.2, 2.0]), X_WO),)))
    surface, away = cast_ray(
        packed, 2, np.array([0.5, 0.2, 1.4]), np.array([0.0, 1.0, 0.0]), (0.2, 0.8), np.arange(len(packed.count))
    )
    assert surface == 0 and away == pytest.approx(0.5)


@settings(max_examples=200)
@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2), st.floats(-np.pi, np.pi), st.integers(0, 1000))
def test_clipping_agrees_with_a_dense_sample_of_the_polygon(
    x: float, y: float, z: float, yaw: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    triangle = rng.uniform(-1, 1, (3, 3))
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    low, high = np.array([-0.5, -0.3, -0.2]), np.array([0.5, 0.3, 0.6])
    meets = polygon_meets_box(triangle, 3, R, np.array([x, y, z]) * 0.5, low, high, np.empty((2, 12, 3)))
    weights = rng.dirichlet(np.ones(3), 4000)
    inside_box = (weights @ triangle - np.array([x, y, z]) * 0.5) @ R
    if ((inside_box > low) & (inside_box < high)).all(axis=1).any():
        assert meets
    wide_low, wide_high = low - 0.1, high + 0.1
    if not ((inside_box > wide_low) & (inside_box < wide_high)).all(axis=1).any():
        assert not meets


def test_near_finds_what_brute_force_finds() -> None:
    rng = np.random.default_rng(0)
    plates = []
    for k in range(200):
        x, y = rng.uniform(-5, 5, 2)
        plates.append(plate(f"p{k}", (x, x + rng.uniform(0.1, 2)), (y, y + rng.uniform(0.1, 2))))
    packed = pack_terrain(Terrain(tuple(plates)))
    for _ in range(100):
        x, y = rng.uniform(-6, 6, 2)
        w, h = rng.uniform(0.01, 1.5, 2)
        by_hand = [
            k for k in range(200)
            if packed.low[k, 0] <= x + w and packed.high[k, 0] >= x and packed.low[k, 1] <= y + h and packed.high[k, 1] >= y
        ]  # fmt: skip
        assert near(packed, x, y, x + w, y + h).tolist() == by_hand


def test_a_torso_box_is_free_beside_a_wall_and_not_in_it() -> None:
    packed = pack_terrain(Terrain((plate("floor", (0, 2), (-1, 1)), wall())))
    centre, size = np.array([0.0, 0.0, 1.2]), np.array([0.3, 0.5, 0.9])
    assert box_is_free(packed, np.array([1.0, 0.40, 0.0]), 0.0, centre, size)
    assert not box_is_free(packed, np.array([1.0, 0.50, 0.0]), 0.0, centre, size)
    assert box_is_free(packed, np.array([1.0, 0.50, 0.0]), np.pi / 2, centre, size)
    assert nothing_near(packed, 1.0, 0.0, 0.5, 0.7, 1.6)
    assert not nothing_near(packed, 1.0, 0.0, 0.8, 0.7, 1.6)
