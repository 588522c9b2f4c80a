"""Scores of contact points against closed forms: how far the edge is of where a point fits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_ground import ESCHER, MODEL, box, floor

from drakeplan.contact_planning.contact_domain import ARM_SLACK
from drakeplan.guide.contact_scores import (
    LAYERS,
    PITCH,
    POINT,
    FootScores,
    foot_scores,
    palm_rays,
    palm_score,
    palm_spaces_near,
    score_of,
    scores_about,
    within_reach,
)
from scenes.footholds.free_space import ROUNDING
from scenes.footholds.projection import PATCH_MARGIN
from scenes.library.plates import level_plate, rectangle, tilt_rotation, tilted_plate, wall_plate
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain, terrain_from

HALF = np.array(ESCHER.effectors[0].half_extent)
INNER, OUTER = float(HALF.min()), float(np.hypot(*HALF))
PALM = np.array(ESCHER.effectors[2].half_extent)
RIM = POINT + PATCH_MARGIN + ROUNDING  # [m] what a point keeps from the edge of a surface
COVER = POINT + ROUNDING  # [m] and from what stands on it
ATOL = 1e-9


def scored(terrain: Terrain, low=(-0.5, -0.5), high=(0.5, 0.5)) -> FootScores:
    return foot_scores(pack_terrain(terrain), ESCHER, np.array(low), np.array(high))


def points(scores: FootScores) -> tuple[np.ndarray, np.ndarray]:
    """x and y of the grid."""
    i, j = np.indices(scores.z.shape[1:])
    return scores.origin[0] + i * PITCH, scores.origin[1] + j * PITCH


def expected(room: np.ndarray) -> np.ndarray:
    return np.clip((room - INNER) / (OUTER - INNER), 0.0, 1.0)


def inside_by(x: np.ndarray, y: np.ndarray, low: tuple[float, float], high: tuple[float, float]) -> np.ndarray:
    """Distance from the edge of a rectangle [m], where inside."""
    return np.min([x - low[0], high[0] - x, y - low[1], high[1] - y], axis=0)


def outside_by(x: np.ndarray, y: np.ndarray, low: tuple[float, float], high: tuple[float, float]) -> np.ndarray:
    """Distance to a rectangle [m]; 0 inside."""
    return np.hypot(
        np.maximum(np.maximum(low[0] - x, x - high[0]), 0), np.maximum(np.maximum(low[1] - y, y - high[1]), 0)
    )


@given(st.floats(-0.1, 0.3), st.floats(0.01, 0.1), st.floats(0.01, 0.1))
def test_a_score_is_nothing_below_the_inscribed_circle_all_beyond_the_circumscribed_and_linear_between(
    room: float, inner: float, wider: float
) -> None:
    outer = inner + wider
    assert score_of(room, inner, outer) == pytest.approx(np.interp(room, [inner, outer], [0.0, 1.0]), abs=ATOL)
    assert score_of(np.nextafter(inner, -1.0), inner, outer) == 0.0
    assert score_of(inner + 1e-7 * wider, inner, outer) == pytest.approx(0.0, abs=1e-6)
    assert score_of(outer - 1e-7 * wider, inner, outer) == pytest.approx(1.0, abs=1e-6)
    assert score_of(outer, inner, outer) == 1.0


def test_on_one_plate_the_edge_is_what_counts() -> None:
    low, high = (-0.31, -0.22), (0.37, 0.41)
    scores = scored(terrain_from([level_plate("p", (low[0], high[0]), (low[1], high[1]), 0.2)]))
    x, y = points(scores)
    room = inside_by(x, y, low, high) - RIM
    assert scores.z.shape[0] == 1
    there = np.isfinite(scores.z[0])
    np.testing.assert_array_equal(there, inside_by(x, y, low, high) >= 0.0)
    np.testing.assert_allclose(scores.z[0][there], 0.2)
    np.testing.assert_allclose(scores.score[0], expected(room), atol=ATOL)
    assert 0 < (scores.score[0] > 0).sum() < there.sum() and (scores.score == 1.0).any()


def test_a_tilted_plate_counts_in_its_own_plane() -> None:
    roll, pitch = 0.3, -0.25
    scores = scored(terrain_from([tilted_plate("p", (0.0, 0.0, 0.1), rectangle(0.6, 0.5), roll, pitch)]))
    R = tilt_rotation(roll, pitch)
    x, y = points(scores)
    there = np.isfinite(scores.z[0])
    u, v, w = R.T @ np.array([x[there], y[there], scores.z[0][there] - 0.1])
    np.testing.assert_allclose(w, 0.0, atol=ATOL)
    room = inside_by(u, v, (-0.3, -0.25), (0.3, 0.25))
    slack = (np.sqrt(2.0) * POINT + PATCH_MARGIN + ROUNDING - RIM) / (OUTER - INNER)  # the point's patch may be turned
    found = scores.score[0][there]
    assert (found <= expected(room - RIM) + ATOL).all()
    assert (found >= expected(room - RIM) - slack).all()
    assert found.max() == 1.0


def test_what_stands_on_a_plate_is_an_edge_too() -> None:
    low, high = (0.05, -0.1), (0.25, 0.15)
    scores = scored(floor((-0.45, 0.45), (-0.45, 0.45), box("b", (*low, 0.0), (*high, 0.6))))
    x, y = points(scores)
    away = outside_by(x, y, low, high)
    free = away > 0.0
    room = np.minimum(
        inside_by(x, y, (-0.45, -0.45), (0.45, 0.45)) - RIM,
        outside_by(x, y, tuple(np.array(low) - COVER), tuple(np.array(high) + COVER)),
    )
    np.testing.assert_allclose(scores.score[0][free], expected(room)[free], atol=ATOL)
    assert (scores.score[0][free & (away < INNER)] == 0.0).all() and (scores.score[0] == 1.0).any()


def test_inside_a_solid_there_is_no_contact_point() -> None:
    scores = scored(floor((-1.0, 1.0), (-1.0, 1.0), box("b", (-0.4, -0.4, 0.0), (0.4, 0.4, 1.0))))
    x, y = points(scores)
    assert (scores.score[0][np.maximum(np.abs(x), np.abs(y)) < 0.4] == 0.0).all()


def test_a_plate_a_little_above_another_one_covers_it_and_is_the_better_floor_itself() -> None:
    low, high = (-0.2, -0.2), (0.2, 0.25)
    upper = level_plate("upper", (low[0], high[0]), (low[1], high[1]), 0.15)
    scores = scored(terrain_from([level_plate("lower", (-0.6, 0.6), (-0.6, 0.6)), upper]))
    x, y = points(scores)
    over = inside_by(x, y, low, high)
    beside = outside_by(x, y, tuple(np.array(low) - COVER), tuple(np.array(high) + COVER))
    room = np.minimum(beside, inside_by(x, y, (-0.6, -0.6), (0.6, 0.6)) - RIM)
    assert scores.z.shape[0] == 1, "15 cm apart they are one floor"
    np.testing.assert_allclose(scores.score[0], np.where(over >= 0, expected(over - RIM), expected(room)), atol=ATOL)
    np.testing.assert_array_equal(scores.z[0][scores.score[0] > 0], np.where(over >= 0, 0.15, 0.0)[scores.score[0] > 0])


def test_floors_far_above_each_other_are_scored_each_on_its_own() -> None:
    floors = [level_plate(f"f{k}", (-0.5 + 0.1 * k, 0.5), (-0.5, 0.5), 2.0 * k) for k in range(LAYERS)]
    scores = scored(terrain_from(floors))
    x, y = points(scores)
    assert scores.z.shape[0] == LAYERS
    for k in range(LAYERS):
        here = scores.z == 2.0 * k
        room = inside_by(x, y, (-0.5 + 0.1 * k, -0.5), (0.5, 0.5))
        np.testing.assert_allclose(np.where(here, scores.score, 0.0).max(axis=0), expected(room - RIM), atol=ATOL)


def test_tiles_in_one_plane_side_by_side_have_no_edge_between_them() -> None:
    tiles = [
        level_plate(f"t{i}{j}", (0.4 * i - 0.4, 0.4 * i), (0.3 * j - 0.3, 0.3 * j), 0.1) for i in (0, 1) for j in (0, 1)
    ]
    joined, whole = scored(terrain_from(tiles)), scored(terrain_from([level_plate("w", (-0.4, 0.4), (-0.3, 0.3), 0.1)]))
    np.testing.assert_allclose(joined.score[0], whole.score[0], atol=1e-3)
    x, y = points(joined)
    middle = (np.abs(x) < 1e-9) & (np.abs(y) < 0.1)
    assert middle.any() and (joined.score[0][middle] == 1.0).all()


def test_the_scores_about_a_place_are_those_of_the_grid_within_reach_of_its_height() -> None:
    floors = [level_plate("low", (-0.5, 0.5), (-0.5, 0.5)), level_plate("high", (-0.2, 0.5), (-0.5, 0.5), 2.0)]
    scores = scored(terrain_from(floors))
    out = np.empty((21, 21))
    for z, rise in ((0.0, 0.35), (2.0, 0.35), (1.0, 0.35), (1.0, 1.0)):
        i0, j0 = scores_about(scores, 0.4, -0.45, z, rise, out)
        assert (i0, j0) == (
            round((0.4 - scores.origin[0]) / PITCH) - 10,
            round((-0.45 - scores.origin[1]) / PITCH) - 10,
        )
        for a in range(21):
            for b in range(21):
                i, j, best = i0 + a, j0 + b, 0.0
                if 0 <= i < scores.z.shape[1] and 0 <= j < scores.z.shape[2]:
                    for layer in range(scores.z.shape[0]):
                        if abs(scores.z[layer, i, j] - z) <= rise:
                            best = max(best, scores.score[layer, i, j])
                assert out[a, b] == best
        assert (out > 0).any() == (z != 1.0 or rise == 1.0)


def plate_scores() -> FootScores:
    return scored(
        terrain_from([level_plate("a", (-0.4, 0.0), (-0.4, 0.3)), level_plate("b", (0.1, 0.5), (-0.3, 0.4), 0.1)])
    )


def test_a_foot_that_may_move_has_the_best_score_within_its_reach() -> None:
    scores, radius = plate_scores(), 0.1
    moved = within_reach(scores, radius)
    x, y = points(scores)
    for i in range(0, scores.z.shape[1], 3):
        for j in range(0, scores.z.shape[2], 3):
            near = np.hypot(x - x[i, j], y - y[i, j]) <= radius + 1e-9
            assert moved.score[0, i, j] == scores.score[0][near].max()
            if moved.score[0, i, j] > 0.0:
                there = near & (scores.score[0] == moved.score[0, i, j])
                assert moved.z[0, i, j] in scores.z[0][there]
    assert (moved.score >= scores.score).all() and (moved.score > scores.score + 0.5).any()


def test_a_foot_that_does_not_move_keeps_its_score() -> None:
    scores = plate_scores()
    same = within_reach(scores, 0.0)
    np.testing.assert_array_equal(same.score, scores.score)
    np.testing.assert_array_equal(same.z, scores.z)


def test_a_better_place_on_the_floor_above_takes_nothing_from_the_one_below() -> None:
    upper, lower = (
        level_plate("upper", (-0.05, 1.0), (-1.0, 1.0), 1.0),
        level_plate("lower", (-1.0, 0.0), (-0.06, 0.06)),
    )
    scores = scored(terrain_from([upper, lower]))
    moved = within_reach(scores, 0.1)

    def below(of: FootScores) -> np.ndarray:
        return np.where(np.abs(of.z) < 0.35, of.score, 0.0).max(axis=0)

    assert (below(moved) >= below(scores)).all()


def palm_scores_on(terrain: Terrain, surface: int, at: np.ndarray) -> np.ndarray:
    packed = pack_terrain(terrain)
    spaces = palm_spaces_near(packed, ESCHER, np.array([-2.0, -2.0]), np.array([2.0, 2.0]))
    inner, outer = float(PALM.min()), float(np.hypot(*PALM))
    return np.array([palm_score(packed, spaces, surface, p, inner, outer) for p in at])


def test_on_a_wall_a_palm_counts_how_far_the_nearest_edge_is() -> None:
    ground, wall = level_plate("g", (-1.0, 1.0), (-1.0, 1.0)), wall_plate("w", (-0.4, 0.5), 0.7, (1.0, 1.6))
    rng = np.random.default_rng(0)
    at = np.column_stack([rng.uniform(-0.5, 0.6, 300), np.full(300, 0.7), rng.uniform(0.95, 1.65, 300)])
    found = palm_scores_on(terrain_from([ground, wall]), 1, at)
    room = inside_by(at[:, 0], at[:, 2], (-0.4, 1.0), (0.5, 1.6)) - RIM
    inner, outer = PALM.min(), np.hypot(*PALM)
    np.testing.assert_allclose(found, np.clip((room - inner) / (outer - inner), 0.0, 1.0), atol=ATOL)
    assert (found == 1.0).any() and (found == 0.0).any()
    assert not palm_scores_on(terrain_from([ground, wall]), 0, at * [1, 1, 0]).any(), "palms use no floor"


def test_panels_of_one_wall_have_no_edge_between_them_and_what_stands_before_it_has_one() -> None:
    panels = [wall_plate("a", (-0.4, 0.0), 0.7, (1.0, 1.6)), wall_plate("b", (0.0, 0.4), 0.7, (1.0, 1.6))]
    middle = np.array([[0.0, 0.7, 1.3], [-0.01, 0.7, 1.2]])
    assert (palm_scores_on(terrain_from(panels), 0, middle) == 1.0).all()
    bar = Surface("bar", np.array([[-0.1, 0.68, 1.0], [0.1, 0.68, 1.0], [0.1, 0.68, 1.6], [-0.1, 0.68, 1.6]]))
    assert (palm_scores_on(terrain_from([*panels, bar]), 0, middle) == 0.0).all()


def test_palms_are_looked_for_along_rays_that_are_as_long_as_the_arm() -> None:
    rays = palm_rays(ESCHER, MODEL.rays, ARM_SLACK)
    assert rays.reach == (ESCHER.arm_reach[0], ARM_SLACK * ESCHER.arm_reach[1])
    assert (rays.inner, rays.outer) == (PALM.min(), np.hypot(*PALM))
    np.testing.assert_array_equal(rays.shoulder, ESCHER.shoulder)
