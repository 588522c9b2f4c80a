"""Plans a scene: with one planner; with stored plans and, where none fits, the search; or with both at once."""

from __future__ import annotations

import dataclasses
import time

from drakeplan.deadline import compile_clock
from drakeplan.progress import Progress, ProgressEvent
from drakeplan.query.inputs import AnyRobot, AnyScene, as_robot, as_scene
from drakeplan.query.one_planner import plan_with_one
from drakeplan.query.options import PlanOptions
from drakeplan.query.parallel import plan_in_parallel
from drakeplan.query.result import PlanResult
from drakeplan.query.watching import Watcher, watched
from scenes.robots.robot import Robot
from scenes.scene import Scene

ADAPT_SHARE = 0.5  # of the deadline for adapting stored plans, before the search begins


def plan_scene(
    scene: AnyScene,
    robot: AnyRobot | None = None,
    options: PlanOptions | None = None,
    progress: Watcher = None,
) -> PlanResult:
    """Plans a crossing and has it verified.

    The first call on a machine compiles for some minutes before its deadline begins to count.

    Args:
        scene: terrain, start and goal: a `Scene`, a name (`list_scenes()`), a scene file, `hpp/<mesh>` or a mesh file.
            A named scene that draws something does so with the seed of the options.
        robot: who crosses: a `Robot`, a name (`robot_names()`) or a YAML file; None: the scene's, else escher.
        options: see `PlanOptions`.
        progress: called with a `ProgressEvent` whenever there is news; True: lines on standard error; False: silence;
            None: lines where standard error is a terminal, or in a notebook.

    Returns:
        Its `status` is "complete" where `plan` holds by the verifier; else `reason` says in one line why not.

    Raises:
        InputError: no such scene or robot, bad options, a robot that does not stand as it is described, a start or goal off
            the terrain.
    """
    options, began = options or PlanOptions(), time.perf_counter()
    terrain = as_scene(scene, options.seed)
    who = as_robot(robot, terrain)
    if terrain is not scene:  # the deadline holds while it is read
        options = dataclasses.replace(options, used=options.used + time.perf_counter() - began)
    with watched(progress) as tell:
        result = _answer(terrain, who, options, tell)
    return result if terrain is scene else _with_notes_of(terrain, result)


def _answer(scene: Scene, robot: Robot, options: PlanOptions, tell: Progress) -> PlanResult:
    """What the planner of the options answers."""
    if options.planner == "parallel":
        return plan_in_parallel(scene, robot, options, tell)
    if options.planner == "adapt" and options.search_too:
        return _adapt_then_search(scene, robot, options, tell)
    return plan_with_one(scene, robot, options, tell)


def _with_notes_of(scene: Scene, result: PlanResult) -> PlanResult:
    """The result with what was changed while the scene was read, which nobody else has seen."""
    notes = (*scene.notes, *result.notes)
    return dataclasses.replace(result, notes=notes, report={**result.report, "notes": list(notes)})


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
