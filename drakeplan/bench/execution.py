"""Plans played in Drake's physics: how many arrive, how near to the plan, and what gave way in the others."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np

from drakeplan.bench.kept_rows import KeptRows
from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.execution import play_plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from scenes.files.scene_source import load_scene
from scenes.robots.robot import Robot, load_robot

COLUMNS = (
    "scene", "plans", "arrived", "with palms", "of these arrived", "CoM mm", "worst CoM mm", "slip mm", "worst slip mm",
    "times real time", "s",
)  # fmt: skip
ONCE = ("flat", "stairs", "narrow_flat", "tilted_slab")  # the same for every seed
SCENES = (*ONCE, "rubble_field", "rubble_corridor", "random_surfaces")
DEADLINE = 30.0  # [s] of each query
KEPT = Path("out/execution.jsonl")  # a line for each plan that was played: a run that was stopped goes on from there
NUMBERS = r"[-\d.]+"


def run(options: BenchOptions) -> BenchTable:
    """Each scene's plans, one after the other in this process; friction in the physics is that of the plan."""
    kept, robot = KeptRows(KEPT), load_robot(options.robot)
    cases = [(name, 0) for name in ONCE]
    cases += [(name, seed) for seed in range(options.seeds) for name in SCENES if name not in ONCE]
    for name, seed in cases:
        key = f"{options.robot} {name} {seed}"
        if key in kept.rows:
            continue
        kept.add(key, _played(name, seed, robot))
        options.tell(f"{key}: {kept.rows[key]['reason'] or 'arrived'}")
    rows, notes = [], []
    for name in SCENES:
        found = [row for (case, seed) in cases if case == name and (row := kept.rows[f"{options.robot} {name} {seed}"])]
        planned = [row for row in found if row["planned"]]
        rows.append(_row(name, planned))
        causes = Counter(_kind(row["reason"]) for row in planned if row["reason"])
        notes += [f"{name}: {count} times: {cause}" for cause, count in causes.most_common()]
        if len(planned) < len(found):
            notes.append(f"{name}: {len(found) - len(planned)} of {len(found)} without a verified plan")
    title = "Plans played in physics"
    notes.append(
        "arrived: stands at the goal one second after the plan's end; medians of the plans that arrived; s: of the whole run; "
        "`drakeplan simulate` plays one."
    )
    return BenchTable("execution", title, COLUMNS, tuple(rows), tuple(notes), most_seeds=None)


def _played(name: str, seed: int, robot: Robot) -> dict:
    """Numbers of one plan and its run."""
    scene = load_scene(name) if name in ONCE else load_scene(name, seed=seed)
    result = plan_scene(scene, robot, PlanOptions(seed=seed, deadline=DEADLINE))
    if result.status != "complete" or result.plan is None:
        return {"planned": False, "reason": result.reason}
    report = play_plan(result.plan, str(robot.model))
    return {
        "planned": True,
        "palms": int(str(result.report["palms_used"])),
        "reason": report.reason,
        "com": report.com_error_m,
        "slip": max(report.slips_m.values()),
        "rate": report.real_time_factor,
        "seconds": report.simulated_s,
    }


def _row(name: str, planned: list[dict]) -> tuple[object, ...]:
    arrived = [row for row in planned if not row["reason"]]
    palms = [row for row in planned if row["palms"]]

    def of(key: str, scale: float = 1.0) -> np.ndarray:
        return scale * np.array([row[key] for row in arrived] or [np.nan])

    com, slip = of("com", 1e3), of("slip", 1e3)
    return (
        name, len(planned), len(arrived), len(palms), sum(not row["reason"] for row in palms),
        np.median(com), com.max(), np.median(slip), slip.max(), np.median(of("rate")), np.median(of("seconds")),
    )  # fmt: skip


def _kind(reason: str) -> str:
    """What failures of one kind have in common: the reason without its numbers."""
    return re.sub(NUMBERS, "#", reason)
