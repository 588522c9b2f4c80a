"""How time grows with the number of surfaces at one distance, and with the distance."""

from __future__ import annotations

import time

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.query.warm_up import warm_up
from drakeplan.search.ana_star import Limits
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.library.rubble_field import long, wide
from scenes.robots.robot import Robot, load_robot
from scenes.scene import Scene

SURFACES = (14, 140, 1400, 14000)
DISTANCES = (3.0, 10.0, 30.0, 100.0)  # [m]
MAX_SEEDS = 10
DEADLINE = 120.0  # [s]


def run(options: BenchOptions) -> BenchTable:
    """Medians over up to 10 seeds; time per expansion beside the logarithm, total time beside the distance."""
    robot = load_robot(options.robot)
    ik = WholeBodyIK(robot)
    warm_up(robot, ik)
    seeds = range(min(options.seeds, MAX_SEEDS))
    rows = []
    base: dict[str, tuple[float, float]] = {}
    cases = [("surfaces", n, [wide(n, s) for s in seeds]) for n in SURFACES]
    cases += [("distance", d, [long(d, s) for s in seeds]) for d in DISTANCES]
    for kind, size, scenes in cases:
        measured = [_measure(scene, robot, ik, seed) for seed, scene in enumerate(scenes)]
        solved = [m for m in measured if m is not None]
        if not solved:
            rows.append((kind, size, f"0 of {len(scenes)}", *([float("nan")] * 7)))
            continue
        setup, total, expansions, again = (float(np.median([m[k] for m in solved])) for k in range(4))
        per_expansion = float(np.median([(m[1] - m[0]) / m[2] for m in solved]))
        first = base.setdefault(kind, (per_expansion, total))
        allowed = np.log(size) / np.log(SURFACES[0]) if kind == "surfaces" else size / DISTANCES[0]
        grown = per_expansion / first[0] if kind == "surfaces" else total / first[1]
        rows.append((kind, size, f"{len(solved)} of {len(scenes)}", 1e3 * setup, 1e3 * again, 1e3 * total, expansions,
                     1e3 * per_expansion, grown, float(allowed)))  # fmt: skip
        options.tell(f"{kind} {size}: {1e3 * total:.1f} ms")
    columns = (
        "of",
        "size",
        "solved",
        "set-up ms",
        "second ms",
        "total ms",
        "expansions",
        "ms per expansion",
        "grown by",
        "allowed",
    )
    notes = (
        "grown by: time per expansion (surfaces) or total time (distance) over that of the smallest case; allowed: the "
        "logarithm of the surfaces, the distance itself.",
        "second: set-up of another planner in the same query, which shares the packed terrain.",
        "ms per expansion leaves out the set-up (packing the terrain into arrays, proportional to its size).",
    )
    return BenchTable(
        "scale", "Growth of the time to the first sequence", columns, tuple(rows), notes, most_seeds=MAX_SEEDS
    )


def _measure(scene: Scene, robot: Robot, ik: WholeBodyIK, seed: int) -> tuple[float, float, int, float] | None:
    """(set-up [s], total [s], expansions, set-up of a second planner in the same query [s]); None without a plan."""
    began = time.perf_counter()
    context, options = QueryContext(scene, robot, ik), PlannerOptions(seed=seed)
    planner = SearchPlanner(context, options)
    plan = next(planner.plans(Limits(deadline=DEADLINE)), None)
    total = time.perf_counter() - began
    again = SearchPlanner(context, options).setup_s
    return None if plan is None else (planner.setup_s, total, max(plan.expansions, 1), again)
