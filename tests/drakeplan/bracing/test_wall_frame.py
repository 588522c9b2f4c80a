"""The wall for ground is the same wall: a rigid motion takes one to the other, for points, surfaces and boxes."""

from __future__ import annotations

import hashlib
import itertools

import numpy as np
import pytest

from drakeplan.bracing.wall_frame import (
    P_WG,
    R_WG,
    SQUARE,
    robot_on_wall,
    to_wall,
    to_world,
    transition_model_of_palms,
    wall_as_ground,
)
from scenes.library.braced_ramp import CRACK_TILT, WALL_Y, braced_ramp
from scenes.library.plates import tilt_rotation
from scenes.robots.bracer.make_bracer import PALM_RADIUS
from scenes.terrain.terrain import Box, Terrain

ATOL = 1e-12  # [m] rounding of a rotation
SEEDS = range(10)


def test_the_way_to_the_wall_and_back_ends_where_it_began() -> None:
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (5, 7, 3))
    np.testing.assert_allclose(to_world(to_wall(points)), points, atol=ATOL)
    np.testing.assert_allclose(to_wall(to_world(points)), points, atol=ATOL)


def test_the_wall_is_turned_and_neither_stretched_nor_mirrored() -> None:
    np.testing.assert_array_equal(R_WG @ R_WG.T, np.eye(3))
    assert np.linalg.det(R_WG) == pytest.approx(1.0)


def test_ahead_stays_ahead_up_becomes_left_and_out_of_the_wall_becomes_up() -> None:
    for given, expected in (((1, 0, 0), (1, 0, 0)), ((0, 0, 1), (0, 1, 0)), ((0, -1, 0), (0, 0, 1))):
        np.testing.assert_allclose(to_wall(P_WG + np.array(given)), expected, atol=ATOL)
    np.testing.assert_allclose(to_wall(np.array([0.7, WALL_Y, 1.2])), [0.7, 1.2, 0.0], atol=ATOL)


@pytest.mark.parametrize("seed", SEEDS)
def test_surfaces_of_the_wall_face_up_from_its_ground_as_far_as_they_are_not_tilted(seed: int) -> None:
    wall = braced_ramp(seed).wall
    ground = wall_as_ground(wall)
    for before, after in zip(wall.surfaces, ground.surfaces, strict=True):
        assert after.normal[2] >= np.cos(CRACK_TILT) ** 2 - ATOL  # both tilts at most
        np.testing.assert_allclose(R_WG @ after.normal, before.normal, atol=ATOL)
        np.testing.assert_allclose(to_world(after.vertices), before.vertices, atol=ATOL)
        assert (after.name, after.friction) == (before.name, before.friction)
        assert after.allows("left_foot"), "palms are feet there"


def test_a_box_is_where_its_triangles_are() -> None:
    rng = np.random.default_rng(1)
    boxes = []
    for k in range(5):
        X_WO = np.eye(4)
        X_WO[:3, :3], X_WO[:3, 3] = tilt_rotation(*rng.uniform(-np.pi, np.pi, 3)), rng.uniform(-2.0, 2.0, 3)
        boxes.append(Box(f"box_{k}", rng.uniform(0.1, 1.0, 3), X_WO))
    wall = Terrain(braced_ramp(0).wall.surfaces, tuple(boxes))
    ground = wall_as_ground(wall)
    np.testing.assert_allclose(ground.triangles, to_wall(wall.triangles), atol=ATOL)
    for before, after in zip(boxes, ground.obstacles, strict=True):
        assert isinstance(after, Box) and after.name == before.name
        np.testing.assert_array_equal(after.size, before.size)
        assert np.linalg.det(after.X_WO[:3, :3]) == pytest.approx(1.0)


def test_a_palm_has_twenty_steps_up_to_forty_centimetres_ahead_and_twenty_up_or_down() -> None:
    """Lin 2020 sec. 5.10."""
    steps = transition_model_of_palms().steps
    wanted = itertools.product((0.1, 0.2, 0.3, 0.4), (-0.2, -0.1, 0.0, 0.1, 0.2), (0.0,))
    assert sorted(map(tuple, np.round(steps, 12).tolist())) == sorted(wanted)


def test_the_square_that_stands_for_a_palm_lies_inside_it_and_the_robot_is_the_model_that_ships() -> None:
    assert 0.95 * PALM_RADIUS < np.hypot(SQUARE, SQUARE) <= PALM_RADIUS
    robot = robot_on_wall(42.0)
    assert robot.mass == 42.0
    assert [tuple(e.half_extent) for e in robot.effectors[:2]] == [(PALM_RADIUS, PALM_RADIUS)] * 2
    assert robot.model_sha256 == hashlib.sha256(robot.model.read_bytes()).hexdigest()
