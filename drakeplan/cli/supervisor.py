"""A command whose process is watched: at its deadline, or asked to stop, it ends within half a second, whatever it does.

The work runs in a forked process, which tells over a pipe when its deadline is and what it has so far. The parent waits.
Python cannot leave a call into C++ (a solver, a collision query) before the call returns, however long that takes; a
parent that kills its child can. What the child told last is then the answer.

Ctrl-C once: the child ends with the best so far; twice: it is killed at once. The child is in a process group of its own,
so that its own workers end with it.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import select
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

GRACE = 0.45  # [s] from the deadline or Ctrl-C until the child is killed
ABORTED, NO_PLAN, DEFECT = 130, 3, 70
PR_SET_PDEATHSIG = 1  # of Linux' prctl: the child does not outlive the parent


class Wire:
    """The child's end of the pipe."""

    def __init__(self, descriptor: int) -> None:
        """Takes the pipe's writing end."""
        self._descriptor = descriptor

    def tell(self, **news: object) -> None:
        """Sends some of: left (seconds until the deadline; None for no deadline), compiling (True, then False: what is in
        between does not count), answering (True once the answer is known), report (a JSON object, the answer if the child
        is killed), kept (path of a plan file, and what to call it).
        """
        os.write(self._descriptor, (json.dumps(news) + "\n").encode())


wire: Wire | None = None  # of this process, where it is a watched child


@dataclass
class _Watch:
    """What the parent knows of its child."""

    kill_at: float = float("inf")
    spared: float = 0.0  # [s] that were left when a kernel began to compile
    why: str = "deadline"
    interrupts: int = 0
    answering: bool = False
    report: dict[str, object] | None = None
    kept: tuple[str, str] | None = None
    stage: str = ""

    def hear(self, news: dict) -> None:
        """Takes a message of the child."""
        if "left" in news:
            left = float("inf") if news["left"] is None else float(news["left"])
            self.kill_at = time.monotonic() + left + GRACE
        if news.get("compiling"):
            self.spared, self.kill_at = self.kill_at - time.monotonic(), float("inf")
        elif "compiling" in news:
            self.kill_at = time.monotonic() + self.spared
        self.stage = news.get("stage", self.stage)
        self.answering = self.answering or bool(news.get("answering"))
        self.report = news.get("report", self.report)
        self.kept = tuple(news["kept"]) if news.get("kept") else self.kept


def supervise(work: Callable[[], int], *, as_json: bool) -> int:
    """Runs the work in a child and returns its exit status, or what its last news amount to.

    Args:
        work: what the child does; its return value is the exit status.
        as_json: whether the answer of a killed child is printed as JSON.
    """
    if not hasattr(os, "fork"):
        return work()
    sys.stdout.flush()
    sys.stderr.flush()
    reading, writing = os.pipe()
    parent, child = os.getpid(), os.fork()
    if child == 0:
        os.close(reading)
        _run_as_child(work, parent, writing)
    os.close(writing)
    watch, before = _Watch(), {}
    with contextlib.suppress(ValueError):  # not in the main thread, where no signal arrives
        before = {s: signal.signal(s, h) for s, h in _handlers(watch, child).items()}
    try:
        status = _wait(watch, child, reading)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        os.close(reading)
    return _answer(watch, status, as_json=as_json)


def _run_as_child(work: Callable[[], int], parent: int, writing: int) -> None:
    """Does the work and leaves, whatever happens."""
    global wire
    status = DEFECT
    try:
        os.setpgid(0, 0)
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() != parent:  # it died in between
                os._exit(DEFECT)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        wire = Wire(writing)
        status = work()
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(status)


def _handlers(watch: _Watch, child: int) -> dict[int, Callable]:
    def interrupt(signum: int, frame: object) -> None:
        watch.interrupts += 1
        watch.why = "interrupt"
        if watch.interrupts == 1:
            watch.kill_at = min(watch.kill_at, time.monotonic() + GRACE)
            _signal(child, signal.SIGINT)
        else:
            watch.answering, watch.kill_at = False, 0.0

    def terminate(signum: int, frame: object) -> None:
        watch.why, watch.answering, watch.kill_at = "terminate", False, 0.0

    def pause(signum: int, frame: object) -> None:
        _signal(child, signal.SIGSTOP, group=True)
        os.kill(os.getpid(), signal.SIGSTOP)
        _signal(child, signal.SIGCONT, group=True)

    return {signal.SIGINT: interrupt, signal.SIGTERM: terminate, signal.SIGTSTP: pause}


def _wait(watch: _Watch, child: int, reading: int) -> int | None:
    """Listens until the child has ended, or is killed; its exit status, None for a killed one."""
    heard = b""
    while True:
        if watch.kill_at <= time.monotonic() and (not watch.answering):
            _signal(child, signal.SIGKILL, group=True)
            os.waitpid(child, 0)
            return None
        ready, _, _ = select.select([reading], [], [], 0.05)
        if ready:
            piece = os.read(reading, 1 << 16)
            heard += piece
            *lines, heard = heard.split(b"\n")
            for line in lines:
                watch.hear(json.loads(line))
            if not piece:  # the pipe is closed: the child ends now
                time.sleep(0.01)
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)


def _signal(child: int, number: int, *, group: bool = False) -> None:
    with contextlib.suppress(ProcessLookupError):
        (os.killpg if group else os.kill)(child, number)


def _answer(watch: _Watch, status: int | None, *, as_json: bool) -> int:
    """The exit status; where the child could not answer, its last news are the answer."""
    if status is not None and status >= 0:
        if watch.kept:
            Path(watch.kept[0]).unlink(missing_ok=True)
        return status
    during = f" during: {watch.stage}" if watch.stage else ""
    if status is not None:
        reason, code = f"the planning process ended by signal {-status}{during}", DEFECT
    elif watch.why == "deadline":
        reason, code = f"the deadline ended it{during}", NO_PLAN
    elif watch.interrupts > 1 or watch.why == "terminate":
        reason, code = "aborted", ABORTED
    else:
        reason, code = f"interrupted{during}", NO_PLAN
    report = {**(watch.report or {}), "status": "none", "reason": reason}
    if watch.kept and code == NO_PLAN:
        os.replace(*watch.kept)
        report |= {"status": "contacts", "files": {"plan": watch.kept[1]}}
    elif watch.kept:
        Path(watch.kept[0]).unlink(missing_ok=True)
    print(f"\ndrakeplan: no complete plan: {reason}", file=sys.stderr)
    if as_json:
        print(json.dumps(report))
    return code
