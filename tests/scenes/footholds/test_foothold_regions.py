"""Regions against the projection that the search uses, which shares no code with them."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import shapely

from optimization.balance.friction import stands_alone
from scenes.files.scene_source import load_scene
from scenes.footholds.foothold_regions import MARGIN, FootholdRegion, disc_region, foothold_regions
from scenes.footholds.free_space import turned_footprint
from scenes.footholds.projection import FOOT_CLEARANCE, PatchShape, patch_fits, patch_shape
from scenes.robots.robot import load_robot
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ESCHER = load_robot("escher")
HEADINGS = [(0.0, 0.0), (-0.25, 0.25), (0.4, 0.9)]


def square(size: float, z: float = 0.0, name: str = "floor") -> Surface:
    h = size / 2
    return Surface(name, np.array([[-h, -h, z], [h, -h, z], [h, h, z], [-h, h, z]]))


def tile(x: float, y: float, size: float) -> Surface:
    """A level square, its lowest corner at (x, y)."""
    return Surface(f"tile {x} {y}", np.array([[x, y, 0], [x + size, y, 0], [x + size, y + size, 0], [x, y + size, 0]]))


def packed_of(*surfaces: Surface) -> PackedTerrain:
    return pack_terrain(Terrain(surfaces))


def points_of(region: FootholdRegion, rng: np.random.Generator, count: int) -> np.ndarray:
    weights = rng.dirichlet(np.ones(len(region.vertices)), count)
    return np.vstack([region.vertices, weights @ region.vertices])


@pytest.mark.parametrize("name", ["rubble_field", "stairs", "random_surfaces"])
@pytest.mark.parametrize("heading", HEADINGS)
def test_a_sole_fits_at_every_point_and_heading_of_a_region(name: str, heading: tuple[float, float]) -> None:
    terrain = load_scene(name, seed=3).terrain
    packed = pack_terrain(terrain)
    rng = np.random.default_rng(0)
    regions = foothold_regions(packed, ESCHER, 0, heading)
    assert regions
    around = np.arange(len(packed.count))
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    sole = patch_shape(ESCHER.effectors[0])
    for region in regions:
        for p in points_of(region, rng, 4):
            contact = region.contact(p, rng.uniform(*heading))
            assert patch_fits(packed, region.surface, contact.p_WC.copy(), contact.R_WC.copy(), sole, around, work)


def test_the_region_of_a_level_square_is_the_square_less_the_sole() -> None:
    (region,) = foothold_regions(packed_of(square(1.0)), ESCHER, 0, (0.0, 0.0))
    hx, hy = ESCHER.effectors[0].half_extent
    expected = np.array([0.5 - hx - MARGIN, 0.5 - hy - MARGIN, 0.0])
    np.testing.assert_allclose(region.vertices.max(axis=0), expected, atol=1e-12)
    np.testing.assert_allclose(region.vertices.min(axis=0), -expected, atol=1e-12)


def test_a_square_smaller_than_the_sole_has_no_region() -> None:
    assert not foothold_regions(packed_of(square(0.2)), ESCHER, 0, (0.0, 0.0))


def test_a_block_on_the_floor_splits_the_floor_into_regions_around_it() -> None:
    regions = foothold_regions(packed_of(square(2.0), square(0.2, 0.05, "block")), ESCHER, 0, (0.0, 0.0))
    floor = [r for r in regions if r.surface == 0]
    assert len(floor) > 1
    assert all((r.A @ np.zeros(3) > r.b).any() for r in floor)  # the middle, under the block, is in none


def test_steep_surfaces_are_left_out_where_a_foot_must_stand_alone() -> None:
    c, s = np.cos(0.6), np.sin(0.6)  # 34 deg, and friction 0.5
    slope = Surface("slope", np.array([[0, -1, 0], [2 * c, -1, 2 * s], [2 * c, 1, 2 * s], [0, 1, 0]]), 0.5)
    packed = packed_of(slope)
    assert foothold_regions(packed, ESCHER, 0, (0.0, 0.0))
    assert not foothold_regions(packed, ESCHER, 0, (0.0, 0.0), holds=partial(stands_alone, "inner"))


def test_a_turning_rectangle_sweeps_what_its_corners_reach() -> None:
    """The footprint reaches as far as the corners in every direction, and a thousandth farther at most."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        half = rng.uniform(0.02, 0.2, 2)
        low = rng.uniform(-np.pi, np.pi)
        high = low + rng.uniform(0.0, 1.5)
        swept = turned_footprint(PatchShape(*half, 0.0, 0.0, 0.0, FOOT_CLEARANCE), low, high, 0.0, 0.0).patch
        turns, directions = np.linspace(low, high, 2001), np.linspace(-np.pi, np.pi, 37)
        signs = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
        for direction in directions:
            x, y = half[0] * signs[:, :1], half[1] * signs[:, 1:]
            reach = (np.cos(turns - direction) * x - np.sin(turns - direction) * y).max()
            most = (swept @ [np.cos(direction), np.sin(direction)]).max()
            assert reach - 1e-7 <= most <= reach + 1e-3 * np.hypot(*half)


def test_the_disc_region_holds_every_point_that_takes_a_sole_at_any_heading() -> None:
    rng = np.random.default_rng(2)
    terrain = load_scene("rubble_field", seed=1).terrain
    for surface in (*terrain.surfaces, square(0.3)):
        packed = packed_of(surface)
        disc = disc_region(packed, 0, 0, min(ESCHER.effectors[0].half_extent))
        for yaw in rng.uniform(-np.pi, np.pi, 3):
            for region in foothold_regions(packed, ESCHER, 0, (yaw, yaw)):
                assert (disc.b[:, None] + 1e-9 >= disc.A @ points_of(region, rng, 5).T).all()


@pytest.mark.parametrize("heading", HEADINGS)
def test_on_a_floor_of_tiles_soles_stand_across_seams(heading: tuple[float, float]) -> None:
    """Each tile's regions together are as large as the floor's in one piece, but for a strip along the seams."""
    tiles = [tile(0.3 * i, 0.3 * j, 0.3) for i in range(4) for j in range(3)]
    packed, whole = packed_of(*tiles), packed_of(tile(0.0, 0.0, 1.2))
    regions = foothold_regions(packed, ESCHER, 0, heading)
    inside = [shapely.Polygon(r.vertices[:, :2]) for r in regions]
    (one,) = foothold_regions(whole, ESCHER, 0, heading)
    floor = shapely.Polygon(one.vertices[:, :2]).intersection(
        shapely.box(0.0, 0.0, 1.2, 0.9 - (1.2 - one.vertices[:, 1].max()))
    )
    assert shapely.union_all(inside).area == pytest.approx(floor.area, rel=0.02)
    rng, around, work = np.random.default_rng(0), np.arange(len(packed.count)), np.empty((2, 12, 3))
    for region in regions:
        disc = disc_region(packed, region.surface, 0, min(ESCHER.effectors[0].half_extent))
        assert (disc.b[:, None] + 1e-9 >= disc.A @ region.vertices.T).all()
        for p in points_of(region, rng, 4):
            c = region.contact(p, rng.uniform(*heading))
            sole = patch_shape(ESCHER.effectors[0])
            assert patch_fits(packed, region.surface, c.p_WC.copy(), c.R_WC.copy(), sole, around, work)
