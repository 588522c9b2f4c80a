"""Fig. 10 of Lin et al. 2019 (Lin 2020 fig. 6.11): sum of the predicted objectives against that of the whole sequence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.bench.lin2019_queries import LEARNED, SCENES, Query, of
from drakeplan.bench.table import BenchTable

LEAST = 3  # sequences that a line is fitted to


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
    """Slope and intercept of y over x by Huber's regression, whom a few far points do not move; NaN for too few points.

    Huber's weights are one choice of the iteratively reweighted least squares that the documents cite (Holland and Welsch 1977).
    """
    if len(x) < LEAST:
        return float("nan"), float("nan")
    from sklearn.linear_model import HuberRegressor

    centre, spread = (x.mean(), y.mean()), (x.std() or 1.0, y.std() or 1.0)  # its scale and penalty want units of one
    fit = HuberRegressor(alpha=0.0, max_iter=1000).fit(
        ((x - centre[0]) / spread[0])[:, None], (y - centre[1]) / spread[1]
    )
    slope = float(fit.coef_[0]) * spread[1] / spread[0]
    return float(slope), float(centre[1] + spread[1] * float(fit.intercept_) - slope * centre[0])


def table(found: Sequence[Prediction], picture: str) -> BenchTable:
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
        f"The first and the last feasible sequence of every query. Robust (Huber) regression, actual over predicted: {picture}",
        "The documents show the picture alone and call the two highly correlated.",
    )
    return BenchTable("lin2019_prediction", title, columns, tuple(rows), notes, bench="lin2019")
