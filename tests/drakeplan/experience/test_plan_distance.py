"""The Hausdorff distance of plans: against the formulas written out, closed forms and what every distance has to be."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_plans import HALF_WIDTH, made_up_plan
from scipy.spatial.transform import Rotation

from drakeplan.experience.plan_distance import TURN_WEIGHT, PlanBatch, distances
from drakeplan.experience.stored_plan import Outline
from scenes.effector import LEFT_FOOT, LEFT_PALM, RIGHT_FOOT, RIGHT_PALM

ATOL = 1e-12  # rounding of sums of a few metres
seeds = st.integers(0, 10**6)


def random_outline(seed: int, count: int, effectors: int = 4) -> Outline:
    """Contacts anywhere within 2 m, turned anyhow; those of every end effector but the last ones."""
    rng = np.random.default_rng(seed)
    quaternion = Rotation.random(count, rng).as_quat(scalar_first=True)
    effector = np.concatenate([np.arange(effectors), rng.integers(0, effectors, max(count - effectors, 0))])[:count]
    return Outline(rng.uniform(-1, 1, (count, 3)), quaternion, effector, np.zeros(count, int), np.zeros(2))


def apart(one: Outline, other: Outline) -> float:
    return float(distances(one, PlanBatch.of([other]))[0])


def single(
    effector: int = LEFT_FOOT,
    position: tuple[float, float, float] = (0.0, 0.0, 0.0),
    turn: Rotation | None = None,
) -> Outline:
    """One contact."""
    turned = (turn or Rotation.identity()).as_quat(scalar_first=True)
    return Outline(np.array([position]), turned[None], np.array([effector]), np.zeros(1, int), np.zeros(2))


def joined(*outlines: Outline) -> Outline:
    """All contacts of these."""
    return Outline(
        np.concatenate([o.position for o in outlines]),
        np.concatenate([o.quaternion for o in outlines]),
        np.concatenate([o.effector for o in outlines]),
        np.concatenate([o.first for o in outlines]),
        np.zeros(2),
    )


def reordered(outline: Outline, order: np.ndarray) -> Outline:
    return Outline(
        outline.position[order], outline.quaternion[order], outline.effector[order], outline.first[order], np.zeros(2)
    )


def contact_distance(a: Outline, i: int, b: Outline, j: int) -> float:
    """Eq. 4.2 of Lin 2020."""
    if a.effector[i] != b.effector[j]:
        return np.inf
    turn = abs(float(a.quaternion[i] @ b.quaternion[j]))
    return float(np.linalg.norm(a.position[i] - b.position[j])) + TURN_WEIGHT * (1.0 - turn)


def slow_distance(a: Outline, b: Outline) -> float:
    """Eq. 4.3 of Lin 2020."""
    table = np.array([[contact_distance(a, i, b, j) for j in range(len(b.effector))] for i in range(len(a.effector))])
    return max(table.min(axis=1).max(), table.min(axis=0).max())


# ---- the formulas


@settings(max_examples=60)
@given(seeds, st.integers(1, 14), st.lists(st.tuples(st.integers(1, 14), st.integers(1, 4)), min_size=1, max_size=4))
def test_the_distance_is_that_of_the_formulas(seed: int, count: int, sizes: list[tuple[int, int]]) -> None:
    one = random_outline(seed, count, 1 + seed % 4)
    others = [random_outline(seed + 1 + k, *size) for k, size in enumerate(sizes)]
    expected = [slow_distance(one, other) for other in others]
    np.testing.assert_allclose(distances(one, PlanBatch.of(others)), expected, atol=ATOL)


@settings(max_examples=15)
@given(seeds, seeds, st.integers(2, 8), st.integers(2, 8))
def test_walks_are_as_far_apart_as_the_formulas_say(seed: int, other: int, steps: int, more: int) -> None:
    a = made_up_plan(steps, 0.25, noise=0.05, seed=seed, palms=(LEFT_PALM,), turn=0.2).outline
    b = made_up_plan(more, 0.22, noise=0.05, seed=other, palms=(LEFT_PALM,), turn=0.2).outline
    assert apart(a, b) == pytest.approx(slow_distance(a, b), abs=ATOL)


# ---- closed forms


@given(st.tuples(*[st.floats(-3, 3)] * 3))
def test_a_contact_is_as_far_away_as_it_was_moved(shift: tuple[float, float, float]) -> None:
    assert apart(single(), single(position=shift)) == pytest.approx(np.linalg.norm(shift), abs=ATOL)


@given(st.floats(-2 * np.pi, 2 * np.pi), seeds)
def test_a_turn_about_any_axis_counts_by_its_half_angle(angle: float, seed: int) -> None:
    axis = np.random.default_rng(seed).standard_normal(3)
    turned = single(turn=Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)))
    assert apart(single(), turned) == pytest.approx(TURN_WEIGHT * (1 - abs(np.cos(angle / 2))), abs=1e-9)


def test_moving_and_turning_add_up() -> None:
    turned = single(position=(0.3, 0.0, 0.4), turn=Rotation.from_euler("z", 90, degrees=True))
    assert apart(single(), turned) == pytest.approx(0.5 + TURN_WEIGHT * (1 - np.sqrt(0.5)))


def test_a_quaternion_and_its_negative_are_one_turn() -> None:
    one = random_outline(0, 6)
    other = Outline(one.position, -one.quaternion, one.effector, one.first, one.distance)
    assert apart(one, other) == pytest.approx(0.0, abs=ATOL)


def test_the_contact_that_nothing_is_near_decides() -> None:
    walk = made_up_plan(5).outline
    lonely = joined(walk, single(LEFT_FOOT, (0.0, 7.0, 0.0)))
    assert apart(walk, lonely) == pytest.approx(7.0 - HALF_WIDTH)  # from the first left foot
    assert apart(walk, lonely) == apart(lonely, walk)


def test_two_steps_more_are_two_strides_further() -> None:
    assert apart(made_up_plan(6).outline, made_up_plan(8).outline) == pytest.approx(0.5, abs=1e-3)


# ---- what a distance has to be


@settings(max_examples=30)
@given(seeds, st.integers(4, 12), st.integers(4, 12), st.integers(4, 12))
def test_it_is_symmetric_zero_on_itself_and_never_negative(seed: int, k: int, m: int, n: int) -> None:
    a, b, c = (random_outline(seed + i, size) for i, size in enumerate((k, m, n)))
    assert apart(a, b) == pytest.approx(apart(b, a), abs=ATOL)
    for outline in (a, b, c):
        assert apart(outline, outline) == pytest.approx(0.0, abs=ATOL)
    assert apart(a, b) > 0.0


@settings(max_examples=30)
@given(seeds, st.integers(4, 12))
def test_the_order_of_contacts_does_not_matter(seed: int, count: int) -> None:
    a, b = random_outline(seed, count), random_outline(seed + 1, 10)
    order = np.random.default_rng(seed).permutation(count)
    assert apart(reordered(a, order), b) == pytest.approx(apart(a, b), abs=ATOL)
    assert apart(b, reordered(a, order)) == pytest.approx(apart(a, b), abs=ATOL)
    assert apart(a, reordered(a, order)) == pytest.approx(0.0, abs=ATOL)


@settings(max_examples=20)
@given(seeds, st.tuples(*[st.floats(-2, 2)] * 3))
def test_it_does_not_depend_on_the_frame_that_both_are_in(seed: int, shift: tuple[float, float, float]) -> None:
    turn = Rotation.random(rng=np.random.default_rng(seed))

    def moved(o: Outline) -> Outline:
        Q = (turn * Rotation.from_quat(o.quaternion, scalar_first=True)).as_quat(scalar_first=True)
        return Outline(turn.apply(o.position) + shift, Q, o.effector, o.first, o.distance)

    a, b = random_outline(seed, 8), random_outline(seed + 1, 9)
    assert apart(moved(a), moved(b)) == pytest.approx(apart(a, b), abs=1e-9)


def test_other_end_effectors_are_infinitely_far() -> None:
    for used, other in itertools.combinations([(), (LEFT_PALM,), (RIGHT_PALM,), (LEFT_PALM, RIGHT_PALM)], 2):
        assert apart(made_up_plan(palms=used).outline, made_up_plan(palms=other).outline) == np.inf
    assert apart(single(LEFT_FOOT), single(RIGHT_FOOT)) == np.inf
    assert apart(single(LEFT_FOOT), joined(single(LEFT_FOOT), single(RIGHT_FOOT))) == np.inf


def test_a_batch_is_each_plan_on_its_own() -> None:
    plans = [made_up_plan(k, noise=0.03, seed=k, palms=(2,) * (k % 2)).outline for k in range(2, 9)]
    batch = PlanBatch.of(plans)
    assert len(batch) == len(plans)
    np.testing.assert_array_equal(distances(plans[0], batch), [apart(plans[0], plan) for plan in plans])


def test_nothing_is_as_far_as_nobody() -> None:
    assert len(PlanBatch.of([])) == 0
    assert distances(single(), PlanBatch.of([])).shape == (0,)
