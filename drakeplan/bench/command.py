"""The whole command as a user runs it: process start to files written."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable

CASES = {
    "rubble_corridor": (["rubble_corridor"], 12.0, 900.0),
    "hpp/darpa": (["hpp/darpa", "--start", "-3.6", "0", "0", "--goal", "3.9", "0"], 40.0, 1200.0),
}
REPEATS = 3


COLUMNS = [
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
]


@dataclass(frozen=True)
class Measured:
    """One run of the command.

    Attributes:
        wall: seconds from the start of the process to its end.
        peak: memory [MB].
        stages: seconds of search, dynamics and motion; NaN where there was none.
        status: exit status.
    """

    wall: float
    peak: float
    stages: tuple[float, ...]
    status: int


def run(options: BenchOptions) -> BenchTable:
    """Each case a few times, with plan file and playback page; the least time stands for the machine at its quietest."""
    rows = []
    for name, (words, seconds, megabytes) in CASES.items():
        runs = []
        for seed in range(min(REPEATS, options.seeds)):
            runs.append(measure([*words, "--seed", str(seed), "--robot", options.robot]))
            options.tell(f"{name} seed {seed}: {runs[-1].wall:.1f} s, {runs[-1].peak:.0f} MB, exit {runs[-1].status}")
        walls = [r.wall for r in runs]
        verified = f"{sum(r.status == 0 for r in runs)} of {len(runs)}"
        times = (float(np.median(walls)), min(walls), max(walls), seconds)
        rows.append((name, verified, *times, max(r.peak for r in runs), megabytes, *stages(runs)))
    title = "Whole command, process start to files written"
    notes = ("Seeds 0 and up, one run each, with --out and --html; search includes 1 s of improvement.",)
    return BenchTable("command", title, tuple(COLUMNS), tuple(rows), notes, most_seeds=REPEATS)


def measure(words: list[str]) -> Measured:
    """Runs `drakeplan plan` with these words, in a process of its own that writes plan and page."""
    with tempfile.TemporaryDirectory() as folder:
        files = ["--out", str(Path(folder) / "plan.h5"), "--html", str(Path(folder) / "plan.html")]
        command = [sys.executable, "-m", "drakeplan", "plan", *words, *files, "--json"]
        began = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        wall = time.perf_counter() - began
    report = json.loads(done.stdout) if done.stdout.strip() else {}
    spent = tuple(float(report.get(k) or np.nan) for k in ("planning_s", "dynamics_s", "motion_s"))
    return Measured(wall, float(report.get("peak_rss_mb", np.nan)), spent, done.returncode)


def stages(runs: list[Measured]) -> list[float]:
    """Medians of the seconds of search, dynamics and motion."""
    return np.median([r.stages for r in runs], axis=0).tolist()
