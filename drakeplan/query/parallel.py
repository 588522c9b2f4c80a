"""Search and adaptation in two processes: the first verified plan ends the other (Lin 2020 fig. 4.1)."""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from drakeplan.deadline import compile_clock
from drakeplan.plan.plan import Plan
from drakeplan.progress import Progress
from drakeplan.query.one_planner import load_kernels, plan_with_one
from drakeplan.query.options import PlanOptions, check_options
from drakeplan.query.record import QueryRecord
from drakeplan.query.result import PlanResult
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.scene import Scene

PLANNERS = ("search", "adapt")  # the search's answer counts where neither has a plan
GRACE = 0.45  # [s] that a helper may be late
TICK = 0.05  # [s] between looks at whether the user wants to stop
PR_SET_PDEATHSIG = 1  # of Linux' prctl: a child does not outlive its parent


def plan_in_parallel(scene: Scene, robot: Robot, options: PlanOptions, tell: Progress) -> PlanResult:
    """The first verified plan of search and adaptation; without one the better of their answers.

    Args:
        scene: terrain, start and goal.
        robot: who crosses.
        options: what the user chose.
        tell: told what goes on.

    Raises:
        InputError: as each of them alone; a library that cannot be used is a note, and the search is alone.
    """
    check_options(options)
    if not hasattr(os, "fork"):
        return plan_with_one(scene, robot, dataclasses.replace(options, planner="search"), tell)
    began, compiled = time.perf_counter(), compile_clock.seconds()
    load_kernels(robot, WholeBodyIK(robot), options.planner, tell)
    used = options.used + time.perf_counter() - began - (compile_clock.seconds() - compiled)
    team = [_Helper(name, scene, robot, dataclasses.replace(options, used=used)) for name in PLANNERS]
    try:
        answers = _listen(team, options, time.perf_counter() + max(options.deadline - used, 0.0) + GRACE, tell)
    finally:
        for helper in team:
            helper.end()
    return _chosen(answers)


class _Helper:
    """A process that plans with one planner."""

    def __init__(self, planner: str, scene: Scene, robot: Robot, options: PlanOptions) -> None:
        self.planner = planner
        context = multiprocessing.get_context("fork")  # kernels are loaded already, and nothing has to be sent
        self.pipe, theirs = context.Pipe()
        self._process: BaseProcess = context.Process(
            target=_work, args=(theirs, planner, scene, robot, options, os.getpid()), daemon=True
        )
        self._process.start()
        theirs.close()

    def stop(self) -> None:
        """Asks for the best so far."""
        with contextlib.suppress(OSError):  # it has died
            self.pipe.send("stop")

    def end(self) -> None:
        """Ends the process at once."""
        self._process.kill()
        self._process.join()
        self.pipe.close()


def _work(pipe: Connection, planner: str, scene: Scene, robot: Robot, options: PlanOptions, parent: int) -> None:
    """In the helper: plans, and sends what happens and the answer."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent says when to stop
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            return

    def keep(plan: Plan, report: dict[str, object]) -> None:
        pipe.send(("keep", (plan, report)))

    stopped = []

    def stop() -> bool:
        if pipe.poll():
            stopped.append(pipe.recv())
        return bool(stopped)

    asked = dataclasses.replace(options, planner=planner, stop=stop, keep=None if options.keep is None else keep)
    if planner != "search":  # dynamics are the search's affair
        asked = dataclasses.replace(asked, dynamics=None)
    try:
        result = plan_with_one(scene, robot, asked, lambda event: pipe.send(("tell", event)))
        pipe.send(("result", dataclasses.replace(result, refusal=None)))  # a refusal holds what cannot be sent
    except InputError as error:
        pipe.send(("input", str(error)))
    with contextlib.suppress(EOFError, OSError):
        while True:  # the parent ends this process once it has the answer
            pipe.recv()


def _listen(
    team: Sequence[_Helper], options: PlanOptions, until: float, tell: Progress
) -> dict[str, PlanResult | InputError]:
    """Passes on what the helpers tell until one has a verified plan, all have answered or time is over; their answers."""
    answers: dict[str, PlanResult | InputError] = {}
    waiting = {helper.pipe: helper for helper in team}
    stopped = False
    while waiting and time.perf_counter() < until:
        if not stopped and options.stop is not None and options.stop():
            stopped = True
            for helper in waiting.values():
                helper.stop()
        for pipe in wait(list(waiting), TICK):
            helper = waiting[pipe]  # type: ignore[index]
            try:
                kind, content = helper.pipe.recv()
            except (EOFError, OSError):  # it died
                del waiting[helper.pipe]
                continue
            if kind == "tell":
                tell(content)
            elif kind == "keep" and options.keep is not None:
                options.keep(*content)
            elif kind in ("input", "result"):
                answers[helper.planner] = InputError(content) if kind == "input" else content
                del waiting[helper.pipe]
                if kind == "result" and content.status == "complete":
                    return answers
    return answers


def _chosen(answers: dict[str, PlanResult | InputError]) -> PlanResult:
    """The best answer, with a note on who gave none."""
    results = {name: found for name in PLANNERS if isinstance(found := answers.get(name), PlanResult)}
    if not results:
        for refused in answers.values():
            if isinstance(refused, InputError):
                raise refused
        reason = "neither the search nor an adapted plan came to an answer in time"
        return PlanResult("none", reason, None, QueryRecord().as_dict("none", reason, None))
    best = max(results, key=lambda name: results[name].rank)
    result, notes = results[best], []
    if result.status == "complete":
        notes.append(f"the plan is that of {best}, which was the first")
    for name in PLANNERS:
        answer = answers.get(name)
        if isinstance(answer, InputError):
            notes.append(f"{name}: {answer}")
        elif answer is None and result.status != "complete":
            notes.append(f"{name}: no answer in time")
        elif answer is not None and name != best and result.status != "complete":
            notes.append(f"{name}: {answer.reason}")
    every = (*result.notes, *notes)
    return dataclasses.replace(result, notes=every, report={**result.report, "notes": list(every)})
