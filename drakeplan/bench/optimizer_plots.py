"""Pictures of the optimisers' table; matplotlib is loaded when one is made."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drakeplan.bench.table import BenchTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(table: BenchTable) -> Figure:
    """Solve time by size, and cost over the best against it, a colour for each formulation, solver and cone."""
    from matplotlib.figure import Figure

    place = {name: k for k, name in enumerate(table.columns)}
    rows = [row for row in table.rows if np.isfinite(_number(row[place["solve CPU ms"]]))]
    sizes = list(dict.fromkeys(row[place["size"]] for row in rows))
    series: dict[str, list[tuple[object, ...]]] = {}
    for row in rows:
        cone = row[place["cone"]]
        name = f"{row[place['formulation']]}, {row[place['solver']]}" + (f", {cone}" if cone else "")
        series.setdefault(name, []).append(row)
    figure = Figure(figsize=(12, 4.6), layout="constrained")
    times, costs = figure.subplots(1, 2, width_ratios=(1.4, 1))
    for k, (name, found) in enumerate(series.items()):
        style = {"color": f"C{k % 10}", "marker": "os^Dv"[k // 10 % 5], "label": name}
        solve = [_number(row[place["solve CPU ms"]]) for row in found]
        times.plot([sizes.index(row[place["size"]]) for row in found], solve, linewidth=0.8, **style)
        costs.plot(solve, [_number(row[place["cost / best"]]) for row in found], linestyle="none", **style)
    times.set(yscale="log", ylabel="solve [CPU ms]", xticks=range(len(sizes)))
    times.set_xticklabels([str(size) for size in sizes], rotation=20, ha="right", fontsize=8)
    costs.set(xscale="log", xlabel="solve [CPU ms]", ylabel="cost over the best, or over the bound")
    figure.legend(*times.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    return figure


def save(table: BenchTable, path: Path) -> None:
    """Writes the picture, making its folder when missing.

    Args:
        table: with the results.
        path: the picture's file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    draw(table).savefig(path, dpi=120)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")
