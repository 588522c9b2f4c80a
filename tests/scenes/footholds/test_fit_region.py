"""Regions where a patch fits, against shapely's polygons: erosion by translates, and Minkowski sums with what covers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from scenes.files.scene_source import load_scene
from scenes.footholds.foothold_table import TURNS, foothold_table
from scenes.footholds.projection import COVER_GAP, FOOT_CLEARANCE, PALM_CLEARANCE, PATCH_MARGIN, PatchShape
from scenes.footholds.snap import Footholds
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

SOLE = PatchShape(0.11, 0.05, 0.0, 0.0, 0.0, FOOT_CLEARANCE)
LONG_FOOT = PatchShape(0.083, 0.042, 0.055, 0.037, 0.011, FOOT_CLEARANCE)
PALM = PatchShape(0.045, 0.045, 0.0, 0.0, 0.0, PALM_CLEARANCE)
EXACT = 1e-3  # [m] the regions differ nowhere by a strip wider than this
CORNERS = [(sx, sy) for sx in (-1, 1) for sy in (-1, 1)]


def plate(name: str, x: tuple[float, float], y: tuple[float, float], z: float = 0.0) -> Surface:
    return Surface(name, np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]]))


def region(
    footholds: Footholds, surface: int, turn: int, patch: PatchShape, palm: bool
) -> tuple[np.ndarray, BaseGeometry]:
    R, parts = footholds.parts(surface, turn, patch, palm)
    polygons = [shapely.Polygon(part) for part in parts]
    for a, one in enumerate(polygons):
        assert one.exterior.is_ccw
        for other in polygons[:a]:
            assert one.intersection(other).buffer(-5e-6).is_empty  # disjoint, but for the rounding of tiles
    return R, shapely.union_all(polygons)


def expected(packed: PackedTerrain, surface: int, R: np.ndarray, patch: PatchShape) -> BaseGeometry:
    """The same by shapely: everything in the plane of the surface, along the axes of R."""
    flat = packed.vertices[surface, : packed.count[surface]] @ R[:, :2]
    outline = shapely.Polygon(flat)
    fits = outline
    for sx, sy in CORNERS:
        fits = fits.intersection(translate(outline, sx * patch.half_length, sy * patch.half_width))
    front, back = patch.half_length + patch.front, patch.half_length + patch.back
    side = patch.half_width + patch.side
    for k in range(len(packed.vertices)):
        corners = packed.vertices[k, : packed.count[k]]
        points = between(corners @ R[:, :2], corners @ R[:, 2] - packed.offset[surface], patch.clearance)
        if k != surface and len(points):
            around = [points - (u, v) for u in (-back, front) for v in (-side, side)]
            fits = fits.difference(shapely.MultiPoint(np.concatenate(around)).convex_hull)
    return fits


def between(flat: np.ndarray, height: np.ndarray, clearance: float) -> np.ndarray:
    """Corners of the part of a polygon that is within the clearance over the plane."""
    found = [p for p, h in zip(flat, height, strict=True) if COVER_GAP <= h <= clearance]
    for a in range(len(flat)):
        b = (a + 1) % len(flat)
        for level in (COVER_GAP, clearance):
            if (height[a] - level) * (height[b] - level) < 0:
                found.append(flat[a] + (level - height[a]) / (height[b] - height[a]) * (flat[b] - flat[a]))
    return np.array(found)


def assert_same(mine: BaseGeometry, theirs: BaseGeometry) -> None:
    """No strip wider than a millimetre is in one and not in the other; nothing that does not fit is in the region."""
    assert mine.symmetric_difference(theirs).buffer(-0.5 * EXACT).area < 1e-9
    assert mine.difference(theirs.buffer(1e-6)).area < 1e-9


@pytest.mark.parametrize("patch", [SOLE, LONG_FOOT], ids=["sole", "sole in a longer foot"])
@pytest.mark.parametrize("name", ["random_surfaces", "rubble_field", "stairs"])
def test_soles_fit_where_shapely_says(name: str, patch: PatchShape) -> None:
    packed = pack_terrain(load_scene(name, seed=1).terrain)
    footholds, areas = Footholds(packed, 0.3), []
    for k in np.flatnonzero(packed.allowed[: packed.num_surfaces, 0] & (packed.floor < 0))[:16]:
        for turn in (0, 7, 40):
            R, mine = region(footholds, int(k), turn, patch, False)
            assert_same(mine, expected(packed, int(k), R, patch))
            areas.append(mine.area)
    assert max(areas) > 0.01


def test_palms_fit_on_walls_where_shapely_says() -> None:
    packed = pack_terrain(load_scene("rubble_corridor", seed=1).terrain)
    footholds, areas = Footholds(packed), []
    for k in np.flatnonzero(packed.allowed[: packed.num_surfaces, 2])[:10]:
        R, mine = region(footholds, int(k), 0, PALM, True)
        assert_same(mine, expected(packed, int(k), R, PALM))
        areas.append(mine.area)
    assert max(areas) > 0.01


@pytest.mark.parametrize("turn", [0, 5, 18])
def test_a_floor_of_tiles_is_as_good_as_the_floor_in_one_piece(turn: int) -> None:
    tiles = [plate(f"{i}{j}", (0.3 * i, 0.3 * i + 0.3), (0.3 * j, 0.3 * j + 0.3)) for i in range(4) for j in range(3)]
    tiles.pop(5)  # and one is missing
    whole = shapely.union_all([shapely.Polygon(t.vertices[:, :2]) for t in tiles])
    footholds = Footholds(pack_terrain(Terrain(tuple(tiles))))
    found = []
    for k in range(len(tiles)):
        R, mine = region(footholds, k, turn, SOLE, False)
        found.append(mine)
    axes = R[:2, :2]
    outline = shapely.Polygon(
        np.array(whole.exterior.coords) @ axes, [np.array(hole.coords) @ axes for hole in whole.interiors]
    )
    edges = [np.array(ring.coords) for ring in (outline.exterior, *outline.interiors)]
    theirs = outline
    for ring in edges:
        for a, b in itertools.pairwise(ring):
            swept = [p + np.array([sx * SOLE.half_length, sy * SOLE.half_width]) for p in (a, b) for sx, sy in CORNERS]
            theirs = theirs.difference(shapely.MultiPoint(np.array(swept)).convex_hull)
    assert theirs.area > 0.05
    assert_same(shapely.union_all(found), theirs)


def test_a_square_as_large_as_the_sole_and_its_margin_has_one_foothold() -> None:
    slack = PATCH_MARGIN + 5e-4
    stone = plate("stone", (-0.11 - slack, 0.11 + slack), (-0.05 - slack, 0.05 + slack))
    footholds = Footholds(pack_terrain(Terrain((stone,))))
    _, mine = region(footholds, 0, 0, SOLE, False)
    assert mine.distance(shapely.Point(0.0, 0.0)) == 0.0
    assert 0 < mine.area < 1.1e-6
    assert region(footholds, 0, 1, SOLE, False)[1].is_empty


def test_a_large_surface_comes_in_tiles_that_leave_nothing_out() -> None:
    packed = pack_terrain(
        Terrain((plate("floor", (-3.3, 4.1), (-1.2, 2.0)), plate("block", (0.2, 0.4), (0.1, 0.3), 0.05)))
    )
    R, mine = region(Footholds(packed), 0, 4, SOLE, False)
    assert_same(mine.buffer(2e-6, join_style="mitre").buffer(-2e-6, join_style="mitre"), expected(packed, 0, R, SOLE))


def test_regions_do_not_depend_on_which_was_asked_for_first() -> None:
    packed = pack_terrain(load_scene("random_surfaces", seed=2).terrain)
    asked = [(k, turn) for k in range(0, 20, 2) for turn in range(0, TURNS, 6)]  # more than an empty table holds
    there, back = Footholds(packed), Footholds(packed)
    one = {key: there.parts(*key, SOLE, False)[1] for key in asked}
    two = {key: back.parts(*key, SOLE, False)[1] for key in reversed(asked)}
    for key, parts in one.items():
        assert len(parts) == len(two[key])
        assert all(np.array_equal(a, b) for a, b in zip(parts, two[key], strict=True))


@pytest.mark.parametrize("size", [3e3, 1e6])
def test_a_floor_of_any_size_takes_little_memory(size: float) -> None:
    packed = pack_terrain(
        Terrain((plate("floor", (-size, size), (-size, size)), plate("stone", (0.0, 0.5), (0.0, 0.5), 0.2)))
    )
    table = foothold_table(packed)
    assert table.row.nbytes < 10e6
    footholds = Footholds(packed)
    R, stone = region(footholds, 1, 0, SOLE, False)
    assert_same(stone, expected(packed, 1, R, SOLE))
