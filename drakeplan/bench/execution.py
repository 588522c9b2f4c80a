"""Plans played in Drake's physics: how many arrive, how near to the plan, and what gave way in the others."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from drakeplan.bench.kept_rows import KeptRows
from drakeplan.bench.scenes import MESHES
from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.execution import ExecutionOptions, ExecutionReport, Physics, play_plan
from drakeplan.plan.plan import Plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.timing.step_timing import Timing
from optimization.balance.friction import FrictionCone
from scenes.files.scene_source import load_scene
from scenes.robots.robot import Robot, load_robot
from scenes.scene import Scene

COLUMNS = (
    "scene", "plans", "arrived", "with palms", "of these arrived", "CoM mm", "worst CoM mm", "slip mm", "worst slip mm",
    "times real time", "s",
)  # fmt: skip
ONCE = ("flat", "stairs", "narrow_flat", "tilted_slab", "slippery_slope", *MESHES)  # the same for every seed
HARD, TRIES = ("tilted_slab", "slippery_slope"), 3  # planned with so many seeds
HOW: dict[str, dict[str, Any]] = {  # what its plans need: only motion crosses it, and only with the true cone
    "slippery_slope": {
        "dynamics": "exact",
        "cone": FrictionCone.SECOND_ORDER,
        "timing": Timing(0.3, 0.6),
        "deadline": 60.0,
    }
}
DISTURBED = "rubble_field"
SCENES = (*ONCE, DISTURBED, "rubble_corridor", "random_surfaces")
DEADLINE = 30.0  # [s] of each query
KEPT = Path("out/execution.jsonl")  # a line for each plan that was played: a run that was stopped goes on from there
NUMBERS = r"[-\d.]+"
SLIPPERY, PUSH = 0.45, 0.2  # of all terrain, where 0.5 was planned with; [m/s] sideways in the middle of a swing
LEFT = np.array([0.0, 1.0, 0.0])  # of a robot that walks along x, as it does in that scene


def run(options: BenchOptions) -> tuple[BenchTable, ...]:
    """Each scene's plans, one after the other in this process; friction in the physics is that of the plan."""
    kept, robot = KeptRows(KEPT), load_robot(options.robot)
    cases = [(name, seed) for name in ONCE for seed in range(TRIES if name in HARD else 1)]
    cases += [(name, seed) for seed in range(options.seeds) for name in SCENES if name not in ONCE]
    for name, seed in cases:
        key = f"{options.robot} {name} {seed}"
        if key in kept.rows:
            continue
        kept.add(key, _planned_and_played(name, seed, robot))
        options.tell(f"{key}: {kept.rows[key]['reason'] or 'arrived'}")
    rows, notes = [], []
    for name in SCENES:
        found = [kept.rows[f"{options.robot} {name} {seed}"] for case, seed in cases if case == name]
        planned = [row for row in found if row["planned"]]
        rows.append(_row(name, planned))
        causes = Counter(_kind(row["reason"]) for row in planned if row["reason"])
        notes += [f"{name}: {_times(count)}: {cause}" for cause, count in causes.most_common()]
        if len(planned) < len(found):
            notes.append(f"{name}: {len(found) - len(planned)} of {len(found)} without a verified plan")
    notes.append(
        "arrived: stands at the goal one second after the plan's end; medians of the plans that arrived; s: of the whole run; "
        "`drakeplan simulate` plays one."
    )
    title = "Plans played in physics"
    table = BenchTable("execution", title, COLUMNS, tuple(rows), tuple(notes), most_seeds=None)
    return table, _disturbed([kept.rows[f"{options.robot} {DISTURBED} {seed}"] for seed in range(options.seeds)])


def load_case(name: str, seed: int) -> Scene:
    """A named scene; those that are the same for every seed take none.

    Args:
        name: of the scene.
        seed: of the others.
    """
    return load_scene(name) if name in ONCE else load_scene(name, seed=seed)


def numbers_of(report: ExecutionReport) -> dict:
    """What a run says, as a row that is kept."""
    return {
        "reason": report.reason,
        "com": report.com_error_m,
        "slip": max(report.slips_m.values()),
        "rate": report.real_time_factor,
        "seconds": report.simulated_s,
    }


def _planned_and_played(name: str, seed: int, robot: Robot) -> dict:
    """Numbers of one plan and its run."""
    start, goal = MESHES.get(name, (None, None))
    asked = PlanOptions(**{"seed": seed, "start": start, "goal": goal, "deadline": DEADLINE, **HOW.get(name, {})})
    result = plan_scene(load_case(name, seed), robot, asked)
    if result.status != "complete" or result.plan is None:
        return {"planned": False, "reason": result.reason}
    plan, model = result.plan, str(robot.model)
    row = {"planned": True, "palms": int(str(result.report["palms_used"])), **numbers_of(play_plan(plan, model))}
    if name == DISTURBED:
        row["disturbed"] = {what: play_plan(plan, model, how).reason for what, how in _disturbances(plan).items()}
    return row


def _disturbances(plan: Plan) -> dict[str, ExecutionOptions]:
    """How else a plan is played, by what differs."""
    assert plan.phases is not None
    swings = [k for k in range(len(plan.phases.end)) if k % 2]
    middle = swings[len(swings) // 2]
    time = 0.5 * float(plan.phases.start[middle] + plan.phases.end[middle])
    aside = PUSH * LEFT * (1.0 if plan.phases.contact[middle, 0] < 0 else -1.0)  # towards the foot that swings
    pushes = {"towards the foot that swings": aside, "away from it": -aside}
    return {
        f"friction {SLIPPERY:g}": ExecutionOptions(physics=Physics(friction=SLIPPERY)),
        "what is measured is off by 2 mm": ExecutionOptions(noise=1.0),
        **{f"push of {PUSH:g} m/s {where}": ExecutionOptions(push=(time, tuple(way))) for where, way in pushes.items()},
    }


def _disturbed(rows: list[dict]) -> BenchTable:
    """How many of the plans of one scene arrive in spite of what differs."""
    played = [row["disturbed"] for row in rows if row["planned"]]
    names = list(played[0]) if played else []
    lines = tuple((name, len(played), sum(not reasons[name] for reasons in played)) for name in names)
    causes = Counter((name, _kind(reasons[name])) for name in names for reasons in played if reasons[name])
    notes = tuple(f"{name}: {_times(count)}: {cause}" for (name, cause), count in causes.most_common())
    title, columns = f"Plans of {DISTURBED} played in other physics", ("what differs", "plans", "arrived")
    return BenchTable("disturbed", title, columns, lines, notes, bench="execution", most_seeds=None)


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


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
