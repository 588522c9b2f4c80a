"""Robots of other people: added from their models alone, checked, and sent across four scenes."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from drakeplan.bench.kept_rows import KeptRows
from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.robot_setup.model_source import find_model_source
from scenes.input_error import InputError

MODELS = {  # robot -> its model inside a package from PyPI
    "G1": "example-robot-data/g1_29dof_rev_1_0.urdf",
    "G1 with hands": "example-robot-data/g1_29dof_with_hand_rev_1_0.urdf",
    "TALOS": "example-robot-data/talos_reduced.urdf",
    "JVRC-1": "jvrc-description/jvrc1.urdf",
    "iCub 2.5": "example-robot-data/icub_reduced.urdf",
    "iCub Genova11": "icub-models/iCubGenova11/model.urdf",
    "Romeo": "example-robot-data/urdf/romeo.urdf",
    "GR1": "robosuite/robots/gr1/robot.xml",
    "H1": "robosuite-models/robots/h1/robot.xml",
    "Alexander's legs": "example-robot-data/alexander_v1.lowerBodyOnly.urdf",
}
SCENES = ("flat", "stairs", "rubble_field", "rubble_corridor")
DEADLINE = 60.0  # [s] of each query
LONGEST = 400.0  # [s] after which a process is ended
COLUMNS = ("robot", "model", "add s", "check", *(f"{scene} s" for scene in SCENES), "min", "reason")
KEPT = Path("out/robots.jsonl")
WORDS = 110  # characters of a reason


def run(options: BenchOptions) -> BenchTable:
    """Each model through `robots add`, `robots check` and four plans, as a stranger would type them."""
    kept = KeptRows(KEPT)
    missing = []
    for name, model in MODELS.items():
        try:
            find_model_source(model, {})
        except InputError:
            missing.append(f"{name} ({model.partition('/')[0]})")
            continue
        if name not in kept.rows:
            kept.add(name, _walk(model))
            options.tell(f"{name}: {kept.rows[name]}")
    rows = [
        (name, model, *(kept.rows[name][column] for column in COLUMNS[2:]))
        for name, model in MODELS.items()
        if name in kept.rows
    ]
    notes = (
        f"add, check: seconds, and how many questions of `drakeplan robots check` are answered with yes. Scenes: seconds of the "
        f"whole command, --deadline {DEADLINE:g}, seed 0, quasi-static dynamics; a dash where no plan was verified. Robots without "
        "palms cross the corridor with their feet. min: minutes of all of it, process starts included.",
        f"Not installed here: {', '.join(missing)}." if missing else "All models are installed.",
    )
    return BenchTable("robots", "Robots added from their models", COLUMNS, tuple(rows), notes, most_seeds=0)


def _walk(model: str) -> dict[str, object]:
    began, reasons = time.perf_counter(), []
    row: dict[str, object] = dict.fromkeys(COLUMNS[2:], "-")
    with tempfile.TemporaryDirectory(prefix="drakeplan-robots-") as folder:
        added, seconds = _command(["robots", "add", model, "--name", "robot", "--out", folder])
        row["add s"] = round(seconds, 1)
        if "file" not in added:
            return {**row, "min": round(seconds / 60, 1), "reason": str(added.get("reason", ""))[:WORDS]}
        file = str(added["file"])
        checked, _ = _command(["robots", "check", file])
        findings = checked.get("findings", [])
        row["check"] = f"{sum(f['ok'] for f in findings)} of {len(findings)}"
        reasons += [f"{f['name']}: {f['says']}" for f in findings if not f["ok"]]
        for scene in SCENES:
            planned, seconds = _command(["plan", scene, "--robot", file, "--deadline", f"{DEADLINE:g}"])
            if planned.get("status") == "complete":
                row[f"{scene} s"] = round(seconds, 1)
            else:
                reasons.append(f"{scene}: {planned.get('reason', '')}")
    return {**row, "min": round((time.perf_counter() - began) / 60, 1), "reason": "; ".join(reasons)[:WORDS]}


def _command(words: list[str]) -> tuple[dict, float]:
    """What a command says with --json, {} where it says nothing; and its seconds."""
    began = time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "drakeplan", *words, "--json"],
            capture_output=True, text=True, check=False, timeout=LONGEST,
        )  # fmt: skip
        text = done.stdout
    except subprocess.TimeoutExpired:
        text = json.dumps({"reason": "it did not end by itself"})
    try:
        return json.loads(text), time.perf_counter() - began
    except json.JSONDecodeError:
        return {}, time.perf_counter() - began
