"""The formats that a plan can be exported to: one module each, imported when it is asked for.

An exporter is a module with one function, `export`; it reads a `Source` and returns the files' bytes. It writes nothing
itself, so that a file is whole or absent whatever goes wrong.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

from scenes.input_error import InputError, unknown_name

if TYPE_CHECKING:
    from drakeplan.export.source import Source

INSTALL = "pip install 'drakeplan[export]'"


@dataclass(frozen=True)
class ExportOptions:
    """Choices that some formats offer.

    Attributes:
        rate: rows per second of `tracking` [Hz].
    """

    rate: int = 30

    def __post_init__(self) -> None:
        if not 1 <= self.rate <= 1000:
            raise InputError(f"rate: expected 1 to 1000 rows per second, got {self.rate}")


@dataclass(frozen=True)
class Product:
    """The files of one export, in memory.

    Attributes:
        main: content of the file that the user names.
        beside: path relative to that file's folder -> content of a file that goes with it.
        facts: what was written, for people and for `--json`.
    """

    main: bytes
    beside: Mapping[str, bytes] = field(default_factory=dict)
    facts: Mapping[str, object] = field(default_factory=dict)


class Exporter(Protocol):
    """What a format's module offers."""

    def export(self, source: Source, file: Path, options: ExportOptions) -> Product:
        """The files of a plan in this format.

        Args:
            source: the plan, with its robot where the format needs it.
            file: where the main file will be; it only names the others.
            options: what the user chose.
        """
        ...


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        module: of `drakeplan.export` that writes it.
        what: in one line.
        needs_motion: whether a plan of contacts only is too little.
        needs_robot: whether the robot's model is read.
        packages: modules that must be installed.
    """

    module: str
    what: str
    needs_motion: bool = True
    needs_robot: bool = False
    packages: tuple[str, ...] = ()


FORMATS = {
    "csv": Format("csv_table", "one table of the whole motion, with units, frames and orders in its head"),
    "npz": Format("numpy_archive", "the same as NumPy arrays by name"),
    "tracking": Format("tracking", "reference motion for tracking policies (base, quaternion, joints at a fixed rate)"),
    "crocoddyl": Format(
        "crocoddyl_problem", "a script that solves a Crocoddyl problem from the plan", needs_robot=True
    ),
    "mujoco": Format("mujoco_scene", "an MJCF of robot and terrain with keyframes, and a player", needs_robot=True),
    "contacts": Format("contact_sequence", "contact phases as JSON, after multicontact-api", needs_motion=False),
    "mcap": Format(
        "foxglove_log",
        "a log that Foxglove plays",
        needs_robot=True,
        packages=("mcap", "mcap_protobuf", "foxglove_schemas_protobuf"),
    ),
    "ros": Format("ros_trajectory", "ROS 2 JointTrajectory and MultiDOFJointTrajectory as YAML"),
}


def find_format(name: str) -> Format:
    """The format of this name, with all that it needs installed.

    Raises:
        InputError: no such format, or a package is missing.
    """
    if name not in FORMATS:
        raise unknown_name("format", name, FORMATS)
    missing = [p for p in FORMATS[name].packages if not _is_installed(p)]
    if missing:
        raise InputError(f"--to {name} needs the package {missing[0]}, which is not installed: {INSTALL}")
    return FORMATS[name]


def load_exporter(found: Format) -> Exporter:
    """The module that writes a format."""
    return cast(Exporter, import_module(f"drakeplan.export.{found.module}"))


def _is_installed(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except (ImportError, ValueError):  # a name that sys.modules says is not there
        return False
