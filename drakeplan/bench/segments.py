"""Rooms joined by corridors and staircases: search, segments of a guiding path, stored plans (Lin 2020 table 5.1)."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path

import numpy as np

from drakeplan.bench.kept_rows import KeptRows
from drakeplan.bench.table import BenchOptions, BenchTable, middle_and_high
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.context import QueryContext
from drakeplan.guide.guided_planner import GuidedPlanner
from drakeplan.query.one_planner import load_kernels
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.robots.robot import Robot, load_robot

SCENES = ("two_corridors", "two_staircases")
WAYS: dict[str, dict[str, object]] = {
    "search": {"planner": "search"},
    "segments, all searched": {"planner": "guided", "guide": "segments"},
    "guided, mean": {"planner": "guided", "guide": "mean"},
    "guided, max": {"planner": "guided", "guide": "max"},
    "adapt": {"planner": "adapt", "search_too": False},
    "parallel": {"planner": "parallel"},
}
DOCUMENTED = {  # Lin 2020 table 5.1: of 50, and seconds of the successful ones
    ("two_corridors", "search"): "17, 138 s",
    ("two_corridors", "segments, all searched"): "27, 164 s",
    ("two_corridors", "guided, mean"): "38, 124 s",
    ("two_corridors", "guided, max"): "42, 153 s",
    ("two_staircases", "search"): "23, 171 s",
    ("two_staircases", "segments, all searched"): "35, 140 s",
    ("two_staircases", "guided, mean"): "39, 144 s",
    ("two_staircases", "guided, max"): "38, 139 s",
}
MOST_SEEDS = 50
DEADLINE = 30.0  # [s] of each query; Lin 2020 allowed 500
KEPT = Path("out/segments.jsonl")


def run(options: BenchOptions) -> BenchTable:
    """Every way on every scene; a run that was stopped goes on from out/segments.jsonl."""
    robot = load_robot(options.robot)
    ik = WholeBodyIK(robot)
    load_kernels(robot, ik, "guided", lambda event: None)
    kept = KeptRows(KEPT)
    found: dict[tuple[str, str], list[dict]] = {}
    for seed in range(min(options.seeds, MOST_SEEDS)):
        for name in SCENES:
            for way, asked in WAYS.items():
                key = f"{options.robot} {name} {seed} {way}"
                if key not in kept.rows:
                    kept.add(key, _query(name, seed, robot, ik, asked))
                    row = kept.rows[key]
                    options.tell(f"{name} seed {seed} {way}: {row['status']} {row['total_s']:.1f} s {row['reason']}")
                found.setdefault((name, way), []).append(kept.rows[key])
    rows = []
    for (name, way), results in found.items():
        status = Counter(row["status"] for row in results)
        done = [row for row in results if row["status"] == "complete"]
        parts = [f"{np.mean([row[key] for row in done]):.1f}" if done else "" for key in ("searched", "adapted")]
        rows.append((name, way, len(results), status["complete"], *middle_and_high([row["total_s"] for row in done]),
                     middle_and_high([row["time_to_first_s"] for row in done])[0],
                     middle_and_high([row["guide_s"] for row in results if row["guide_s"] is not None])[0],
                     " / ".join(parts) if "guide" in WAYS[way] else "",
                     middle_and_high([row["stances"] for row in done])[0], DOCUMENTED.get((name, way), "")))  # fmt: skip
    columns = ("scene", "way", "queries", "verified", "median s", "p95 s", "first contacts s", "guiding path s",
               "searched / adapted", "stances", "Lin 2020")  # fmt: skip
    notes = (
        f"--deadline {DEADLINE:g} for the whole query; seconds and stances of the verified ones; searched / adapted: parts.",
        "Guiding path: traversability, path and segments. Lin 2020 table 5.1: other draws, 500 s, contacts alone; guiding path 25 s.",
    )
    title = "Rooms joined by corridors and staircases"
    return BenchTable("segments", title, columns, tuple(rows), notes, most_seeds=MOST_SEEDS)


def _query(name: str, seed: int, robot: Robot, ik: WholeBodyIK, asked: dict[str, object]) -> dict:
    scene = load_scene(name, seed=seed)
    guide_s = None
    if "guide" in asked:
        context = QueryContext(scene, robot, ik)
        began = (context.start, context.goal, time.perf_counter())[2]
        GuidedPlanner(context, PlannerOptions(seed=seed), adapt=asked["guide"] != "segments")
        guide_s = time.perf_counter() - began
    result = plan_scene(scene, robot, PlanOptions(seed=seed, deadline=DEADLINE, **asked))  # type: ignore[arg-type]
    guide = result.report["guide"]
    methods = Counter(str(part["method"]) for part in guide) if isinstance(guide, list) else Counter[str]()
    numbers = {key: result.report[key] for key in ("total_s", "stances", "palms_used", "planner", "time_to_first_s")}
    parts = {"searched": methods["search"], "adapted": methods["adapt"]}
    return {"status": result.status, "reason": result.reason, "guide_s": guide_s, **parts, **numbers}
