"""The experiments of Lin et al. 2019 sec. VIII (Lin 2020 sec. 6.7) again: figures 7 to 10 of the paper.

Three tables: what planners achieve on the rubble scenes (fig. 8), how long they take until a sequence proves dynamically
feasible (fig. 7) with an ablation, and how well the sum of predicted objectives foretells the actual one (fig. 10).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drakeplan.bench.contact_query import QueryResult, run_query
from drakeplan.bench.robustness import COLUMNS, robustness
from drakeplan.bench.table import BenchOptions, BenchTable, spread
from drakeplan.contact_planner import ContactPlannerOptions, DynamicsName
from drakeplan.sequence_dynamics import sequence_problem
from drakeplan.warm_up import warm_up
from learning.surrogate import DynamicsSurrogate, load_surrogate
from optimization.whole_body_ik import WholeBodyIK
from scenes.robot import Robot, load_robot
from scenes.scene_source import load_scene

SCENES = ("rubble_field", "rubble_corridor")
DEADLINE, IMPROVE = 30.0, 2.0  # [s] the documents improve for all of 30 s
EXACT_DEADLINE, EXACT_SEEDS = 60.0, 5  # a program for every branch: slow, so fewer seeds
PLOT = Path("out/lin2019_prediction.png")
# Lin et al. 2019 fig. 8: columns (1) to (12).
PUBLISHED = {
    ("rubble_field", "quasi-static"): "47/50 47/47 1.17 3498.5 12.0 12.7 0.472 0.706 0.767 0.012 0.062 0.0068",
    ("rubble_field", "learned"): "50/50 50/50 1.02 3334.2 6.00 9.68 0.581 0.559 0.763 0.010 0.079 0.0079",
    ("rubble_corridor", "quasi-static"): "44/50 44/44 1.05 3418.7 11.5 11.16 0.523 0.618 0.768 0.013 0.082 0.0069",
    ("rubble_corridor", "learned"): "50/50 49/50 1.59 2392.5 4.38 4.83 1.378 0.349 0.631 0.025 0.088 0.0173",
}
PUBLISHED_FIRST = "0.098 +- 0.037 s (learned), 85.93, 33.93, 46.40 s (mixed integer, 12, 18, 24 contacts)"


@dataclass(frozen=True, eq=False)
class Study:
    """All queries of one planner on one scene."""

    scene: str
    planner: str
    results: tuple[QueryResult, ...]

    @property
    def proven(self) -> list[QueryResult]:
        """Those that ended in a dynamically feasible sequence."""
        return [r for r in self.results if r.chosen is not None]


def run(options: BenchOptions) -> tuple[BenchTable, ...]:
    """Seeds 0 to `options.seeds` - 1, one thread; scene, robot, kernels and weights loaded before the clock starts."""
    robot = load_robot(options.robot)
    ik = WholeBodyIK(robot)
    warm_up(robot, ik)
    surrogate = load_surrogate(robot)
    studies = list(_studies(options, robot, ik, surrogate))
    return _results(robot, studies), _times(studies), _prediction(studies)


def _studies(options: BenchOptions, robot: Robot, ik: WholeBodyIK, surrogate: DynamicsSurrogate) -> Iterator[Study]:
    raw = uncalibrated(surrogate)
    for name in SCENES:
        for label, dynamics, net, ask, seeds, deadline, improve in (
            ("quasi-static", "quasi-static", None, True, options.seeds, DEADLINE, IMPROVE),
            ("learned", "learned", surrogate, True, options.seeds, DEADLINE, IMPROVE),
            ("learned, uncalibrated", "learned", raw, False, options.seeds, DEADLINE, IMPROVE),
            ("exact in the loop", "exact", None, True, min(options.seeds, EXACT_SEEDS), EXACT_DEADLINE, 0.0),
        ):
            results = []
            for seed in range(seeds):
                asked = ContactPlannerOptions(seed=seed, dynamics=_name(dynamics), surrogate=net, ask_when_far=ask)
                scene = load_scene(name, seed=seed)
                result = run_query(scene, robot, ik, asked, deadline=deadline, improve=improve)
                results.append(result)
                options.tell(
                    f"{name} {label} seed {seed}: {len(result.plans)} sequences, first {result.first_s:.3f} s, first "
                    f"feasible {result.first_feasible_s:.3f} s, tested {result.tested} {result.why}"
                )
            yield Study(name, label, tuple(results))


def _name(name: str) -> DynamicsName:
    return "exact" if name == "exact" else "learned" if name == "learned" else "quasi-static"


def uncalibrated(surrogate: DynamicsSurrogate) -> DynamicsSurrogate:
    """The same networks with their raw logits: a transition counts as feasible from probability one half."""
    one = np.ones_like(surrogate.scale)
    return replace(surrogate, scale=one, offset=0.0 * one, threshold=0.5 * one)


def _results(robot: Robot, studies: list[Study]) -> BenchTable:
    """Fig. 8."""
    rows = []
    for study in studies:
        if study.planner not in ("quasi-static", "learned"):
            continue
        proven, found = study.proven, sum(bool(r.plans) for r in study.results)
        cases = [
            (sequence_problem(robot, r.chosen.stances).schedule, r.estimate.trajectory)
            for r in proven
            if r.chosen is not None and r.estimate is not None and r.estimate.trajectory is not None
        ]
        objective = [r.estimate.cost for r in proven if r.estimate is not None]
        rows.append(
            (
                study.scene,
                study.planner,
                f"{found}/{len(study.results)}",
                f"{len(proven)}/{found}",
                float(np.mean([r.tested for r in proven])) if proven else float("nan"),
                float(np.mean(objective)) if objective else float("nan"),
                *robustness(cases, robot.mass, robot.half_extents),
                f"{sum(r.palms_used() for r in proven)}/{len(proven)}",
            )
        )
    notes = [f"published, {scene}, {planner}: {numbers}" for (scene, planner), numbers in PUBLISHED.items()]
    notes.append(f"search goes on for {IMPROVE:g} s after the first sequence (documents: {DEADLINE:g} s in all)")
    columns = ("scene", "planner", "(1) found", "(2) feasible", "(3) tested", "(4) objective", *COLUMNS, "with palms")
    return BenchTable("lin2019", "Contact sequences with learned dynamics (Lin et al. 2019 fig. 8)", columns,
                      tuple(rows), tuple(notes))  # fmt: skip


def _times(studies: list[Study]) -> BenchTable:
    """Fig. 7, and the ablation."""
    rows = []
    for study in studies:
        first = [1e3 * r.first_feasible_s for r in study.proven]
        confirm = spread([1e3 * r.confirm_s for r in study.proven])
        asked = {who: sum(r.asked.get(who, 0) for r in study.results) for who in ("learned", "exact")}
        s = spread(first)
        rows.append(
            (
                study.scene,
                study.planner,
                f"{len(study.proven)}/{len(study.results)}",
                float(np.mean(first)) if first else float("nan"),
                float(np.std(first)) if first else float("nan"),
                s["median"],
                s["p95"],
                confirm["median"],
                asked["learned"],
                asked["exact"],
                float(np.mean([r.estimate.cost for r in study.proven if r.estimate])) if first else float("nan"),
            )
        )
    columns = ("scene", "planner", "proven", "mean ms", "std", "median", "p95", "confirming program ms",
               "judged by networks", "by programs", "objective")  # fmt: skip
    notes = (
        "time: search and queries until the first sequence that proves dynamically feasible; one thread",
        f"published, rubble_field: {PUBLISHED_FIRST}",
        f"exact in the loop: {EXACT_SEEDS} seeds at most, {EXACT_DEADLINE:g} s; mixed integer: drakeplan bench planners",
    )
    return BenchTable("lin2019_time", "Time to the first dynamically feasible sequence (Lin et al. 2019 fig. 7)",
                      columns, tuple(rows), notes)  # fmt: skip


def _prediction(studies: list[Study]) -> BenchTable:
    """Fig. 10: sum of predicted objectives against the actual one."""
    pairs = np.array(
        [
            (r.chosen.predicted_effort, r.estimate.cost)
            for study in studies
            if study.planner == "learned"
            for r in study.proven
            if r.chosen is not None and r.estimate is not None and r.chosen.predicted_effort is not None
        ]
    ).reshape(-1, 2)
    columns = ("sequences", "correlation", "slope", "intercept")
    title = "Sum of predicted objectives against the actual one (Lin et al. 2019 fig. 10)"
    if len(pairs) < 3:
        return BenchTable("lin2019_prediction", title, columns, ((len(pairs), *(float("nan"),) * 3),))
    from sklearn.linear_model import HuberRegressor

    fit = HuberRegressor().fit(pairs[:, :1] / 1e3, pairs[:, 1] / 1e3)
    correlation = float(np.corrcoef(pairs.T)[0, 1])
    _plot(pairs, float(fit.coef_[0]), 1e3 * float(fit.intercept_))
    row = (len(pairs), correlation, float(fit.coef_[0]), 1e3 * float(fit.intercept_))
    return BenchTable("lin2019_prediction", title, columns, (row,), (f"robust (Huber) regression; plot: {PLOT}",))


def _plot(pairs: np.ndarray, slope: float, intercept: float) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5, 4), layout="constrained")
    axes.plot(*pairs.T, ".", color="tab:blue", label="sequences")
    ends = np.array([pairs[:, 0].min(), pairs[:, 0].max()])
    axes.plot(ends, slope * ends + intercept, color="tab:red", label=f"robust fit, slope {slope:.2f}")
    axes.set_xlabel("sum of predicted objectives of the transitions")
    axes.set_ylabel("objective of the whole sequence")
    axes.legend()
    PLOT.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PLOT, dpi=120)
    plt.close(figure)
