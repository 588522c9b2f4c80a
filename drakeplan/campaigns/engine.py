"""Runs a campaign: hands out tasks, keeps whole shards, takes up exactly where it was stopped. It knows no dynamics.

The rows of a task depend on the campaign, the seed and the task's place alone, and a shard is written in one step when
its last task has ended. A campaign that was killed and resumed, or run on other workers, has the same files, bit for bit.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from drakeplan.campaigns.campaign import Campaign, Task, identity
from drakeplan.campaigns.card import Card, make_card, session_facts
from drakeplan.campaigns.label_folder import LabelFolder
from drakeplan.campaigns.workers import Outcome, Workers
from learning.shard_file import Quarantined, ShardHeader
from scenes.input_error import InputError

HOPELESS = 8  # tasks that must have failed, with none that succeeded, for the campaign to be given up
TICK = 1.0  # [s] between signs of life while no task ends


@dataclass(frozen=True)
class CollectOptions:
    """What to collect.

    Attributes:
        tasks: how many tasks the campaign has in all; more can be asked for when it is resumed.
        seed: of all random numbers.
        tasks_per_shard: tasks in one file; at most this many per worker are lost when everything is killed.
    """

    tasks: int
    seed: int = 0
    tasks_per_shard: int = 8

    def __post_init__(self) -> None:
        for name, least in (("tasks", 1), ("seed", 0), ("tasks_per_shard", 1)):
            if getattr(self, name) < least:
                raise InputError(f"{name}: expected {least} or more, got {getattr(self, name)}")

    @property
    def num_shards(self) -> int:
        """Shards in all, the last one perhaps not full."""
        return -(-self.tasks // self.tasks_per_shard)

    def tasks_of(self, shard: int) -> int:
        """How many tasks this shard holds."""
        return min(self.tasks_per_shard, self.tasks - shard * self.tasks_per_shard)


@dataclass(frozen=True)
class CampaignProgress:
    """Progress of a campaign.

    Attributes:
        tasks: ended, those of earlier sessions among them.
        all_tasks: that it has.
        rows: collected so far.
        failed: tasks in quarantine.
        rate: rows a second in this session.
        remaining: estimated time to the end [s], None before there is an estimate.
        cpu_time: processor time that tasks took in this session [s].
        message: something worth telling, may be empty.
    """

    tasks: int
    all_tasks: int
    rows: int
    failed: int
    rate: float
    remaining: float | None
    cpu_time: float
    message: str = ""


ProgressListener = Callable[[CampaignProgress], None]


def collect(
    campaign: Campaign,
    folder: str | Path,
    options: CollectOptions,
    workers: Workers,
    *,
    resume: bool = False,
    listener: ProgressListener | None = None,
) -> Card:
    """Collects all rows of a campaign into a folder of shards, and describes them on a card.

    Args:
        campaign: what to collect.
        folder: where to.
        options: how much of it.
        workers: who does the work; they stay open.
        resume: whether to go on with what the folder holds.
        listener: told after every task, and once a second.

    Raises:
        InputError: the folder holds another campaign or more tasks than asked for, cannot be written (a full disk), or
            no task succeeds. Whole shards stay.
    """
    shards = LabelFolder(Path(folder), identity(campaign, options.seed, options.tasks_per_shard), resume=resume)
    with shards.locked():
        run = _Run(campaign, shards, options, listener)
        run.note_code()
        run.work(workers)
        return make_card(campaign, shards, options.tasks)


class _Run:
    """One session of a campaign."""

    def __init__(
        self, campaign: Campaign, folder: LabelFolder, options: CollectOptions, listener: ProgressListener | None
    ) -> None:
        self.campaign, self.folder, self.options, self.listener = campaign, folder, options, listener
        self.done = self.rows = self.failed = 0
        self.began, self.new_tasks, self.new_rows, self.cpu_time = time.monotonic(), 0, 0, 0.0
        self.open: dict[int, dict[int, Outcome]] = {}
        self.missing = self._take_stock()

    def note_code(self) -> None:
        """Adds the code that is running to those that made the data; says so where it is another than before."""
        code, before = session_facts(), self.folder.sessions()
        if before and before[-1] != code:
            self._tell("the code has changed since the last session: its card will name both")
        if not before or before[-1] != code:
            self.folder.add_session(code)

    def work(self, workers: Workers) -> None:
        """Runs every task that is missing, a few ahead of the workers."""
        self.began = time.monotonic()
        todo = (self._task(shard, index) for shard in self.missing for index in range(self.options.tasks_of(shard)))
        in_flight = 0
        exhausted = False
        self._tell()
        while True:
            while not exhausted and in_flight < 2 * workers.num_workers:
                task = next(todo, None)
                exhausted = task is None
                if task is not None:
                    workers.submit(task)
                    in_flight += 1
            if not in_flight:
                return
            outcome = workers.next_outcome(TICK)
            if outcome is not None:
                in_flight -= 1
                self._keep(outcome)
            self._tell()

    def _take_stock(self) -> list[int]:
        """Counts what is there already and returns the shards that are not."""
        options, wanted = self.options, range(self.options.num_shards)
        whole = self.folder.whole_shards(self._tell)
        for shard, (header, rows) in whole.items():
            if shard not in wanted or header.tasks > options.tasks_of(shard):
                raise InputError(f"{self.folder.path}: holds more than {options.tasks} tasks already: ask for more")
            if header.tasks == options.tasks_of(shard):
                self.done += header.tasks
                self.rows += rows
                self.failed += len(header.quarantined)
        return [s for s in wanted if s not in whole or whole[s][0].tasks < options.tasks_of(s)]

    def _task(self, shard: int, index: int) -> Task:
        return Task(shard, index, shard * self.options.tasks_per_shard + index, self.options.seed)

    def _keep(self, outcome: Outcome) -> None:
        """Takes an outcome in, and writes its shard when it was the last."""
        task, table = outcome.task, outcome.table
        self.done += 1
        self.new_tasks += 1
        self.cpu_time += outcome.cpu_time
        if table is None:
            self.failed += 1
            if self.failed == self.done >= min(HOPELESS, self.options.tasks):
                raise InputError(f"campaign {self.campaign.name}: no task succeeds; the last: {outcome.failure}")
            self._tell(f"task {task.number} failed: {outcome.failure}")
        else:
            self.rows += table.num_rows
            self.new_rows += table.num_rows
        ended = self.open.setdefault(task.shard, {})
        ended[task.index] = outcome
        if len(ended) == self.options.tasks_of(task.shard):
            self._write(task.shard, self.open.pop(task.shard))

    def _write(self, shard: int, ended: dict[int, Outcome]) -> None:
        in_order = [ended[index] for index in sorted(ended)]
        tables = [outcome.table for outcome in in_order if outcome.table is not None]
        table = pa.concat_tables([self.campaign.schema.empty_table(), *tables]).combine_chunks()
        failed = tuple(Quarantined(o.task.index, o.failure) for o in in_order if o.table is None)
        header = ShardHeader(self.folder.identity.fingerprint, shard, len(in_order), failed)
        try:
            self.folder.write(shard, table, header)
        except InputError as error:
            raise InputError(f"{error}; every shard before it is whole, --resume goes on from there") from None

    def _tell(self, message: str = "") -> None:
        if self.listener is None:
            return
        elapsed = time.monotonic() - self.began
        left = self.options.tasks - self.done
        remaining = elapsed / self.new_tasks * left if self.new_tasks else None
        rate = self.new_rows / elapsed if elapsed > 0 else 0.0
        self.listener(
            CampaignProgress(
                self.done, self.options.tasks, self.rows, self.failed, rate, remaining, self.cpu_time, message
            )
        )
