"""Pairs of feet about the torso: its frame is where their mean is, and they are the transition model's steps."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_ground import MODEL, STEPS

from drakeplan.guide.torso_steps import CELL, DIRECTIONS, torso_steps
from learning.training.footstep_counts import mirror_of
from scenes.transition_model import transition_model

MIRROR = mirror_of(STEPS.translations)

LONGEST = 0.8  # [m] that a foot of the robot moves at most


def relative(stand: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(n, 3) poses of feet (n, 3) seen from standing ones (n, 3)."""
    c, s, d = np.cos(stand[:, 2]), np.sin(stand[:, 2]), step - stand
    return np.column_stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0], d[:, 2]])


def in_order(rows: np.ndarray) -> np.ndarray:
    rows = np.round(rows, 9) + 0.0
    return rows[np.lexsort(rows.T)]


def test_the_torso_stands_in_the_middle_of_its_feet_and_looks_where_they_look_on_average() -> None:
    np.testing.assert_allclose(STEPS.pairs.sum(axis=1), 0.0, atol=1e-12)
    assert (STEPS.pairs[:, 0, 1] > 0.0).all(), "the left foot is to the left"


def test_a_foot_seen_from_the_other_one_stands_where_the_transition_model_says() -> None:
    left, right = STEPS.pairs[:, 0], STEPS.pairs[:, 1]
    half = len(MODEL.steps)
    assert len(STEPS.pairs) == 2 * half
    np.testing.assert_allclose(in_order(relative(right, left)[:half]), in_order(MODEL.mirrored(True)[0]), atol=1e-9)
    np.testing.assert_allclose(in_order(relative(left, right)[half:]), in_order(MODEL.mirrored(False)[0]), atol=1e-9)


def test_further_steps_are_all_of_the_model_that_do_not_move_a_foot_too_far() -> None:
    count = 0
    for k, pair in enumerate(STEPS.pairs):
        for mover in (0, 1):
            mine = (STEPS.pair == k) & (STEPS.mover == mover)
            place, stand = STEPS.place[mine], np.tile(pair[1 - mover], (mine.sum(), 1))
            seen, steps = relative(stand, place), MODEL.mirrored(mover == 0)[0]
            away = np.abs(seen[:, None] - steps[None]).max(axis=2)
            assert (away.min(axis=1) < 1e-9).all()
            assert len(np.unique(away.argmin(axis=1))) == mine.sum(), "no step comes twice"
            assert (np.hypot(*(place[:, :2] - pair[mover, :2]).T) <= LONGEST).all()
            c, s = np.cos(stand[0, 2]), np.sin(stand[0, 2])
            all_places = steps[:, :2] @ np.array([[c, s], [-s, c]]) + stand[0, :2]
            count += (np.hypot(*(all_places - pair[mover, :2]).T) <= LONGEST).sum()
    assert count == len(STEPS.pair)
    assert (np.diff(STEPS.pair) >= 0).all()


def test_a_step_moves_the_torso_by_the_nearest_cell_in_the_sector_where_its_mean_went() -> None:
    stand = STEPS.pairs[STEPS.pair, 1 - STEPS.mover, :2]
    mean = 0.5 * (STEPS.place[:, :2] + stand)
    off = mean / CELL - STEPS.translations[STEPS.translation]
    assert np.abs(off).max() <= 0.5 + 1e-9
    still = np.hypot(*mean.T) < 1e-6
    np.testing.assert_array_equal(still, STEPS.direction < 0)
    turn = np.arctan2(mean[:, 1], mean[:, 0]) - 2 * np.pi / DIRECTIONS * STEPS.direction
    turn = np.arctan2(np.sin(turn), np.cos(turn))[~still]
    assert np.abs(turn).max() <= np.pi / DIRECTIONS + 1e-9


def test_the_mirror_image_of_a_mirror_image_is_the_translation_itself() -> None:
    np.testing.assert_array_equal(MIRROR[MIRROR], np.arange(len(STEPS.translations)))
    np.testing.assert_array_equal(STEPS.translations[MIRROR], STEPS.translations * [1, -1])
    assert len(np.unique(STEPS.translations, axis=0)) == len(STEPS.translations)


def image_of(rows: np.ndarray, images: np.ndarray) -> np.ndarray:
    """(n,) which row each image is; every one is some row."""
    away = np.abs(np.round(images, 9)[:, None] - np.round(rows, 9)[None]).max(axis=2)
    assert away.min(axis=1).max() < 1e-8
    return away.argmin(axis=1)


def test_mirrored_steps_make_mirrored_translations() -> None:
    images = STEPS.pairs[:, ::-1] * [1.0, -1.0, -1.0]
    image_of(STEPS.pairs.reshape(-1, 6), images.reshape(-1, 6))
    for k in range(0, len(STEPS.pairs), 9):
        other = image_of(STEPS.pairs.reshape(-1, 6), images[k].reshape(1, 6))[0]
        mine, its = np.flatnonzero(STEPS.pair == k), np.flatnonzero(STEPS.pair == other)
        assert len(mine) == len(its)
        rows = np.column_stack([STEPS.mover[its], STEPS.place[its]])
        found = image_of(rows, np.column_stack([1 - STEPS.mover[mine], STEPS.place[mine] * [1.0, -1.0, -1.0]]))
        np.testing.assert_array_equal(STEPS.translation[its[found]], MIRROR[STEPS.translation[mine]])


def test_mirrored_translations_lead_in_mirrored_directions() -> None:
    way = STEPS.direction_of_translation
    np.testing.assert_array_equal(way[MIRROR], np.where(way < 0, -1, -way % DIRECTIONS))


def test_one_translation_stays_and_has_no_direction() -> None:
    (stay,) = np.flatnonzero((STEPS.translations == 0).all(axis=1))
    assert np.flatnonzero(STEPS.direction_of_translation < 0).tolist() == [stay]
    angle = np.arctan2(*STEPS.translations.T[::-1]) - 2 * np.pi / DIRECTIONS * STEPS.direction_of_translation
    angle = np.abs(np.arctan2(np.sin(angle), np.cos(angle)))
    assert np.delete(angle, stay).max() <= np.pi / DIRECTIONS + 1e-9


@pytest.mark.parametrize("name", ["experiments", "training"])
def test_other_models_and_shorter_travel_give_fewer_steps_of_the_same_pairs(name: str) -> None:
    model = transition_model(name)
    far, near = torso_steps(model, LONGEST), torso_steps(model, 0.3)
    np.testing.assert_array_equal(far.pairs, near.pairs)
    assert 0 < len(near.pair) < len(far.pair)
    assert np.hypot(*(near.place[:, :2] - near.pairs[near.pair, near.mover, :2]).T).max() <= 0.3
