"""First contact sequences with steps that move to the nearest foothold, beside the fixed steps of Lin 2020."""

from __future__ import annotations

from typing import get_args

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable, spread
from drakeplan.contact_planning.contact_plan import DynamicsName, FootholdsName, PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.query.warm_up import warm_up
from drakeplan.search.ana_star import Limits
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.robots.robot import Robot, load_robot

CASES: tuple[tuple[str, DynamicsName], ...] = (
    ("random_surfaces", "quasi-static"),
    ("random_surfaces", "learned"),
    ("rubble_field", "quasi-static"),
    ("rubble_field", "learned"),
    ("rubble_corridor", "quasi-static"),
    ("rubble_corridor", "learned"),
    ("stairs", "quasi-static"),
)
MAX_SEEDS = 20
DEADLINE = 10.0  # [s] of search


def run(options: BenchOptions) -> BenchTable:
    """Seeds 0 to 19 of each scene, both kinds of steps in turn on each seed, one thread; scene, robot and kernels loaded."""
    robot = load_robot(options.robot)
    ik = WholeBodyIK(robot)
    warm_up(robot, ik)
    rows, notes = [], []
    seeds = min(options.seeds, MAX_SEEDS)
    for scene, dynamics in CASES:
        found: dict[FootholdsName, list[tuple[float, float, float]]] = {name: [] for name in get_args(FootholdsName)}
        for seed in range(seeds):
            for footholds, times in found.items():
                times.append(
                    _first(scene, seed, robot, ik, PlannerOptions(seed, dynamics=dynamics, footholds=footholds))
                )
                options.tell(f"{scene} seed {seed}, {dynamics}, {footholds}: {times[-1][0]:.1f} ms")
            if not np.isfinite(found["snapped"][-1][0]):
                notes.append(f"{scene} seed {seed}, {dynamics}, snapped: no contacts in {DEADLINE:g} s")
        for footholds, times in found.items():
            first, expansions, each = np.array(times).T
            solved = np.isfinite(first)
            s = spread(first.tolist())
            mean = float(first[solved].mean()) if solved.any() else float("nan")
            rows.append((scene, dynamics, footholds, f"{int(solved.sum())} of {seeds}", s["median"], mean, s["p95"], s["max"],
                         float(np.median(expansions)), float(np.median(each))))  # fmt: skip
    columns = ("scene", "dynamics", "footholds", "solved", "median ms", "mean ms of the solved", "p95", "max", "expansions",
               "ms per expansion")  # fmt: skip
    notes.append(
        "Both kinds of steps take turns on each seed. Packing the terrain and the heuristic's grid are included."
    )
    return BenchTable("footholds", "Snapped and fixed steps", columns, tuple(rows), tuple(notes), most_seeds=MAX_SEEDS)


def _first(scene: str, seed: int, robot: Robot, ik: WholeBodyIK, options: PlannerOptions) -> tuple[float, float, float]:
    """Milliseconds to the first contact sequence, inf without one; expansions; and milliseconds of each."""
    planner = SearchPlanner(QueryContext(load_scene(scene, seed=seed), robot, ik), options)
    plan = next(planner.plans(Limits(deadline=DEADLINE)), None)
    if plan is None:
        count = planner.counts().expansions
        return np.inf, float(count), 1e3 * DEADLINE / max(count, 1)
    return 1e3 * plan.elapsed, float(plan.expansions), 1e3 * (plan.elapsed - planner.setup_s) / max(plan.expansions, 1)
