"""`drakeplan export`: a plan in another tool's format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from drakeplan.cli.arguments import Packages
from drakeplan.export.formats import FORMATS, ExportOptions
from scenes.input_error import InputError

ABOUT = """Writes a plan in another tool's format. docs/export.md says what each holds: columns, units, frames, orders.

  csv        one table of the whole motion: base, joints, torques, CoM, momenta, contacts and forces
  npz        the same as NumPy arrays by name
  tracking   reference motion for tracking policies: base position, quaternion (w last), joints; no head
  crocoddyl  a Python script that solves a Crocoddyl problem from the plan, and a folder of data
  mujoco     an MJCF of robot and terrain with keyframes, a folder of assets, and a player
  contacts   contact phases as JSON, with the fields of multicontact-api; also of a plan of contacts only
  mcap       a log that Foxglove plays
  ros        ROS 2 JointTrajectory and MultiDOFJointTrajectory as YAML

The same plan gives the same bytes. mcap needs more packages: pip install 'drakeplan[export]'.

examples:
  drakeplan export plan.h5 --to csv --out plan.csv
  drakeplan export plan.h5 --to tracking --rate 50 --out plan_50hz.csv
  drakeplan export plan.h5 --to mujoco --out plan.xml && python plan_play.py
  drakeplan export plan.h5 --to crocoddyl --out solve_plan.py && python solve_plan.py
  drakeplan export plan.h5 --to mcap --out plan.mcap --json

exit status: 0 done, 2 the plan cannot be read or has no motion, a package is missing, or a file cannot be written"""

FormatName = Literal["csv", "npz", "tracking", "crocoddyl", "mujoco", "contacts", "mcap", "ros"]


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan export`."""

    plan: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PLAN.h5")]
    """the plan file"""
    to: Annotated[FormatName | None, tyro.conf.arg(metavar="FORMAT", help_behavior_hint="")] = None
    """one of the formats above"""
    out: Annotated[str | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """the file; what goes with it is put beside it and called after it"""
    rate: Annotated[int | None, tyro.conf.arg(metavar="HZ", help_behavior_hint="")] = None
    """rows per second of --to tracking, usually 30 (default) or 50"""
    robot: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
    """robot name or robot file (default: found by the plan's name and the SHA-256 of its model)"""
    package: Packages = ()
    """folder of package://NAME addresses in the robot's model; may be given several times"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Writes the files and says which."""
    if arguments.to is None:
        raise InputError(f"--to: a format is missing, expected one of {', '.join(FORMATS)}")
    if arguments.out is None:
        raise InputError("--out: a file is missing")
    if arguments.rate is not None and arguments.to != "tracking":
        raise InputError(f"--rate: only --to tracking has a rate, --to {arguments.to} has the plan's own times")
    from pathlib import Path

    from drakeplan.export import export_plan
    from drakeplan.export.formats import find_format
    from drakeplan.plan.plan_file import read_plan, require_writable
    from drakeplan.plan.robot_of_plan import RobotMark, find_robot
    from scenes.robots.addresses import read_packages

    found = find_format(arguments.to)
    require_writable(arguments.out)
    rate = ExportOptions.rate if arguments.rate is None else ExportOptions(arguments.rate).rate
    plan = read_plan(arguments.plan)
    if Path(arguments.out).exists() and Path(arguments.out).samefile(arguments.plan):
        raise InputError(f"--out: {arguments.out} is the plan itself")
    if found.needs_motion and plan.motion is None:
        raise InputError(
            f"{arguments.plan}: a plan of contacts only: --to contacts exports it, --to {arguments.to} needs a motion"
        )
    robot = None
    if found.needs_robot or arguments.robot is not None:
        robot = find_robot(RobotMark.of(plan), arguments.robot, read_packages(arguments.package))
    try:
        exported = export_plan(plan, arguments.to, arguments.out, robot=robot, rate=rate)
    except InputError as error:
        raise InputError(_with_file(str(error), arguments)) from None
    files = [str(path) for path in exported.files]
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json({"plan": arguments.plan, "to": arguments.to, "files": files, "facts": exported.facts})
    else:
        _print(files, exported.facts)
    return 0


def _with_file(message: str, arguments: Arguments) -> str:
    """The message, which names the plan file where it names no other."""
    return message if str(arguments.out) in message or arguments.plan in message else f"{arguments.plan}: {message}"


def _print(files: list[str], facts: dict[str, object]) -> None:
    """The files, a folder in one line, and the facts."""
    from collections import Counter
    from pathlib import Path

    many = Counter(str(Path(file).parent) for file in files[1:])
    for file in files:
        folder = str(Path(file).parent)
        if file == files[0] or folder == str(Path(files[0]).parent):
            print(file)
    for folder, count in many.items():
        if folder != str(Path(files[0]).parent):
            print(f"{folder}/ ({count} file{'s' if count > 1 else ''})")
    for key, value in facts.items():
        if key == "format":
            continue
        text = f"{value:.9g}" if isinstance(value, float) else str(value)
        if isinstance(value, dict):
            text = ", ".join(f"{k} {v}" for k, v in value.items())
        print(f"  {key.replace('_', ' '):<15} {text}")
