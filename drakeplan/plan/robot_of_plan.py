"""Finds the robot that a plan was made for: by name and SHA-256 of its model, or where the user says."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import h5py

from scenes.input_error import InputError
from scenes.robots.robot import Robot, load_robot, robot_names

ROBOT_FILE = "robot_file"  # key of a plan's provenance: the robot file that was given by path


class Planned(Protocol):
    """What of a plan names its robot."""

    @property
    def robot(self) -> str: ...
    @property
    def robot_model_sha256(self) -> str: ...
    @property
    def provenance(self) -> Mapping[str, object]: ...


@dataclass(frozen=True)
class RobotMark:
    """What a plan says of its robot.

    Attributes:
        name: of the robot.
        sha256: of its model.
        file: the robot file it was planned with, "" for a robot that comes with drakeplan.
    """

    name: str
    sha256: str
    file: str = ""

    @classmethod
    def of(cls, plan: Planned) -> RobotMark:
        """The mark of a plan in memory."""
        return cls(plan.robot, plan.robot_model_sha256, str(plan.provenance.get(ROBOT_FILE, "")))

    @classmethod
    def of_file(cls, path: str | Path) -> RobotMark | None:
        """The mark of a plan file; None where the file cannot be read."""
        try:
            with h5py.File(path, "r") as file:
                name, sha256 = (str(file.attrs[key]) for key in ("robot", "robot_model_sha256"))
                return cls(name, sha256, str(json.loads(str(file.attrs["provenance"])).get(ROBOT_FILE, "")))
        except (OSError, KeyError, ValueError, RuntimeError, TypeError, AttributeError):
            return None


def find_robot(mark: RobotMark, robot: str | Path | None = None, packages: Mapping[str, Path] | None = None) -> Robot:
    """The robot of a plan.

    Args:
        mark: what the plan says of it.
        robot: name or robot file that the user gives; None: the robot of that name, or the file of the plan.
        packages: folders of package:// addresses by package name.

    Raises:
        InputError: no robot here has the model that the plan was made for.
    """
    if robot is not None:
        found = load_robot(robot, packages)
        if found.model_sha256 == mark.sha256:
            return found
        raise InputError(
            f"--robot {robot}: the plan was made for another model of {mark.name} "
            f"(sha256 {mark.sha256[:12]}, here {found.model_sha256[:12]})"
        )
    for place in [n for n in robot_names() if n == mark.name] + [f for f in [mark.file] if f and Path(f).is_file()]:
        try:
            found = load_robot(place, packages)
        except InputError:
            continue
        if found.model_sha256 == mark.sha256:
            return found
    was = f", which was {mark.file}" if mark.file else ""
    raise InputError(
        f"the plan was made for a model of {mark.name} (sha256 {mark.sha256[:12]}) that is not here: add --robot FILE with "
        f"its robot file{was}"
    )


def model_for(
    path: str | Path, robot: str | Path | None = None, packages: Mapping[str, Path] | None = None
) -> Path | None:
    """The model to verify a plan file with; None for the one that the file names.

    Args:
        path: the plan file.
        robot: name or robot file that the user gives.
        packages: folders of package:// addresses by package name.

    Raises:
        InputError: the robot that the user gives is not the plan's.
    """
    if robot is not None:
        return load_robot(robot, packages).model
    mark = RobotMark.of_file(path)
    if mark is None:
        return None
    try:
        return find_robot(mark, None, packages).model
    except InputError:
        return None
