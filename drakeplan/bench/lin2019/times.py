"""Fig. 7 of Lin et al. 2019 (Lin 2020 fig. 6.8): time to the first contact sequence that is dynamically feasible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.bench.lin2019.mixed_integer_baseline import DEADLINE as BASELINE_DEADLINE
from drakeplan.bench.lin2019.mixed_integer_baseline import SCENE, FirstSequence, WholePlan
from drakeplan.bench.lin2019.queries import DEADLINE, LEARNED, PLANNERS, SCENES, Query, of
from drakeplan.bench.table import BenchTable, spread
from drakeplan.contact_planning.program_planner import FORMULATIONS

# Lin et al. 2019 fig. 7: mean and standard deviation [s].
PUBLISHED = {
    "learned, published": (0.098, 0.037),
    "mixed integer, 12 contacts, published": (85.93, 56.41),
    "mixed integer, 18 contacts, published": (33.93, 18.54),
    "mixed integer, 24 contacts, published": (46.40, 20.30),
}
COLUMNS = ("scene", "planner", "feasible", "mean s", "std", "median", "p95", "confirming program s", "over learned",
           "verified", "contacts of it s", "over learned ", "whole plan s")  # fmt: skip


@dataclass(frozen=True, eq=False)
class Series:
    """Times of one planner on one scene, by seed.

    Attributes:
        scene, planner: which.
        asked: seeds.
        first_s: seconds to the first dynamically feasible sequence, of the seeds that have one.
        confirm_s: seconds of the program that proved it.
    """

    scene: str
    planner: str
    asked: int
    first_s: dict[int, float]
    confirm_s: dict[int, float]


def all_series(queries: Sequence[Query], firsts: Sequence[FirstSequence]) -> list[Series]:
    """The search on both scenes, then the mixed-integer planners on theirs.

    Args:
        queries: of the search, on all scenes.
        firsts: first sequences of the mixed-integer planners.
    """
    found = []
    for scene in SCENES:
        for planner in PLANNERS:
            mine = of(queries, scene, planner)
            good = {q.seed: q.answer for q in mine if np.isfinite(q.answer.first_feasible_s)}
            first = {seed: a.first_feasible_s for seed, a in good.items()}
            found.append(Series(scene, planner, len(mine), first, {seed: a.confirm_s for seed, a in good.items()}))
        for name in FORMULATIONS if scene == SCENE else ():
            asked = [f for f in firsts if f.planner == name]
            first = {f.seed: f.first_s for f in asked if f.feasible}
            confirm = {f.seed: f.confirm_s for f in asked if f.feasible}
            found.append(Series(scene, name, len(asked), first, confirm))
    return found


def table(
    series: Sequence[Series], firsts: Sequence[FirstSequence], plans: Sequence[WholePlan], busy: float
) -> BenchTable:
    """Ours, the published numbers, and how many times longer each takes than the learned search.

    Args:
        series: times to the first dynamically feasible sequence.
        firsts: those of the mixed-integer planners, for what they ran on.
        plans: whole queries.
        busy: mean over the searches of processor time over wall time.
    """
    learned = next(s for s in series if (s.scene, s.planner) == (SCENE, LEARNED))
    rows = []
    for s in series:
        rows.append(_row(s, learned, plans))
        if s.scene == SCENE and s.planner == LEARNED:
            rows += [_published(name) for name in PUBLISHED if name.startswith(LEARNED)]
        if s.planner == FORMULATIONS[-1]:
            rows += [_published(name) for name in PUBLISHED if not name.startswith(LEARNED)]
    title = "Time to the first dynamically feasible sequence (Lin et al. 2019 fig. 7)"
    return BenchTable(
        "lin2019_time",
        title,
        COLUMNS,
        tuple(rows),
        (*_notes(series, learned, firsts, plans), _quiet(busy)),
        bench="lin2019",
        most_seeds=None,
    )


def _published(name: str) -> tuple[object, ...]:
    return (SCENE, name, "", *PUBLISHED[name], *("",) * (len(COLUMNS) - 5))


def _row(series: Series, learned: Series, plans: Sequence[WholePlan]) -> tuple[object, ...]:
    first = list(series.first_s.values())
    middle = spread(first)
    row = (
        series.scene, series.planner, f"{len(first)}/{series.asked}", float(np.mean(first)) if first else float("nan"),
        float(np.std(first)) if first else float("nan"), middle["median"], middle["p95"],
        spread(list(series.confirm_s.values()))["median"],
    )  # fmt: skip
    mine = [p for p in plans if series.scene == SCENE and p.planner == series.planner]
    verified = {p.seed: p for p in mine if p.verified}
    there = {p.seed: p.planning_s for p in plans if p.planner == LEARNED and p.verified}
    over = ratio_of_means(series.first_s, learned.first_s) if series.scene == SCENE else float("nan")
    return (
        *row, over, f"{len(verified)}/{len(mine)}" if mine else "",
        _mean([p.planning_s for p in verified.values()]),
        ratio_of_means({seed: p.planning_s for seed, p in verified.items()}, there),
        _mean([p.total_s for p in verified.values()]),
    )  # fmt: skip


def ratio_of_means(over: dict[int, float], under: dict[int, float]) -> float:
    """Mean over mean, of the seeds that both have; NaN without any.

    Args:
        over: numerator by seed.
        under: denominator by seed.
    """
    both = sorted(over.keys() & under.keys())
    return _mean([over[s] for s in both]) / _mean([under[s] for s in both]) if both else float("nan")


def _notes(
    series: Sequence[Series], learned: Series, firsts: Sequence[FirstSequence], plans: Sequence[WholePlan]
) -> list[str]:  # fmt: skip
    baseline = [s for s in series if s.planner in FORMULATIONS and s.first_s]
    there = {p.seed: p.planning_s for p in plans if p.planner == LEARNED and p.verified}
    notes = [
        "Time: search and queries, one thread, until the first sequence for which the program over the whole of it is feasible; "
        "that program's own time stands beside it.",
        "Over learned: mean over the learned search's mean on the same seeds. Verified: whole queries to the verifier's word on "
        "the same seeds; contacts of it: seconds of planning until the contacts that were verified, refused ones included.",
    ]
    if baseline:
        best = min(baseline, key=lambda s: ratio_of_means(s.first_s, learned.first_s))
        notes.append(
            f"Best mixed-integer stack, {best.planner}: {ratio_of_means(best.first_s, learned.first_s):.0f} times the learned "
            "search's time to the first dynamically feasible sequence."
        )
    whole = {name: {p.seed: p.planning_s for p in plans if p.planner == name and p.verified} for name in FORMULATIONS}
    ratios = {name: ratio_of_means(times, there) for name, times in whole.items() if times.keys() & there.keys()}
    if ratios:
        name = min(ratios, key=lambda n: ratios[n])
        notes.append(
            f"Both counted only when verified: {name} takes {ratios[name]:.0f} times as long to the contacts of the plan."
        )
    solvers = ", ".join(sorted({f"{f.planner}: {f.solver}" for f in firsts if f.solver}))
    notes += [
        f"Mixed-integer planners: seeds 0 to {max((f.seed for f in firsts), default=0)}, {BASELINE_DEADLINE:g} s at most; they "
        f"choose the number of contacts themselves ({solvers}). The search: {DEADLINE:g} s at most.",
        "Published: i7-6700; Gurobi 8.0 on 8 threads, point contacts, simplified dynamics.",
    ]
    return notes + [f"{p.planner} seed {p.seed}, not verified: {p.reason}" for p in plans if not p.verified]


def _quiet(busy: float) -> str:
    return f"The searches had {100 * busy:.0f} % of a core: wall times mean something where that is nearly all of it."


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")
