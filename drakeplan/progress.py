"""Progress events of a long computation, and how a terminal shows them."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TextIO

QUIET_INTERVAL = 2.0  # [s] between plain lines that bring only a lower cost
CLEAR_TO_END = "\033[K"  # of a terminal's line


@dataclass(frozen=True)
class ProgressEvent:
    """One progress event.

    Attributes:
        stage: what is going on: "load", "search", "dynamics", "motion", "verify", "explain", "simulate", "batch"
            or "write".
        message: one line for people, may be empty.
        cost: of the best contact sequence so far; None before there is one.
        bound: that cost is at most this many times the optimum; None where nothing is known.
        expansions: nodes the search has expanded.
        elapsed: seconds since planning began.
        left: seconds of the deadline that are left; None before its clock runs, inf without a deadline.
    """

    stage: str
    message: str = ""
    cost: float | None = None
    bound: float | None = None
    expansions: int | None = None
    elapsed: float | None = None
    left: float | None = None


Progress = Callable[[ProgressEvent], None]


class ProgressPrinter:
    """Shows events: on a terminal as one line that is written over, elsewhere as plain lines, few of them.

    Plain lines appear when the stage or the message changes; a lower cost alone, not more often than every
    `QUIET_INTERVAL`. The time that a line shows is that since the printer was made, so that it never runs backwards,
    whatever the events count from. Use it as a context manager, or call `close` at the end.
    """

    def __init__(self, stream: TextIO) -> None:
        """Shows nothing yet.

        Args:
            stream: where to, normally standard error.
        """
        self._stream = stream
        self._terminal = stream.isatty()
        self._began = time.monotonic()
        self._last_time = self._began - QUIET_INTERVAL
        self._last_news, self._last_cost = ("", ""), None
        self._open = False  # whether the terminal's line waits to be written over

    def __call__(self, event: ProgressEvent) -> None:
        """Shows the event, or leaves it out where plain lines would be too many."""
        now = time.monotonic()
        line = format_event(event, now - self._began)
        if self._terminal:
            width = shutil.get_terminal_size().columns - 1
            self._stream.write(f"\r{line[:width]}{CLEAR_TO_END}")
            self._stream.flush()
            self._open = True
            return
        news, cost = (event.stage, event.message), event.cost
        if news == self._last_news and (cost == self._last_cost or now - self._last_time < QUIET_INTERVAL):
            return
        self._last_news, self._last_cost, self._last_time = news, cost, now
        print(line, file=self._stream, flush=True)

    def close(self) -> None:
        """Ends the terminal's line, so that what follows stands below it."""
        if self._open:
            print(file=self._stream, flush=True)
            self._open = False

    def __enter__(self) -> ProgressPrinter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def format_event(event: ProgressEvent, elapsed: float) -> str:
    """One line: time [s], stage, cost, bound, expansions, message; what is unknown is left out.

    Args:
        event: to show.
        elapsed: time to show at the start of the line [s].
    """
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
