"""Useful pairs of feet are counted by the search's own steps: all on a floor, none on nothing, more where feet may move."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_ground import ESCHER, MODEL, STEPS, floor, stones

from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.contact_planning.transition_check import TransitionCheck
from drakeplan.guide.useful_footsteps import TorsoPose, UsefulFootsteps
from learning.training.footstep_counts import mirror_of
from optimization.balance.friction import DEFAULT_CONE
from scenes.library.plates import level_plate, wall_plate
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.terrain import Terrain, terrain_from

MIRROR = mirror_of(STEPS.translations)

(STAY,) = np.flatnonzero((STEPS.translations == 0).all(axis=1)).tolist()
(AHEAD,) = np.flatnonzero((STEPS.translations == [1, 0]).all(axis=1)).tolist()
ALIKE = 0.05  # contacts of one cell of 2 cm and 5 deg are one, and where the cells begin counts
POSE = TorsoPose(0.03, -0.02, 0.0, 0.4)


def counter(terrain: Terrain, ik, footholds="fixed") -> UsefulFootsteps:
    packed = pack_terrain(terrain)
    check = TransitionCheck(ContactPool(packed), ESCHER, ik, packed, DEFAULT_CONE)
    return UsefulFootsteps(packed, ESCHER, check, MODEL, STEPS, footholds)


def count(of: UsefulFootsteps, pose=POSE, mode="feet", translations=(STAY, AHEAD), seed=0) -> tuple[list[int], int]:
    useful, pairs = of.count(pose, mode, translations, np.random.default_rng(seed))
    return useful.tolist(), pairs


@pytest.fixture(scope="module")
def wide(ik) -> UsefulFootsteps:
    return counter(floor((-2.0, 2.0), (-2.0, 2.0)), ik)


def test_on_a_wide_floor_every_pair_fits_and_from_each_the_torso_can_stay(wide) -> None:
    pairs = len(STEPS.pairs)
    assert pairs == 2 * len(MODEL.steps) == 114
    (stays, ahead), found = count(wide)
    assert found == stays == pairs
    assert 0 < ahead <= pairs


def test_the_count_of_a_translation_asks_for_no_other(wide) -> None:
    together, _ = count(wide)
    assert [count(wide, translations=(v,))[0][0] for v in (STAY, AHEAD)] == together
    assert count(wide, translations=(AHEAD, STAY))[0] == together[::-1]


def test_a_floor_looks_the_same_from_everywhere_and_to_every_side(wide) -> None:
    (stays, ahead), pairs = count(wide, TorsoPose(-0.61, 0.37, 0.0, -2.9))
    assert stays == pairs == len(STEPS.pairs)
    assert ahead == pytest.approx(count(wide)[0][1], rel=ALIKE)


def test_mirror_images_of_translations_are_as_useful_on_a_floor(wide) -> None:
    (side,) = np.flatnonzero((STEPS.translations == [0, 1]).all(axis=1)).tolist()
    useful, _ = count(wide, TorsoPose(0.0, 0.0, 0.0, 0.0), translations=(side, int(MIRROR[side])))
    assert useful[0] == pytest.approx(useful[1], rel=ALIKE) and useful[1] > 0


def test_the_feet_of_a_pair_stand_where_the_pair_says(wide, ik) -> None:
    fresh = counter(floor((-2.0, 2.0), (-2.0, 2.0)), ik)
    c, s = np.cos(POSE.yaw), np.sin(POSE.yaw)
    for (left, right), pair in zip(fresh.pairs(POSE), STEPS.pairs, strict=True):
        for number, (x, y, turn) in zip((left, right), pair.tolist(), strict=True):
            p, yaw = fresh._pool.p[number], fresh._pool.yaw[number]
            np.testing.assert_allclose(p, [POSE.x + c * x - s * y, POSE.y + s * x + c * y, 0.0], atol=0.02)
            assert np.cos(yaw - POSE.yaw - turn) >= np.cos(np.deg2rad(5.0)) - 1e-9


def test_without_ground_there_is_no_pair_and_nothing_useful(ik, wide) -> None:
    away = counter(terrain_from([level_plate("far", (5.0, 6.0), (-1.0, 1.0))]), ik)
    assert count(away) == ([0, 0], 0)
    assert count(wide, TorsoPose(0.0, 0.0, 1.0, 0.0)) == ([0, 0], 0), "the floor is a metre below"
    narrow = counter(floor((-2.0, 2.0), (-0.06, 0.06)), ik)
    assert count(narrow) == ([0, 0], 0), "no two feet side by side"


def test_near_an_edge_fewer_pairs_fit(ik, wide) -> None:
    half = TorsoPose(1.86, 0.0, 0.0, 0.0)
    (stays, ahead), pairs = count(wide, half)
    assert 0 < stays <= pairs < 114
    assert ahead < count(wide)[0][1]


@pytest.mark.parametrize("mode", ["left_palm", "right_palm", "all"])
def test_no_footstep_is_useful_in_a_mode_whose_palms_find_no_wall(wide, mode: str) -> None:
    (stays, ahead), pairs = count(wide, mode=mode)
    assert pairs == 114 and stays == ahead == 0


def test_a_wall_serves_the_palm_that_is_beside_it(ik) -> None:
    for side, y in (("left_palm", 0.55), ("right_palm", -0.55)):
        ground = [level_plate("f", (-1.5, 1.5), (-1.5, 1.5)), wall_plate("w", (-1.5, 1.5), y, (0.9, 1.6))]
        of = counter(terrain_from(ground), ik)
        pose = TorsoPose(0.0, 0.0, 0.0, 0.0)
        other = {"left_palm": "right_palm", "right_palm": "left_palm"}[side]
        assert count(of, pose, side, (STAY,))[0][0] > 10
        assert count(of, pose, other, (STAY,))[0] == count(of, pose, "all", (STAY,))[0] == [0]


def test_feet_that_may_move_find_stones_that_the_steps_miss(ik) -> None:
    """Two stones hardly larger than a sole, 6 cm farther apart than any pair of feet that the torso's cell knows."""
    wide_apart = float(STEPS.pairs[:, 0, 1].max()) + 0.03
    pads = [
        level_plate(name, (-0.2, 0.4), (y - 0.055, y + 0.055)) for name, y in (("l", wide_apart), ("r", -wide_apart))
    ]
    pose = TorsoPose(0.0, 0.0, 0.0, 0.0)
    _, fixed = count(counter(terrain_from(pads), ik), pose)
    _, snapped = count(counter(terrain_from(pads), ik, "snapped"), pose)
    assert fixed == 0 < snapped


def test_feet_that_were_moved_to_one_foothold_are_one_pair(ik) -> None:
    of = counter(stones(6, walls=False), ik, "snapped")
    pairs = of.pairs(TorsoPose(0.113, 0.0571, 0.0, 0.211))
    assert len(pairs) == len(set(pairs)) > 0
    assert all(of._pool.p[a] @ of._pool.p[a] > 0 and a != b for a, b in pairs)


def test_equal_draws_give_equal_counts(ik) -> None:
    of = counter(stones(6), ik, "snapped")
    pose = TorsoPose(0.113, 0.0571, 0.0, 0.211)
    one, two = (count(of, pose, "all", seed=3) for _ in range(2))
    assert one == two
    useful, pairs = one
    assert max(useful) <= pairs
