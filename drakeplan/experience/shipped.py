"""Libraries that come with the package, one folder a robot."""

from __future__ import annotations

from pathlib import Path

from scenes.input_error import InputError
from scenes.robots.robot import Robot

SHIPPED = Path(__file__).parent / "libraries"


def library_folder(robot: Robot, chosen: str = "") -> Path:
    """The folder of the library to use.

    Args:
        robot: who shall use it.
        chosen: a folder that the user named; "" for the one that comes with the robot.

    Raises:
        InputError: no library comes with the robot.
    """
    if chosen:
        return Path(chosen)
    folder = SHIPPED / robot.name
    if not folder.is_dir():
        raise InputError(
            f"no library comes with robot {robot.name!r}: drakeplan library build --library DIR --robot {robot.name} makes "
            "one, and plan --library DIR uses it"
        )
    return folder
