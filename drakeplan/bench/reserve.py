"""What a reserve of friction and supports costs the planner, and what it buys in physics: each part alone, and all together."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drakeplan.bench.execution import DEADLINE, load_case, numbers_of
from drakeplan.bench.kept_rows import KeptRows
from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.execution import play_plan
from drakeplan.motion.free_timing import effort, planned_schedule
from drakeplan.plan.plan import Plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from optimization.balance.friction import FrictionCone
from optimization.balance.reserve import ALL, USUAL, Reserve
from optimization.centroidal.trajectory import CentroidalTrajectory
from scenes.robots.robot import Robot, load_robot

RESERVES = {
    "none": ALL,
    "friction": Reserve(friction=USUAL.friction),
    "pressure": Reserve(pressure=USUAL.pressure),
    "supports": Reserve(support=USUAL.support),
    "brief": Reserve(brief=USUAL.brief),
    "all": USUAL,
}
SCENES = ("rubble_corridor", "random_surfaces")
MOST_SEEDS = 10
KEPT = Path("out/reserve.jsonl")  # a run that was stopped goes on from there
COLUMNS = ("scene", "reserve", "queries", "verified", "keep it", "median s", "median effort", "arrived in physics")


def run(options: BenchOptions) -> BenchTable:
    """The same scenes and seeds with each reserve, planned and played one after the other in this process."""
    kept, robot = KeptRows(KEPT), load_robot(options.robot)
    seeds = range(min(options.seeds, MOST_SEEDS))
    for seed in seeds:
        for scene in SCENES:
            for name, reserve in RESERVES.items():
                key = f"{options.robot} {scene} {seed} {name}"
                if key not in kept.rows:
                    kept.add(key, _planned_and_played(scene, seed, robot, reserve))
                    options.tell(f"{key}: {kept.rows[key]['reason'] or 'arrived'}")
    rows = []
    for scene in SCENES:
        for name in RESERVES:
            found = [kept.rows[f"{options.robot} {scene} {seed} {name}"] for seed in seeds]
            rows.append(_row(scene, name, found))
    notes = (
        f"friction: {USUAL.friction:g} of each coefficient; pressure: within {USUAL.pressure:g} of each support; supports: parts of "
        f"soles with an inner radius of {USUAL.support:g} of half their width alone; brief: at most {USUAL.brief:g} M g in the first "
        "and last 0.2 s of a contact; effort: the objective of Lin 2020 sec. 6.3 over the whole plan.",
    )
    return BenchTable(
        "reserve", "What plans leave unused, and how many arrive", COLUMNS, tuple(rows), notes, most_seeds=MOST_SEEDS
    )


def _planned_and_played(scene: str, seed: int, robot: Robot, reserve: Reserve) -> dict:
    result = plan_scene(load_case(scene, seed), robot, PlanOptions(seed=seed, deadline=DEADLINE, reserve=reserve))
    if result.status != "complete" or result.plan is None:
        return {"planned": False, "reason": result.reason}
    plan = result.plan
    return {
        "planned": True,
        "keeps": plan.provenance["reserve"] == vars(reserve),
        "total_s": result.report["total_s"],
        "effort": _effort(plan, robot),
        **numbers_of(play_plan(plan, str(robot.model))),
    }


def _effort(plan: Plan, robot: Robot) -> float:
    c = plan.centroidal
    assert c is not None
    trajectory = CentroidalTrajectory(**{name: getattr(c, name) for name in CentroidalTrajectory.__dataclass_fields__})
    return effort(robot, planned_schedule(plan), FrictionCone(plan.friction_cone), trajectory)


def _row(scene: str, name: str, found: list[dict]) -> tuple[object, ...]:
    planned = [row for row in found if row["planned"]]

    def middle(key: str) -> float:
        return float(np.median([row[key] for row in planned])) if planned else np.nan

    keep, arrived = sum(row["keeps"] for row in planned), sum(not row["reason"] for row in planned)
    return scene, name, len(found), len(planned), keep, middle("total_s"), middle("effort"), arrived
