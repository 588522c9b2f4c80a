"""How well a surrogate predicts transitions of scenes that it has not seen: the table of Lin 2020 fig. 6.10, and more."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from learning.calibration import ReliabilityCurve, reliability_curve
from learning.labelled_transitions import TEST, TRAIN, LearningSet
from learning.surrogate import DynamicsSurrogate
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
HEADER = (
    f"{'category':32s} {'train':>7s} {'test':>6s} {'feas.':>6s} {'major.':>6s} {'acc.':>6s} {'bal.':>6s} {'rec.':>6s}"
    f" {'ECE':>6s} {'far':>6s} {'objective':>9s} {'error':>8s} {'CoM mm':>7s} {'mm/s':>6s}"
)


@dataclass(frozen=True)
class CategoryFit:
    """One row of the table; numbers over what a category lacks are NaN.

    Attributes:
        category: 0..9, or -1 for all of them together.
        train: rows it was trained on.
        test: rows of the test scenes.
        feasible: share of feasible rows among them.
        majority: accuracy of always saying what is more frequent.
        accuracy: share of right answers at probability 1/2.
        balanced: mean of the shares of right answers among feasible and among infeasible rows, at probability 1/2.
        recall: share of the feasible rows that reach the threshold of their category.
        calibration: expected calibration error.
        far: share of rows flagged as far from the training data.
        objective: mean objective of the feasible rows [-].
        objective_error: mean absolute error there [-].
        com_error: mean absolute error of the final CoM, a coordinate [m].
        velocity_error: the same of its velocity [m/s].
        com_distance: mean distance of predicted and true final CoM [m].
        velocity_distance: the same of its velocity [m/s].
        balanced_at_threshold: as `balanced`, at the threshold.
    """

    category: int
    train: int
    test: int
    feasible: float
    majority: float
    accuracy: float
    balanced: float
    recall: float
    calibration: float
    far: float
    objective: float
    objective_error: float
    com_error: float
    velocity_error: float
    com_distance: float
    velocity_distance: float
    balanced_at_threshold: float


@dataclass(frozen=True, eq=False)
class FitReport:
    """The table and the reliability curve of one surrogate.

    Attributes:
        kind: of its networks.
        rows: one a category that occurs in the test scenes, then all of them together.
        reliability: over all test rows.
    """

    kind: str
    rows: tuple[CategoryFit, ...]
    reliability: ReliabilityCurve

    def text(self) -> str:
        """The table as people read it, with the documents' row under each category's."""
        lines = [HEADER]
        for row in self.rows:
            name = "all" if row.category < 0 else f"{row.category} {CATEGORIES[row.category]}"
            lines.append(
                f"{name:32s} {row.train:7d} {row.test:6d} {row.feasible:6.1%} {row.majority:6.1%} {row.accuracy:6.1%}"
                f" {row.balanced:6.1%} {row.recall:6.1%} {row.calibration:6.3f} {row.far:6.1%} {row.objective:9.2f}"
                f" {row.objective_error:8.2f} {1e3 * row.com_error:7.2f} {1e3 * row.velocity_error:6.2f}"
            )
            if row.category >= 0:
                accuracy, objective, error, com, velocity = DOCUMENTED[row.category]
                lines.append(
                    f"{'  Lin et al. 2019':32s} {'100000':>7s} {'1000':>6s} {'':13s} {accuracy:6.1%} {'':27s}"
                    f" {objective:9.2f} {error:8.2f} {1e3 * com:7.2f} {1e3 * velocity:6.2f}"
                )
        return "\n".join(lines)

    def facts(self) -> dict[str, Any]:
        """The same as JSON values; NaN becomes None."""
        rows = [{k: None if v != v else v for k, v in asdict(row).items()} for row in self.rows]
        curve = {name: getattr(self.reliability, name).tolist() for name in ("predicted", "observed", "count")}
        return {"kind": self.kind, "categories": rows, "reliability": curve}


def fit_report(surrogate: DynamicsSurrogate, data: LearningSet, part: int = TEST) -> FitReport:
    """Measures a surrogate on one part of the data.

    Raises:
        ValueError: there are no rows in that part.
    """
    rows = data.rows(part)
    if not len(rows):
        raise ValueError("no scene was held out: there is nothing to measure on; give more scenes")
    c = data.representatives.take(rows)
    says = surrogate.predict_canonical(c, data.relative[rows])
    truth, trained = data.feasible[rows], data.counts(TRAIN)
    com_error = np.abs(c.points_from_world(says.com) - data.com[rows])
    velocity_error = np.abs(c.vectors_from_world(says.velocity) - data.velocity[rows])
    fits = []
    for category in [*np.unique(c.category).tolist(), -1]:
        k = np.flatnonzero((c.category == category) | (category < 0))
        yes = k[truth[k]]
        answer = says.probability[k] >= 0.5
        share = float(truth[k].mean())
        fits.append(
            CategoryFit(
                category, int(trained[category] if category >= 0 else trained.sum()), len(k), share,
                max(share, 1.0 - share), float((answer == truth[k]).mean()), balanced_accuracy(answer, truth[k]),
                _mean(says.feasible[yes]), reliability_curve(says.probability[k], truth[k]).expected_error,
                float(says.far[k].mean()), _mean(data.cost[rows][yes]),
                _mean(np.abs(says.cost[yes] - data.cost[rows][yes])), _mean(com_error[yes]), _mean(velocity_error[yes]),
                _mean(np.linalg.norm(com_error[yes], axis=1)), _mean(np.linalg.norm(velocity_error[yes], axis=1)),
                balanced_accuracy(says.feasible[k], truth[k]),
            )
        )  # fmt: skip
    return FitReport(str(surrogate.card.get("kind")), tuple(fits), reliability_curve(says.probability, truth))


def balanced_accuracy(answer: np.ndarray, truth: np.ndarray) -> float:
    """Mean of the shares of right answers in either class; NaN where there is only one."""
    truth = np.asarray(truth, bool)
    if truth.all() or not truth.any():
        return float("nan")
    return float(0.5 * (np.mean(answer[truth]) + np.mean(~answer[~truth])))


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if len(values) else float("nan")
