"""The whole command as a user runs it: process start to files written."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable

CASES = {
    "rubble_corridor": (["rubble_corridor"], 12.0, 900.0),
    "hpp/darpa": (["hpp/darpa", "--start", "-3.6", "0", "0", "--goal", "3.9", "0"], 40.0, 1200.0),
}
REPEATS = 3


def run(options: BenchOptions) -> BenchTable:
    """Each case a few times, with plan file and playback page; the least time stands for the machine at its quietest."""
    rows = []
    for name, (words, seconds, megabytes) in CASES.items():
        walls, peaks, stages, verified = [], [], [], 0
        for seed in range(min(REPEATS, options.seeds)):
            with tempfile.TemporaryDirectory() as folder:
                out = [str(Path(folder) / "plan.h5"), str(Path(folder) / "plan.html")]
                command = [
                    sys.executable,
                    "-m",
                    "drakeplan",
                    "plan",
                    *words,
                    "--seed",
                    str(seed),
                    "--robot",
                    options.robot,
                    "--out",
                    out[0],
                    "--html",
                    out[1],
                    "--json",
                ]
                began = time.perf_counter()
                done = subprocess.run(command, capture_output=True, text=True, check=False)
                walls.append(time.perf_counter() - began)
            report = json.loads(done.stdout) if done.stdout.strip() else {}
            peaks.append(float(report.get("peak_rss_mb", np.nan)))
            stages.append(tuple(float(report.get(k) or np.nan) for k in ("planning_s", "dynamics_s", "motion_s")))
            verified += done.returncode == 0
            options.tell(f"{name} seed {seed}: {walls[-1]:.1f} s, {peaks[-1]:.0f} MB, exit {done.returncode}")
        planning, dynamics, motion = np.median(stages, axis=0)
        rows.append(
            (
                name,
                f"{verified} of {len(walls)}",
                float(np.median(walls)),
                min(walls),
                max(walls),
                seconds,
                max(peaks),
                megabytes,
                planning,
                dynamics,
                motion,
            )
        )
    columns = (
        "plan",
        "verified",
        "median s",
        "min",
        "max",
        "target s",
        "peak MB",
        "target MB",
        "search s",
        "dynamics s",
        "motion s",
    )
    notes = ("Seeds 0 and up, one run each, with --out and --html; search includes 1 s of improvement.",)
    return BenchTable(
        "command", "Whole command, process start to files written", columns, tuple(rows), notes, most_seeds=REPEATS
    )
