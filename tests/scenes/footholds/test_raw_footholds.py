"""Foot placements on raw geometry: what is found is held, what a grid of poses finds is found between edges."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from drakeplan.bench.bars import BAR_WIDTH, MAX_TILT, two_bars
from scenes.footholds.edge_candidates import bridge_edges
from scenes.footholds.partial_support import INNER_RADIUS
from scenes.footholds.projection import patch_shape
from scenes.footholds.raw_placement import Ball, Placement, geometry_points, near_ball
from scenes.footholds.raw_sampler import SamplerOptions, sample_foothold
from scenes.robots.robot import load_robot
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

FOOT = load_robot("escher").effectors[0]
PATCH = patch_shape(FOOT)
LENGTH = 2 * FOOT.half_extent[0]
BALL = Ball(np.zeros(3), 0.4)
OPTIONS = SamplerOptions(max_tilt=MAX_TILT)


def sample(packed: PackedTerrain, seed: int = 0, ball: Ball = BALL, options: SamplerOptions = OPTIONS) -> Placement:
    return sample_foothold(packed, 0, PATCH, ball, 0.0, options, np.random.default_rng(seed))


def bridge(packed: PackedTerrain, ball: Ball = BALL) -> Placement:
    return bridge_edges(packed, 0, PATCH, ball, 0.0, MAX_TILT)


def touched(placed: Placement, gap: float) -> shapely.Geometry:
    """Hull of what of two level bars lies under a level sole, by shapely alone, for bars along x."""
    half_length, half_width = FOOT.half_extent
    sole = affinity.rotate(
        shapely.box(-half_length, -half_width, half_length, half_width), placed.heading, (0, 0), use_radians=True
    )
    sole = affinity.translate(sole, *placed.p[:2])
    sides = [
        shapely.box(-0.5, gap / 2, 0.5, gap / 2 + BAR_WIDTH),
        shapely.box(-0.5, -gap / 2 - BAR_WIDTH, 0.5, -gap / 2),
    ]
    return shapely.union_all([sole.intersection(side) for side in sides]).convex_hull


def inner_radius(polygon: shapely.Geometry) -> float:
    """Of the greatest circle inside [m]."""
    if shapely.area(polygon) == 0:
        return 0.0
    return float(shapely.length(shapely.maximum_inscribed_circle(np.array([polygon]), np.array([1e-5])))[0])


def exists(gap: float) -> bool:
    """Whether any pose of a fine grid of headings and shifts has a support that is large enough."""
    for heading in np.deg2rad(np.arange(40.0, 91.0, 1.0)):
        for shift in np.arange(0.0, 0.02, 0.0005):
            placed = Placement(np.array([0.0, shift, 0.0]), np.eye(3), float(heading), np.zeros((8, 2)), 0, 0.0, 0)
            if inner_radius(touched(placed, gap)) > INNER_RADIUS + 1e-4:
                return True
    return False


@pytest.mark.parametrize("share", [0.3, 0.8, 0.95])
@pytest.mark.parametrize("find", [sample, bridge])
def test_a_sole_between_bars_rests_on_both(find, share: float) -> None:
    placed = find(two_bars(share * LENGTH))
    support = touched(placed, share * LENGTH)
    assert placed.count >= 3
    assert inner_radius(support) >= INNER_RADIUS
    corners = shapely.Polygon(placed.corners[: placed.count])
    assert corners.area == pytest.approx(shapely.area(support), abs=2e-5)


@pytest.mark.parametrize("share", [1.0, 1.05, 1.08])
def test_between_edges_a_foothold_is_found_wherever_a_grid_of_poses_has_one(share: float) -> None:
    expected = exists(share * LENGTH)
    assert (bridge(two_bars(share * LENGTH)).count > 0) == expected
    assert expected == (share < 1.07)  # both answers occur


def test_bars_too_far_apart_and_bars_alone_hold_nothing() -> None:
    beyond = two_bars(1.2 * LENGTH)
    assert sample(beyond).count == 0
    assert bridge(beyond).count == 0


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_a_plane_rises_to_what_stands_on_it(seed: int, roll: float, pitch: float) -> None:
    """On a floor with a tilted block every placement is flush with a face or leans on edges, and nothing pokes through it."""
    c, s = np.cos([roll, pitch]), np.sin([roll, pitch])
    X_WO = np.eye(4)
    X_WO[:3, :3] = np.array([[1, 0, 0], [0, c[0], -s[0]], [0, s[0], c[0]]]) @ [
        [c[1], 0, s[1]],
        [0, 1, 0],
        [-s[1], 0, c[1]],
    ]
    block = Box("block", np.array([0.3, 0.25, 0.12]), X_WO)
    half = np.array([0.15, 0.125])
    top = np.array(
        [[half[0], half[1], 0.06], [-half[0], half[1], 0.06], [-half[0], -half[1], 0.06], [half[0], -half[1], 0.06]]
    )
    floor = Surface("floor", np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float))
    packed = pack_terrain(Terrain((floor, Surface("top", top @ X_WO[:3, :3].T)), (block,)))
    placed = sample(packed, seed)
    assert placed.count >= 3
    assert np.linalg.norm(placed.p) <= BALL.radius
    assert placed.R[2, 2] >= np.cos(MAX_TILT) - 1e-9
    corners = shapely.points((np.array([(x, y, z) for x in (-0.15, 0.15) for y in (-0.125, 0.125) for z in (-0.06, 0.06)])
                              @ X_WO[:3, :3].T - placed.p) @ placed.R)  # fmt: skip
    over = [q for q in shapely.get_coordinates(corners, include_z=True) if q[2] > 0.004]
    inside = [q for q in over if np.all(np.abs(q[:2]) < np.array(FOOT.half_extent)) and q[2] < PATCH.clearance]
    assert not inside


def test_the_same_seed_gives_the_same_foothold() -> None:
    packed = two_bars(0.9 * LENGTH, 0.3, 0.05)
    one, two, other = sample(packed, 7), sample(packed, 7), sample(packed, 8)
    np.testing.assert_array_equal(one.p, two.p)
    assert one.tries == two.tries
    assert not np.array_equal(one.p, other.p)


def test_wanted_heading_and_place_come_first() -> None:
    floor = pack_terrain(
        Terrain((Surface("floor", np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)),))
    )
    placed = sample(floor)
    assert placed.heading == 0.0
    assert np.hypot(*placed.p[:2]) < OPTIONS.cell


def test_points_lie_on_the_geometry_and_in_the_ball() -> None:
    packed = two_bars(0.1, 0.4, 0.02)
    ball = Ball(np.array([0.1, 0.0, 0.0]), 0.3)
    points = geometry_points(packed, near_ball(packed, ball, 0.1), ball, 0.1)
    assert len(points) > 8
    assert np.linalg.norm(points - ball.centre, axis=1).max() <= ball.radius + 1e-12
    np.testing.assert_allclose(points[:, 2], 0.02, atol=1e-12)


def test_nothing_near_is_no_foothold() -> None:
    far = Ball(np.array([5.0, 0.0, 0.0]), 0.3)
    assert sample(two_bars(0.1), ball=far).count == 0
    assert bridge(two_bars(0.1), ball=far).count == 0
