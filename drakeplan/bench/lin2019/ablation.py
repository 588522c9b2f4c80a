"""What learning, and what its calibration, is worth: planners at equal wall time on the same seeds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drakeplan.bench.lin2019.queries import ABLATION_SEEDS, LEARNED, LONG, PLANNERS, SCENES, SHORT, Query, mean, of
from drakeplan.bench.table import BenchTable


def table(queries: Sequence[Query]) -> BenchTable:
    """One row for each scene, time of search and planner; only seeds that searched for `LONG`."""
    rows = []
    for scene in SCENES:
        for seconds in (SHORT, LONG):
            learned = _by_seed(queries, scene, LEARNED, seconds)
            rows += [_row(queries, scene, seconds, planner, learned) for planner in PLANNERS]
    columns = ("scene", "search s", "planner", "found", "feasible", "objective", "over learned's", "with palms", "sequences",
               "first s", "first feasible s", "judged by networks", "by programs")  # fmt: skip
    notes = (
        f"The same seeds, one thread; what a search had come to after {SHORT:g} s is read off the one of {LONG:g} s. The programs "
        "over whole sequences are not in these times.",
        "objective: of the last dynamically feasible sequence, the cheapest by the search's own measure, mean; over learned's: "
        "median of the ratios on seeds where both have one.",
        "uncalibrated: raw logits, threshold one half, and no flag for what is far from the training data. exact, every branch: a "
        "program for each child of an expansion, as documented; when popped: `--dynamics exact`, one program over the last "
        "transitions of the path to a state that is about to be expanded.",
    )
    title = "Planners at equal wall time"
    return BenchTable(
        "lin2019_ablation", title, columns, tuple(rows), notes, bench="lin2019", most_seeds=ABLATION_SEEDS
    )


def _by_seed(queries: Sequence[Query], scene: str, planner: str, seconds: float) -> dict[int, Query]:
    return {q.seed: q for q in of(queries, scene, planner) if LONG in q.within and seconds in q.within}


def _row(
    queries: Sequence[Query], scene: str, seconds: float, planner: str, learned: dict[int, Query]
) -> tuple[object, ...]:  # fmt: skip
    mine = _by_seed(queries, scene, planner, seconds)
    outcomes = {seed: q.within[seconds] for seed, q in mine.items()}
    feasible = {seed: o for seed, o in outcomes.items() if o.feasible}
    ratios = [
        o.objective / learned[seed].within[seconds].objective
        for seed, o in feasible.items()
        if seed in learned and learned[seed].within[seconds].feasible
    ]
    judged = (sum(q.asked.get(who, 0) for q in mine.values()) for who in ("learned", "exact"))
    return (
        scene, seconds, planner, f"{sum(o.found > 0 for o in outcomes.values())}/{len(outcomes)}",
        f"{len(feasible)}/{len(outcomes)}", mean([o.objective for o in feasible.values()]),
        float(np.median(ratios)) if ratios else float("nan"), f"{sum(o.palms for o in feasible.values())}/{len(feasible)}",
        mean([o.found for o in outcomes.values()]), mean([o.first_s for o in outcomes.values()]),
        mean([o.first_feasible_s for o in outcomes.values()]), *(judged if seconds == LONG else ("", "")),
    )  # fmt: skip
