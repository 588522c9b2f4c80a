"""A campaign run from the command line: workers, a progress bar on standard error, and what is said when it is stopped."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from tqdm import tqdm

    from drakeplan.campaigns.campaign import Campaign
    from drakeplan.campaigns.card import Card
    from drakeplan.campaigns.engine import CampaignProgress, CollectOptions
    from drakeplan.campaigns.workers import Workers


@dataclass(frozen=True)
class Crew:
    """Who does the work.

    Attributes:
        workers: processes on this machine.
        cluster: address of a dask scheduler whose workers are used instead; None for none.
        task_timeout: time limit of one environment [s].
    """

    workers: int
    cluster: str | None
    task_timeout: float

    def start(self, campaign: Campaign) -> Workers:
        """The workers, started."""
        if self.cluster is not None:
            from drakeplan.campaigns.cluster import ClusterWorkers

            return ClusterWorkers(campaign, self.cluster, task_timeout=self.task_timeout)
        from drakeplan.campaigns.workers import LocalWorkers

        return LocalWorkers(campaign, self.workers, task_timeout=self.task_timeout)


def collect_aloud(
    campaign: Campaign,
    folder: str,
    options: CollectOptions,
    crew: Crew,
    *,
    rows: str,
    resume: bool,
    unit: str = "env",
    again: str = "--resume",
) -> Card:
    """Collects a campaign with a progress bar; its card.

    Args:
        campaign: what to collect.
        folder: where to.
        options: how much of it.
        crew: who does the work.
        rows: what its rows are called.
        resume: whether to go on with what the folder holds.
        unit: what the tasks are called.
        again: what a user gives to go on after stopping it.
    """
    from drakeplan.campaigns.engine import collect

    bar = CampaignBar(options.tasks, rows, unit)
    try:
        workers = crew.start(campaign)
        try:
            return collect(campaign, folder, options, workers, resume=resume, listener=bar)
        finally:
            workers.close()
    except KeyboardInterrupt:
        bar.close()
        print(f"stopped; {again} goes on from the whole shards in {folder}", file=sys.stderr)
        raise
    finally:
        bar.close()


class CampaignBar:
    """A progress bar on standard error; it appears with the first progress, so that a mistake stands on a line alone."""

    def __init__(self, count: int, rows: str, unit: str = "env") -> None:
        """A bar that is not shown yet.

        Args:
            count: environments in all.
            rows: what the rows are called.
            unit: what the tasks are called.
        """
        self._count, self._rows, self._unit = count, rows, unit
        self._bar: tqdm[NoReturn] | None = None
        self._began_at: int | None = None

    def __call__(self, progress: CampaignProgress) -> None:
        """Shows it."""
        if self._bar is None:
            from tqdm.auto import tqdm

            self._bar = tqdm(total=self._count, unit=self._unit, file=sys.stderr, dynamic_ncols=True, smoothing=0.0)
        if progress.message:
            self._bar.write(progress.message, file=sys.stderr)
        if self._began_at is None:  # what earlier sessions did says nothing about the rate
            self._began_at = self._bar.initial = self._bar.n = progress.tasks
        self._bar.set_postfix_str(
            f"{progress.rows} {self._rows}, {progress.rate:.2g}/s, {progress.failed} failed", refresh=False
        )
        self._bar.update(progress.tasks - self._bar.n)

    def close(self) -> None:
        """Leaves it on its line."""
        if self._bar is not None:
            self._bar.close()
