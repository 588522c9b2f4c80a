"""When a query has to stop: its time is over, or the user asked it to."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from numba.core import event


class CompileClock(event.Listener):
    """Seconds that this process has spent compiling kernels; loading compiled ones does not count.

    Attributes:
        tell: called with True when it starts to compile and with False when it ends; None for nobody.
    """

    def __init__(self) -> None:
        self._total, self._depth, self._began = 0.0, 0, 0.0
        self.tell: Callable[[bool], None] | None = None

    def seconds(self) -> float:
        """So far, what is being compiled now included."""
        running = time.perf_counter() - self._began if self._depth else 0.0
        return self._total + running

    def on_start(self, event: event.Event) -> None:
        """A kernel starts to compile, perhaps because another one calls it."""
        if self._depth == 0:
            self._began = time.perf_counter()
            if self.tell is not None:
                self.tell(True)
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """It is compiled."""
        self._depth -= 1
        if self._depth == 0:
            self._total += time.perf_counter() - self._began
            if self.tell is not None:
                self.tell(False)


compile_clock = CompileClock()
event.register("numba:compile", compile_clock)


class OutOfTimeError(Exception):
    """The query has to stop; the message says why."""


@dataclass
class Deadline:
    """The time of one query, from `start` on; kernels that compile in between do not count.

    Attributes:
        seconds: allowed altogether; None for as long as it takes.
        stop: asked now and then; True ends the query.
        used: seconds of these that were used before the clock started.
        whole: the deadline that this one is a part of; None for a whole one.
    """

    seconds: float | None = None
    stop: Callable[[], bool] | None = None
    used: float = 0.0
    whole: Deadline | None = None
    _began: float | None = None
    _compiled: float = 0.0

    def start(self) -> None:
        """Starts the clock."""
        self._began, self._compiled = time.perf_counter(), compile_clock.seconds()

    def part(self, share: float) -> Deadline:
        """A deadline after this share of what is left; it is stopped as this one is.

        Args:
            share: between 0 and 1.
        """
        if self.seconds is None:
            return self
        return replace(self, seconds=self.seconds - (1.0 - share) * self.left(), whole=self.whole or self)

    def left(self) -> float:
        """Seconds that remain, 0 when the time is over; inf without a limit."""
        if self.seconds is None:
            return float("inf")
        gone = 0.0
        if self._began is not None:
            gone = time.perf_counter() - self._began - (compile_clock.seconds() - self._compiled)
        return max(self.seconds - self.used - gone, 0.0)

    def why(self) -> str:
        """Why the query has to stop, "" while it has not to: "deadline" or "cancelled"."""
        if self.stop is not None and self.stop():
            return "cancelled"
        return "deadline" if self.left() <= 0.0 else ""

    def check(self, doing: str) -> None:
        """Does nothing while there is time.

        Args:
            doing: what goes on, for the message.

        Raises:
            OutOfTimeError: the query has to stop.
        """
        why = self.why()
        if why:
            raise OutOfTimeError(self.message(doing))

    def message(self, doing: str) -> str:
        """One line that says why it ended, and where.

        Args:
            doing: what went on, "during the motion" for example.
        """
        if self.why() == "cancelled":
            return f"stopped {doing}"
        return f"the deadline of {(self.whole or self).seconds:g} s ended {doing}"
