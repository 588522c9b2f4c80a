"""`drakeplan plan`: from a scene to a verified plan, its file and its page."""

from __future__ import annotations

import contextlib
import os
import resource
import shlex
import signal
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from drakeplan.cli import supervisor
from drakeplan.cli.arguments import Packages
from drakeplan.cli.output import seconds_since_process_start
from drakeplan.cli.plan_library import join_library, open_library
from drakeplan.cli.plan_options import in_radians, timing_of
from drakeplan.cli.plan_summary import summary
from drakeplan.contact_planning.planner import PLANNERS
from scenes.input_error import InputError

if TYPE_CHECKING:
    from drakeplan.plan.plan import Plan
    from drakeplan.progress import Progress, ProgressEvent
    from drakeplan.query.options import PlanOptions
    from drakeplan.query.result import PlanResult
    from scenes.robots.robot import Robot
    from scenes.scene import Scene

ABOUT = """Plans how a robot crosses a scene with its feet and palms, and has the plan verified.

SCENE is a name (drakeplan scenes list), a scene file, hpp/MESH (a mesh of the hpp-environments package) or a mesh file.
Lengths in metres, angles in degrees, times in seconds. A start or goal is set down on the terrain:
on the floor nearest its z, within 0.5 m.

examples:
  drakeplan plan rubble_corridor --seed 3 --out plan.h5 --html plan.html
  drakeplan plan hpp/darpa --start -3.6 0 0 --goal 3.9 0 --out darpa.h5
  drakeplan plan stones.yaml --friction 0.4 --deadline 10 --json
  drakeplan plan rubble_field --dynamics quasi-static --html plan.html
  drakeplan plan stairs --planner footsteps
  drakeplan plan stairs --first --out stairs.h5
  drakeplan plan random_surfaces --seed 3 --planner parallel
  drakeplan plan two_corridors --planner guided --html plan.html

Ctrl-C ends it with the best contacts so far (--keep-partial writes them); Ctrl-C again aborts.

exit status: 0 the plan is complete and verified, 2 bad input, 3 no complete plan (the reason is printed)"""

DEFAULT_ROBOT = "escher"


def _planner_names() -> str:
    return "{" + ",".join(PLANNERS) + "}"


def _planner_help() -> str:
    return "what finds the contacts: " + "; ".join(f"{name}: {entry.about}" for name, entry in PLANNERS.items())


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan plan`."""

    scene: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE")]
    """a name, a scene file, hpp/MESH or a mesh file"""
    robot: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
    """robot name or robot file (default: the scene's robot, else escher)"""
    package: Packages = ()
    """folder of package://NAME addresses in the robot's model; may be given several times"""
    seed: int = 0
    """random seed of the scene and of the planner"""
    start: Annotated[tuple[float, ...], tyro.conf.arg(metavar="X Y [YAW]", help_behavior_hint="")] = ()
    """start: mean of the feet and heading (default: the scene's)"""
    goal: Annotated[tuple[float, ...], tyro.conf.arg(metavar="X Y [YAW]", help_behavior_hint="")] = ()
    """goal: mean of the feet and heading; without YAW any heading (default: the scene's)"""
    start_z: Annotated[float | None, tyro.conf.arg(metavar="Z", help_behavior_hint="")] = None
    """height of the start's floor, where several lie over each other (default: the lowest with head room)"""
    goal_z: Annotated[float | None, tyro.conf.arg(metavar="Z", help_behavior_hint="")] = None
    """height of the goal's floor (default: the one nearest the start's height)"""
    goal_radius: Annotated[float | None, tyro.conf.arg(metavar="R", help_behavior_hint="")] = None
    """greatest distance from the goal (default: the scene's, else 0.2)"""
    friction: Annotated[float | None, tyro.conf.arg(metavar="MU", help_behavior_hint="")] = None
    """replaces every friction coefficient in the scene"""
    cone: Literal["inner", "square", "second_order", "diamond"] = "inner"
    """friction cone; diamond is larger than real friction allows: for comparison only"""
    planner: Annotated[str, tyro.conf.arg(metavar=_planner_names(), help=_planner_help())] = "search"
    dynamics: Annotated[
        Literal["quasi-static", "exact", "learned"] | None,
        tyro.conf.arg(metavar="{quasi-static,exact,learned}", help_behavior_hint=""),
    ] = None
    """test of a transition: static balance, networks trained on the centroidal program, or the program itself
    (default: learned; quasi-static where no network fits)"""
    capture: Literal["none", "swing", "worst-case"] = "none"
    """plan against the scene's pushes, with the feet alone: an edge costs what a push may do at four moments of its swing, or at
    the first; palms may catch the robot"""
    shift: Annotated[float | None, tyro.conf.arg(metavar="S", help_behavior_hint="")] = None
    """seconds to shift the centre of mass before each swing (default: 1; with --capture 0.6)"""
    swing: Annotated[float | None, tyro.conf.arg(metavar="S", help_behavior_hint="")] = None
    """seconds to move an end effector (default: 1; with --capture 0.4)"""
    free_timing: bool = False
    """optimise these durations for less effort; the total time stays"""
    transition_model: Annotated[
        Literal["experiments", "training", "planning", "long_stride", "leap_stride"] | None,
        tyro.conf.arg(metavar="{experiments,training,planning,long_stride,leap_stride}", help_behavior_hint=""),
    ] = None
    """list of foot steps (default: the scene's, else experiments)"""
    heuristic: Literal["grid", "traversability", "euclidean", "admissible"] = "grid"
    """how the search estimates what is left: length of the torso's way; the same with learned estimates of how hard the ground
    is; the straight line; a bound, with which the plan's cost is compared"""
    guide: Literal["mean", "max", "segments"] = "mean"
    """of --planner guided: a segment is adapted from a stored plan where the mean of its steps, or its hardest one, is hard; or
    all segments are searched"""
    footholds: Literal["snapped", "fixed"] = "snapped"
    """what becomes of a step or palm that does not fit where it would be set: moved to the nearest place where it does, or
    dropped"""
    deadline: float = 30.0
    """time limit of the whole command, motion and verification included [s]; kernels that compile for the first time
    do not count"""
    improve: Annotated[float | None, tyro.conf.arg(metavar="S", help_behavior_hint="")] = None
    """time for improvement after the first plan [s] (default: 150 more nodes, or 0.15 of the deadline: runs repeat)"""
    first: bool = False
    """the first verified plan, not improved"""
    library: Annotated[str, tyro.conf.arg(metavar="DIR", help_behavior_hint="")] = ""
    """stored plans for --planner adapt, parallel and guided (default: those that come with the robot); a new plan joins DIR
    where it differs enough"""
    expansions: Annotated[int | None, tyro.conf.arg(metavar="N", help_behavior_hint="")] = None
    """limit of expanded nodes; makes runs repeatable, unlike a time limit"""
    no_palms: bool = False
    """plan with the feet alone"""
    avoid: Annotated[tuple[str, ...], tyro.conf.arg(metavar="SURFACE ...", help_behavior_hint="")] = ()
    """surfaces that no foot and no palm may touch"""
    full_soles: bool = False
    """every sole rests whole; without this it may rest on planks, bars, an edge or a stone smaller than itself"""
    no_reserve: bool = False
    """use all that friction and supports give; without this a plan leaves a tenth of the friction and the rim of every
    sole unused, as far as there is such a plan"""
    simulate: bool = False
    """play each plan in physics, and go on searching while it falls; the deadline counts that too"""
    explain: bool = False
    """if the dynamics of a contact sequence are infeasible: print what blocks them, and which changes are enough
    to change (takes up to half a minute)"""
    keep_partial: bool = False
    """also write a contact sequence whose dynamics, motion or verification failed"""
    out: Annotated[str | None, tyro.conf.arg(metavar="PLAN.h5", help_behavior_hint="")] = None
    """write the plan"""
    html: Annotated[str | None, tyro.conf.arg(metavar="PAGE.html", help_behavior_hint="")] = None
    """write a page that plays it"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Plans, writes, tells; see the exit status in `ABOUT`."""
    _check_arguments(arguments)
    from drakeplan.plan.plan_file import require_writable

    outputs = [path for path in (arguments.out, arguments.html) if path is not None]
    for path in outputs:
        require_writable(path)
    if len({Path(path).resolve() for path in outputs}) < len(outputs):
        raise InputError(f"--out and --html name the same file {arguments.out}")
    from scenes.robots.addresses import read_packages
    from scenes.robots.robot import load_robot

    scene = _read_scene(arguments)
    robot = load_robot(arguments.robot or scene.robot or DEFAULT_ROBOT, read_packages(arguments.package))
    _require_ends(arguments, scene)
    open_library(arguments.library, arguments.planner, robot)
    from drakeplan.progress import ProgressPrinter
    from drakeplan.query.planning import plan_scene

    with (
        _interruptible() as interrupted,
        ProgressPrinter(sys.stderr) as progress,
        _Telling(arguments, scene) as telling,
    ):
        options = _options(arguments, interrupted, telling)
        result = plan_scene(scene, robot, options, telling.along(progress))
        telling.answering()
    for note in result.notes:
        print(f"note: {note}", file=sys.stderr)
    for line in _explanation(arguments, result):
        print(line, file=sys.stderr)
    files = _write(arguments, result, robot)
    if "plan" in files and robot.given_by_path:
        print(
            f"note: this plan needs its robot file: {_verify_command(arguments)} where {robot.source} is not there",
            file=sys.stderr,
        )
    complete = result.status == "complete"
    joined = join_library(arguments.library, result)
    report = {
        **result.report,
        "scene": scene.name,
        "robot": robot.name,
        "seed": arguments.seed,
        "notes": [*scene.notes, *result.notes],
        "total_s": seconds_since_process_start(),
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        "files": files,
        **({"library": joined} if joined else {}),
    }
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json(report)
    elif result.plan is not None:
        print(summary(report))
    if not complete:
        print(f"drakeplan: no complete plan: {result.reason}", file=sys.stderr)
    return 0 if complete else 3


def _read_scene(arguments: Arguments) -> Scene:
    """The scene, with its notes on standard error; the deadline holds while it is read."""
    from drakeplan.cli.output import read_scene_aloud
    from drakeplan.deadline import compile_clock  # it counts what compiles from here on

    wire = supervisor.wire
    if wire is not None:
        compile_clock.tell = lambda compiling: wire.tell(compiling=compiling)
        wire.tell(left=arguments.deadline - seconds_since_process_start(), stage=f"read {arguments.scene}")
    scene = read_scene_aloud(arguments.scene, arguments.seed)
    if wire is not None:
        wire.tell(left=None, stage="load")  # until the query's own clock starts
    for note in scene.notes:
        print(f"note: {note}", file=sys.stderr)
    return scene


def _check_arguments(arguments: Arguments) -> None:
    if arguments.planner not in PLANNERS:
        known = ", ".join(PLANNERS)
        raise InputError(f"drakeplan plan: --planner: unknown {arguments.planner!r}: expected one of {known}")
    if arguments.seed < 0:
        raise InputError(f"--seed: expected 0 or more, got {arguments.seed}")
    if arguments.expansions is not None and arguments.expansions < 1:
        raise InputError(f"--expansions: expected 1 or more, got {arguments.expansions}")
    for name in ("goal_radius", "friction", "deadline", "improve"):
        value = getattr(arguments, name)
        if value is not None and value < 0:
            raise InputError(f"--{name.replace('_', '-')}: expected 0 or more, got {value:g}")


def _require_ends(arguments: Arguments, scene: Scene) -> None:
    """A scene without start or goal needs the option; the message helps to choose one."""
    missing = [
        option
        for option, given, known in (
            ("--start", arguments.start, scene.start),
            ("--goal", arguments.goal, scene.goal),
        )
        if not given and known is None
    ]
    if missing:
        lowest, highest = scene.terrain.extent
        spans = ", ".join(f"{a} from {lo:.2f} to {hi:.2f} m" for a, lo, hi in zip("xyz", lowest, highest, strict=True))
        raise InputError(f"scene {scene.name} needs {' and '.join(missing)}: its terrain spans {spans}")


def _options(arguments: Arguments, interrupted: _Flag, telling: _Telling) -> PlanOptions:
    from drakeplan.deadline import compile_clock
    from drakeplan.query.options import PlanOptions, check_options
    from optimization.balance.friction import FrictionCone
    from optimization.balance.reserve import ALL, USUAL

    options = PlanOptions(
        seed=arguments.seed,
        start=in_radians(arguments.start),
        goal=in_radians(arguments.goal),
        start_z=arguments.start_z,
        goal_z=arguments.goal_z,
        goal_radius=arguments.goal_radius,
        friction=arguments.friction,
        cone=FrictionCone(arguments.cone),
        planner=arguments.planner,
        dynamics=arguments.dynamics,
        timing=timing_of(
            arguments.shift, arguments.swing, free=arguments.free_timing, pushes=arguments.capture != "none"
        ),
        transition_model=arguments.transition_model,
        deadline=arguments.deadline,
        improve=0.0 if arguments.first else arguments.improve,
        expansions=arguments.expansions,
        library=arguments.library,
        use_palms=not arguments.no_palms,
        avoid=arguments.avoid,
        full_soles=arguments.full_soles,
        heuristic=arguments.heuristic,
        guide=arguments.guide,
        footholds=arguments.footholds,
        capture=arguments.capture,
        stop=interrupted,
        used=seconds_since_process_start() - compile_clock.seconds() if supervisor.wire is not None else 0.0,
        keep=telling.keep,
        explain=arguments.explain,
        reserve=ALL if arguments.no_reserve else USUAL,
        simulate=arguments.simulate,
        command=shlex.join(["drakeplan", *sys.argv[1:]]),
    )
    check_options(options)
    return options


def _verify_command(arguments: Arguments) -> str:
    """How to verify the plan on a machine that has the robot file elsewhere."""
    return shlex.join(["drakeplan", "verify", arguments.out or "", "--robot", arguments.robot or ""])


def _write(arguments: Arguments, result: PlanResult, robot: Robot) -> dict[str, str]:
    """Writes what was asked for; a plan without a verified motion only with --keep-partial."""
    files: dict[str, str] = {}
    if result.plan is None or (result.status != "complete" and not arguments.keep_partial):
        return files
    if arguments.out is not None:
        from drakeplan.plan.plan_file import write_plan

        write_plan(result.plan, arguments.out)
        files["plan"] = arguments.out
    if arguments.html is not None:
        from drakeplan.playback import write_page

        write_page(result.plan, arguments.html, robot)
        files["html"] = arguments.html
    return files


class _Flag:
    """Called, says whether Ctrl-C was pressed."""

    def __init__(self) -> None:
        self.raised = False

    def __call__(self) -> bool:
        return self.raised


class _Telling(contextlib.AbstractContextManager):
    """Tells the watching process (`drakeplan.cli.supervisor`) how far the query is; does nothing where none watches."""

    def __init__(self, arguments: Arguments, scene: Scene) -> None:
        self._wire = supervisor.wire
        self._facts = {"scene": scene.name, "seed": arguments.seed}
        self._out = arguments.out if arguments.keep_partial else None
        self._kept = f"{self._out}.{os.getpid()}.partial"
        self._started = False

    def __exit__(self, *_: object) -> None:
        if self._out is not None and self._wire is not None:
            Path(self._kept).unlink(missing_ok=True)

    def along(self, progress: Progress) -> Progress:
        """The same progress, told to the watching process too."""

        def tell(event: ProgressEvent) -> None:
            progress(event)
            if self._wire is None:
                return
            self._wire.tell(stage=" ".join([event.stage, event.message]).rstrip())
            if event.stage == "explain":  # asked for beyond the deadline
                self.answering()
            if event.left is None:
                return
            if not self._started:
                self._started = True
                self._wire.tell(report=self._facts)
            self._wire.tell(left=event.left)  # again and again: kernels may have compiled meanwhile

        return tell

    def keep(self, plan: Plan, report: dict[str, object]) -> None:
        """Puts contacts aside, for the case that this process is killed while it makes their motion."""
        if self._wire is None:
            return
        kept = None
        if self._out is not None:
            from drakeplan.plan.plan_file import write_plan

            write_plan(plan, self._kept)
            kept = (self._kept, self._out)
        self._wire.tell(report={**report, **self._facts}, kept=kept)

    def answering(self) -> None:
        """Says that the answer is known and only has to be written."""
        if self._wire is not None:
            self._wire.tell(answering=True)


@contextlib.contextmanager
def _interruptible() -> Iterator[_Flag]:
    """Inside, the first Ctrl-C raises the flag and the second one aborts as usual."""
    flag = _Flag()

    def interrupt(signum: int, frame: object) -> None:
        if flag.raised:
            raise KeyboardInterrupt
        flag.raised = True
        print(
            "\ninterrupted: ends with the best contacts so far; press Ctrl-C again to abort",
            file=sys.stderr,
            flush=True,
        )

    try:
        before = signal.signal(signal.SIGINT, interrupt)
    except ValueError:  # not in the main thread, where no signal arrives
        yield flag
        return
    try:
        yield flag
    finally:
        signal.signal(signal.SIGINT, before)


def _explanation(arguments: Arguments, result: PlanResult) -> list[str]:
    """What `--explain` has to say."""
    if not arguments.explain or result.status == "complete":
        return []
    if result.explanation is not None:
        return result.explanation.lines()
    obstacle = result.report.get("obstacle")
    if isinstance(obstacle, dict):
        tried = [f"  tried {change}: {ended}" for change, ended in obstacle["tested"].items()]
        return [f"what stands in the way ({obstacle['kind']}): {obstacle['text']}", *tried]
    return ["--explain: no contact sequence with infeasible dynamics was found, so there is nothing to explain"]
