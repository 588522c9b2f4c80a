"""How well a surrogate predicts transitions of scenes that it has not seen: the table of Lin 2020 fig. 6.10, and more."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from learning.calibration import ReliabilityCurve, reliability_curve
from learning.labelled_transitions import TEST, TRAIN, LearningSet
from learning.surrogate import DynamicsSurrogate, TransitionPrediction
from learning.transition_features import CATEGORIES

# Lin 2020 fig. 6.10 / Lin et al. 2019 fig. 9: accuracy [-], mean objective, its error, CoM [m], velocity [m/s]
DOCUMENTED = (
    (0.903, 1436.10, 62.45, 0.0075, 0.0066),
    (0.970, 740.85, 40.38, 0.0060, 0.0054),
    (0.953, 164.96, 20.70, 0.0090, 0.0054),
    (0.935, 119.85, 11.07, 0.0067, 0.0047),
    (0.943, 516.53, 45.06, 0.0071, 0.0041),
    (0.952, 87.80, 12.39, 0.0091, 0.0041),
    (0.981, 53.47, 8.10, 0.0073, 0.0041),
    (0.966, 50.66, 17.28, 0.0081, 0.0024),
    (0.961, 88.00, 15.18, 0.0090, 0.0030),
    (0.983, 62.40, 7.56, 0.0081, 0.0037),
)
_LEAST_OBJECTIVE = 1.0  # [-] under a relative error
HEADER = (
    f"{'category':32s} {'train':>7s} {'test':>6s} {'no':>5s} {'feas.':>6s} {'major.':>6s} {'acc.':>6s} {'bal.':>6s}"
    f" {'rec.':>6s} {'ECE':>6s} {'far':>6s} {'objective':>9s} {'error':>8s} {'median':>7s} {'CoM mm':>7s} {'mm/s':>6s}"
)


@dataclass(frozen=True)
class CategoryFit:
    """One row of the table; numbers over what a category lacks are NaN.

    Attributes:
        category: 0..9, or -1 for all of them together.
        train: rows it was trained on.
        test: rows of the test scenes.
        infeasible: how many of them are not feasible. Balanced accuracy counts them for half, whatever their share.
        feasible: share of feasible rows among them.
        majority: accuracy of always saying what is more frequent.
        accuracy: share of right answers at probability 1/2.
        balanced: mean of the shares of right answers among feasible and among infeasible rows, at probability 1/2.
        recall: share of the feasible rows that reach the threshold of their category.
        calibration: expected calibration error.
        far: share of rows flagged as far from the training data.
        objective: mean objective of the feasible rows [-].
        objective_error: mean absolute error there [-]; a few dear transitions rule it.
        objective_median: median of |error| / objective there.
        com_error: mean absolute error of the final CoM, a coordinate [m].
        velocity_error: the same of its velocity [m/s].
        com_distance: mean distance of predicted and true final CoM [m].
        velocity_distance: the same of its velocity [m/s].
        balanced_at_threshold: as `balanced`, at the threshold.
    """

    category: int
    train: int
    test: int
    infeasible: int
    feasible: float
    majority: float
    accuracy: float
    balanced: float
    recall: float
    calibration: float
    far: float
    objective: float
    objective_error: float
    objective_median: float
    com_error: float
    velocity_error: float
    com_distance: float
    velocity_distance: float
    balanced_at_threshold: float


@dataclass(frozen=True, eq=False)
class FitReport:
    """The tables and the reliability curve of one surrogate.

    Attributes:
        kind: of its networks.
        rows: one a category that occurs in the test scenes, then all of them together.
        visited: the same for the states that a planner met there, without those that were shifted at random; no rows
            where there are none.
        reliability: over all test rows.
    """

    kind: str
    rows: tuple[CategoryFit, ...]
    visited: tuple[CategoryFit, ...]
    reliability: ReliabilityCurve

    def text(self) -> str:
        """The tables as people read them, with the documents' row under each category's."""
        lines = ["Test scenes", HEADER, *_lines(self.rows)]
        if self.visited:
            lines += ["", "Test scenes, states as the planner meets them", HEADER, *_lines(self.visited)]
        return "\n".join(lines)

    def facts(self) -> dict[str, Any]:
        """The same as JSON values; NaN becomes None."""
        curve = {name: getattr(self.reliability, name).tolist() for name in ("predicted", "observed", "count")}
        tables = {"categories": _facts(self.rows), "visited": _facts(self.visited)}
        return {"kind": self.kind, **tables, "reliability": curve}


def fit_report(surrogate: DynamicsSurrogate, data: LearningSet, part: int = TEST) -> FitReport:
    """Measures a surrogate on one part of the data.

    Args:
        surrogate: what to measure.
        data: representatives and what the program said of them.
        part: TRAIN, VALIDATION or TEST.

    Raises:
        ValueError: there are no rows in that part.
    """
    rows = data.rows(part)
    if not len(rows):
        raise ValueError("no scene was held out: there is nothing to measure on; give more scenes")
    c = data.representatives.take(rows)
    says = surrogate.predict_canonical(c, data.relative[rows])
    met = data.visited[rows]
    return FitReport(
        str(surrogate.card.get("kind")),
        _fits(says, data, rows, np.ones(len(rows), bool)),
        _fits(says, data, rows, met) if met.any() else (),
        reliability_curve(says.probability, data.feasible[rows]),
    )


def _fits(
    says: TransitionPrediction, data: LearningSet, rows: np.ndarray, chosen: np.ndarray
) -> tuple[CategoryFit, ...]:
    """The table of the chosen ones among these rows."""
    c = data.representatives.take(rows)
    truth, trained = data.feasible[rows], data.counts(TRAIN)
    cost_error = np.abs(says.cost - data.cost[rows])
    com_error = np.abs(c.points_from_world(says.com) - data.com[rows])
    velocity_error = np.abs(c.vectors_from_world(says.velocity) - data.velocity[rows])
    fits = []
    for category in [*np.unique(c.category[chosen]).tolist(), -1]:
        k = np.flatnonzero(chosen & ((c.category == category) | (category < 0)))
        yes = k[truth[k]]
        answer, share = says.probability[k] >= 0.5, float(truth[k].mean())
        fits.append(
            CategoryFit(
                category=category,
                train=int(trained[category] if category >= 0 else trained.sum()),
                test=len(k),
                infeasible=len(k) - len(yes),
                feasible=share,
                majority=max(share, 1.0 - share),
                accuracy=float((answer == truth[k]).mean()),
                balanced=balanced_accuracy(answer, truth[k]),
                balanced_at_threshold=balanced_accuracy(says.feasible[k], truth[k]),
                recall=_mean(says.feasible[yes]),
                calibration=reliability_curve(says.probability[k], truth[k]).expected_error,
                far=float(says.far[k].mean()),
                objective=_mean(data.cost[rows][yes]),
                objective_error=_mean(cost_error[yes]),
                objective_median=_median(cost_error[yes] / np.maximum(data.cost[rows][yes], _LEAST_OBJECTIVE)),
                com_error=_mean(com_error[yes]),
                velocity_error=_mean(velocity_error[yes]),
                com_distance=_mean(np.linalg.norm(com_error[yes], axis=1)),
                velocity_distance=_mean(np.linalg.norm(velocity_error[yes], axis=1)),
            )
        )
    return tuple(fits)


def _lines(rows: tuple[CategoryFit, ...]) -> list[str]:
    lines = []
    for row in rows:
        name = "all" if row.category < 0 else f"{row.category} {CATEGORIES[row.category]}"
        lines.append(
            f"{name:32s} {row.train:7d} {row.test:6d} {row.infeasible:5d} {row.feasible:6.1%} {row.majority:6.1%}"
            f" {row.accuracy:6.1%} {row.balanced:6.1%} {row.recall:6.1%} {row.calibration:6.3f} {row.far:6.1%}"
            f" {row.objective:9.2f} {row.objective_error:8.2f} {row.objective_median:7.1%} {1e3 * row.com_error:7.2f}"
            f" {1e3 * row.velocity_error:6.2f}"
        )
        if row.category >= 0:
            accuracy, objective, error, com, velocity = DOCUMENTED[row.category]
            lines.append(
                f"{'  Lin et al. 2019':32s} {'100000':>7s} {'1000':>6s} {'':19s} {accuracy:6.1%} {'':27s}"
                f" {objective:9.2f} {error:8.2f} {'':7s} {1e3 * com:7.2f} {1e3 * velocity:6.2f}"
            )
    return lines


def _facts(rows: tuple[CategoryFit, ...]) -> list[dict[str, Any]]:
    return [{k: None if v != v else v for k, v in asdict(row).items()} for row in rows]


def balanced_accuracy(answer: np.ndarray, truth: np.ndarray) -> float:
    """Mean of the shares of right answers in either class; NaN where there is only one.

    Args:
        answer: (n,) bool, as predicted.
        truth: (n,) bool, as the program decided.
    """
    truth = np.asarray(truth, bool)
    if truth.all() or not truth.any():
        return float("nan")
    return float(0.5 * (np.mean(answer[truth]) + np.mean(~answer[~truth])))


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else float("nan")
