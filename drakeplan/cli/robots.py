"""`drakeplan robots`: which robots there are and where their models lie."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from drakeplan.cli.arguments import Packages
from scenes.input_error import InputError
from scenes.robots.addresses import read_packages
from scenes.robots.robot import Robot, load_robot, robot_names

ABOUT = """Lists the robots, or prints the model file of one.

The path that --path prints is absolute, and Drake loads that file without a package map: Parser().AddModels(PATH).

examples:
  drakeplan robots
  drakeplan robots --path escher
  drakeplan robots --json"""


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan robots`."""

    action: Annotated[Literal["list"], tyro.conf.Positional, tyro.conf.arg(metavar="list")] = "list"
    """what to do"""
    path: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """print the absolute path of this robot's model file (a robot name or robot file)"""
    package: Packages = ()
    """folder of package://NAME addresses in the robot's model; may be given several times"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Prints one path, or a line for each robot."""
    from drakeplan.cli.output import print_json

    if arguments.path is not None:
        robot = load_robot(arguments.path, read_packages(arguments.package))
        if arguments.json:
            print_json(_facts(robot))
        else:
            print(robot.model)
        return 0
    found = {name: _try_load(name) for name in robot_names()}
    if arguments.json:
        print_json(
            {"robots": [_facts(r) if isinstance(r, Robot) else {"name": n, "missing": r} for n, r in found.items()]}
        )
        return 0
    for name, robot in found.items():
        if isinstance(robot, Robot):
            print(f"{name:<10} {robot.mass:6.1f} kg   feet reach {robot.max_foot_translation} m   {robot.model}")
        else:
            print(f"{name:<10} not usable here: {robot}")
    return 0


def _try_load(name: str) -> Robot | str:
    """The robot, or why it cannot be loaded (its package may not be installed)."""
    try:
        return load_robot(name)
    except InputError as error:
        return str(error)


def _facts(robot: Robot) -> dict[str, object]:
    return {
        "name": robot.name,
        "path": str(robot.model),
        "sha256": robot.model_sha256,
        "mass": robot.mass,
        "effectors": {e.name: {"frame": e.frame, "half_extent": list(e.half_extent)} for e in robot.effectors},
    }
