"""Search, mixed-integer programs and a graph of convex sets on the same scenes, seeds, motion stage and verifier."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.contact_planning.planner import PLANNERS
from drakeplan.context import QueryContext
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.result import PlanResult
from drakeplan.query.warm_up import warm_up
from optimization.contact_programs.length_bound import LengthBound, length_lower_bound
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.library import NAMED_SCENES
from scenes.robots.robot import Robot, load_robot
from scenes.scene import Scene

SCENES = ("flat", "stairs", "rubble_field", "rubble_corridor")
MAX_SEEDS = 2
DEADLINE = 60.0  # [s] of planning; dynamics, motion and verification follow
PLOT = Path("out") / "planners.png"


@dataclass(frozen=True)
class Attempt:
    """One query by one planner."""

    scene: str
    planner: str
    seed: int
    result: PlanResult
    bound: float

    @property
    def verified(self) -> bool:
        """Whether the plan is complete and the verifier holds."""
        return self.result.status == "complete"

    def number(self, key: str) -> float:
        """A number of the report, NaN where there is none."""
        value = self.result.report.get(key)
        return float(value) if isinstance(value, int | float) else float("nan")

    @property
    def gap(self) -> float:
        """Of the plan's cost to the lower bound, relative to the cost."""
        cost = self.number("cost")
        return max(cost - self.bound, 0.0) / cost if cost > 0 and np.isfinite(self.bound) else float("nan")


def run(options: BenchOptions) -> BenchTable:
    """Every planner on every scene and seed; a plot of success against time goes to out/planners.png."""
    robot = load_robot(options.robot)
    ik = WholeBodyIK(robot)
    warm_up(robot, ik)
    attempts: list[Attempt] = []
    for name in SCENES:
        for seed in range(min(options.seeds, MAX_SEEDS)):
            scene = NAMED_SCENES[name](seed)
            bound = _bound(scene, robot, ik)
            for planner in PLANNERS:
                wanted = PlanOptions(seed=seed, dynamics="quasi-static", planner=planner, deadline=DEADLINE)
                attempt = Attempt(name, planner, seed, plan_scene(scene, robot, wanted), bound.cost)
                attempts.append(attempt)
                options.tell(
                    f"{name} seed {seed} {planner}: {attempt.result.status}, contacts after"
                    f" {attempt.number('planning_s'):.2f} s {attempt.result.reason}"
                )
    rows = [
        _row(name, planner, [a for a in attempts if a.scene == name and a.planner == planner])
        for name in SCENES
        for planner in PLANNERS
    ]
    _plot(attempts, PLOT)
    notes = [
        f"Seeds 0 to {min(options.seeds, MAX_SEEDS) - 1}, {DEADLINE:g} s of planning, one thread; the same motion stage and verifier.",
        "Cost is the search's own (Lin 2020 eq. 3.2); gap to `length_lower_bound`, the relaxation of a graph of convex sets.",
        "The search improves for 1 s after its first plan, the programs for 1 s after their first that passes inverse kinematics.",
        f"Success against time: {PLOT}.",
    ]
    notes += [f"{a.scene} seed {a.seed} {a.planner}: {a.result.reason}" for a in attempts if not a.verified]
    columns = (
        "scene",
        "planner",
        "verified",
        "first contacts s",
        "planning s",
        "total s",
        "stances",
        "cost",
        "gap to bound",
        "repairs",
    )
    return BenchTable(
        "planners", "Planners on the same scenes and verifier", columns, tuple(rows), tuple(notes), most_seeds=MAX_SEEDS
    )


def _bound(scene: Scene, robot: Robot, ik: WholeBodyIK) -> LengthBound:
    context = QueryContext(scene, robot, ik)
    return length_lower_bound(scene, robot, context.start, context.goal)


def _row(scene: str, planner: str, attempts: Sequence[Attempt]) -> tuple[object, ...]:
    def median(key: str) -> float:
        values = [a.number(key) for a in attempts if a.verified]
        return float(np.median(values)) if values else float("nan")

    gaps = [a.gap for a in attempts if a.verified]
    return (
        scene,
        planner,
        f"{sum(a.verified for a in attempts)} of {len(attempts)}",
        median("time_to_first_s"),
        median("planning_s"),
        median("total_s"),
        median("stances"),
        median("cost"),
        float(np.median(gaps)) if gaps else float("nan"),
        median("repairs"),
    )


def _plot(attempts: Sequence[Attempt], path: Path) -> None:
    """Share of the queries that a planner had a verified plan's contacts for, against the time to them."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    path.parent.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(figsize=(6.0, 4.0), constrained_layout=True)
    for planner in PLANNERS:
        mine = [a for a in attempts if a.planner == planner]
        times = np.sort([a.number("time_to_first_s") for a in mine if a.verified])
        share = np.arange(1, len(times) + 1) / max(len(mine), 1)
        axes.step(
            np.r_[1e-3, times, DEADLINE],
            np.r_[0.0, share, share[-1:] if len(share) else [0.0]],
            where="post",
            label=f"{planner} ({len(times)} of {len(mine)})",
        )
    axes.set(
        xscale="log",
        xlim=(1e-3, DEADLINE),
        ylim=(0.0, 1.03),
        xlabel="time to the first contacts that pass [s]",
        ylabel="share of queries, verified",
    )
    axes.legend(loc="upper left")
    figure.savefig(path, dpi=120)
    plt.close(figure)
