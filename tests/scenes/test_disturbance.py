"""Pushes: eq. 7.2 of Lin 2020 in closed form, and draws that follow it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenes.disturbance import (
    PERIOD,
    Disturbance,
    PushDistribution,
    any_along,
    discretised,
    pushes_at,
    sample_pushes,
)
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.pose import pose_matrix

SIDE = np.array([[0.0, 38.0, 0.0], [0.0, -38.0, 0.0]])
EVERYWHERE = Disturbance(SIDE, 0.01)
SHELTERED = Disturbance(np.array([[-40.0, 0.0, 0.0]]), 0.2, (2.0, 1.0, 4.0), pose_matrix([3.0, 0.0, 1.0], [0, 0, 0.5]))


@given(st.lists(st.floats(0.0, 0.25), min_size=1, max_size=4), st.floats(0.0, 20.0))
def test_the_probabilities_of_all_pushes_and_of_none_add_up_to_one(probability: list[float], duration: float) -> None:
    here = PushDistribution(np.ones((len(probability), 3)), np.array(probability))
    assert here.within(duration).sum() + here.none_within(duration) == pytest.approx(1.0, abs=1e-12)
    assert (here.within(duration) >= 0).all()


def test_within_one_period_every_push_has_the_probability_that_the_scene_says() -> None:
    np.testing.assert_allclose(pushes_at([EVERYWHERE], np.zeros(3)).within(PERIOD), [0.005, 0.005])


@given(st.floats(0.0, 1.0), st.integers(0, 40))
def test_at_least_one_push_in_n_periods_is_one_less_n_calm_ones(p: float, periods: int) -> None:
    here = pushes_at([Disturbance(SIDE, p)], np.zeros(3))
    assert here.any_within(periods * PERIOD) == pytest.approx(1.0 - (1.0 - p) ** periods, abs=1e-9)


@given(st.floats(0.0, 0.9), st.floats(0.0, 3.0), st.floats(0.0, 3.0))
def test_calm_in_two_spans_is_calm_in_both(p: float, first: float, second: float) -> None:
    here = pushes_at([Disturbance(SIDE, p)], np.zeros(3))
    assert here.none_within(first + second) == pytest.approx(here.none_within(first) * here.none_within(second))


def test_where_regions_overlap_their_sets_are_put_together() -> None:
    inside, outside = np.array([3.0, 0.2, 1.0]), np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(pushes_at([EVERYWHERE, SHELTERED], inside).probability, [0.005, 0.005, 0.2])
    np.testing.assert_allclose(pushes_at([EVERYWHERE, SHELTERED], outside).probability, [0.005, 0.005])
    assert not len(pushes_at([SHELTERED], outside).impulses)
    assert pushes_at([SHELTERED], outside).any_within(100.0) == 0.0


def test_a_region_is_turned_with_its_pose() -> None:
    along = np.array([np.cos(0.5), np.sin(0.5), 0.0])
    across = np.array([-np.sin(0.5), np.cos(0.5), 0.0])
    centre = np.array([3.0, 0.0, 1.0])
    points = [centre + 0.99 * along, centre + 1.01 * along, centre + 0.49 * across, centre + 0.51 * across]
    assert SHELTERED.acts_at(np.array(points)).tolist() == [True, False, True, False]


def test_regions_that_overlap_with_more_than_certainty_are_refused() -> None:
    with pytest.raises(InputError, match=r"add up to 1\.4"):
        pushes_at([Disturbance(SIDE, 0.7), Disturbance(SIDE, 0.7)], np.zeros(3))


def _way() -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(61) * PERIOD
    return t, np.stack([0.1 * np.arange(61), np.zeros(61), np.ones(61)], axis=1)


def test_a_way_is_hit_unless_every_interval_stays_calm() -> None:
    t, com = _way()
    inside = int(SHELTERED.acts_at(com[:-1]).sum())
    assert 0 < inside < 60
    assert any_along([SHELTERED], t, com) == pytest.approx(1.0 - 0.8**inside)
    assert any_along([], t, com) == 0.0


def test_draws_come_as_often_as_the_closed_form_says() -> None:
    """1000 ways: each share must lie within four standard deviations of the closed form."""
    t, com = _way()
    ways = 1000
    scene = [Disturbance(SIDE, 0.02), SHELTERED]
    rng = np.random.default_rng(7)
    drawn = [sample_pushes(scene, t, com, rng) for _ in range(ways)]
    hit = np.mean([len(d.interval) > 0 for d in drawn])
    expected = any_along(scene, t, com)
    assert abs(hit - expected) < 4 * np.sqrt(expected * (1 - expected) / ways)
    impulses = np.concatenate([d.impulse for d in drawn])
    inside = int(SHELTERED.acts_at(com[:-1]).sum())
    for impulse, mean in ((SIDE[0], 0.01 * 60), (SIDE[1], 0.01 * 60), (SHELTERED.impulses[0], 0.2 * inside)):
        count = (impulses == impulse).all(axis=1).sum() / ways
        assert abs(count - mean) < 4 * np.sqrt(mean / ways)
    for d in drawn:
        assert (np.diff(d.interval) > 0).all()


def test_the_same_seed_draws_the_same_pushes_and_another_seed_others() -> None:
    t, com = _way()
    scene = [Disturbance(SIDE, 0.3)]
    first, again, other = (sample_pushes(scene, t, com, np.random.default_rng(s)) for s in (3, 3, 4))
    np.testing.assert_array_equal(first.interval, again.interval)
    np.testing.assert_array_equal(first.impulse, again.impulse)
    assert first.interval.tolist() != other.interval.tolist()


def test_a_calm_region_on_the_way_does_not_change_what_happens_elsewhere() -> None:
    t, com = _way()
    both = [Disturbance(SIDE, 0.3, (2.0, 2.0, 2.0), pose_matrix([5.0, 0, 1.0], [0, 0, 0])), SHELTERED]
    drawn = sample_pushes(both, t, com, np.random.default_rng(1))
    alone = sample_pushes(both[:1], t, com, np.random.default_rng(1))
    late = drawn.interval >= 42  # past the sheltered region
    np.testing.assert_array_equal(drawn.interval[late], alone.interval[alone.interval >= 42])


def test_certain_pushes_come_in_every_interval() -> None:
    t, com = _way()
    drawn = sample_pushes([Disturbance(SIDE, 1.0)], t, com, np.random.default_rng(0))
    assert drawn.interval.tolist() == list(range(60))


def test_a_distribution_is_cut_into_voronoi_cells() -> None:
    """Of impulses uniform on [0, 4), 0.5 takes what is nearer to it than to 3: [0, 1.75)."""
    x = np.random.default_rng(0).uniform(0.0, 4.0, 20_000)
    samples = np.stack([x, 0 * x, 0 * x], axis=1)
    low, high = discretised(np.array([[0.5, 0, 0], [3.0, 0, 0], [90.0, 0, 0]]), samples, 0.1)
    assert low.probability == pytest.approx(0.1 * 1.75 / 4, abs=1e-3)
    assert low.probability + high.probability == pytest.approx(0.1)


def test_the_narrow_strip_is_pushed_from_both_sides_once_in_a_hundred_periods() -> None:
    """Lin 2020 sec. 7.8: P(D_high, 0.1) = 1 %, shared evenly by m (0, +-0.6, 0) of a robot of 63.47 kg."""
    here = pushes_at(load_scene("narrow_flat").disturbances, np.array([0.5, 0.0, 0.8]))
    np.testing.assert_allclose(here.impulses, [[0, 38.082, 0], [0, -38.082, 0]])
    assert here.any_within(PERIOD) == pytest.approx(0.01)
    assert here.any_within(0.4) == pytest.approx(1 - 0.99**4)


@pytest.mark.parametrize(
    ("impulses", "probability", "box", "message"),
    [
        (np.zeros((0, 3)), 0.1, None, "impulses"),
        ([[np.nan, 0, 0]], 0.1, None, "impulses"),
        ([[1.0, 0]], 0.1, None, "impulses"),
        (SIDE, 1.2, None, "probability"),
        (SIDE, np.nan, None, "probability"),
        (SIDE, 0.1, (1.0, 0.0, 1.0), "box"),
    ],
)
def test_what_cannot_be_a_disturbance_is_refused(
    impulses: object, probability: float, box: object, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Disturbance(impulses, probability, box)  # type: ignore[arg-type]


def test_ways_that_do_not_ascend_in_time_are_refused() -> None:
    _, com = _way()
    with pytest.raises(InputError, match="ascend"):
        any_along([EVERYWHERE], np.zeros(61), com)
    with pytest.raises(InputError, match="duration"):
        pushes_at([EVERYWHERE], np.zeros(3)).any_within(-0.1)
