"""`drakeplan robots`: which robots there are, and how to add one's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from drakeplan.cli.arguments import Packages
from drakeplan.cli.robot_facts import robot_facts
from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.robots.addresses import read_packages
from scenes.robots.robot import Robot, load_robot, own_robot_names, robot_names

ABOUT = """Lists the robots, prints the model file of one, adds a robot of your own, or checks what a robot can do.

add reads a URDF, SDF or MJCF model, by its path or as PACKAGE/FILE of an installed Python package. It finds base, feet, hands,
soles and palms, a posture that stands, reaches and limits, and writes a robot file with a comment at each value that says where it
comes from: to --out DIR, else to your data folder, where --robot finds it by name.

check asks whether the robot stands, shifts its weight, steps, leans its palms on a wall and climbs a stair.

The path that --path prints is absolute, and Drake loads that file without a package map: Parser().AddModels(PATH).

examples:
  drakeplan robots
  drakeplan robots --path escher
  drakeplan robots add my_robot.urdf --package my_description=DIR --name my_robot
  drakeplan robots add robot.urdf --left-foot l_sole --right-foot r_sole --out robots --picture robot.png
  drakeplan robots add example-robot-data/romeo.urdf --name romeo
  drakeplan robots check my_robot
  drakeplan plan stairs --robot my_robot

exit status of check: 0 the robot can do all of it, 1 it cannot, 2 it cannot be read"""


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan robots`."""

    action: Annotated[
        Literal["list", "add", "check"], tyro.conf.Positional, tyro.conf.arg(metavar="list|add|check")
    ] = "list"
    """what to do"""
    robot: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="MODEL|NAME")] = ""
    """with add: the model; with check: a robot's name or robot file"""
    path: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """print the absolute path of this robot's model file (a robot name or robot file)"""
    name: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
    """with add: what the robot is called (default: the model file's name)"""
    out: Annotated[str | None, tyro.conf.arg(metavar="DIR", help_behavior_hint="")] = None
    """with add: where NAME.yaml is written (default: your data folder)"""
    picture: Annotated[str | None, tyro.conf.arg(metavar="FILE.png", help_behavior_hint="")] = None
    """with add and check: the robot from four sides as it was understood (add: default NAME.png beside the robot file)"""
    left_foot: Annotated[str | None, tyro.conf.arg(metavar="LINK", help_behavior_hint="")] = None
    """with add: link of the left foot, where it is not found"""
    right_foot: Annotated[str | None, tyro.conf.arg(metavar="LINK", help_behavior_hint="")] = None
    """with add: link of the right foot"""
    left_palm: Annotated[str | None, tyro.conf.arg(metavar="LINK", help_behavior_hint="")] = None
    """with add: link of the left hand"""
    right_palm: Annotated[str | None, tyro.conf.arg(metavar="LINK", help_behavior_hint="")] = None
    """with add: link of the right hand"""
    replace: bool = False
    """with add: replace a robot of this name that was added before"""
    seed: int = 0
    """with add and check: of random postures and of the crossings"""
    package: Packages = ()
    """folder of package://NAME addresses in the robot's model; may be given several times"""
    json: bool = False
    """one JSON object on standard output"""


ADD_ONLY = ("name", "out", "left_foot", "right_foot", "left_palm", "right_palm", "replace")


def run(arguments: Arguments) -> int:
    """Does what `action` says."""
    _check_options(arguments)
    if arguments.action == "list":
        return _list(arguments) if arguments.path is None else _path(arguments)
    from drakeplan.cli import robots_add

    packages = read_packages(arguments.package)
    if arguments.action == "check":
        return robots_add.check(arguments.robot, packages, arguments.picture, arguments.seed, arguments.json)
    wanted = {
        "name": arguments.name,
        "folder": arguments.out,
        "picture": arguments.picture,
        "links": {e: link for e in EFFECTORS if (link := getattr(arguments, e)) is not None},
        "replace": arguments.replace,
        "seed": arguments.seed,
    }
    return robots_add.add(arguments.robot, packages, wanted, arguments.json)


def _check_options(arguments: Arguments) -> None:
    action = arguments.action
    if action == "list" and arguments.robot:
        raise InputError(f"drakeplan robots list: expected nothing after it, got {arguments.robot!r}")
    if action != "list" and not arguments.robot:
        what = "MODEL (a URDF, SDF or MJCF file)" if action == "add" else "NAME (a robot's name or robot file)"
        raise InputError(f"drakeplan robots {action}: expected {what} after it")
    if action != "list" and arguments.path is not None:
        raise InputError(f"--path: goes with drakeplan robots, not with drakeplan robots {action}")
    for key in ADD_ONLY:
        if action != "add" and getattr(arguments, key):
            raise InputError(f"--{key.replace('_', '-')}: goes with drakeplan robots add")
    if action == "list" and arguments.picture is not None:
        raise InputError("--picture: goes with drakeplan robots add and check")
    if arguments.seed < 0:
        raise InputError(f"--seed: expected 0 or more, got {arguments.seed}")


def _path(arguments: Arguments) -> int:
    robot = load_robot(str(arguments.path), read_packages(arguments.package))
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json(robot_facts(robot))
    else:
        print(robot.model)
    return 0


def _list(arguments: Arguments) -> int:
    found = {name: _try_load(name) for name in robot_names()}
    if arguments.json:
        from drakeplan.cli.output import print_json

        print_json(
            {
                "robots": [
                    robot_facts(r) if isinstance(r, Robot) else {"name": n, "missing": r} for n, r in found.items()
                ]
            }
        )
        return 0
    own = own_robot_names()
    width = max([10, *map(len, found)])
    for name, robot in found.items():
        if isinstance(robot, Robot):
            added = "   added by you" if name in own else ""
            print(
                f"{name:<{width}} {robot.mass:6.1f} kg   feet reach {robot.max_foot_translation} m   {robot.model}{added}"
            )
        else:
            print(f"{name:<{width}} not usable here: {robot}")
    return 0


def _try_load(name: str) -> Robot | str:
    """The robot, or why it cannot be loaded (its package may not be installed)."""
    try:
        return load_robot(name)
    except InputError as error:
        return str(error)
