"""Label campaigns: labels a second on one worker and on two, what the second is worth, and what a stop half way costs."""

from __future__ import annotations

import contextlib
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.campaigns.card import Card
from drakeplan.campaigns.dynamics import DynamicsCampaign
from drakeplan.campaigns.engine import CampaignProgress, CollectOptions, ProgressListener, collect
from drakeplan.campaigns.label_walk import WalkOptions
from drakeplan.campaigns.workers import LocalWorkers

WORKERS = (1, 2)
MAX_TASKS = 40
QUOTA = 8  # labels a category and environment: small tasks, so that workers end together
WARM = 2  # tasks of another seed for each worker before the clock: imports, kernels
AIM = 0.9  # efficiency


@dataclass(frozen=True)
class _Session:
    """One session of a campaign, its workers started and warm before the clock.

    Attributes:
        card: of the data, None where it was stopped.
        tasks: that had ended at its end, those of earlier sessions among them.
        found: tasks that it found done.
        stock_s: wall time until it knew that [s].
        wall: wall time [s].
        workers_cpu, engine_cpu: processor time of the tasks and of this process [s].
        start_s: wall time until the first worker was at its first task [s].
    """

    card: Card | None
    tasks: int
    found: int
    stock_s: float
    wall: float
    workers_cpu: float
    engine_cpu: float
    start_s: float


class _StopError(Exception):
    """The campaign is stopped here."""


def run(options: BenchOptions) -> BenchTable:
    """The same environments on one worker, on two, and on two with a stop half way; `--seeds` of them, 40 at most."""
    tasks = min(options.seeds, MAX_TASKS)
    campaign = DynamicsCampaign(robot=options.robot, walk=WalkOptions(quota=QUOTA))
    sessions: dict[str, list[_Session]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for count in WORKERS:
            options.tell(f"{tasks} environments on {count} worker{'s' if count > 1 else ''}")
            sessions[str(count)] = [_session(campaign, Path(folder) / str(count), tasks, count)]
        options.tell(f"{tasks} environments on {WORKERS[-1]} workers, stopped half way and resumed")
        parts = Path(folder) / "parts"
        sessions[f"{WORKERS[-1]}, stopped and resumed"] = [
            _session(campaign, parts, tasks, WORKERS[-1], stop_at=max(tasks // 2, 1)),
            _session(campaign, parts, tasks, WORKERS[-1], resume=True),
        ]
    return _table(tasks, sessions)


def _session(
    campaign: DynamicsCampaign,
    folder: Path,
    tasks: int,
    count: int,
    *,
    stop_at: int | None = None,
    resume: bool = False,
) -> _Session:
    told: list[tuple[float, CampaignProgress]] = []

    def listen(progress: CampaignProgress) -> None:
        told.append((time.perf_counter(), progress))
        if stop_at is not None and progress.tasks >= stop_at:
            raise _StopError

    with tempfile.TemporaryDirectory() as warm, LocalWorkers(campaign, count) as workers:
        start_s = _warm(campaign, Path(warm) / "warm", count, workers)
        began, cpu = time.perf_counter(), time.process_time()
        card = None
        with contextlib.suppress(_StopError):
            card = collect(campaign, folder, CollectOptions(tasks), workers, resume=resume, listener=listen)
        wall, cpu = time.perf_counter() - began, time.process_time() - cpu
    (known_at, first), (_, last) = told[0], told[-1]
    return _Session(card, last.tasks, first.tasks, known_at - began, wall, last.cpu_time, cpu, start_s)


def _warm(campaign: DynamicsCampaign, folder: Path, count: int, workers: LocalWorkers) -> float:
    """Wakes the workers up; wall time until one of them began its first task [s]."""
    began = time.perf_counter()
    starts: list[float] = []

    def listen(progress: CampaignProgress) -> None:
        if progress.tasks == 1:
            starts.append(time.perf_counter() - began - progress.cpu_time)

    listener: ProgressListener = listen
    collect(campaign, folder, CollectOptions(WARM * count, seed=1), workers, listener=listener)
    return starts[0] if starts else float("nan")


def _table(tasks: int, sessions: dict[str, list[_Session]]) -> BenchTable:
    (one,), (two,), (stopped, resumed) = sessions.values()
    assert one.card is not None
    labels, alone = one.card.rows, one.card.rows / one.wall
    rows = []
    for (name, parts), count in zip(sessions.items(), (*WORKERS, WORKERS[-1]), strict=True):
        wall, workers_cpu, engine_cpu = (
            sum(getattr(p, key) for p in parts) for key in ("wall", "workers_cpu", "engine_cpu")
        )
        card = parts[-1].card
        rows.append(
            (
                name,
                tasks,
                labels,
                wall,
                labels / wall,
                workers_cpu,
                labels / workers_cpu,
                f"{100 * engine_cpu / workers_cpu:.1f} %",
                labels / wall / alone / count,
                workers_cpu / wall / count,
                max(p.start_s for p in parts),
                "same" if card is not None and card.sha256 == one.card.sha256 else "DIFFERS",
            )
        )
    columns = (
        "workers",
        "environments",
        "labels",
        "wall s",
        "labels/s",
        "workers' CPU s",
        "labels per CPU s",
        "engine CPU",
        "efficiency",
        "workers busy",
        "start-up s",
        "data",
    )
    again = stopped.tasks - resumed.found
    overhead = (stopped.wall + resumed.wall) / two.wall - 1.0
    notes = (
        f"efficiency (aim {AIM:g}): labels/s over that of one worker, per worker. It is the product of labels per CPU s over one "
        "worker's (cores that share caches and memory) and of workers busy (processor time of tasks over wall time, per worker: "
        "waiting at the end, a machine that does something else), over one worker's.",
        "engine CPU: of handing out, collecting and writing, over the workers'. start-up: processes and imports, before the clock.",
        f"stopped and resumed: {again} of {tasks} environments ended in shards that were not whole and were done again, and what "
        f"was in the workers' hands; taking stock {resumed.stock_s:.3f} s; in all {100 * overhead:.0f} % more wall time. "
        "A stop loses at most the open shards, however long the campaign.",
        "data: whether the files are those of one worker, bit for bit.",
    )
    return BenchTable("campaign", "Label campaigns on one machine", columns, tuple(rows), notes, most_seeds=MAX_TASKS)
