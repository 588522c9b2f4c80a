"""Workers on this machine: one process each, replaced when it dies or hangs, without effect on the others."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from types import TracebackType
from typing import Protocol

import pyarrow as pa
from pebble import ProcessExpired, ProcessPool

from drakeplan.campaigns.campaign import Campaign, Task, limit_memory, run_task
from scenes.input_error import InputError

MEMORY = 6 << 30  # [bytes] of private memory that a worker may hold
CANCELLED = "cancelled"
_THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True, eq=False)
class Outcome:
    """How a task ended.

    Attributes:
        task: which one.
        table: its rows, None where it failed.
        failure: one line, "" where it did not fail.
        cpu_time: processor time of the worker [s].
    """

    task: Task
    table: pa.Table | None
    failure: str = ""
    cpu_time: float = 0.0


class Workers(Protocol):
    """Runs tasks on this machine or on a cluster."""

    num_workers: int

    def submit(self, task: Task) -> None:
        """Puts a task in the queue."""
        ...

    def next_outcome(self, timeout: float) -> Outcome | None:
        """The next task that ended, None where none did within this time [s]."""
        ...

    def close(self) -> None:
        """Ends all workers at once, whatever they are doing."""
        ...


class LocalWorkers:
    """Processes of this machine, one thread each (pebble, spawned).

    A task that kills its process, or takes longer than `task_timeout` or more memory than `memory`, ends as a
    failure; the process is replaced. Workers end when this process does, even by kill -9.
    """

    def __init__(
        self, campaign: Campaign, num_workers: int, *, task_timeout: float = 600.0, memory: int = MEMORY
    ) -> None:
        """Starts the processes.

        Args:
            campaign: whose tasks are run.
            num_workers: number of processes.
            task_timeout: wall time that one task may take [s].
            memory: private memory that one process may hold [bytes].
        """
        if num_workers < 1:
            raise InputError(f"workers: expected 1 or more, got {num_workers}")
        self.campaign, self.num_workers, self.task_timeout = campaign, num_workers, task_timeout
        self._ended: queue.SimpleQueue[Outcome] = queue.SimpleQueue()
        # Libraries read these when they load, and a worker may be started at any time.
        self._environment = {name: os.environ.get(name) for name in _THREAD_LIMITS}
        os.environ.update(dict.fromkeys(_THREAD_LIMITS, "1"))
        self._pool = ProcessPool(
            num_workers, initializer=_begin, initargs=(memory,), context=multiprocessing.get_context("spawn")
        )

    def submit(self, task: Task) -> None:
        """Puts a task in the queue."""
        try:
            with without_ctrl_c():  # the first task starts the pool
                future = self._pool.schedule(timed_task, args=(self.campaign, task), timeout=self.task_timeout)
        except RuntimeError:
            raise _cannot_work() from None
        future.add_done_callback(lambda done: self._ended.put(self._outcome(task, done)))

    def next_outcome(self, timeout: float) -> Outcome | None:
        """The next task that ended, None where none did within this time [s]."""
        try:
            outcome = self._ended.get(timeout=timeout)
        except queue.Empty:
            outcome = None
        if (outcome is None and not self._pool.active) or (outcome is not None and outcome.failure == CANCELLED):
            raise _cannot_work()  # the tasks are not to blame
        return outcome

    def close(self) -> None:
        """Ends all workers at once, whatever they are doing."""
        self._pool.stop()
        self._pool.join()
        for name, value in self._environment.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value

    def __enter__(self) -> LocalWorkers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _outcome(self, task: Task, done: Future[tuple[pa.Table, float]]) -> Outcome:
        if done.cancelled():
            return Outcome(task, None, CANCELLED)
        error = done.exception()
        if error is None:
            table, cpu_time = done.result()
            return Outcome(task, table, "", cpu_time)
        if isinstance(error, FutureTimeoutError):
            return Outcome(task, None, f"no answer within {self.task_timeout:g} s")
        if isinstance(error, ProcessExpired):
            return Outcome(task, None, f"its process died (exit code {error.exitcode})")
        return Outcome(task, None, failure_line(error))


def timed_task(campaign: Campaign, task: Task) -> tuple[pa.Table, float]:
    """The rows of a task and the processor time they took [s]; runs inside a worker.

    Args:
        campaign: the source of rows.
        task: which of its tasks.
    """
    began = time.process_time()
    table = run_task(campaign, task)
    return table, time.process_time() - began


def failure_line(error: BaseException) -> str:
    """An exception in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}".removesuffix(": ")


def _cannot_work() -> InputError:
    return InputError(
        "workers cannot start, or not again: where a script collects, everything in it that runs must stand under "
        "`if __name__ == '__main__':`"
    )


@contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Threads that start here, and the processes that they start, never get Ctrl-C, not even while they import.

    This thread gets it afterwards. Blocking alone does not do that: another thread may receive the signal, and Python
    then raises KeyboardInterrupt here, between the start of a process and what it is told to do.
    """
    resource_tracker.ensure_running()  # the first call lets signals through again
    came: list[int] = []
    in_main = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGINT, lambda number, frame: came.append(number)) if in_main else None
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if in_main:
            signal.signal(signal.SIGINT, handler)
    if came:
        signal.raise_signal(signal.SIGINT)


def _begin(memory: int) -> None:
    """First thing in a worker: leave Ctrl-C to the parent, die with it, and stay within bounds."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    limit_memory(memory)
    pa.set_cpu_count(1)
    threading.Thread(target=_die_with_parent, daemon=True).start()


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
