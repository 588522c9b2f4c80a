"""The representative of a transition does not depend on where the world is, how it is turned, or which side is which."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from learning.relative_features import relative_feature_names, relative_features
from learning.transition_batch import TransitionBatch
from learning.transition_features import (
    CATEGORIES,
    NUM_CATEGORIES,
    UNKNOWN,
    canonical,
    canonicalise,
    documented_feature_names,
    documented_features,
    tait_bryan,
)
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS
from scenes.pose import rpy_rotation
from scenes.stance import Stance

ATOL = 1e-12  # rounding of a few products of numbers of order 1
MIRROR = np.diag([1.0, -1.0, 1.0])
# Lin et al. 2019 fig. 3: palms held before, mover, whether it holds a contact after -> category (palm on either side)
TABLE = [
    ((), "left_foot", True, 0),
    ((), "right_foot", True, 0),
    ((), "left_palm", True, 1),
    ((), "right_palm", True, 1),
    (("left_palm",), "left_foot", True, 2),
    (("right_palm",), "right_foot", True, 2),
    (("left_palm",), "right_foot", True, 3),
    (("right_palm",), "left_foot", True, 3),
    (("left_palm",), "left_palm", False, 4),
    (("right_palm",), "right_palm", False, 4),
    (("left_palm",), "left_palm", True, 5),
    (("right_palm",), "right_palm", True, 5),
    (("left_palm",), "right_palm", True, 6),
    (("right_palm",), "left_palm", True, 6),
    (("left_palm", "right_palm"), "left_foot", True, 7),
    (("left_palm", "right_palm"), "right_foot", True, 7),
    (("left_palm", "right_palm"), "left_palm", False, 8),
    (("left_palm", "right_palm"), "right_palm", False, 8),
    (("left_palm", "right_palm"), "left_palm", True, 9),
    (("left_palm", "right_palm"), "right_palm", True, 9),
]
DIMENSIONS = (24, 24, 30, 30, 24, 30, 30, 36, 30, 36)  # the last column of that figure


def random_contact(rng: np.random.Generator, effector: str) -> Contact:
    side = 1.0 if effector.startswith("left") else -1.0
    foot = effector.endswith("foot")
    normal = np.array([0.0, 0.0, 1.0]) if foot else np.array([0.0, -side, 0.0])
    normal = normal + rng.uniform(-0.3, 0.3, 3)
    point = np.array([0.0, side * (0.1 if foot else 0.5), 0.0 if foot else 1.2]) + rng.uniform(-0.2, 0.2, 3)
    X_WC = contact_pose(effector, point, normal / np.linalg.norm(normal), rng.uniform(-0.4, 0.4))
    return Contact(effector, 0, X_WC, 0.5)


def random_transition(rng: np.random.Generator, row: tuple) -> tuple[Stance, Stance, np.ndarray, np.ndarray]:
    palms, mover, makes, _ = row
    held = ("left_foot", "right_foot", *palms)
    before = Stance(tuple(random_contact(rng, e) if e in held else None for e in EFFECTORS))
    after = before.replace(EFFECTORS.index(mover), random_contact(rng, mover) if makes else None)
    return before, after, rng.uniform([-0.1, -0.1, 0.8], [0.1, 0.1, 1.0]), rng.uniform(-0.3, 0.3, 3)


def moved(stance: Stance, X: np.ndarray) -> Stance:
    return Stance(tuple(c and Contact(c.effector, c.surface, X @ c.X_WC, c.friction) for c in stance.contacts))


def reflected(stance: Stance) -> Stance:
    contacts: list[Contact | None] = [None] * 4
    for c in stance.held:
        X = np.eye(4)
        X[:3, :3], X[:3, 3] = MIRROR @ c.R_WC @ MIRROR, MIRROR @ c.p_WC
        e = EFFECTORS.index(c.effector) ^ 1
        contacts[e] = Contact(EFFECTORS[e], c.surface, X, c.friction)
    return Stance(tuple(contacts))


@pytest.mark.parametrize("row", TABLE, ids=lambda r: f"{'+'.join(r[0]) or 'feet'}:{r[1]}:{r[3]}")
def test_the_ten_categories_are_those_of_the_documents_figure(row) -> None:
    category, features, mirrored = canonical(*random_transition(np.random.default_rng(1), row))
    assert category == row[3]
    assert features.shape == (DIMENSIONS[category],)
    assert len(documented_feature_names(category)) == DIMENSIONS[category]
    palms = row[0]
    assert mirrored == (palms[0] if len(palms) == 1 else row[1]).startswith("right")


@given(seed=st.integers(0, 10**6), row=st.sampled_from(TABLE))
def test_shift_and_turn_of_the_world_change_nothing(seed: int, row) -> None:
    rng = np.random.default_rng(seed)
    before, after, com, velocity = random_transition(rng, row)
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = rpy_rotation([0, 0, rng.uniform(-np.pi, np.pi)]), rng.uniform(-5, 5, 3)
    there = moved(before, X), moved(after, X), X[:3, :3] @ com + X[:3, 3], X[:3, :3] @ velocity
    category, features, mirrored = canonical(before, after, com, velocity)
    category_there, features_there, mirrored_there = canonical(*there)
    assert (category, mirrored) == (category_there, mirrored_there)
    np.testing.assert_allclose(features, features_there, atol=1e-9)


@given(seed=st.integers(0, 10**6), row=st.sampled_from(TABLE))
def test_left_and_right_are_one(seed: int, row) -> None:
    before, after, com, velocity = random_transition(np.random.default_rng(seed), row)
    category, features, mirrored = canonical(before, after, com, velocity)
    other = canonical(reflected(before), reflected(after), MIRROR @ com, MIRROR @ velocity)
    assert other[0] == category and other[2] != mirrored
    np.testing.assert_allclose(features, other[1], atol=1e-9)
    pairs = [(before, after), (reflected(before), reflected(after))]
    batch = TransitionBatch.from_stances(pairs, np.array([com, MIRROR @ com]), np.array([velocity, MIRROR @ velocity]))
    for frame in ("heading", "quarter"):
        one, two = relative_features(canonicalise(batch, frame))
        np.testing.assert_allclose(one, two, atol=1e-6)  # float32


@given(seed=st.integers(0, 10**6), row=st.sampled_from(TABLE), quarters=st.integers(1, 3))
def test_relative_features_stay_when_the_world_is_shifted_and_turned_by_quarters(seed, row, quarters) -> None:
    """By other angles they do not: the box in which the CoM must end is the world's."""
    rng = np.random.default_rng(seed)
    before, after, com, velocity = random_transition(rng, row)
    rows = []
    for angle in (0.0, quarters * np.pi / 2, 0.3):
        X = np.eye(4)
        X[:3, :3], X[:3, 3] = rpy_rotation([0, 0, angle]), rng.uniform(-5, 5, 3)
        pair = [(moved(before, X), moved(after, X))]
        batch = TransitionBatch.from_stances(pair, X[:3, :3] @ com + X[:3, 3], X[:3, :3] @ velocity)
        rows.append(relative_features(canonicalise(batch, "quarter"))[0])
    np.testing.assert_allclose(rows[0], rows[1], atol=1e-5)
    assert np.abs(rows[0] - rows[2]).max() > 1e-3


def test_relative_features_are_what_their_names_say() -> None:
    """One transition by hand: the left foot steps forward and turns out, the CoM moves forward."""
    up = np.array([0.0, 0.0, 1.0])
    left, right = (
        Contact(e, 0, contact_pose(e, [0.0, y, 0.0], up, 0.0), 0.5)
        for e, y in (("left_foot", 0.1), ("right_foot", -0.1))
    )
    new = Contact("left_foot", 1, contact_pose("left_foot", [0.5, 0.1, 0.0], up, 0.2), 0.5)
    before, com = Stance((left, right, None, None)), np.array([0.02, 0.0, 0.981])
    batch = TransitionBatch.from_stances([(before, before.replace(0, new))], com, np.array([0.4, 0.0, 0.0]))
    row = dict(zip(relative_feature_names(), relative_features(canonicalise(batch, "quarter"))[0], strict=True))
    expected = {
        "left_foot.held": 1, "left_foot.y": 0.1, "left_foot.z": -0.981, "left_foot.nz": 1, "left_palm.held": 0,
        "right_foot.distance": np.sqrt(0.02**2 + 0.1**2 + 0.981**2), "new.x": 0.48, "new.xx": np.cos(0.2),
        "category0": 1, "category1": 0, "com_over_feet.z": 0.981, "velocity.x": 0.4, "feet_after_from_com.x": 0.23,
        "feet_that_stay_from_com.y": -0.1, "capture_point.x": 0.02 + 0.4 * np.sqrt(0.1), "capture_point.y": 0,
        "feet_after_from_capture_point.x": 0.25 - 0.02 - 0.4 * np.sqrt(0.1), "com_beyond_box_0.12.x": -0.23 + 0.12,
        "feet_that_stay_beyond_box_0.12.x": -0.25 + 0.12, "feet_that_stay_beyond_box_0.12.y": 0,
        "capture_point_in_right_foot.x": 0.02 + 0.4 * np.sqrt(0.1), "capture_point_in_right_foot.y": 0.1,
        "feet_after_in_left_foot.x": 0.25, "feet_after_in_left_foot.y": -0.1,
    }  # fmt: skip
    for name, value in expected.items():
        assert row[name] == pytest.approx(value, abs=1e-6), name


@given(seed=st.integers(0, 10**6), row=st.sampled_from(TABLE))
def test_answers_come_back_to_the_world_unchanged(seed: int, row) -> None:
    rng = np.random.default_rng(seed)
    before, after, com, velocity = random_transition(rng, row)
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = rpy_rotation([0, 0, rng.uniform(-np.pi, np.pi)]), rng.uniform(-5, 5, 3)
    com, velocity = X[:3, :3] @ com + X[:3, 3], X[:3, :3] @ velocity
    c = canonicalise(TransitionBatch.from_stances([(moved(before, X), moved(after, X))], com, velocity))
    np.testing.assert_allclose(c.points_to_world(c.com)[0], com, atol=ATOL)
    np.testing.assert_allclose(c.vectors_to_world(c.velocity)[0], velocity, atol=ATOL)
    np.testing.assert_allclose(c.points_from_world(com[None]), c.com, atol=ATOL)
    np.testing.assert_allclose(c.vectors_from_world(velocity[None]), c.velocity, atol=ATOL)
    np.testing.assert_allclose(c.points_to_world(c.feet_after)[0], moved(after, X).feet_mean(), atol=ATOL)


def test_the_representative_is_the_same_transition_seen_from_the_feet() -> None:
    """Left foot moves, heading 0, feet's mean at the origin: F is W, and the row can be read off the stance."""
    left, right = (
        Contact(e, 0, contact_pose(e, [0.0, y, 0.0], np.array([0, 0, 1.0]), 0.0), 0.5)
        for e, y in (("left_foot", 0.1), ("right_foot", -0.1))
    )
    new = Contact("left_foot", 1, contact_pose("left_foot", [0.3, 0.12, 0.05], np.array([0, 0, 1.0]), 0.0), 0.5)
    before = Stance((left, right, None, None))
    category, row, mirrored = canonical(before, before.replace(0, new), np.array([0.01, 0, 0.9]), np.array([0.2, 0, 0]))
    expected = [0, 0.1, 0, 0, 0, 0, 0, -0.1, 0, 0, 0, 0, 0.3, 0.12, 0.05, 0, 0, 0, 0.01, 0, 0.9, 0.2, 0, 0]
    assert (category, mirrored) == (0, False)
    np.testing.assert_allclose(row, expected, atol=ATOL)


@given(seed=st.integers(0, 10**6))
def test_tait_bryan_angles_give_the_rotation_back(seed: int) -> None:
    R = rpy_rotation(np.random.default_rng(seed).uniform(-np.pi, np.pi, 3))
    a, b, c = tait_bryan(R)
    again = rpy_rotation([a, 0, 0]) @ rpy_rotation([0, b, 0]) @ rpy_rotation([0, 0, c])
    np.testing.assert_allclose(again, R, atol=1e-9)
    assert -np.pi <= min(a, b, c) and max(a, b, c) < np.pi


def test_a_batch_is_its_rows_one_by_one() -> None:
    rng = np.random.default_rng(3)
    transitions = [random_transition(rng, row) for row in TABLE for _ in range(5)]
    batch = TransitionBatch.from_stances(
        [(t[0], t[1]) for t in transitions],
        np.array([t[2] for t in transitions]),
        np.array([t[3] for t in transitions]),
    )
    c = canonicalise(batch)
    singles = [canonical(*t) for t in transitions]
    for category in range(NUM_CATEGORIES):
        rows = np.flatnonzero(c.category == category)
        assert len(rows) == 10  # two rows of the table, five each
        np.testing.assert_allclose(documented_features(c, category), [singles[i][1] for i in rows], atol=ATOL)
    features = relative_features(c)
    assert features.shape == (len(batch), len(relative_feature_names())) and len(CATEGORIES) == NUM_CATEGORIES
    half = relative_features(canonicalise(batch.take(np.arange(0, len(batch), 2))))
    np.testing.assert_array_equal(features[::2], half)


def test_what_no_category_covers_is_said_and_not_guessed() -> None:
    rng = np.random.default_rng(0)
    before, after, com, velocity = random_transition(rng, TABLE[0])
    one_foot = before.replace(1, None)
    pairs = [(one_foot, one_foot.replace(0, after.contacts[0])), (before, one_foot), (before, after)]
    c = canonicalise(TransitionBatch.from_stances(pairs, np.tile(com, (3, 1)), np.tile(velocity, (3, 1))))
    assert c.category.tolist() == [UNKNOWN, UNKNOWN, 0]
    assert not relative_features(c)[:2].any()
    assert canonical(one_foot, pairs[0][1], com, velocity)[1].size == 0


def test_shapes_that_do_not_fit_are_refused() -> None:
    rng = np.random.default_rng(0)
    before, after, com, velocity = random_transition(rng, TABLE[0])
    batch = TransitionBatch.from_stances([(before, after)], com, velocity)
    with pytest.raises(ValueError, match="com has shape"):
        TransitionBatch(
            batch.held, batch.p, batch.R, batch.mover, batch.makes, batch.p_new, batch.R_new, com, batch.velocity
        )
