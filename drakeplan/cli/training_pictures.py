"""Pictures of a training: losses, the reliability curve, and what more labels would buy."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from learning.training.learning_curve import LearningCurve

CURVES, LEARNING = "curves.png", "learning_curve.png"


def draw_training(folder: Path) -> Path:
    """`curves.png` from `curves.csv` and `report.json` in a folder: training and validation loss, reliability."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.5))
    left, right = figure.subplots(1, 2)
    _losses(left, folder / "curves.csv")
    _reliability(right, folder / "report.json")
    figure.tight_layout()
    figure.savefig(folder / CURVES, dpi=120)
    return folder / CURVES


def draw_learning_curve(curve: LearningCurve, folder: Path) -> Path:
    """`learning_curve.png`: each error over the rows trained on, with the fitted power law up to four times the rows.

    Args:
        curve: errors over rows.
        folder: where the picture goes.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    figure = Figure(figsize=(13, 3.6))
    rows, errors = curve.errors()
    names = ("1 - balanced accuracy", "final CoM [m]", "CoM velocity [m/s]", "objective, median error")
    for axes, name, error, law in zip(figure.subplots(1, 4), names, errors.T, curve.laws(), strict=True):
        axes.loglog(rows, error, "o")
        reach = np.geomspace(rows[0], 4.0 * rows[-1], 20)
        axes.loglog(reach, [law.at(n) for n in reach], color="0.6", label=f"rows^-{law.exponent:.2f}")
        axes.set(xlabel="rows trained on", title=name)
        axes.xaxis.set_minor_formatter(NullFormatter())  # there is room for powers of ten alone
        shown = error[np.isfinite(error) & (error > 0)]
        if len(shown):  # a flat curve looks flat
            axes.set_ylim(0.5 * shown.min(), 2.0 * shown.max())
        axes.legend()
    figure.tight_layout()
    figure.savefig(folder / LEARNING, dpi=120)
    return folder / LEARNING


def _losses(axes: Axes, path: Path) -> None:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for name in dict.fromkeys(row["network"] for row in rows):
        mine = [row for row in rows if row["network"] == name]
        epochs = [int(row["epoch"]) for row in mine]
        (line,) = axes.plot(epochs, [float(row["training_loss"]) for row in mine], label=name)
        axes.plot(epochs, [float(row["validation_loss"]) for row in mine], "--", color=line.get_color())
    axes.set(xlabel="epoch", ylabel="loss (dashed: scenes held out)", yscale="log")
    axes.legend(fontsize=6, ncol=2)


def _reliability(axes: Axes, path: Path) -> None:
    """Predicted against observed, and above the axis how many transitions stand behind each point."""
    curve = json.loads(path.read_text(encoding="utf-8"))["reliability"]
    count = np.array(curve["count"], float)
    error = np.average(np.abs(np.subtract(curve["predicted"], curve["observed"])), weights=count)
    axes.plot([0, 1], [0, 1], color="0.8")
    axes.bar(curve["predicted"], count / count.sum(), width=0.04, color="0.85", label="share of transitions")
    axes.plot(curve["predicted"], curve["observed"], "o-", label=f"expected calibration error {error:.3f}")
    axes.set(xlabel="predicted probability of being feasible", ylabel="observed share", xlim=(0, 1), ylim=(0, 1))
    axes.legend()
