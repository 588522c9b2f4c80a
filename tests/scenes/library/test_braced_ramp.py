"""The braced ramp: four pieces of wall about a window, a pipe before one of them, and a ramp that falls towards them."""

from __future__ import annotations

import numpy as np
import pytest

from scenes.library.braced_ramp import (
    CRACK_TILT,
    FRICTION_OF_PALMS,
    FRICTION_OF_WHEELS,
    PARTS,
    PIPE,
    PITCH,
    ROLL,
    WALL_Y,
    braced_ramp,
)
from scenes.terrain.terrain import Box

SEEDS = range(30)
ATOL = 1e-12


@pytest.mark.parametrize("seed", SEEDS)
def test_the_wall_has_four_surfaces_for_palms_alone_and_a_pipe(seed: int) -> None:
    wall = braced_ramp(seed).wall
    assert [s.name for s in wall.surfaces] == list(PARTS)
    for surface in wall.surfaces:
        assert surface.allows("left_palm") and not surface.allows("left_foot")
        assert surface.friction == FRICTION_OF_PALMS
        assert surface.normal[1] < -(np.cos(CRACK_TILT) ** 2) + ATOL, "it faces the ramp"
    (pipe,) = wall.obstacles
    assert isinstance(pipe, Box)


@pytest.mark.parametrize("seed", SEEDS)
def test_seeds_differ_in_the_tilts_of_the_pieces_and_in_nothing_else(seed: int) -> None:
    one, other, again = braced_ramp(seed), braced_ramp(seed + 1), braced_ramp(seed)
    assert one.wall.surfaces == again.wall.surfaces
    for a, b, (x0, x1, z0, z1) in zip(one.wall.surfaces, other.wall.surfaces, PARTS.values(), strict=True):
        np.testing.assert_allclose(a.centroid, [0.5 * (x0 + x1), WALL_Y, 0.5 * (z0 + z1)], atol=ATOL)
        np.testing.assert_allclose(b.centroid, a.centroid, atol=ATOL)
        edges = [np.linalg.norm(np.roll(s.vertices, -1, axis=0) - s.vertices, axis=1) for s in (a, b)]
        np.testing.assert_allclose(sorted(edges[0]), sorted([x1 - x0, z1 - z0] * 2), atol=ATOL)
        np.testing.assert_allclose(edges[0], edges[1], atol=ATOL)
        assert not np.allclose(a.normal, b.normal, atol=1e-6)
    np.testing.assert_array_equal(one.wall.triangles, other.wall.triangles)
    for name in ("ramp", "start", "goal"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.radius == other.radius


def test_tilts_are_uniform_over_six_degrees_either_way_about_both_axes() -> None:
    normals = np.array([s.normal for seed in range(200) for s in braced_ramp(seed).wall.surfaces])
    # n = R_x(90 deg + roll) R_y(pitch) e_z = (sin pitch, -cos roll cos pitch, -sin roll cos pitch)
    pitch, roll = np.arcsin(normals[:, 0]), np.arctan2(-normals[:, 2], -normals[:, 1])
    for angle in (roll, pitch):
        assert 0.98 * CRACK_TILT < np.abs(angle).max() <= CRACK_TILT + ATOL
        assert abs(angle.mean()) < 4.0 * CRACK_TILT / np.sqrt(3.0 * len(angle))
        np.testing.assert_allclose((angle**2).mean(), CRACK_TILT**2 / 3.0, rtol=0.1)


def test_the_straight_way_from_start_to_goal_leads_through_the_window_nearer_to_its_upper_edge() -> None:
    ramp = braced_ramp(0)
    lower, upper = PARTS["below_the_window"][3], PARTS["above_the_window"][2]
    x0, x1 = PARTS["above_the_window"][:2]
    for x in np.linspace(x0, x1, 20):
        share = (x - ramp.start[0]) / (ramp.goal[0] - ramp.start[0])
        z = (ramp.start + share * (ramp.goal - ramp.start))[2]
        assert lower < z < upper, "there is no wall"
        assert upper - z < z - lower
    for place, name in ((ramp.start, "before_the_window"), (ramp.goal, "behind_the_window")):
        x0, x1, z0, z1 = PARTS[name]
        assert x0 < place[0] < x1 and z0 < place[2] < z1 and place[1] == WALL_Y


def test_the_pipe_stands_before_the_upper_piece_alone_and_covers_all_of_its_height() -> None:
    low, high = (f(braced_ramp(0).wall.triangles.reshape(-1, 3), axis=0) for f in (np.min, np.max))
    middle, width, depth = PIPE
    x0, x1, z0, z1 = PARTS["above_the_window"]
    np.testing.assert_allclose([low[0], high[0]], [middle - width / 2, middle + width / 2], atol=ATOL)
    assert x0 < low[0] and high[0] < x1, "some of the piece is free on both sides"
    assert low[2] < z0 and high[2] > z1, "no way above or below it"
    assert low[2] > PARTS["below_the_window"][3], "the lower piece is free"
    assert low[1] <= WALL_Y - depth + ATOL and high[1] >= WALL_Y


def test_the_axes_of_the_ramp_are_orthonormal_it_rises_along_the_wall_and_falls_towards_it() -> None:
    R = braced_ramp(0).ramp
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=ATOL)
    assert np.linalg.det(R) == pytest.approx(1.0)
    along, towards, normal = R.T
    np.testing.assert_allclose(along, [np.cos(PITCH), 0.0, np.sin(PITCH)], atol=ATOL)
    assert towards[1] > 0 > towards[2]
    assert normal[2] > 0 < normal[1], "its normal leans to the wall, as on ground that falls that way"
    # across the wall's direction, in the plane x = 0, it falls with the roll
    assert -normal[1] / normal[2] == pytest.approx(-np.tan(ROLL))


def test_a_robot_on_the_ramp_and_the_picture_of_the_ramp_are_in_one_plane() -> None:
    ramp = braced_ramp(0)
    ground = ramp.ground
    assert ground.friction == FRICTION_OF_WHEELS
    np.testing.assert_allclose(ground.normal, ramp.ramp[:, 2], atol=ATOL)
    for x in (-1.0, 0.0, 3.0):
        X_WB = ramp.base(x)
        assert X_WB[0, 3] == x
        assert abs((X_WB[:3, 3] - ground.vertices[0]) @ ground.normal) < ATOL
        np.testing.assert_array_equal(X_WB[:3, :3], ramp.ramp)


def test_the_ramp_is_not_so_steep_that_the_wheels_slide() -> None:
    tilt = np.arccos(braced_ramp(0).ramp[2, 2])
    assert np.tan(ROLL) < np.tan(tilt) < FRICTION_OF_WHEELS
