"""The experiments of Lin et al. 2019 sec. VIII (Lin 2020 sec. 6.7) again: figures 7, 8 and 10, the gap and the slope, an ablation.

With the file that `DRAKEPLAN_BENCH_RESUME` names it goes on where it was stopped. Pictures go to out/.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from drakeplan.bench.kept_cases import KeptCases
from drakeplan.bench.lin2019 import ablation, crossings, pictures, prediction, robustness, times
from drakeplan.bench.lin2019.mixed_integer_baseline import first_sequences, whole_plans
from drakeplan.bench.lin2019.queries import all_queries, mean
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
    crossed = crossings.table(robot, ik, kept, options.tell)

    series = times.all_series(queries, firsts)
    predicted = prediction.predictions(queries)
    results, errors = robustness.table(queries), prediction.table(predicted)
    durations = times.table(series, firsts, plans, mean([q.busy for q in queries]))
    return (
        _with_picture(results, pictures.draw_robustness(results)),
        _with_picture(durations, pictures.draw_times(series)),
        _with_picture(errors, pictures.draw_prediction(predicted)),
        crossed,
        ablation.table(queries),
    )


def _with_picture(table: BenchTable, figure: Figure) -> BenchTable:
    """The table with a note of its picture, which is written."""
    path = PICTURES / f"{table.name}.png"
    pictures.save(figure, path)
    return replace(table, notes=(*table.notes, f"Picture: {path}"))
