"""The progress bar of a campaign on standard error."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from tqdm import tqdm

    from drakeplan.campaigns.engine import CampaignProgress


class CampaignBar:
    """A progress bar on standard error; it appears with the first progress, so that a mistake stands on a line alone."""

    def __init__(self, count: int, rows: str) -> None:
        """A bar that is not shown yet.

        Args:
            count: environments in all.
            rows: what the rows are called.
        """
        self._count, self._rows = count, rows
        self._bar: tqdm[NoReturn] | None = None
        self._began_at: int | None = None

    def __call__(self, progress: CampaignProgress) -> None:
        """Shows it."""
        if self._bar is None:
            from tqdm.auto import tqdm

            self._bar = tqdm(total=self._count, unit="env", file=sys.stderr, dynamic_ncols=True, smoothing=0.0)
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
