"""Who is told how far a long computation is: by default the person at the terminal or in the notebook, if there is one."""

from __future__ import annotations

import multiprocessing
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

from drakeplan.progress import Progress, ProgressEvent, ProgressPrinter

Watcher: TypeAlias = Callable[[ProgressEvent], object] | bool | None
COMMANDS = "drakeplan.cli"  # loaded by the command line alone
TICK = 1.0  # [s] after which a terminal's line shows the time that has passed, though nothing else is new


@contextmanager
def watched(progress: Watcher) -> Iterator[Progress]:
    """What events are to be told to, while this lasts.

    Args:
        progress: called with each event; True: lines on standard error; False: nothing; None: lines where a person watches.
    """
    if callable(progress):
        told = progress

        def tell(event: ProgressEvent) -> None:
            told(event)  # what it returns says nothing

        yield tell
    elif progress or (progress is None and someone_watches()):
        with ProgressPrinter(sys.stderr) as printer, _ticking(printer) as shown:
            yield shown
    else:
        yield lambda event: None


def someone_watches() -> bool:
    """Whether standard error is a terminal, or this is a notebook; never in a worker, nor where a command tells its own."""
    if multiprocessing.parent_process() is not None or COMMANDS in sys.modules or sys.stderr is None:
        return False
    return sys.stderr.isatty() or in_notebook()


def in_notebook() -> bool:
    """Whether a Jupyter kernel runs this."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


@contextmanager
def _ticking(printer: ProgressPrinter) -> Iterator[Progress]:
    """The printer; on a terminal its last event again every `TICK`, so that a long step does not look like a halt."""
    if not sys.stderr.isatty():
        yield printer
        return
    lock, over = threading.Lock(), threading.Event()
    last: list[tuple[float, ProgressEvent]] = []

    def tell(event: ProgressEvent) -> None:
        with lock:
            last[:] = [(time.monotonic(), event)]
            printer(event)

    def tick() -> None:
        while not over.wait(TICK):
            with lock:
                if last and time.monotonic() - last[0][0] >= TICK:
                    printer(last[0][1])

    ticker = threading.Thread(target=tick, daemon=True)
    ticker.start()
    try:
        yield tell
    finally:
        over.set()
        ticker.join()
