"""Time to the first contact sequence that passes inverse kinematics and balance, heuristic grid included."""

from __future__ import annotations

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable, spread
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.query.warm_up import warm_up
from drakeplan.search.ana_star import Limits
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.robots.robot import load_robot

SCENES = ("rubble_field", "rubble_corridor")
DEADLINE = 30.0  # [s], as in Lin et al. 2019
# Lin 2020 fig. 6.8 and 6.9: solved of 50 within 30 s by the quasi-static planner; 98 ms with learned dynamics.
PUBLISHED = {"rubble_field": "47 of 50", "rubble_corridor": "44 of 50"}


def run(options: BenchOptions) -> BenchTable:
    """Seeds 0 to `options.seeds` - 1 of each scene, one thread, scene, robot and kernels loaded."""
    robot = load_robot(options.robot)
    ik = WholeBodyIK(robot)
    warm_up(robot, ik)
    rows, notes = (
        [],
        ["Scene, robot and kernels are loaded; packing the terrain and the heuristic's grid are included."],
    )
    for name in SCENES:
        times, expansions, steps, palms = [], [], [], []
        for seed in range(options.seeds):
            context = QueryContext(load_scene(name, seed=seed), robot, ik)
            planner = SearchPlanner(context, PlannerOptions(seed=seed))
            plan = next(planner.plans(Limits(deadline=DEADLINE)), None)
            if plan is None:
                times.append(np.inf)
                notes.append(f"{name} seed {seed}: {planner.why_not()}")
                continue
            times.append(1e3 * plan.elapsed)
            expansions.append(plan.expansions)
            steps.append(len(plan.stances) - 1)
            palms.append(plan.palms_used > 0)
            options.tell(f"{name} seed {seed}: {times[-1]:.1f} ms, {steps[-1]} transitions")
        s = spread(times)
        solved = f"{int(np.isfinite(times).sum())} of {options.seeds}"
        rows.append(
            (name, solved, s["median"], s["p5"], s["p95"], s["max"], float(np.median(expansions)),
             float(np.median(steps)), int(sum(palms)), PUBLISHED[name])
        )  # fmt: skip
    columns = ("scene", "solved", "median ms", "p5", "p95", "max", "expansions", "transitions", "plans with palms",
               "Lin 2020, quasi-static, 30 s")  # fmt: skip
    return BenchTable(
        "first", "Time to the first contact sequence", columns, tuple(rows), tuple(notes), most_seeds=None
    )
