"""What a long computation says while it runs, and how that is shown on a terminal."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TextIO

QUIET_INTERVAL = 0.25  # [s] lines that bring no better plan come no faster than this


@dataclass(frozen=True)
class ProgressEvent:
    """One thing worth telling.

    Attributes:
        stage: what is going on: "load", "search", "dynamics", "motion", "verify" or "write".
        message: one line for people, may be empty.
        cost: of the best contact sequence so far; None before there is one.
        bound: that cost is at most this many times the optimum; None where nothing is known.
        expansions: nodes the search has expanded.
        elapsed: seconds since planning began.
    """

    stage: str
    message: str = ""
    cost: float | None = None
    bound: float | None = None
    expansions: int | None = None
    elapsed: float | None = None


Progress = Callable[[ProgressEvent], None]


@dataclass
class ProgressPrinter:
    """Writes events as lines; call it with each event.

    A line appears when the stage, the cost or the message changes, otherwise not more often than `QUIET_INTERVAL`. The time it
    shows is that since the printer was made, so that it never runs backwards, whatever the events count from.

    Attributes:
        stream: where to, normally standard error.
    """

    stream: TextIO

    def __post_init__(self) -> None:
        self._last: tuple[str, float | None, str] = ("", None, "")
        self._began = time.monotonic()
        self._last_time = self._began - QUIET_INTERVAL

    def __call__(self, event: ProgressEvent) -> None:
        """Shows the event, unless nothing changed and the last line is very recent."""
        now = time.monotonic()
        news = (event.stage, event.cost, event.message)
        if news == self._last and now - self._last_time < QUIET_INTERVAL:
            return
        self._last, self._last_time = news, now
        print(format_event(event, now - self._began), file=self.stream, flush=True)


def format_event(event: ProgressEvent, elapsed: float) -> str:
    """One line: time [s], stage, cost, bound, expansions, message; what is unknown is left out."""
    parts = [f"[{elapsed:7.2f} s]", f"{event.stage:<8}"]
    if event.cost is not None:
        parts.append(f"cost {event.cost:.3f}")
    if event.bound is not None:
        parts.append(f"bound {event.bound:.3f}")
    if event.expansions is not None:
        parts.append(f"{event.expansions} expansions")
    if event.message:
        parts.append(event.message)
    return "  ".join(parts).rstrip()
