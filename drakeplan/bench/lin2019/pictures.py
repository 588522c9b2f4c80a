"""Pictures of the tables of Lin et al. 2019, ours beside the published numbers; matplotlib is loaded when one is made."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drakeplan.bench.lin2019.mixed_integer_baseline import SCENE
from drakeplan.bench.lin2019.prediction import Prediction
from drakeplan.bench.lin2019.queries import MAIN, SCENES
from drakeplan.bench.lin2019.times import PUBLISHED, Series
from drakeplan.bench.table import BenchTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {"quasi-static": "tab:gray", "learned": "tab:blue"}


def draw_prediction(found: Sequence[Prediction]) -> Figure:
    """Fig. 10: every sequence, and the robust line through all of them."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.2, 4.4), layout="constrained")
    axes = figure.subplots()
    both = found[-1]
    for p, colour, marker in zip(found[:-1], ("tab:blue", "tab:orange"), "os", strict=False):
        axes.plot(
            p.predicted,
            p.actual,
            marker,
            color=colour,
            markersize=4,
            alpha=0.8,
            label=f"{p.scene}, r = {p.correlation:.2f}",
        )
    if np.isfinite(both.slope):
        ends = np.array([both.predicted.min(), both.predicted.max()])
        axes.plot(
            ends,
            both.slope * ends + both.intercept,
            color="tab:red",
            label=f"robust fit, slope {both.slope:.2f}; r = {both.correlation:.2f}",
        )
    low, high = (
        (f(np.concatenate([both.predicted, both.actual])) for f in (np.min, np.max)) if len(both.actual) else (0, 1)
    )
    axes.plot([low, high], [low, high], ":", color="tab:gray", label="sum = actual")
    axes.set(xlabel="sum of the predicted objectives of the transitions", ylabel="objective of the whole sequence")
    axes.legend(fontsize=8)
    return figure


def draw_times(series: Sequence[Series]) -> Figure:
    """Fig. 7: share of queries with a dynamically feasible sequence against time, on the scene of the baselines."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    axes = figure.subplots()
    for s in (s for s in series if s.scene == SCENE and s.asked):
        times = np.sort(list(s.first_s.values()))
        share = np.arange(1, len(times) + 1) / s.asked
        end = max(100.0, *times) if len(times) else 100.0
        axes.step(
            np.r_[1e-3, times, end],
            np.r_[0.0, share, share[-1:] if len(share) else [0.0]],
            where="post",
            label=f"{s.planner} ({len(times)} of {s.asked})",
        )
    for name, (mean, std) in PUBLISHED.items():
        axes.errorbar(mean, 0.5, xerr=std, fmt="k^", markersize=5, capsize=3, linewidth=0.8)
        axes.annotate(
            name.removesuffix(", published").replace("mixed integer, ", ""),
            (mean, 0.5),
            (0, 8),
            rotation=90,
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=7,
        )
    axes.plot([], [], "k^", label="published: mean and standard deviation")
    axes.set(
        xscale="log",
        xlim=(5e-3, 200.0),
        ylim=(0.0, 1.03),
        xlabel="time to the first dynamically feasible sequence [s]",
        ylabel=f"share of queries, {SCENE}",
    )
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    return figure


def draw_robustness(table: BenchTable) -> Figure:
    """Fig. 8: columns (4) to (12), ours filled and the published hatched, a panel for each."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 6.6), layout="constrained")
    names = [c for c in table.columns if c.startswith("(") and int(c[1 : c.index(")")]) >= 4]
    rows = {(row[0], row[1]): row for row in table.rows}
    for axes, name in zip(figure.subplots(3, 3).flat, names, strict=True):
        k = table.columns.index(name)
        for i, (scene, planner, source) in enumerate(
            (scene, planner, source) for scene in SCENES for planner in MAIN for source in ("", ", published")
        ):
            at = 5 * (i // 4) + 1.05 * (i % 4)
            label = f"{planner}{source}" if i < 4 else None
            axes.bar(
                at,
                rows[scene, planner + source][k],
                color=COLOURS[planner],
                alpha=0.45 if source else 1.0,
                hatch="//" if source else None,
                label=label,
            )
        axes.set(title=name, xticks=[1.6, 6.6])
        axes.set_xticklabels(SCENES, fontsize=8)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Writes a picture, making its folder when missing.

    Args:
        figure: to write.
        path: the file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
