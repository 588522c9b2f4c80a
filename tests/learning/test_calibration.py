"""Probabilities that mean what they say, thresholds that keep what they promise, and a sense of distance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.special import expit

from learning.calibration import fit_platt, fit_training_range, reliability_curve, threshold_for_recall


def test_outcomes_drawn_from_the_predictions_are_found_reliable() -> None:
    rng = np.random.default_rng(0)
    probability = rng.uniform(size=200_000)
    curve = reliability_curve(probability, rng.uniform(size=len(probability)) < probability)
    assert curve.expected_error < 0.01 and curve.count.sum() == len(probability)
    np.testing.assert_allclose(curve.observed, curve.predicted, atol=0.02)


def test_the_calibration_error_of_a_constant_guess_is_its_distance_from_the_truth() -> None:
    truth = np.array([True] * 3 + [False] * 7)
    assert reliability_curve(np.full(10, 0.9), truth).expected_error == pytest.approx(0.6)
    assert reliability_curve(np.array([1.0, 0.0]), np.array([True, False])).expected_error == 0.0
    with pytest.raises(ValueError, match="at least one"):
        reliability_curve(np.zeros(0), np.zeros(0, bool))


@given(scale=st.floats(0.2, 5.0), offset=st.floats(-2.0, 2.0), seed=st.integers(0, 100))
def test_platt_scaling_finds_the_distortion_that_was_put_in(scale: float, offset: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    true_logit = rng.normal(0.0, 2.0, 40_000)
    truth = rng.uniform(size=len(true_logit)) < expit(true_logit)
    logit = (true_logit - offset) / scale
    a, b = fit_platt(logit, truth)
    # A maximum likelihood estimate of n samples spreads as the inverse of Fisher's information (Fisher 1925).
    p, x = expit(true_logit), np.stack([logit, np.ones_like(logit)])
    spread = np.sqrt(np.diag(np.linalg.inv((x * p * (1 - p)) @ x.T)))
    assert abs(a - scale) < 4.0 * spread[0] and abs(b - offset) < 4.0 * spread[1]


def test_platt_scaling_leaves_alone_what_it_cannot_judge_and_stays_finite_where_classes_separate() -> None:
    assert fit_platt(np.linspace(-1, 1, 50), np.ones(50, bool)) == (1.0, 0.0)
    assert fit_platt(np.zeros(0), np.zeros(0, bool)) == (1.0, 0.0)
    logit = np.concatenate([np.full(50, -3.0), np.full(50, 3.0)])
    a, b = fit_platt(logit, logit > 0)
    assert np.isfinite([a, b]).all() and a > 0
    np.testing.assert_allclose(expit(a * 3.0 + b), 51 / 52, atol=1e-3)  # Platt's softened target


@given(seed=st.integers(0, 1000), recall=st.floats(0.01, 1.0), n=st.integers(1, 200))
def test_the_threshold_is_the_greatest_that_keeps_the_recall(seed: int, recall: float, n: int) -> None:
    rng = np.random.default_rng(seed)
    probability, truth = rng.uniform(size=n), rng.uniform(size=n) < 0.5
    truth[0] = True
    t = threshold_for_recall(probability, truth, recall)
    assert np.mean(probability[truth] >= t) >= recall - 1e-9
    above = probability[truth][probability[truth] > t]
    assert len(above) == 0 or np.mean(probability[truth] >= above.min()) < recall


def test_a_recall_of_nothing_or_of_more_than_all_is_refused() -> None:
    assert threshold_for_recall(np.array([0.2]), np.array([False]), 0.9) == 0.5
    for recall in (0.0, 1.1):
        with pytest.raises(ValueError, match="recall"):
            threshold_for_recall(np.array([0.2]), np.array([True]), recall)


def test_distance_is_mahalanobis_and_its_limit_holds_the_stated_share() -> None:
    rng = np.random.default_rng(1)
    mixing = rng.normal(size=(5, 5))
    features = (rng.normal(size=(20_000, 5)) @ mixing).astype(np.float32)
    extent = fit_training_range(features, np.full(20_000, 3), share=0.99)
    fresh = (rng.normal(size=(20_000, 5)) @ mixing).astype(np.float32)
    category = np.full(20_000, 3)
    assert np.mean(extent.distance(fresh, category) > 1.0) == pytest.approx(0.01, abs=0.004)
    # The slow twin: sqrt(d^T C^-1 d) with C the covariance of what was drawn (the floor adds 4e-4 to variances of order 5).
    d = fresh[:50] - features.mean(axis=0)
    slow = np.sqrt(np.einsum("ij,jk,ik->i", d, np.linalg.inv(np.cov(features.T) + 4e-4 * np.eye(5)), d))
    np.testing.assert_allclose(extent.distance(fresh[:50], category[:50]) * extent.limit[3], slow, rtol=1e-3)


def test_few_data_in_many_dimensions_do_not_make_all_others_far() -> None:
    """The limit from 100 rows in 40 dimensions is too tight for new ones, as Hotelling 1931 says; held-out rows mend it."""
    rng = np.random.default_rng(4)
    few, others, fresh = (rng.normal(size=(n, 40)).astype(np.float32) for n in (100, 500, 5000))
    zeros = [np.zeros(n, int) for n in (100, 500, 5000)]
    alone = fit_training_range(few, zeros[0])
    aware = fit_training_range(few, zeros[0], held_out=(others, zeros[1]))
    # Hotelling: n / (n + 1) d^2 of a new row is (n - 1) p / (n - p) times an F variable with p and n - p degrees.
    ratio = alone.limit[0] ** 2 * (100 / 101) * (100 - 40) / ((100 - 1) * 40)
    expected = stats.f.sf(ratio, 40, 100 - 40)
    assert expected > 0.3
    assert np.mean(alone.distance(fresh, zeros[2]) > 1.0) == pytest.approx(expected, abs=0.05)
    # The share beyond the k-th greatest of n is Beta(k, n - k + 1); here k = 500 (1 - 0.995), rounded up.
    assert np.mean(aware.distance(fresh, zeros[2]) > 1.0) < stats.beta.ppf(0.999, 3, 500 - 3 + 1)


def test_what_training_never_saw_is_far_also_where_it_saw_no_variation() -> None:
    """All training soles were level: a tilted one is far, though the spread of its normal was zero."""
    rng = np.random.default_rng(2)
    features = rng.normal(size=(5000, 4)).astype(np.float32)
    features[:, 3] = 0.0
    extent = fit_training_range(features, np.zeros(5000, int))
    tilted = features[:100].copy()
    tilted[:, 3] = 0.3
    assert (extent.distance(tilted, np.zeros(100, int)) > 1.0).all()
    assert np.mean(extent.distance(features, np.zeros(5000, int)) > 1.0) == pytest.approx(0.005, abs=0.002)


def test_a_category_without_data_is_always_far() -> None:
    features = np.random.default_rng(3).normal(size=(100, 4)).astype(np.float32)
    extent = fit_training_range(features, np.zeros(100, int))
    distance = extent.distance(features[:4], np.array([0, 1, -1, 0]))
    assert np.isinf(distance[[1, 2]]).all() and np.isfinite(distance[[0, 3]]).all()
    assert np.isinf(extent.distance(features[:2], np.array([-1, -1]))).all()
