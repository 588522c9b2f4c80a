"""Results of the planner and the verifier on every named scene, and on the meshes of hpp-environments."""

from __future__ import annotations

from collections import Counter

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.warm_up import warm_up
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.library import NAMED_SCENES
from scenes.robots.robot import load_robot

MESHES = {
    "hpp/darpa": ((-3.6, 0.0, 0.0), (3.9, 0.0)),
    "hpp/stairs": ((-0.6, 0.8, 0.0), (2.2, 0.8)),
    "hpp/rubbles_stairs_1": ((0.0, 0.0, 0.0), (8.5, 0.0)),
}
MAX_SEEDS = 10
DEADLINE = 10.0  # [s] of search


def run(options: BenchOptions) -> BenchTable:
    """Named scenes with seeds 0 to 9, the meshes once."""
    robot = load_robot(options.robot)
    warm_up(robot, WholeBodyIK(robot))
    cases = [(name, seed, None, None) for name in NAMED_SCENES for seed in range(min(options.seeds, MAX_SEEDS))]
    cases += [(name, 0, start, goal) for name, (start, goal) in MESHES.items()]
    results: dict[str, list] = {}
    notes = []
    for name, seed, start, goal in cases:
        try:
            scene = load_scene(name, seed=seed)
        except InputError as error:
            notes.append(f"{name}: {error}")
            continue
        found = plan_scene(scene, robot, PlanOptions(seed=seed, start=start, goal=goal, deadline=DEADLINE))
        results.setdefault(name, []).append(found)
        options.tell(f"{name} seed {seed}: {found.status} {found.reason}")
        if found.status != "complete":
            notes.append(f"{name} seed {seed}: {found.reason}")
    rows = []
    for name, found in results.items():
        complete = [f.report for f in found if f.status == "complete"]
        statuses = Counter(f.status for f in found)
        total = [float(r["total_s"]) for r in complete]  # type: ignore[arg-type]
        rows.append((name, len(found), statuses["complete"], statuses["contacts"], statuses["none"],
                     sum(bool(r["palms_used"]) for r in complete),
                     float(np.median(total)) if total else float("nan")))  # fmt: skip
    columns = ("scene", "queries", "verified", "contacts only", "no plan", "verified with palms", "median total s")
    return BenchTable("scenes", "Verdicts of the verifier", columns, tuple(rows), tuple(notes), most_seeds=MAX_SEEDS)
