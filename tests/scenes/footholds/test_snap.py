"""Candidates that find no foothold: moved to one near by, within the reach of a step, or to none where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from scenes.files.scene_source import load_scene
from scenes.footholds.projection import (
    LEG_CLEARANCE,
    PALM_CLEARANCE,
    PatchShape,
    no_placements,
    project_feet,
    project_palms,
    set_down,
)
from scenes.footholds.snap import Footholds, Snap, step_limits
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain
from scenes.transition_model import transition_model

HALF = (0.11, 0.05)
SOLE = PatchShape(*HALF, 0.0, 0.0, 0.0, LEG_CLEARANCE)
PALM = PatchShape(0.045, 0.045, 0.0, 0.0, 0.0, PALM_CLEARANCE)
STEPS = transition_model().steps
SNAP = Snap(apart=0.0, enough=len(STEPS) + 1)  # everything moves, and no duplicate is dropped
BEYOND = 0.1
LIMITS = step_limits(STEPS, HALF, BEYOND)
WINDOW = (-0.35, 0.35)
SCENES = [("random_surfaces", seed) for seed in range(4)] + [("rubble_field", 0), ("stairs", 0)]


def candidates(stand: np.ndarray, left: bool) -> np.ndarray:
    sign = 1.0 if left else -1.0
    steps = STEPS * [1.0, sign, sign]
    c, s = np.cos(stand[2]), np.sin(stand[2])
    xy = stand[:2] + steps[:, :2] @ np.array([[c, s], [-s, c]])
    return np.column_stack([xy, stand[2] + steps[:, 2]])


def stands(rng: np.random.Generator, count: int) -> list[np.ndarray]:
    return [np.array([rng.uniform(0.3, 2.0), rng.uniform(-0.3, 0.3), rng.uniform(-0.6, 0.6)]) for _ in range(count)]


def plate(name: str, x: tuple[float, float], y: tuple[float, float], z: float = 0.0) -> Surface:
    return Surface(name, np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]]))


def within_limits(stand: np.ndarray, left: bool, xy_yaw: np.ndarray, tolerance: float = 1e-5) -> np.ndarray:
    """(n,) whether steps are inside the bounds of the transition model and a little more, by the corners of the sole."""
    sign = 1.0 if left else -1.0
    c, s = np.cos(stand[2]), np.sin(stand[2])
    ahead, aside = ((xy_yaw[:, :2] - stand[:2]) @ np.array([[c, -s], [s, c]])).T * np.array([[1.0], [sign]])
    turn = ((xy_yaw[:, 2] - stand[2] + np.pi) % (2 * np.pi) - np.pi) * sign
    inner = np.full(len(xy_yaw), np.inf)
    for hx in (-HALF[0], HALF[0]):
        for hy in (-HALF[1], HALF[1]):
            inner = np.minimum(inner, aside + np.sin(turn) * hx + np.cos(turn) * hy)
    model = [np.cos(yaw) * -HALF[1] + y - abs(np.sin(yaw)) * HALF[0] for _, y, yaw in STEPS]
    return (
        (ahead >= STEPS[:, 0].min() - BEYOND - tolerance)
        & (ahead <= STEPS[:, 0].max() + BEYOND + tolerance)
        & (aside <= STEPS[:, 1].max() + BEYOND + tolerance)
        & (inner >= min(model) - tolerance)
        & (turn >= STEPS[:, 2].min() - tolerance)
        & (turn <= STEPS[:, 2].max() + tolerance)
    )


@pytest.mark.parametrize(("name", "seed"), SCENES)
def test_a_step_is_moved_to_a_place_where_the_projection_sets_it_down(name: str, seed: int) -> None:
    packed = pack_terrain(load_scene(name, seed=seed).terrain)
    rng, moved = np.random.default_rng(seed), 0
    footholds = Footholds(packed, 0.1, SNAP)
    for stand in stands(rng, 6):
        for left in (True, False):
            wanted = candidates(stand, left)
            found = wanted.copy()
            p, R, surface = footholds.place_feet(1 - left, found, WINDOW, SOLE, stand, LIMITS)
            fixed = no_placements(len(wanted))
            project_feet(packed, 1 - left, wanted, WINDOW, SOLE, fixed)
            stays = fixed.surface >= 0
            assert np.array_equal(surface[stays], fixed.surface[stays])  # what fits is not touched
            assert np.array_equal(p[stays], fixed.p[stays])
            assert np.array_equal(found[stays], wanted[stays])
            new = (surface >= 0) & ~stays
            moved += int(new.sum())
            assert within_limits(stand, left, np.column_stack([p[:, :2], found[:, 2]])[new]).all()
            for k in np.flatnonzero(new):
                contact = set_down(
                    packed,
                    ("left_foot", "right_foot")[1 - left],
                    p[k, 0],
                    p[k, 1],
                    found[k, 2],
                    HALF,
                    (p[k, 2] - 1e-6, p[k, 2] + 1e-6),
                )
                assert contact is not None and contact.surface == surface[k]
                np.testing.assert_allclose(contact.p_WC, p[k], atol=1e-9)
                np.testing.assert_allclose(contact.R_WC, R[k], atol=1e-9)
                n = packed.normal[surface[k]]
                over = (packed.offset[surface[k]] - n[:2] @ wanted[k, :2]) / n[2]
                away = np.linalg.norm(p[k] - [*wanted[k, :2], over])
                assert away <= SNAP.radius + SNAP.margin + 1e-9
                assert abs(found[k, 2] - wanted[k, 2]) <= (SNAP.turns * SNAP.stride + 0.51) * np.deg2rad(5.0)
    assert moved > 20 or name != "random_surfaces"


@pytest.mark.parametrize("seed", range(3))
def test_where_no_foothold_is_found_dense_sampling_finds_none(seed: int) -> None:
    packed = pack_terrain(load_scene("random_surfaces", seed=seed).terrain)
    rng, asked, footholds = np.random.default_rng(seed), 0, Footholds(packed, 0.0, SNAP)
    grid = np.stack(np.meshgrid(*[np.linspace(-0.1, 0.1, 21)] * 2), axis=-1).reshape(-1, 2)
    grid = grid[np.hypot(*grid.T) < 0.93 * SNAP.radius]  # the radius counts along surfaces of up to 20 deg
    turns = np.deg2rad(5.0) * SNAP.stride * np.arange(-SNAP.turns, SNAP.turns + 1)
    for stand in stands(rng, 8):
        stand[2] = np.deg2rad(5.0) * round(stand[2] / np.deg2rad(5.0))  # the headings that are tried
        wanted = candidates(stand, True)
        found = wanted.copy()
        surface = footholds.place_feet(0, found, WINDOW, SOLE, stand, LIMITS).surface
        for k in np.flatnonzero(surface < 0)[:6]:
            near = np.array([[*(wanted[k, :2] + g), wanted[k, 2] + t] for g in grid for t in turns])
            near = near[within_limits(stand, True, near, -2 * SNAP.margin)]
            placed = no_placements(len(near))
            project_feet(packed, 0, near, WINDOW, SOLE, placed)
            assert not (placed.surface >= 0).any()
            asked += 1
    assert asked > 10


def test_a_step_beside_a_stone_goes_to_the_nearest_place_on_it_and_inwards() -> None:
    packed = pack_terrain(Terrain((plate("stone", (0.2, 0.6), (0.0, 0.4)),)))
    xy_yaw = np.array([[0.25, 0.2, 0.0]])  # the heel hangs 6 cm over
    p, _, surface = Footholds(packed, 0.0, SNAP).place_feet(0, xy_yaw, WINDOW, SOLE, np.zeros(3), LIMITS)
    assert surface[0] == 0
    np.testing.assert_allclose(p[0], [0.31 + SNAP.margin, 0.2, 0.0], atol=2e-3)
    assert xy_yaw[0, 2] == 0.0


def test_a_narrow_stone_turns_the_foot() -> None:
    c, s = np.cos(np.deg2rad(20)), np.sin(np.deg2rad(20))
    corners = np.array([[-0.12, -0.06], [0.12, -0.06], [0.12, 0.06], [-0.12, 0.06]]) @ np.array([[c, s], [-s, c]])
    stone = Surface("stone", np.column_stack([corners + np.array([0.2, 0.25]), np.zeros(4)]))
    xy_yaw = np.array([[0.2, 0.25, 0.0]])
    placed = Footholds(pack_terrain(Terrain((stone,))), 0.0, SNAP).place_feet(
        0, xy_yaw, WINDOW, SOLE, np.zeros(3), LIMITS
    )
    assert placed.surface[0] == 0
    assert xy_yaw[0, 2] == pytest.approx(np.deg2rad(20))


def test_duplicates_are_dropped_and_what_was_found_before_does_not_matter() -> None:
    packed = pack_terrain(load_scene("random_surfaces", seed=1).terrain)
    snap = Snap(enough=len(STEPS) + 1)
    used, fresh = Footholds(packed, 0.0, snap), Footholds(packed, 0.0, snap)
    rng = np.random.default_rng(0)
    places = stands(rng, 12)
    for stand in places:
        used.place_feet(0, candidates(stand, True), WINDOW, SOLE, stand, LIMITS)
    for stand in reversed(places):
        again, first = candidates(stand, True), candidates(stand, True)
        p, _, surface = used.place_feet(0, again, WINDOW, SOLE, stand, LIMITS)
        q, _, other = fresh.place_feet(0, first, WINDOW, SOLE, stand, LIMITS)
        assert np.array_equal(surface, other) and np.array_equal(p[surface >= 0], q[other >= 0])
        assert np.array_equal(again, first)
        moved = (surface >= 0) & (p[:, :2] != candidates(stand, True)[:, :2]).any(axis=1)
        for k in np.flatnonzero(moved):
            same = (surface == surface[k]) & (np.abs(again[:, 2] - again[k, 2]) < np.deg2rad(10.1))
            same[k] = False
            assert not (np.linalg.norm(p[same] - p[k], axis=1) < snap.apart).any()


def test_nothing_moves_where_footholds_are_fixed_or_enough() -> None:
    packed = pack_terrain(load_scene("random_surfaces", seed=1).terrain)
    for stand in stands(np.random.default_rng(1), 4):
        fixed = no_placements(len(STEPS))
        project_feet(packed, 0, candidates(stand, True), WINDOW, SOLE, fixed)
        for snap in (None, Snap(enough=0)):
            placed = Footholds(packed, 0.0, snap).place_feet(0, candidates(stand, True), WINDOW, SOLE, stand, LIMITS)
            assert np.array_equal(placed.surface, fixed.surface)


def rays() -> np.ndarray:
    return transition_model().rays


def palms(packed: PackedTerrain, snap: Snap | None, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    p, _, surface = Footholds(packed, 0.0, snap).place_palms(2, origin, rays(), 0.0, (0.2, 0.78), PALM)
    return p, surface


@pytest.mark.parametrize("seed", range(3))
def test_a_palm_is_moved_to_a_place_that_a_ray_from_the_shoulder_meets(seed: int) -> None:
    packed = pack_terrain(load_scene("random_surfaces", seed=seed).terrain)
    rng, moved = np.random.default_rng(seed), 0
    for _ in range(12):
        origin = np.array([rng.uniform(0.4, 2.0), rng.uniform(0.1, 0.4), 1.35])
        _, before = palms(packed, None, origin)
        p, after = palms(packed, SNAP, origin)
        assert np.array_equal(after[before >= 0], before[before >= 0])
        for k in np.flatnonzero((after >= 0) & (before < 0)):
            ray = (p[k] - origin) / np.linalg.norm(p[k] - origin)
            placed = no_placements(1)
            project_palms(packed, 2, origin, ray[None], 0.0, (0.2, 0.78), PALM, placed)
            assert placed.surface[0] == after[k]
            np.testing.assert_allclose(placed.p[0], p[k], atol=1e-6)
            moved += 1
    assert moved > 5


def test_palms_do_not_depend_on_what_was_found_before() -> None:
    packed = pack_terrain(load_scene("random_surfaces", seed=2).terrain)
    rng, ray = np.random.default_rng(0), rays()
    origins = [np.array([rng.uniform(0.4, 2.0), rng.uniform(0.1, 0.4), 1.35]) for _ in range(20)]
    used = Footholds(packed, 0.0, Snap())
    for origin in origins:
        used.place_palms(2, origin, ray, 0.0, (0.2, 0.78), PALM)
    for origin in origins:
        again = used.place_palms(2, origin, ray, 0.0, (0.2, 0.78), PALM)
        first = Footholds(packed, 0.0, Snap()).place_palms(2, origin, ray, 0.0, (0.2, 0.78), PALM)
        assert np.array_equal(again.surface, first.surface)
        assert np.array_equal(again.p[again.surface >= 0], first.p[first.surface >= 0])
