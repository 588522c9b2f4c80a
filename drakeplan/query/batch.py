"""Many queries at once, one process each; what happens to one says nothing about the others."""

from __future__ import annotations

import dataclasses
import gc
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import contextmanager
from multiprocessing.connection import wait as wait_for
from typing import NamedTuple, TypeVar

from pebble import ProcessExpired, ProcessPool

from drakeplan.campaigns.workers import failure_line, without_ctrl_c
from drakeplan.progress import Progress, ProgressEvent
from drakeplan.query.inputs import AnyRobot, AnyScene, as_robot, as_scene
from drakeplan.query.one_planner import load_kernels
from drakeplan.query.options import PlanOptions, check_options
from drakeplan.query.planning import plan_scene
from drakeplan.query.record import QueryRecord
from drakeplan.query.result import PlanResult
from drakeplan.query.watching import Watcher, someone_watches
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.scene import Scene

LATE = 60.0  # [s] after its deadline, loading and kernels included, at which a query that does not answer is ended
LOOK = 0.1  # [s] between looks at whether the user wants to stop
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
AT_THE_TOP = (
    "plan_many: workers cannot start: in a script, what runs must stand under `if __name__ == '__main__':`, because each "
    "worker reads the script again"
)

Answer = TypeVar("Answer")


class _Query(NamedTuple):
    """One of many queries."""

    scene: Scene
    robot: Robot
    options: PlanOptions


def plan_many(
    scenes: Sequence[AnyScene],
    robot: AnyRobot | None = None,
    options: PlanOptions | Sequence[PlanOptions] | None = None,
    workers: int = 2,
    progress: Watcher = None,
) -> list[PlanResult]:
    """Plans many crossings at once, each in a process of its own.

    The results do not depend on the number of workers where `PlanOptions.expansions` bounds the searches; with times alone
    they depend on how busy the machine is, as those of `plan_scene` do. A query that fails, kills its process or does not
    end has a result of status "none" with the reason; the others go on. Ctrl-C ends all of them at once.

    In a script, call it under `if __name__ == "__main__":`.

    Args:
        scenes: one for each query; see `plan_scene`.
        robot: who crosses all of them; None: each scene's own, else escher.
        options: of all queries, or one for each of the scenes (of other seeds, for example). `stop` of the first one ends all;
            `keep` is without effect.
        workers: processes.
        progress: called with a `ProgressEvent` of stage "batch" whenever a query ends; True: a bar on standard error; False:
            silence; None: a bar where standard error is a terminal, or in a notebook.

    Returns:
        One result for each scene, in their order; without `refusal`, which cannot leave its process.

    Raises:
        InputError: no such scene or robot, bad options, or workers that cannot start.
    """
    queries = _queries(scenes, robot, options)
    if workers < 1:
        raise InputError(f"plan_many: workers: expected 1 or more, got {workers}")
    if not queries:
        return []
    with _told(progress, len(queries)) as tell:
        for who, planner in {
            (q.robot.model_sha256, q.options.planner): (q.robot, q.options.planner) for q in queries
        }.values():
            load_kernels(who, WholeBodyIK(who), planner, tell)  # compiled once, not by each worker
        first = options[0] if isinstance(options, Sequence) else options
        stop = None if first is None else first.stop
        return _run(queries, min(workers, len(queries)), stop or (lambda: False), tell)


def _queries(
    scenes: Sequence[AnyScene], robot: AnyRobot | None, options: PlanOptions | Sequence[PlanOptions] | None
) -> list[_Query]:
    """The queries with their scenes read, so that what is wrong is said before anything starts."""
    if isinstance(scenes, str | os.PathLike | Scene):
        raise InputError("plan_many: scenes: expected a list of scenes, got one: use plan_scene, or a list")
    wanted = list(scenes)
    every = [options or PlanOptions()] * len(wanted) if not isinstance(options, Sequence) else list(options)
    if len(every) != len(wanted):
        raise InputError(f"plan_many: options: expected one, or one for each of {len(wanted)} scenes, got {len(every)}")
    found = []
    for source, asked in zip(wanted, every, strict=True):
        check_options(asked)
        scene = as_scene(source, asked.seed)
        here = dataclasses.replace(asked, stop=None, keep=None)  # what is called here cannot be called in a worker
        found.append(_Query(scene, as_robot(robot, scene), here))
    return found


def _run(queries: Sequence[_Query], workers: int, stop: Callable[[], bool], tell: Progress) -> list[PlanResult]:
    """The answers to all queries, in their order."""
    with _garbage_of_this_thread():
        return _run_in_pool(queries, workers, stop, tell)


def _run_in_pool(queries: Sequence[_Query], workers: int, stop: Callable[[], bool], tell: Progress) -> list[PlanResult]:
    pool = ProcessPool(workers, initializer=_begin, context=multiprocessing.get_context("spawn"))
    results: dict[int, PlanResult] = {}
    try:
        with _one_thread_each():
            first = _schedule(pool, _begin)  # fails where no process can begin
            pending = {_schedule(pool, _plan, query): k for k, query in enumerate(queries)}
            while pending and not stop():
                ended, _ = wait(pending, timeout=LOOK, return_when=FIRST_COMPLETED)
                if not pool.active or (first.done() and first.exception() is not None):
                    raise InputError(AT_THE_TOP)
                for future in ended:
                    k = pending.pop(future)
                    results[k] = _result(future, queries[k])
                    said = f"{len(results)} of {len(queries)}: {queries[k].scene.name}: {results[k].status}"
                    tell(ProgressEvent("batch", f"{said} {results[k].reason}".rstrip()))
    finally:
        pool.stop()
        pool.join()
    return [results.get(k) or _failed("stopped before it was answered") for k in range(len(queries))]


@contextmanager
def _garbage_of_this_thread() -> Iterator[None]:
    """Inside, no thread of the pool collects garbage: a Meshcat of the user's that is no longer used must die in his own thread.

    Drake ends the process when it dies in another.
    """
    collects = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def _schedule(pool: ProcessPool, work: Callable[..., Answer], query: _Query | None = None) -> Future[Answer]:
    limit = None if query is None else query.options.deadline + LATE
    try:
        with without_ctrl_c():  # the first one starts the pool
            return pool.schedule(work, args=() if query is None else (query,), timeout=limit)
    except RuntimeError:
        raise InputError(AT_THE_TOP) from None


def _plan(query: _Query) -> PlanResult:
    """In a worker: the answer to one query, without what cannot be sent."""
    try:
        return dataclasses.replace(plan_scene(*query, progress=False), refusal=None)
    except InputError as error:
        return _failed(str(error))


def _result(future: Future[PlanResult], query: _Query) -> PlanResult:
    """What a query came to, whatever became of its process."""
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, FutureTimeoutError):
        return _failed(f"no answer within {query.options.deadline + LATE:g} s")
    if isinstance(error, ProcessExpired):
        return _failed(f"its process died (exit code {error.exitcode})")
    return _failed(failure_line(error))


def _failed(reason: str) -> PlanResult:
    return PlanResult("none", reason, None, QueryRecord().as_dict("none", reason, None))


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes that start in between compute with one thread: libraries read this when they load."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _told(progress: Watcher, count: int) -> Iterator[Progress]:
    """What is told whenever a query ends: the user's function, a bar or nobody."""
    if callable(progress):
        call: Callable[[ProgressEvent], object] = progress

        def tell(event: ProgressEvent) -> None:
            call(event)

        yield tell
    elif progress or (progress is None and someone_watches()):
        from tqdm.auto import tqdm

        with tqdm(total=count, unit="plan", file=sys.stderr, dynamic_ncols=True) as bar:

            def advance(event: ProgressEvent) -> None:
                bar.set_postfix_str(event.message, refresh=True)
                bar.update(event.stage == "batch")

            yield advance
    else:
        yield lambda event: None


def _begin() -> None:
    """First thing in a worker: leave Ctrl-C to the parent, and die with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_die_with_parent, daemon=True).start()


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for([parent.sentinel])
        os._exit(1)
