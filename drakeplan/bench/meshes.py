"""Every mesh of hpp-environments with one start and one goal: status, reason, time and memory of the whole command."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

from drakeplan.bench.mesh_ends import FARTHEST, ends_of
from drakeplan.bench.table import BenchOptions, BenchTable
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.meshes.mesh_path import hpp_meshes
from scenes.robots.robot import load_robot
from scenes.scene import Scene

COLUMNS = ("mesh", "status", "s", "MB", "start", "goal", "reason")
DEADLINE = 30.0  # [s] of each query
LONGEST = 120.0  # [s] after which a process is ended
KEPT = Path("out/meshes.jsonl")  # a line for each mesh that is done: a run that was stopped goes on from there
WORDS = 160  # characters of a reason


def run(options: BenchOptions) -> BenchTable:
    """One query for each mesh, each in a process of its own; remove out/meshes.jsonl to begin anew."""
    KEPT.parent.mkdir(parents=True, exist_ok=True)
    done = {}
    if KEPT.exists():
        done = {row["mesh"]: row for row in map(json.loads, KEPT.read_text(encoding="utf-8").splitlines())}
    for name in mesh_names():
        if name in done:
            continue
        row = done[name] = {"mesh": name, **_query(name, options.robot)}
        with KEPT.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        options.tell(f"{name}: {row['status']} in {row['s']:.1f} s {row['reason']}")
    rows = [tuple(row[column] for column in COLUMNS) for name, row in sorted(done.items())]
    walked = Counter(row["status"] for row in done.values())
    asked = len(rows) - walked["no ground"]
    notes = (
        f"{walked['complete']} of {asked} complete, {walked['contacts']} with contacts only; "
        f"{walked['no ground']} meshes have no ground on which the robot could go anywhere.",
        f"--deadline {DEADLINE:g}; start and goal are two ends of the mesh's largest group of places to stand, at most "
        f"{FARTHEST:g} m apart (drakeplan/bench/mesh_ends.py); wall time and memory of the whole process.",
    )
    return BenchTable("meshes", "Meshes of hpp-environments", COLUMNS, tuple(rows), notes, most_seeds=0)


def mesh_names() -> list[str]:
    """Names after `hpp/` of all meshes, each once."""
    seen: dict[str, str] = {}
    for name, reference in hpp_meshes().items():
        seen.setdefault(reference, name)
    return sorted(seen.values())


def _query(name: str, robot: str) -> dict[str, object]:
    """Status, seconds, megabytes, start, goal and reason of one mesh."""
    nothing = {"status": "no ground", "s": 0.0, "MB": float("nan"), "start": "", "goal": ""}
    try:
        scene: Scene = load_scene(f"hpp/{name}")
    except InputError as error:
        return {**nothing, "reason": str(error).partition(": ")[2][:WORDS]}
    ends = ends_of(scene.terrain, load_robot(robot))
    if ends is None:
        return {**nothing, "reason": "no two places for both soles that steps could join"}
    (x, y, yaw, z), (gx, gy, gz) = ends
    command = [sys.executable, "-m", "drakeplan", "plan", f"hpp/{name}", "--robot", robot, "--json"]
    command += ["--start", f"{x:.3f}", f"{y:.3f}", f"{np.degrees(yaw):g}", f"--start-z={z:.3f}"]
    command += ["--goal", f"{gx:.3f}", f"{gy:.3f}", f"--goal-z={gz:.3f}", "--deadline", f"{DEADLINE:g}"]
    places = {"start": f"{x:.2f} {y:.2f} {z:.2f}", "goal": f"{gx:.2f} {gy:.2f} {gz:.2f}"}
    began = time.perf_counter()
    try:
        ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return {"status": "hung", "s": LONGEST, "MB": float("nan"), **places, "reason": "it did not end by itself"}
    spent = time.perf_counter() - began
    report = json.loads(ended.stdout) if ended.stdout.strip() else {}
    last = ended.stderr.rstrip().rpartition("\n")[2]
    return {
        "status": report.get("status", f"exit {ended.returncode}"),
        "s": spent,
        "MB": report.get("peak_rss_mb", float("nan")),
        **places,
        "reason": str(report.get("reason", last))[:WORDS],
    }
