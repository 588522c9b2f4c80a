"""Label campaigns: labels a second on one worker and on two, and how much of the second one's time is worth anything."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.campaigns.dynamics import DynamicsCampaign
from drakeplan.campaigns.engine import CampaignProgress, CollectOptions, collect
from drakeplan.campaigns.label_walk import WalkOptions
from drakeplan.campaigns.workers import LocalWorkers

WORKERS = (1, 2)
MAX_TASKS = 24
QUOTA = 8  # labels a category and environment: small tasks, so that workers end together


@dataclass(frozen=True)
class _Measured:
    """One campaign: labels, wall time [s], processor time of the workers and of the engine [s], hash of the data."""

    labels: int
    wall: float
    workers_cpu: float
    engine_cpu: float
    sha256: str


def run(options: BenchOptions) -> BenchTable:
    """The same environments on one worker and on two; `--seeds` is the number of environments, 24 at most."""
    tasks = min(options.seeds, MAX_TASKS)
    campaign = DynamicsCampaign(robot=options.robot, walk=WalkOptions(quota=QUOTA))
    measured = {}
    for count in WORKERS:
        options.tell(f"{tasks} environments on {count} worker{'s' if count > 1 else ''}")
        measured[count] = _measure(campaign, tasks, count)
    one = measured[1]
    rows = []
    for count, m in measured.items():
        speed_up = (m.labels / m.wall) / (one.labels / one.wall)
        rows.append(
            (count, tasks, m.labels, m.wall, m.labels / m.wall, m.labels / m.workers_cpu,
             f"{100 * m.engine_cpu / m.workers_cpu:.1f} %", speed_up / count, "same" if m.sha256 == one.sha256 else "DIFFERS")
        )  # fmt: skip
    columns = (
        "workers", "environments", "labels", "wall s", "labels/s", "labels per CPU s", "engine CPU", "efficiency", "data"
    )  # fmt: skip
    notes = (
        "efficiency: labels/s over that of one worker, per worker; wall times, so it means something on an idle machine only.",
        "labels per CPU s: of the workers; it falls where cores share caches and memory. engine CPU: of handing out, "
        "collecting and writing, over the workers'.",
        "workers are started before the clock; data: whether the files are those of one worker, bit for bit.",
    )
    return BenchTable("campaign", "Label campaigns on one machine", columns, tuple(rows), notes)


def _measure(campaign: DynamicsCampaign, tasks: int, count: int) -> _Measured:
    told: list[CampaignProgress] = []
    with tempfile.TemporaryDirectory() as folder, LocalWorkers(campaign, count) as workers:
        # Another seed wakes the workers up: imports and compiled kernels.
        collect(campaign, Path(folder) / "warm", CollectOptions(2 * count, seed=1), workers)
        began, cpu = time.perf_counter(), time.process_time()
        card = collect(campaign, Path(folder) / "timed", CollectOptions(tasks), workers, listener=told.append)
        wall, cpu = time.perf_counter() - began, time.process_time() - cpu
    last = told[-1]
    return _Measured(card.rows, wall, last.cpu_time, cpu, card.sha256)
