"""Footholds near a place against feet set down all around it, and starts and goals that depend on them."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from scenes.files.scene_source import load_scene
from scenes.footholds.free_polygon import MARGIN, footholds_near, free_polygon
from scenes.footholds.free_space import footprint_of
from scenes.footholds.goal_footholds import nobody_fits
from scenes.footholds.projection import patch_shape, set_down
from scenes.footholds.start_stance import feet_down
from scenes.robots.robot import load_robot
from scenes.scene import Goal
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ROBOT = load_robot("escher")
FOOT = ROBOT.effectors[0]
ANYWHERE, ANY_HEIGHT = np.empty((0, 4)), (-np.inf, np.inf)
RADIUS = 0.14
SOLE = footprint_of(patch_shape(FOOT))
STEP = 0.01  # [m] between the places of the slow twin


def plate(name: str, x: tuple[float, float], y: tuple[float, float], z: float = 0.0) -> Surface:
    return Surface(name, np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]]))


def fits(packed: PackedTerrain, x: float, y: float, yaw: float) -> bool:
    return set_down(packed, FOOT.name, x, y, yaw, FOOT.half_extent, overhang=FOOT.overhang) is not None


@pytest.mark.parametrize("name", ["random_surfaces", "rubble_field", "stairs"])
def test_no_foot_set_down_near_by_is_nearer_than_the_nearest_foothold(name: str) -> None:
    packed = pack_terrain(load_scene(name, seed=5).terrain)
    rng = np.random.default_rng(0)
    ticks = np.arange(-RADIUS, RADIUS + 0.5 * STEP, STEP)
    around = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    some = 0
    for _ in range(30):
        x, y, yaw = rng.uniform(0.2, 2.5), rng.uniform(-0.6, 0.6), rng.uniform(-3.0, 3.0)
        found = footholds_near(packed, FOOT, (x, y, yaw), ANY_HEIGHT, RADIUS, ANYWHERE)
        for distance, contact in found:
            p = contact.p_WC
            assert distance <= RADIUS
            assert distance == pytest.approx(np.hypot(p[0] - x, p[1] - y), abs=1e-12)
            below = (-np.inf, float(p[2]) + 1e-6)
            again = set_down(packed, FOOT.name, p[0], p[1], yaw, FOOT.half_extent, below, overhang=FOOT.overhang)
            assert again is not None
            np.testing.assert_allclose(again.X_WC, contact.X_WC, atol=1e-9)
        places = around[np.hypot(*around.T) <= RADIUS - STEP]
        away = [float(np.hypot(*d)) for d in places if fits(packed, x + d[0], y + d[1], yaw)]
        if away:
            moved_off_the_edge, in_a_tilted_plane = 2 * MARGIN, 1.1
            assert found[0][0] <= in_a_tilted_plane * min(away) + moved_off_the_edge + 1e-9
            some += min(away) > 0.0
    assert some > 2


def test_footholds_keep_to_the_half_spaces() -> None:
    packed = pack_terrain(Terrain((plate("floor", (-2, 2), (-2, 2)),)))
    beyond = np.array([[-1.0, 0.0, 0.0, -0.05]])  # x >= 0.05
    ((distance, contact),) = footholds_near(packed, FOOT, (0.0, 0.0, 0.3), ANY_HEIGHT, RADIUS, beyond)
    assert 0.05 <= contact.p_WC[0] <= 0.05 + MARGIN + 1e-9
    assert distance == pytest.approx(contact.p_WC[0])
    assert not footholds_near(packed, FOOT, (0.0, 0.0, 0.3), (0.1, 1.0), RADIUS, beyond)


def test_a_robot_starts_on_stones_hardly_larger_than_its_soles_wherever_they_are_near() -> None:
    """Stones 4 mm longer and wider than a sole, each moved by up to 8 cm along either axis."""
    rng = np.random.default_rng(1)
    half_width = 0.5 * ROBOT.foot_separation[1]
    a, b = (h + 2e-3 for h in FOOT.half_extent)
    for _ in range(20):
        stones = []
        for side in (1.0, -1.0):
            x, y = rng.uniform(-0.08, 0.08), side * half_width + side * rng.uniform(0.0, 0.08)
            stones.append(plate(f"stone {side}", (x - a, x + a), (y - b, y + b), rng.uniform(0.0, 0.1)))
        stance = feet_down(pack_terrain(Terrain(tuple(stones))), ROBOT, (0.0, 0.0, 0.0), ANY_HEIGHT, full_soles=True)
        assert stance is not None
        for foot, stone in zip(stance.held, stones, strict=True):
            np.testing.assert_allclose(foot.p_WC, stone.centroid, atol=2.1e-3)


@pytest.mark.parametrize(("longer", "proof"), [(-7e-3, True), (4e-3, False)])
def test_stones_a_little_smaller_than_a_sole_are_proved_to_hold_nobody(longer: float, proof: bool) -> None:
    a, b = (2 * h + 2 * longer for h in FOOT.half_extent)
    stones = []
    for i in range(-3, 4):
        for j in range(-5, 6):
            x, y = (a + 0.02) * i, (b + 0.02) * j
            stones.append(plate(f"stone {i} {j}", (x - 0.5 * a, x + 0.5 * a), (y - 0.5 * b, y + 0.5 * b)))
    terrain = Terrain(tuple(stones))
    why = nobody_fits(terrain, pack_terrain(terrain), ROBOT, Goal((0.05, 0.03, 0.0), 0.2), 0.4)
    assert (why == "no foothold within the radius: no two soles fit there") == proof


def test_a_floor_of_too_many_gaps_is_taken_piece_by_piece_and_says_so() -> None:
    """A comb: a back of 0.4 m, and teeth with gaps between them that no sole covers."""
    for teeth, known in ((20, True), (80, False)):
        length = 0.3 * teeth
        back = plate("back", (0.0, length), (-0.4, 0.0))
        comb = [back, *(plate(f"tooth {k}", (0.3 * k, 0.3 * k + 0.25), (0.0, 0.5)) for k in range(teeth))]
        R = np.eye(3)
        region, complete = free_polygon(pack_terrain(Terrain(tuple(comb))), 0, R, SOLE, ANYWHERE)
        alone, _ = free_polygon(pack_terrain(Terrain((back,))), 0, R, SOLE, ANYWHERE)
        assert complete == known
        assert (region.area > alone.area + 1e-3) == known
        assert region.intersects(shapely.Point(0.5 * length, -0.2))
