"""Plans a scene: with one planner; with stored plans and, where none fits, the search; or with both at once."""

from __future__ import annotations

import dataclasses
import time

from drakeplan.deadline import compile_clock
from drakeplan.progress import Progress, ProgressEvent
from drakeplan.query.one_planner import plan_with_one
from drakeplan.query.options import PlanOptions
from drakeplan.query.parallel import plan_in_parallel
from drakeplan.query.result import PlanResult
from scenes.robots.robot import Robot
from scenes.scene import Scene

ADAPT_SHARE = 0.5  # of the deadline for adapting stored plans, before the search begins


def plan_scene(
    scene: Scene, robot: Robot, options: PlanOptions | None = None, progress: Progress | None = None
) -> PlanResult:
    """Plans a crossing and has it verified.

    Args:
        scene: terrain, start and goal.
        robot: who crosses.
        options: see `PlanOptions`.
        progress: called with events while it runs.

    Raises:
        InputError: bad options, a robot that does not stand as it is described, a start or goal off the terrain.
    """
    options, tell = options or PlanOptions(), progress or (lambda event: None)
    if options.planner == "parallel":
        return plan_in_parallel(scene, robot, options, tell)
    if options.planner == "adapt" and options.search_too:
        return _adapt_then_search(scene, robot, options, tell)
    return plan_with_one(scene, robot, options, tell)


def _adapt_then_search(scene: Scene, robot: Robot, options: PlanOptions, tell: Progress) -> PlanResult:
    """A stored plan that fits; where none does in half of the time, the search's answer."""
    began, compiled = time.perf_counter(), compile_clock.seconds()
    until = options.used + ADAPT_SHARE * max(options.deadline - options.used, 0.0)
    adapted = plan_with_one(scene, robot, dataclasses.replace(options, deadline=until), tell)
    used = options.used + time.perf_counter() - began - (compile_clock.seconds() - compiled)
    stopped = options.stop is not None and options.stop()
    if adapted.status == "complete" or adapted.hopeless or stopped or used >= options.deadline:
        return adapted
    note = f"no stored plan became a verified one ({adapted.reason}); planned with the search"
    tell(ProgressEvent("search", note))
    searched = plan_with_one(scene, robot, dataclasses.replace(options, planner="search", used=used), tell)
    best = adapted if adapted.rank > searched.rank else searched
    notes = (*adapted.notes, note, *(line for line in searched.notes if line not in adapted.notes))
    return dataclasses.replace(best, notes=notes, report={**best.report, "notes": list(notes)})
