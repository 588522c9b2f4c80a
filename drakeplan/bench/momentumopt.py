"""The centroidal program against published reference solutions of momentumopt, under the reference's own rules.

The reference's forces are not published, so its objective is counted without them. Ours is counted with them, for the
verdict: a lower figure is lower whatever the reference's forces were; and without, to compare like with like.
"""

from __future__ import annotations

import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from drakeplan.bench.peers.momentumopt_case import Variant, read_case
from drakeplan.bench.table import BenchOptions, BenchTable
from optimization.centroidal.timing import TimingOptions, optimise_timing
from optimization.centroidal.trajectory import CentroidalTrajectory

FILE = "momentumopt_demo01.json"
NEAR = 0.06  # of every component of com, linear and angular momentum: the reference's own test [m, kg m/s, N m s]
HOLDS = 1e-6  # greatest violation of a rule, in M g, M g m, m or N m
COLUMNS = (
    "variant", "timing", "objective", "less forces", "reference", "com off m", "l off kg m/s", "k off N m s", "dt off s",
    "worst violation", "rule", "verdict", "programs", "time s",
)  # fmt: skip


def run(options: BenchOptions) -> BenchTable:
    """Every variant of `options.case`, or of the file in the folder that DRAKEPLAN_CASES names."""
    case = options.case
    if case is None and (folder := os.environ.get("DRAKEPLAN_CASES")):
        case = Path(folder) / FILE
    title = "Centroidal program against momentumopt"
    if case is None:
        return BenchTable(
            "momentumopt", f"{title}: skipped, no --case and DRAKEPLAN_CASES names no folder", COLUMNS, (), most_seeds=0
        )
    rows = []
    for variant in read_case(case):
        for row in compare(variant):
            rows.append(row)
            options.tell(f"{row[0]}, {row[1]}: {row[COLUMNS.index('verdict')]}, {row[2]:.1f} against {row[4]:.1f}")
    notes = (
        f"within: every component at every knot within {NEAR} of the reference; lower: a lower objective under the same"
        f" rules, each recomputed from forces, pressure centres and torques and held to {HOLDS:g}.",
        "The objective counts forces and torques, the reference's does not: they are not published; less forces: ours without them.",
        "programs: convex ones; where timing is free, programs of fixed time.",
    )
    return BenchTable("momentumopt", title, COLUMNS, tuple(rows), notes, most_seeds=0)


def compare(variant: Variant) -> list[tuple[object, ...]]:
    """One row for the given timing, or the reference's own, and one more where timing is free."""
    dt = variant.problem.schedule.dt if variant.reference_dt is None else variant.reference_dt
    started = time.perf_counter()
    problem = replace(variant.problem, schedule=replace(variant.problem.schedule, dt=dt))
    estimate = variant.build(problem, variant.options).solve()
    elapsed = time.perf_counter() - started
    timing = "given" if variant.reference_dt is None else "the reference's"
    rows = [judge(variant, timing, dt, estimate.trajectory, len(estimate.records), elapsed)]
    return rows if variant.dt_range is None else [*rows, _free(variant, dt)]


def _free(variant: Variant, dt: np.ndarray) -> tuple[object, ...]:
    """Every interval free within the variant's bounds, from the given ones: the reference's are not shown to us."""
    least, most = variant.dt_range or (np.nan, np.nan)
    given = variant.problem.schedule.dt
    started = time.perf_counter()
    timed = optimise_timing(
        variant.problem,
        variant.options,
        TimingOptions(
            each="interval",
            shortest=least / float(given.max()),
            longest=most / float(given.min()),
            interval=(least, most),
            total=None if variant.fixed_horizon else np.inf,
            change_weight=variant.time_weight,
        ),
        build=variant.build,
    )
    elapsed = time.perf_counter() - started
    programs = 1 + len(timed.records)
    return judge(variant, "free", dt, timed.estimate.trajectory, programs, elapsed)


def judge(
    variant: Variant, timing: str, dt: np.ndarray, t: CentroidalTrajectory | None, programs: int, elapsed: float
) -> tuple[object, ...]:
    """The row of a trajectory.

    Args:
        variant: of the published case.
        timing: name of the timing in the table.
        dt: (N-1,) the reference's intervals [s].
        t: the trajectory; None where no solution was found.
        programs: number of programs solved.
        elapsed: time they took [s].
    """
    reference = variant.objective(dt, *variant.reference)
    if t is None:
        return variant.name, timing, np.inf, np.inf, reference, *(np.nan,) * 5, "", "no answer", programs, elapsed
    ours = variant.cost(t)
    whole = t.com, t.linear_momentum, t.angular_momentum
    off = [float(np.abs(a[1:] - b).max()) for a, b in zip(whole, variant.reference, strict=True)]
    near = max(off) <= NEAR
    rule, worst = max(variant.violations(t).items(), key=lambda item: item[1])
    verdict = "breaks a rule" if worst > HOLDS else "within" if near else "lower"
    if verdict == "lower" and ours > reference:
        verdict = "higher"
    off.append(float(np.abs(np.diff(t.t) - dt).max()))
    bare = variant.objective(np.diff(t.t), *(part[1:] for part in whole))
    return (
        variant.name,
        timing,
        ours,
        bare,
        reference,
        *off,
        worst,
        rule if worst > 0 else "",
        verdict,
        programs,
        elapsed,
    )
