"""The robot of a campaign by its name, kept between the tasks of one worker."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.robots.robot import Robot, load_robot

Packages = tuple[tuple[str, str], ...]  # names and folders of package:// addresses in the robot's model


@lru_cache(maxsize=2)
def campaign_robot(name: str, packages: Packages) -> Robot:
    """The robot of this name.

    Args:
        name: of the robot, or its file.
        packages: of its model.

    Raises:
        InputError: no such robot.
    """
    return load_robot(name, {package: Path(folder) for package, folder in packages})


@lru_cache(maxsize=1)
def campaign_ik(name: str, packages: Packages) -> WholeBodyIK:
    """Its inverse kinematics.

    Args:
        name: of the robot, or its file.
        packages: of its model.

    Raises:
        InputError: no such robot.
    """
    return WholeBodyIK(campaign_robot(name, packages))
