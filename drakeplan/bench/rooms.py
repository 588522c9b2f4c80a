"""Rooms joined by corridors and staircases: search, stored plans along the torso's way, and both (Lin 2020 table 5.1)."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from drakeplan.bench.kept_rows import KeptRows
from drakeplan.bench.table import BenchOptions, BenchTable, middle_and_high
from drakeplan.query.one_planner import load_kernels
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.robots.robot import load_robot

SCENES = ("two_corridors", "two_staircases", "three_corridors")
WAYS: dict[str, dict[str, object]] = {
    "search": {"planner": "search"},
    "adapt": {"planner": "adapt", "search_too": False},
    "parallel": {"planner": "parallel"},
}
DOCUMENTED = {  # of 50, and seconds of the successful ones: the best of the document's planners
    "two_corridors": "42 of 50, 153 s",
    "two_staircases": "39 of 50, 144 s",
    "three_corridors": "",
}
MOST_SEEDS = 50
DEADLINE = 30.0  # [s] of each query; Lin 2020 allowed 500
KEPT = Path("out/rooms.jsonl")


def run(options: BenchOptions) -> BenchTable:
    """Every way on every scene; a run that was stopped goes on from out/rooms.jsonl."""
    robot = load_robot(options.robot)
    load_kernels(robot, WholeBodyIK(robot), "parallel", lambda event: None)
    kept = KeptRows(KEPT)
    found: dict[tuple[str, str], list[dict]] = {}
    for seed in range(min(options.seeds, MOST_SEEDS)):
        for name in SCENES:
            for way, asked in WAYS.items():
                key = f"{options.robot} {name} {seed} {way}"
                if key not in kept.rows:
                    wanted = PlanOptions(seed=seed, deadline=DEADLINE, **asked)  # type: ignore[arg-type]
                    result = plan_scene(load_scene(name, seed=seed), robot, wanted)
                    numbers = {key: result.report[key] for key in ("total_s", "stances", "palms_used", "planner")}
                    kept.add(key, {"status": result.status, "reason": result.reason, **numbers})
                    row = kept.rows[key]
                    options.tell(f"{name} seed {seed} {way}: {row['status']} {row['total_s']:.1f} s {row['reason']}")
                found.setdefault((name, way), []).append(kept.rows[key])
    rows = []
    for (name, way), results in found.items():
        status = Counter(row["status"] for row in results)
        done = [row for row in results if row["status"] == "complete"]
        steps = middle_and_high([row["stances"] for row in done])[0]
        adapted = sum(row["planner"] == "adapt" for row in done) if way == "parallel" else ""
        rows.append((name, way, len(results), status["complete"], *middle_and_high([row["total_s"] for row in done]),
                     steps, adapted, DOCUMENTED[name]))  # fmt: skip
    columns = ("scene", "way", "queries", "verified", "median s", "p95 s", "stances", "adapt first", "Lin 2020")
    notes = (
        f"--deadline {DEADLINE:g} for the whole query; seconds and median stances of the verified ones.",
        "Lin 2020 table 5.1: other draws, 500 s, contacts alone; adapt first: verified plans of parallel that were adapted.",
    )
    title = "Rooms joined by corridors and staircases"
    return BenchTable("rooms", title, columns, tuple(rows), notes, most_seeds=MOST_SEEDS)
