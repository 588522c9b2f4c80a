"""The experiments of Lin et al. 2019 sec. VIII (Lin 2020 sec. 6.7) again: figures 7, 8 and 10, the gap and the slope, an ablation.

With the file that `DRAKEPLAN_BENCH_RESUME` names it goes on where it was stopped. Pictures go to out/.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from drakeplan.bench import (
    lin2019_ablation,
    lin2019_crossings,
    lin2019_pictures,
    lin2019_prediction,
    lin2019_robustness,
    lin2019_times,
)
from drakeplan.bench.kept_cases import KeptCases
from drakeplan.bench.lin2019_queries import all_queries, mean
from drakeplan.bench.mixed_integer_baseline import first_sequences, whole_plans
from drakeplan.bench.table import BenchOptions, BenchTable
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.robots.robot import load_robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES = Path("out")


def run(options: BenchOptions) -> tuple[BenchTable, ...]:
    """Seeds 0 to `options.seeds` - 1, one thread; scene, robot, kernels and weights are loaded before any clock starts."""
    robot = load_robot(options.robot)
    ik, kept = WholeBodyIK(robot), KeptCases.asked_for()
    queries = all_queries(robot, ik, options.seeds, kept, options.tell)
    firsts = first_sequences(robot, ik, options.seeds, kept, options.tell)
    plans = whole_plans(robot, options.seeds, kept, options.tell)
    crossings = lin2019_crossings.table(robot, ik, kept, options.tell)

    series = lin2019_times.all_series(queries, firsts)
    predictions = lin2019_prediction.predictions(queries)
    results, prediction = lin2019_robustness.table(queries), lin2019_prediction.table(predictions)
    times = lin2019_times.table(series, firsts, plans, mean([q.busy for q in queries]))
    return (
        _with_picture(results, lin2019_pictures.draw_robustness(results)),
        _with_picture(times, lin2019_pictures.draw_times(series)),
        _with_picture(prediction, lin2019_pictures.draw_prediction(predictions)),
        crossings,
        lin2019_ablation.table(queries),
    )


def _with_picture(table: BenchTable, figure: Figure) -> BenchTable:
    """The table with a note of its picture, which is written."""
    path = PICTURES / f"{table.name}.png"
    lin2019_pictures.save(figure, path)
    return replace(table, notes=(*table.notes, f"Picture: {path}"))
