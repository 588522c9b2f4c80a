"""Fig. 10 of Lin et al. 2019 (Lin 2020 fig. 6.11): sum of the predicted objectives against that of the whole sequence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.bench.lin2019.queries import LEARNED, SCENES, Query, of
from drakeplan.bench.table import BenchTable

LEAST = 3  # sequences that a line is fitted to
BISQUARE = (
    4.685  # [spreads] residuals beyond count for nothing: 95 % as efficient as least squares where nothing is far
)
NORMAL_MAD = 0.6745  # median of |x| of a normal distribution of spread 1
ITERATIONS = 100


@dataclass(frozen=True, eq=False)
class Prediction:
    """Sequences of one scene, or of all of them, and the line through them.

    Attributes:
        scene: its name, "both" for all.
        predicted: (n,) sums of the objectives that the search saw.
        actual: (n,) objectives of the programs over the whole sequences.
        slope, intercept: of the robust fit actual = slope predicted + intercept; NaN for too few.
    """

    scene: str
    predicted: np.ndarray
    actual: np.ndarray
    slope: float
    intercept: float

    @property
    def correlation(self) -> float:
        """Pearson's r."""
        return float(np.corrcoef(self.predicted, self.actual)[0, 1]) if len(self.actual) >= LEAST else float("nan")

    @property
    def rank_correlation(self) -> float:
        """Spearman's: how well the sum orders sequences, which is all that a search makes of it."""
        from scipy.stats import rankdata

        if len(self.actual) < LEAST:
            return float("nan")
        return float(np.corrcoef(rankdata(self.predicted), rankdata(self.actual))[0, 1])

    @property
    def relative_error(self) -> float:
        """Median distance of the actual objective from the line, over the objective."""
        off = np.abs(self.slope * self.predicted + self.intercept - self.actual)
        return float(np.median(off / self.actual)) if len(self.actual) else float("nan")


def predictions(queries: Sequence[Query]) -> list[Prediction]:
    """Of each scene and of both together: the first and the last feasible sequence of every learned query."""
    by_scene: dict[str, np.ndarray] = {}
    for scene in SCENES:
        answers = [q.answer for q in of(queries, scene, LEARNED) if q.answer.feasible]
        pairs = [(a.predicted, a.objective) for a in answers] + [
            (a.first_predicted, a.first_objective) for a in answers
        ]
        found = np.array(pairs).reshape(-1, 2)
        by_scene[scene] = found[np.isfinite(found).all(axis=1)]
    by_scene["both"] = np.concatenate(list(by_scene.values()))
    return [_prediction(scene, pairs[:, 0], pairs[:, 1]) for scene, pairs in by_scene.items()]


def _prediction(scene: str, predicted: np.ndarray, actual: np.ndarray) -> Prediction:
    slope, intercept = robust_line(predicted, actual)
    return Prediction(scene, predicted, actual, slope, intercept)


def robust_line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope and intercept of a line through points, insensitive to a few outliers; NaN for too few points.

    Iteratively reweighted least squares (Holland and Welsch 1977, cited by Lin 2020) with bisquare weights of the
    residuals over their spread, which the points' leverage widens: far points have weight zero.

    Args:
        x: (n,) values.
        y: (n,) values at x.
    """
    if len(x) < LEAST or np.ptp(x) == 0:
        return float("nan"), float("nan")
    A = np.stack([(x - x.mean()) / np.ptp(x), np.ones(len(x))], axis=1)
    leverage = np.minimum((np.linalg.qr(A)[0] ** 2).sum(axis=1), 0.9999)
    line, tiny = np.linalg.lstsq(A, y, rcond=None)[0], 1e-9 * max(float(np.std(y)), 1.0)
    for _ in range(ITERATIONS):
        residual = (y - A @ line) / np.sqrt(1.0 - leverage)
        spread = max(float(np.median(np.sort(np.abs(residual))[A.shape[1] - 1 :])) / NORMAL_MAD, tiny)
        root = np.maximum(1.0 - (residual / (BISQUARE * spread)) ** 2, 0.0)  # of the weights
        before, line = line, np.linalg.lstsq(root[:, None] * A, root * y, rcond=None)[0]
        if np.abs(line - before).max() <= tiny:
            break
    slope = float(line[0] / np.ptp(x))
    return slope, float(line[1] - slope * x.mean())


def table(found: Sequence[Prediction]) -> BenchTable:
    """One row a scene."""
    rows = [
        (p.scene, len(p.actual), p.correlation, p.rank_correlation, p.slope, p.intercept, p.relative_error) for p in found
    ]  # fmt: skip
    columns = (
        "scene",
        "sequences",
        "correlation",
        "rank correlation",
        "slope",
        "intercept",
        "median error of the line",
    )
    title = "Sum of predicted objectives against the actual one (Lin et al. 2019 fig. 10)"
    notes = (
        "The first and the last feasible sequence of every query. Robust regression (bisquare weights), actual over predicted.",
        "The documents show the picture alone and call the two highly correlated.",
    )
    return BenchTable("lin2019_prediction", title, columns, tuple(rows), notes, bench="lin2019", most_seeds=None)
