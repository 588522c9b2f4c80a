"""`drakeplan simulate`: a plan played in physics."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Annotated

import tyro

from drakeplan.cli.arguments import Packages
from scenes.input_error import InputError

ABOUT = """Plays a plan in Drake's physics: a controller finds torques that follow the plan, feet and palms touch, slip and let go.

It says whether the robot stands at the goal in the end, or when it fell, where in the plan, and what gave way.
--html shows the simulated motion in place of the planned one, at the plan's times, until where it ended.

examples:
  drakeplan simulate plan.h5
  drakeplan simulate plan.h5 --html played.html
  drakeplan simulate plan.h5 --push 0 0.2 0 --at 4.5
  drakeplan simulate plan.h5 --friction 0.45 --noise 1 --json

exit status: 0 the robot stands at the goal, 1 it does not, 2 the plan cannot be read or has no motion"""


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan simulate`."""

    plan: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN.h5")]
    """the plan file"""
    robot: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
    """robot name or robot file (default: found by the plan's name and the SHA-256 of its model)"""
    package: Packages = ()
    """folder of package://NAME addresses in the robot's model; may be given several times"""
    friction: Annotated[float | None, tyro.conf.arg(metavar="MU", help_behavior_hint="")] = None
    """of all terrain (default: as planned)"""
    push: Annotated[tuple[float, ...], tyro.conf.arg(metavar="X Y Z", help_behavior_hint="")] = ()
    """change of the whole robot's velocity [m/s], at --at"""
    at: Annotated[float, tyro.conf.arg(metavar="T")] = 1.0
    """when it is pushed [s]"""
    noise: Annotated[float, tyro.conf.arg(metavar="N")] = 0.0
    """of what is measured: 1 is 2 mm of the base, 0.5 mrad and 10 mrad/s of the joints"""
    seed: Annotated[int, tyro.conf.arg(metavar="N")] = 0
    """of the noise"""
    html: Annotated[str | None, tyro.conf.arg(metavar="PAGE.html")] = None
    """write the simulated motion as a page"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Plays the plan; 0 when the robot stands at the goal, else 1."""
    _check(arguments)
    from drakeplan.execution import ExecutionOptions, Physics, play_plan
    from drakeplan.execution.played import played_plan
    from drakeplan.plan.plan_file import read_plan, require_writable
    from drakeplan.plan.robot_of_plan import RobotMark, find_robot
    from drakeplan.progress import ProgressEvent, ProgressPrinter
    from scenes.robots.addresses import read_packages

    if arguments.html is not None:
        require_writable(arguments.html)
    plan = read_plan(arguments.plan)
    if plan.motion is None:
        raise InputError(f"{arguments.plan}: a plan of contacts only: there is no motion to play")
    robot = find_robot(RobotMark.of(plan), arguments.robot, read_packages(arguments.package))
    push = arguments.push
    options = ExecutionOptions(
        physics=Physics(friction=arguments.friction),
        push=(arguments.at, (push[0], push[1], push[2])) if push else None,
        noise=arguments.noise,
        seed=arguments.seed,
    )
    with ProgressPrinter(sys.stderr) as progress:

        def tell(s: float, duration: float) -> None:
            tenth = 10 * int(10.0 * min(s / duration, 1.0))  # a line for each tenth where there is no terminal
            progress(ProgressEvent("simulate", f"{tenth} % of {duration:.1f} s"))

        report = play_plan(plan, str(robot.model), options, tell)
        if arguments.html is not None:
            from drakeplan.playback import write_page

            progress(ProgressEvent("write", arguments.html))
            write_page(played_plan(plan, report), arguments.html, robot)
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json({"plan": arguments.plan, **report.as_dict(), "html": arguments.html})
    else:
        print(report.text())
        if arguments.html is not None:
            print(f"  html  {arguments.html}")
    return 0 if report.reached else 1


def _check(arguments: Arguments) -> None:
    """Raises InputError for a number that cannot be."""
    if arguments.friction is not None and not 0.0 < arguments.friction <= 10.0:
        raise InputError(f"--friction: expected a number above 0 and at most 10, got {arguments.friction:g}")
    if arguments.push and not (len(arguments.push) == 3 and all(abs(v) <= 10.0 for v in arguments.push)):
        raise InputError("--push: expected three numbers X Y Z, at most 10 m/s each")
    if not 0.0 <= arguments.at < 1e6:
        raise InputError(f"--at: expected a time in seconds, got {arguments.at:g}")
    if not 0.0 <= arguments.noise <= 100.0:
        raise InputError(f"--noise: expected 0 to 100, got {arguments.noise:g}")
    if arguments.seed < 0:
        raise InputError(f"--seed: expected a number from 0 on, got {arguments.seed}")
