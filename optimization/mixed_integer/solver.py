"""The one file that chooses solvers of mixed-integer programs, bounds their time and judges their answers.

Gurobi, then Mosek where they are licensed, else SCIP (extra `mip`), else Drake's branch and bound. Each runs in a
process of its own that streams its incumbents out: a crash, a hang or a licence that fails between `enabled()` and
the solve costs the answer of that solver, never the caller, and a time limit gives back the best that was found, marked.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from optimization.convex.solver import ConvexSolver, SolverSettings
from optimization.mixed_integer import scip_adapter
from optimization.mixed_integer.data import MixedIntegerData, build_program, read_program
from optimization.mixed_integer.worker import Job
from scenes.input_error import InputError, unknown_name

GRACE = 1.0  # [s] that a solver may overrun its own time limit before its process is killed
FOUND, LIMIT, INFEASIBLE, FAILED = "solved", "time limit", "infeasible", "failed"


@dataclass(frozen=True)
class Backend:
    """One mixed-integer solver.

    Attributes:
        name: as users write it.
        entry: "module:function", called in the worker as `scip_adapter.solve` is.
        missing: says why it cannot be used here, "" if it can.
    """

    name: str
    entry: str
    missing: Callable[[], str]


def _unlicensed(solver: str) -> str:
    import pydrake.solvers

    found = getattr(pydrake.solvers, solver)()
    if not found.available():
        return f"{solver} is not part of this Drake"
    return "" if found.enabled() else f"{solver} has no licence here"


BACKENDS = (
    Backend("gurobi", "optimization.mixed_integer.drake_adapter:gurobi", lambda: _unlicensed("GurobiSolver")),
    Backend("mosek", "optimization.mixed_integer.drake_adapter:mosek", lambda: _unlicensed("MosekSolver")),
    Backend(
        "scip",
        "optimization.mixed_integer.scip_adapter:solve",
        lambda: "" if scip_adapter.available() else scip_adapter.MISSING,
    ),
    Backend("drake", "optimization.mixed_integer.drake_adapter:branch_and_bound", lambda: ""),
)


@dataclass(frozen=True)
class MixedIntegerSettings:
    """How a mixed-integer program is to be solved.

    Attributes:
        solver: "auto" (the first of `backends` that can be used; the next where one fails), or by name.
        time_limit: seconds, kept by killing the solver's process if need be.
        gap: relative gap between incumbent and bound at which to stop.
        first_only: stop at the first feasible answer.
        accept: greatest violation of any constraint at which an answer counts as feasible.
        backends: solvers in the order of preference.
    """

    solver: str = "auto"
    time_limit: float = 60.0
    gap: float = 0.01
    first_only: bool = False
    accept: float = 1e-5
    backends: tuple[Backend, ...] = BACKENDS

    def __post_init__(self) -> None:
        if self.solver != "auto" and self.solver not in (b.name for b in self.backends):
            raise unknown_name("solver", self.solver, ("auto", *(b.name for b in self.backends)))
        for key in ("time_limit", "gap"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"mixed-integer settings: {key}: expected a finite number >= 0, got {value}")


@dataclass(frozen=True)
class Progress:
    """Where a solver stood: seconds since it started, cost of its incumbent (inf: none), and bound on the optimum."""

    time: float
    cost: float
    bound: float

    @property
    def gap(self) -> float:
        """Relative gap (cost - bound) / |cost|; inf where there is no incumbent or no bound."""
        if not (np.isfinite(self.cost) and np.isfinite(self.bound)):
            return np.inf
        return max(self.cost - self.bound, 0.0) / max(abs(self.cost), 1e-9)


@dataclass(frozen=True, eq=False)
class MixedIntegerRecord:
    """What was run and what it gave.

    Attributes:
        solver: name of the one whose answer this is.
        status: "solved" (to the gap, or the first answer where that was asked), "time limit" (x is the incumbent, if
            there is one), "infeasible" or "failed".
        message: one line: how it ended, and what happened to solvers tried before.
        x: (n,) the best answer that satisfies every constraint by our own check, None where there is none.
        cost: of x by our own evaluation; inf where there is none.
        bound: the solver's lower bound on the optimum; -inf where it gave none.
        worst, worst_constraint: greatest violation at x and what it violates.
        time: seconds, process start included.
        time_to_first: seconds to the first feasible answer by the solver's word, NaN where there was none.
        history: incumbents and bounds over time.
        peak_rss_mb: of the solver's process.
        cpu_time: of the solver's process, its start included [s].
    """

    solver: str
    status: str
    message: str
    x: np.ndarray | None
    cost: float
    bound: float
    worst: float
    worst_constraint: str
    time: float
    time_to_first: float
    history: tuple[Progress, ...] = field(default=())
    peak_rss_mb: float = float("nan")
    cpu_time: float = float("nan")

    @property
    def gap(self) -> float:
        """Relative gap between the answer and the bound."""
        return Progress(self.time, self.cost, self.bound).gap


def solve_mixed_integer(
    prog: object | MixedIntegerData,
    settings: MixedIntegerSettings | None = None,
    *,
    on_progress: Callable[[Progress, np.ndarray | None], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> MixedIntegerRecord:
    """Solves a MathematicalProgram with binary variables, or its numbers.

    Args:
        prog: the program.
        settings: see `MixedIntegerSettings`.
        on_progress: called with every incumbent (and the answer) and better bound (and None).
        stop: polled about ten times a second; True ends the solve as the time limit does.

    Raises:
        InputError: the data holds a NaN, or no solver, or not the one asked for by name, can be used here.
        ValueError: the program holds a term that no mixed-integer solver here takes.
    """
    settings = settings or MixedIntegerSettings()
    data = prog if isinstance(prog, MixedIntegerData) else read_program(prog)
    if bad := data.non_finite():
        raise InputError(f"mixed-integer program: the data of {bad!r} is not finite")
    notes: list[str] = []
    deadline = time.perf_counter() + settings.time_limit
    best = None
    for backend in _usable(settings, notes):
        left = max(deadline - time.perf_counter(), 0.0)
        record = _run(backend, data, replace(settings, time_limit=left), on_progress, stop)
        notes.append(record.message)
        # What a solver found before it crashed counts where those after it find nothing cheaper.
        if best is None or record.cost < best.cost or (record.status != FAILED and best.x is None):
            best = record
        if record.status != FAILED:
            break
    if best is None:
        raise InputError(f"mixed-integer program: no solver can be used here: {'; '.join(notes)}")
    return replace(best, message="; ".join(dict.fromkeys(notes)))


def _usable(settings: MixedIntegerSettings, notes: list[str]) -> Iterator[Backend]:
    """The solvers to try, best first; what cannot be used is noted, or an error where it was asked for by name."""
    for backend in settings.backends:
        if settings.solver not in ("auto", backend.name):
            continue
        missing = backend.missing()
        if not missing:
            yield backend
        elif settings.solver == backend.name:
            raise InputError(f"solver {backend.name!r}: {missing}")
        elif backend.name == "scip":
            notes.append(missing)


def _run(
    backend: Backend,
    data: MixedIntegerData,
    settings: MixedIntegerSettings,
    on_progress: Callable[[Progress, np.ndarray | None], None] | None,
    stop: Callable[[], bool] | None,
) -> MixedIntegerRecord:
    """One solver in its own process, its incumbents, and our judgement of the best one."""
    began = time.perf_counter()
    history: list[Progress] = []
    best, ended, error = None, "", ""
    with _Worker(Job(backend.entry, data, settings.time_limit, settings.gap, settings.first_only)) as worker:
        limit = began + settings.time_limit + GRACE
        for frame in worker.frames(limit, stop):
            if frame[0] == "news":
                news = Progress(frame[1], frame[2], frame[3])
                history.append(news)
                best = frame[4] if frame[4] is not None else best
                if on_progress is not None:
                    on_progress(news, frame[4])
            elif frame[0] == "end":
                ended = frame[2]
            else:
                error = f"{frame[2]}: {frame[3]}"
        why = error or ("" if ended or worker.killed else worker.obituary())
    x, cost, worst, name = _judge(data, best, settings.accept)
    first = next((p.time for p in history if np.isfinite(p.cost)), np.nan)
    bound = max((p.bound for p in history if np.isfinite(p.bound)), default=-np.inf)
    status = _status(ended, worker.killed, why, x)
    message = {
        FOUND: f"{backend.name}: {ended}",
        LIMIT: f"{backend.name}: {'stopped' if worker.stopped else f'the time limit of {settings.time_limit:.3g} s fired'}"
        + ("" if x is not None else " before any answer was found"),
        INFEASIBLE: f"{backend.name}: infeasible",
        FAILED: f"{backend.name}: {why or f'ended as {ended!r} without an answer that holds'}",
    }[status]
    elapsed = time.perf_counter() - began
    return MixedIntegerRecord(
        backend.name,
        status,
        message,
        x,
        cost,
        bound,
        worst,
        name,
        elapsed,
        first,
        tuple(history),
        worker.peak_rss_mb,
        worker.cpu_time,
    )


def _status(ended: str, killed: bool, why: str, x: np.ndarray | None) -> str:
    word = ended.lower()
    if killed or "time" in word:
        return LIMIT
    if why:
        return FAILED
    if "infeasible" in word and x is None:
        return INFEASIBLE
    return FOUND if x is not None else FAILED


def _judge(data: MixedIntegerData, x: np.ndarray | None, accept: float) -> tuple[np.ndarray | None, float, float, str]:
    """The answer with exact binaries and its continuous part solved again, where that holds; else as it came."""
    if x is None:
        return None, np.inf, np.inf, ""
    fixed = data.with_binaries(x)
    answer, _ = ConvexSolver(build_program(fixed)[0], SolverSettings(accept=accept)).solve()
    for candidate in (answer, x):
        if candidate is None:
            continue
        exact = np.where(data.binary, np.round(x), candidate)
        worst, name = data.worst(exact)
        if worst <= accept:
            return exact, data.cost(exact), worst, name
    worst, name = data.worst(x)
    return None, np.inf, worst, name


class _Worker:
    """A solver's process, as a context that never leaves it running."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self.killed = self.stopped = False
        self.peak_rss_mb = self.cpu_time = float("nan")
        self._status: int | None = None

    def __enter__(self) -> _Worker:
        environment = dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
        root = str(Path(__file__).resolve().parents[2])
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, (root, environment.get("PYTHONPATH", ""))))
        self._errors: IO[bytes] = tempfile.TemporaryFile()
        self._process: subprocess.Popen[bytes] = subprocess.Popen(
            [sys.executable, "-m", "optimization.mixed_integer.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env=environment,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._frames: IO[bytes] = self._process.stdout
        try:
            self._process.stdin.write(pickle.dumps(self._job))
            self._process.stdin.close()
        except BrokenPipeError:
            pass  # it died at once: `obituary` says how
        return self

    def __exit__(self, *exception: object) -> None:
        if self._status is None:
            self._process.kill()
            self._reap()
        self._frames.close()
        self._errors.close()

    def frames(self, limit: float, stop: Callable[[], bool] | None) -> Iterator[tuple[Any, ...]]:
        """What the worker says until it ends, `limit` (perf_counter) passes or `stop` says so; then it is gone."""
        pipe, buffer = self._frames.fileno(), b""
        while True:
            while len(buffer) >= 8 and len(buffer) >= 8 + (size := struct.unpack("<q", buffer[:8])[0]):
                frame, buffer = buffer[8 : 8 + size], buffer[8 + size :]
                yield pickle.loads(frame)
            self.stopped = stop is not None and stop()
            if self.stopped or time.perf_counter() > limit:
                self.killed = True
                self._process.kill()
                break
            if select.select([pipe], [], [], min(0.1, max(limit - time.perf_counter(), 0.0)))[0]:
                chunk = os.read(pipe, 1 << 20)
                if not chunk:
                    break
                buffer += chunk
        self._reap()

    def _reap(self) -> None:
        _, status, usage = os.wait4(self._process.pid, 0)
        self._status = self._process.returncode = os.waitstatus_to_exitcode(status)
        self.peak_rss_mb = usage.ru_maxrss / 1024.0
        self.cpu_time = usage.ru_utime + usage.ru_stime

    def obituary(self) -> str:
        """How the process died, with the last line that it wrote to standard error."""
        code = self._status or 0
        how = (
            f"its process was killed by {signal.Signals(-code).name}" if code < 0 else f"its process exited with {code}"
        )
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return f"{how} without an answer" + (f" ({lines[-1][:200]})" if lines else "")
