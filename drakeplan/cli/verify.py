"""`drakeplan verify`: the independent check of a plan file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from drakeplan.cli.arguments import Packages
from scenes.input_error import InputError

ABOUT = """Checks a plan file: contacts, friction, momentum, motion, limits, collisions, start and goal.

It reads the file and the robot's model alone and shares no code with the planner. One line a check: the worst value,
its limit and where it occurs.

examples:
  drakeplan verify plan.h5
  drakeplan verify plan.h5 --robot my_robot.yaml --json

exit status: 0 the plan holds, 1 it does not, 2 it cannot be read"""


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan verify`."""

    plan: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN.h5")]
    """the plan file"""
    robot: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
    """robot name or robot file (default: found by the plan's name and the SHA-256 of its model)"""
    package: Packages = ()
    """folder of package://NAME addresses in the robot's model; may be given several times"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Prints the report; 0 when every check holds, else 1."""
    from drakeplan.plan.robot_of_plan import model_for
    from drakeplan.verifier import UnreadablePlan, verify
    from scenes.robots.addresses import read_packages

    model = model_for(arguments.plan, arguments.robot, read_packages(arguments.package))
    try:
        report = verify(arguments.plan, model)
    except UnreadablePlan as error:
        raise InputError(str(error)) from None
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json(report.as_dict())
    else:
        print(report.table())
    return 0 if report.holds else 1
