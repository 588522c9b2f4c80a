"""`drakeplan verify`: the independent check of a plan file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from scenes.input_error import InputError

ABOUT = """Checks a plan file: contacts, friction, momentum, motion, limits, collisions, start and goal.

It reads the file and the robot's model alone and shares no code with the planner. One line a check: the worst value,
its limit and where it occurs.

examples:
  drakeplan verify plan.h5
  drakeplan verify plan.h5 --json

exit status: 0 the plan holds, 1 it does not, 2 it cannot be read"""


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan verify`."""

    plan: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN.h5")]
    """the plan file"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Prints the report; 0 when every check holds, else 1."""
    from drakeplan.verifier import UnreadablePlan, verify

    try:
        report = verify(arguments.plan)
    except UnreadablePlan as error:
        raise InputError(str(error)) from None
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json(report.as_dict())
    else:
        print(report.table())
    return 0 if report.holds else 1
