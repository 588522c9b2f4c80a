"""The learned dynamics: how well they predict scenes that they were not trained on, and what a prediction costs.

The errors are those that `drakeplan train dynamics` measured on its test scenes and wrote to the card of the weights
(Lin 2020 fig. 6.10 beside them). The times are measured here.
"""

from __future__ import annotations

from typing import Any

from drakeplan.bench.surrogate_times import times
from drakeplan.bench.table import BenchOptions, BenchTable
from learning.fit_report import DOCUMENTED
from learning.surrogate import load_surrogate
from learning.transition_features import CATEGORIES
from learning.weights import PRETRAINED

COLUMNS = ("category", "train", "test", "no", "majority", "accuracy", "doc.", "balanced", "ECE", "far", "objective", "error",
           "relative", "doc.", "median", "CoM mm", "doc.", "velocity mm/s", "doc.")  # fmt: skip


def run(options: BenchOptions) -> tuple[BenchTable, ...]:
    """Fig. 6.10 for the weights that come with this robot, for all test rows and for those a planner met, and times."""
    surrogate = load_surrogate(options.robot)
    measured = surrogate.card["measured"]
    size = sum(f.stat().st_size for f in (PRETRAINED / options.robot).iterdir())
    notes = (
        "Scenes held out whole; errors are mean absolute errors a coordinate of feasible transitions; no: test rows that are"
        " not feasible; majority: accuracy of always saying the more frequent answer; median: of the error of the objective"
        " over the objective. doc.: Lin 2020 fig. 6.10, with 100 000 labels a category.",
        f"Weights and card: {size / 1e6:.1f} MB, {surrogate.card['kind']}.",
    )
    title = "Learned centroidal dynamics"
    tables = [BenchTable("surrogate", title, COLUMNS, _rows(measured["categories"]), notes, most_seeds=0)]
    if measured.get("visited"):
        title += ", states as the planner meets them"
        rows = _rows(measured["visited"])
        tables.append(BenchTable("surrogate_visited", title, COLUMNS, rows, notes[:1], bench="surrogate", most_seeds=0))
    return *tables, times(options, surrogate)


def _rows(fits: list[dict[str, Any]]) -> tuple[tuple[object, ...], ...]:
    rows = []
    for fit in fits:
        k = fit["category"]
        theirs = DOCUMENTED[k] if k >= 0 else (None,) * 5
        row = (
            "all" if k < 0 else f"{k} {CATEGORIES[k]}", fit["train"], fit["test"], fit.get("infeasible"),
            _percent(fit["majority"]), _percent(fit["accuracy"]), _percent(theirs[0]), _percent(fit["balanced"]),
            fit["calibration"], _percent(fit["far"]), fit["objective"], fit["objective_error"],
            _percent(_ratio(fit["objective_error"], fit["objective"])), _percent(_ratio(theirs[2], theirs[1])),
            _percent(fit.get("objective_median")), _milli(fit["com_error"]), _milli(theirs[3]),
            _milli(fit["velocity_error"]), _milli(theirs[4]),
        )  # fmt: skip
        rows.append(tuple("-" if cell is None else cell for cell in row))
    return tuple(rows)


def _ratio(a: float | None, b: float | None) -> float | None:
    return None if a is None or not b else a / b


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _milli(value: float | None) -> str:
    return "-" if value is None else f"{1e3 * value:.1f}"
