"""Workers of a dask.distributed cluster: the same tasks, the same rows, on many machines (extra `cluster`)."""

from __future__ import annotations

import faulthandler
import queue
import time
from collections import deque
from types import TracebackType
from typing import TYPE_CHECKING

from drakeplan.campaigns.campaign import Campaign, Task
from drakeplan.campaigns.workers import Outcome, failure_line, timed_task
from scenes.input_error import InputError

if TYPE_CHECKING:
    import pyarrow as pa
    from distributed import Client, Future

CONNECT_TIMEOUT = 10.0  # [s]
PATIENCE = 120.0  # [s] for which a cluster may be without workers, while they are being replaced
ROWS_LOST = ("lost", "pending")  # states of a task that had ended, and whose worker died before its rows were fetched


class ClusterWorkers:
    """Workers that a dask scheduler has, each with one thread and started with a nanny, which replaces those that die.

    The tasks of a worker that dies are run again elsewhere. When workers keep dying, dask marks every task that they
    had as failed; each of these is then run alone, and one that dies alone is a failure. A task that hangs ends its
    worker after `task_timeout`.

    Raises:
        InputError: dask is not installed, no scheduler responds at the address, or workers have more than one thread.
    """

    def __init__(self, campaign: Campaign, address: str, *, task_timeout: float = 600.0) -> None:
        """Connects to the scheduler.

        Args:
            campaign: whose tasks are run; the workers need drakeplan in the same version.
            address: of the scheduler, as `tcp://host:8786`.
            task_timeout: wall time that one task may take [s].
        """
        self.campaign, self.task_timeout = campaign, task_timeout
        self._client = _connect(address)
        threads = [worker["nthreads"] for worker in self._client.scheduler_info(n_workers=-1)["workers"].values()]
        if not threads or max(threads) > 1:
            self._client.close()
            found = "no workers" if not threads else f"workers with {max(threads)} threads"
            raise InputError(f"cluster {address}: expected workers with one thread (--nthreads 1), it has {found}")
        self.num_workers = len(threads)
        self._ended: queue.SimpleQueue[tuple[Task, Future]] = queue.SimpleQueue()
        self._futures: dict[Task, Future] = {}
        self._suspects: deque[Task] = deque()
        self._alone: Task | None = None
        self._address, self._last_seen = address, time.monotonic()

    def submit(self, task: Task) -> None:
        """Puts a task in the queue."""
        future = self._client.submit(guarded_task, self.campaign, task, self.task_timeout, pure=False)
        self._futures[task] = future
        future.add_done_callback(lambda done: self._ended.put((task, done)))

    def next_outcome(self, timeout: float) -> Outcome | None:
        """The next task that ended, None where none did within this time [s]."""
        if self._suspects and not self._futures:
            self._alone = self._suspects.popleft()
            self.submit(self._alone)
        try:
            task, done = self._ended.get(timeout=timeout)
        except queue.Empty:
            self._check_workers()
            return None
        status = done.status
        if status in ROWS_LOST:
            self.submit(task)
            return None
        del self._futures[task]
        alone, self._alone = task == self._alone, None
        return self._outcome(task, done, status, alone)

    def close(self) -> None:
        """Cancels what is under way; the cluster stays."""
        self._client.cancel(list(self._futures.values()), force=True)
        self._client.close()

    def __enter__(self) -> ClusterWorkers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _check_workers(self) -> None:
        """Gives up once the cluster has had no workers for `PATIENCE`."""
        now = time.monotonic()
        if self._client.nthreads():
            self._last_seen = now
        elif now - self._last_seen > PATIENCE:
            raise InputError(f"cluster {self._address}: it has had no workers for {PATIENCE:g} s; --resume goes on")

    def _outcome(self, task: Task, done: Future, status: str | None, alone: bool) -> Outcome | None:
        from distributed.scheduler import KilledWorker

        if status == "finished":
            table, cpu_time = done.result()
            return Outcome(task, table, "", cpu_time)
        if status != "error":
            raise InputError(f"cluster {self._address}: the connection was lost (a task is {status}); --resume goes on")
        error = done.exception()
        if not isinstance(error, KilledWorker):
            return Outcome(task, None, failure_line(error))  # type: ignore[arg-type]
        if not alone:
            self._suspects.append(task)
            return None
        return Outcome(task, None, f"it ended every worker that ran it, or took more than {self.task_timeout:g} s")


def guarded_task(campaign: Campaign, task: Task, timeout: float) -> tuple[pa.Table, float]:
    """As `timed_task`, but ends the process when the task takes too long, even inside compiled code.

    Args:
        campaign: the source of rows.
        task: which of its tasks.
        timeout: wall time that the task may take [s].
    """
    faulthandler.dump_traceback_later(timeout, exit=True)
    try:
        return timed_task(campaign, task)
    finally:
        faulthandler.cancel_dump_traceback_later()


def _connect(address: str) -> Client:
    try:
        from distributed import Client
    except ImportError:
        raise InputError("a cluster needs dask.distributed: pip install 'drakeplan[cluster]'") from None
    try:
        return Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"cluster {address}: no dask scheduler answers there ({type(error).__name__})") from None
