"""What a predicted probability is worth, where to draw the line, and how far a transition lies from the training data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from scipy.linalg import solve_triangular
from scipy.special import expit

from learning.matrix_product import add_product, padded, panels
from learning.transition_features import NUM_CATEGORIES

_FEATURE_FLOOR = 0.02  # [m, -, m/s] variations smaller than this mean nothing, also where training had none


@dataclass(frozen=True, eq=False)
class ReliabilityCurve:
    """How often what was predicted came true.

    Attributes:
        predicted: (B,) mean probability of each bin that is not empty.
        observed: (B,) share of feasible transitions in it.
        count: (B,) transitions in it.
    """

    predicted: np.ndarray
    observed: np.ndarray
    count: np.ndarray

    @property
    def expected_error(self) -> float:
        """Expected calibration error: mean of |predicted - observed|, weighted by count (Guo et al. 2017, eq. 3)."""
        return float(np.average(np.abs(self.predicted - self.observed), weights=self.count))


def reliability_curve(probability: np.ndarray, feasible: np.ndarray, bins: int = 15) -> ReliabilityCurve:
    """The curve over equally wide bins of (n,) probabilities beside (n,) truths.

    Args:
        probability: (n,) as predicted.
        feasible: (n,) bool, as the program decided.
        bins: how many.

    Raises:
        ValueError: nothing to make a curve of.
    """
    if not len(probability):
        raise ValueError("a reliability curve needs at least one transition")
    index = np.minimum((np.asarray(probability, float) * bins).astype(int), bins - 1)
    count = np.bincount(index, minlength=bins)
    predicted = np.bincount(index, weights=probability, minlength=bins)
    observed = np.bincount(index, weights=np.asarray(feasible, float), minlength=bins)
    some = count > 0
    return ReliabilityCurve(predicted[some] / count[some], observed[some] / count[some], count[some])


def fit_platt(logit: np.ndarray, feasible: np.ndarray) -> tuple[float, float]:
    """Scale a > 0 and offset b so that expit(a logit + b) is calibrated (Platt 1999).

    Newton's method on the log loss, with Platt's softened targets, which keep a and b finite where the logits separate
    the classes. With one class, or too little to go by, (1, 0): nothing is changed.

    Args:
        logit: (n,) of feasibility, before calibration.
        feasible: (n,) bool, as the program decided.
    """
    logit, truth = np.asarray(logit, float), np.asarray(feasible, bool)
    positives, negatives = int(truth.sum()), int((~truth).sum())
    if min(positives, negatives) < 5:
        return 1.0, 0.0
    target = np.where(truth, (positives + 1.0) / (positives + 2.0), 1.0 / (negatives + 2.0))
    scale = max(float(np.std(logit)), 1e-6)  # Newton in standard units
    x = np.stack([logit / scale, np.ones_like(logit)], axis=1)
    theta = np.array([scale, 0.0])

    def loss(theta: np.ndarray) -> float:
        z = x @ theta
        return float(np.sum(np.logaddexp(0.0, z) - target * z))

    for _ in range(100):
        p = expit(x @ theta)
        gradient = x.T @ (p - target)
        hessian = (x * (p * (1 - p))[:, None]).T @ x + 1e-9 * np.eye(2)
        step = np.linalg.solve(hessian, gradient)
        length = 1.0
        while loss(theta - length * step) > loss(theta) and length > 1e-6:
            length *= 0.5
        theta = theta - length * step
        if np.abs(length * step).max() < 1e-9:
            break
    a, b = theta[0] / scale, theta[1]
    return (float(a), float(b)) if np.isfinite(theta).all() and a > 0 else (1.0, 0.0)


def threshold_for_recall(probability: np.ndarray, feasible: np.ndarray, recall: float) -> float:
    """The greatest probability p such that at least this share of the feasible transitions is predicted at p or above.

    0.5 where none is feasible.

    Args:
        probability: (n,) as predicted, calibrated.
        feasible: (n,) bool, as the program decided.
        recall: share of the feasible ones that has to be found, in (0, 1].
    """
    if not 0.0 < recall <= 1.0:
        raise ValueError(f"recall must lie in (0, 1], got {recall}")
    of_feasible = np.sort(np.asarray(probability, float)[np.asarray(feasible, bool)])
    if not len(of_feasible):
        return 0.5
    allowed = int(np.floor((1.0 - recall) * len(of_feasible) + 1e-9))  # feasible ones that may be missed
    return float(of_feasible[allowed])


@dataclass(frozen=True, eq=False)
class TrainingRange:
    """Where training data were: a Gaussian for each category, on the relative features (Mahalanobis 1936).

    Attributes:
        mean: (10, d).
        whitening: (10, d, d), so that |(x - mean) whitening| is the distance.
        limit: (10,) distance beyond which a transition is far; 0 for a category without data.
    """

    mean: np.ndarray
    whitening: np.ndarray
    limit: np.ndarray

    def distance(self, features: np.ndarray, category: np.ndarray) -> np.ndarray:
        """(n,) distances over their limits: far where above 1, infinite where there were no data.

        Args:
            features: (n, d) relative features.
            category: (n,) 0..9 or `UNKNOWN`.
        """
        out = np.full(len(features), np.inf, np.float32)
        _distance(np.ascontiguousarray(features, np.float32), category, self.mean, self._panels, self.limit, out)
        return out

    @cached_property
    def _panels(self) -> np.ndarray:
        return np.array([panels(matrix) for matrix in self.whitening])


def fit_training_range(
    features: np.ndarray,
    category: np.ndarray,
    share: float = 0.995,
    held_out: tuple[np.ndarray, np.ndarray] | None = None,
) -> TrainingRange:
    """The range that holds this share of the (n, d) features of each category.

    Args:
        features: (n, d) that a network was trained on.
        category: (n,) of them.
        share: that lies within the limit.
        held_out: features and categories of other scenes: the limit holds this share of those too, where there are at
            least 100 of a category. A Gaussian lies nearer to its own data than to new ones.
    """
    d = features.shape[1]
    mean, whitening = np.zeros((NUM_CATEGORIES, d)), np.zeros((NUM_CATEGORIES, d, d))
    limit = np.zeros(NUM_CATEGORIES)
    for k in range(NUM_CATEGORIES):
        x = np.asarray(features[category == k], float)
        if len(x) < 2:
            continue
        mean[k] = x.mean(axis=0)
        covariance = np.cov(x.T) + _FEATURE_FLOOR**2 * np.eye(d)
        lower = np.linalg.cholesky(covariance)  # covariance = L L^T, distance^2 = |L^-1 (x - mean)|^2
        whitening[k] = solve_triangular(lower, np.eye(d), lower=True).T
        limit[k] = np.quantile(np.linalg.norm((x - mean[k]) @ whitening[k], axis=1), share)
        if held_out is not None and (held_out[1] == k).sum() >= 100:
            others = np.linalg.norm((held_out[0][held_out[1] == k] - mean[k]) @ whitening[k], axis=1)
            limit[k] = max(limit[k], np.quantile(others, share))
    return TrainingRange(mean.astype(np.float32), whitening.astype(np.float32), limit.astype(np.float32))


@njit(cache=True)
def _distance(
    x: np.ndarray, category: np.ndarray, mean: np.ndarray, whitening: np.ndarray, limit: np.ndarray, out: np.ndarray
) -> None:
    """Fills in the distances over their limits, one category after the other; others keep what they hold."""
    n, d = x.shape
    rows = np.empty(n, np.int64)
    for k in range(len(limit)):
        m = 0
        for i in range(n):
            if category[i] == k:
                rows[m] = i
                m += 1
        if m == 0 or not limit[k] > 0:
            continue
        offset, z = np.empty((m, d), np.float32), np.zeros((m, padded(d)), np.float32)
        for i in range(m):
            for j in range(d):
                offset[i, j] = x[rows[i], j] - mean[k, j]
        add_product(offset, whitening[k], 0, d, z)
        for i in range(m):
            out[rows[i]] = np.sqrt(_square(z[i])) / limit[k]


@njit(cache=True)
def _square(z: np.ndarray) -> float:
    """|z|^2, summed in sixteen parts whatever the processor; the length is a multiple of that."""
    part = np.zeros(16, np.float32)
    for j in range(0, len(z), 16):
        for lane in range(16):
            part[lane] += z[j + lane] * z[j + lane]
    total = 0.0
    for lane in range(16):
        total += part[lane]
    return total
