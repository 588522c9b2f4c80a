"""Whole queries on every named scene, on ground that people report and on meshes: verdicts, times, and where the time went."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

from drakeplan.bench.ground_cases import ground_cases
from drakeplan.bench.kept_rows import KeptRows
from drakeplan.bench.table import BenchOptions, BenchTable, middle_and_high
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.query.warm_up import warm_up
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.library import NAMED_SCENES
from scenes.robots.robot import Robot, load_robot
from scenes.scene import Scene

MESHES = {
    "hpp/darpa": ((-3.6, 0.0, 0.0), (3.9, 0.0)),
    "hpp/stairs": ((-0.6, 0.8, 0.0), (2.2, 0.8)),
    "hpp/rubbles_stairs_1": ((0.0, 0.0, 0.0), (8.5, 0.0)),
}
MOST_SEEDS = 100
SEEDS = {"random_surfaces": MOST_SEEDS, "tilted_slab": 10}  # others 50
ROOMS = ("two_corridors", "two_staircases", "three_corridors")  # `bench segments` is about them
USUAL_SEEDS = 50
DYNAMIC = ("wide_gap", "wider_gap", "steep_slope", "slippery_slope")  # `bench crossings` is about them
DEADLINE = 20.0  # [s] of each query
KEPT = Path("out/scenes.jsonl")
LATE = 0.5  # [s]
STAGES = ("planning_s", "dynamics_s", "motion_s", "verification_s")


def run(options: BenchOptions) -> tuple[BenchTable, ...]:
    """Named scenes with their seeds, ground cases and meshes once; a run that was stopped goes on from out/scenes.jsonl."""
    robot = load_robot(options.robot)
    warm_up(robot, WholeBodyIK(robot))
    kept = KeptRows(KEPT)
    groups: dict[str, list[dict]] = {}
    for name, seed, load, ends in _cases(options.seeds):
        key = f"{options.robot} {name} {seed}"
        if key not in kept.rows:
            try:
                kept.add(key, _query(load(), robot, seed, ends))
            except InputError as error:
                kept.add(key, {"status": "refused", "reason": str(error)})
            row = kept.rows[key]
            options.tell(f"{name} seed {seed}: {row['status']} {row.get('total_s', 0.0):.1f} s {row['reason']}")
        groups.setdefault(name, []).append(kept.rows[key])
    return _verdicts(groups), _times(groups)


Ends = tuple[tuple[float, float, float], tuple[float, float]]


def _cases(seeds: int) -> list[tuple[str, int, Callable[[], Scene], Ends | None]]:
    """Name, seed, how to load it, and start and goal of the meshes; seed by seed, so that a short run has all scenes."""
    named = [
        (name, seed, lambda name=name, seed=seed: load_scene(name, seed=seed), None)
        for seed in range(min(seeds, MOST_SEEDS))
        for name in NAMED_SCENES
        if name not in (*DYNAMIC, *ROOMS) and seed < SEEDS.get(name, USUAL_SEEDS)
    ]
    ground = [(name, 0, load, None) for name, load in ground_cases().items()]
    meshes = [(name, 0, lambda name=name: load_scene(name), ends) for name, ends in MESHES.items()]
    return [*ground, *meshes, *named]


def _query(scene: Scene, robot: Robot, seed: int, ends: Ends | None) -> dict:
    start, goal = ends or (None, None)
    found = plan_scene(scene, robot, PlanOptions(seed=seed, start=start, goal=goal, deadline=DEADLINE))
    numbers = ("total_s", "time_to_first_s", "stances", "palms_used", "repairs", "expansions", *STAGES)
    return {"status": found.status, "reason": found.reason, **{name: found.report[name] for name in numbers}}


def _verdicts(groups: dict[str, list[dict]]) -> BenchTable:
    rows, notes = [], []
    for name, found in groups.items():
        status = Counter(row["status"] for row in found)
        complete = [row for row in found if row["status"] == "complete"]
        palms = sum(bool(row["palms_used"]) for row in complete)
        late = sum(row.get("total_s", 0.0) > DEADLINE + LATE for row in found)
        rows.append((name, len(found), status["complete"], status["contacts"], status["none"] + status["refused"], palms,
                     *middle_and_high([row["total_s"] for row in complete]), late))  # fmt: skip
        notes += [
            f"{name} seed {seed}: {row['reason']}" for seed, row in enumerate(found) if row["status"] != "complete"
        ]
    columns = (
        "scene",
        "queries",
        "verified",
        "contacts only",
        "no plan",
        "verified with palms",
        "median s",
        "p95 s",
        "late",
    )
    head = f"--deadline {DEADLINE:g} for the whole query; seconds of the verified ones; late: ended more than {LATE:g} s after it."
    return BenchTable("scenes", "Verdicts of the verifier", columns, tuple(rows), (head, *notes), most_seeds=MOST_SEEDS)


def _times(groups: dict[str, list[dict]]) -> BenchTable:
    """Where the time of all queries went, and what a stance of the verified ones took."""
    rows = []
    for name, found in groups.items():
        asked = [row for row in found if row["status"] != "refused"]
        total = sum(row["total_s"] for row in asked)
        shares = [100.0 * sum(row[stage] for row in asked) / max(total, 1e-9) for stage in STAGES]
        first = [1e3 * row["time_to_first_s"] for row in asked if row["time_to_first_s"] is not None]
        each = [
            1e3 * (row["dynamics_s"] + row["motion_s"]) / row["stances"]
            for row in asked
            if row["status"] == "complete" and not row["repairs"]
        ]
        rows.append((name, *middle_and_high(first), *middle_and_high(each), *shares,
                     sum(row["repairs"] for row in asked)))  # fmt: skip
    columns = ("scene", "first contacts ms", "p95", "dynamics and motion, ms a stance", "p95", "search %", "dynamics %",
               "motion %", "verification %", "refused motions")  # fmt: skip
    notes = ("ms a stance: of verified plans whose first sequence held; shares: of the time of all queries.",)
    title = "Where the time of whole queries went"
    return BenchTable("scene_times", title, columns, tuple(rows), notes, bench="scenes", most_seeds=MOST_SEEDS)
