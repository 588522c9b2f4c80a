"""The YAML file that describes a robot, checked before anything is made of it."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from scenes.effector import EFFECTORS
from scenes.files.strict_yaml import key_path, load_yaml, read_text
from scenes.input_error import InputError


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    if any(b < a for a, b in pairwise(values)):
        raise ValueError("expected numbers that do not decrease")
    return values


def _known_effectors(effectors: dict[str, object]) -> dict[str, object]:
    if not set(EFFECTORS[:2]) <= set(effectors) <= set(EFFECTORS):
        feet, palms = " and ".join(EFFECTORS[:2]), " and ".join(EFFECTORS[2:])
        raise ValueError(f"expected {feet}, and {palms} where the robot has palms")
    return effectors


def _plain_name(name: str) -> str:
    """A robot's name is part of a folder's name."""
    if not re.fullmatch(r"\w[\w .+-]{0,63}", name):
        raise ValueError("expected letters, digits, spaces and . + - _, at most 64, the first a letter or digit")
    return name


def _printable(text: str) -> str:
    if not text.isprintable() or not text:
        raise ValueError("expected printable text")
    return text


Text = Annotated[str, AfterValidator(_printable)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Point = tuple[Number, Number, Number]
Range = Annotated[tuple[Positive, Positive], AfterValidator(_ascending)]
Heights = Annotated[tuple[Positive, Positive, Positive], AfterValidator(_ascending)]


PALM_KEYS = ("shoulder", "arm_reach", "max_palm_translation")  # only robots with palms have them


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class EffectorEntry(_Strict):
    """One end effector: its frame, patch [m], what reaches beyond it [m], force limit [M g], reach from the CoM [m]."""

    frame: str
    half_extent: tuple[Positive, Positive]
    overhang: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    force_limit: Positive
    com_reach: Positive


class TorsoBoxEntry(_Strict):
    """Box that stands for the trunk, in T [m]."""

    centre: Point
    size: tuple[Positive, Positive, Positive]


class FrameEntry(_Strict):
    """A contact frame to add: where it sits on a body of the model [m, rad]."""

    body: str
    xyz: Point
    rpy: Point = (0.0, 0.0, 0.0)


class ModelChanges(_Strict):
    """What is changed of a model.

    Attributes:
        frames: contact frames to add as links.
        fixed: joints that are welded, at these angles [rad]; joints that mimic are welded at 0 unless named.
        collide_as_drawn: bodies without collision shapes that take the shapes they are drawn with.
        one_hull: groups of welded bodies whose collision shapes become one convex hull on the first of them.
        ignored_pairs: bodies that may touch besides those that do in the nominal posture.
    """

    frames: dict[Text, FrameEntry] = {}
    fixed: dict[str, Number] = {}
    collide_as_drawn: list[str] = []
    one_hull: list[Annotated[list[str], Field(min_length=1)]] = []
    ignored_pairs: list[tuple[str, str]] = []


class PackageEntry(ModelChanges):
    """A model inside an installed Python distribution, which the adapter makes readable for Drake.

    Attributes:
        distribution: name on PyPI.
        folders: name in package:// addresses -> folder below site-packages.
        urdf: package:// address of the model.
    """

    distribution: str
    folders: dict[str, str]
    urdf: str


class RobotEntry(_Strict):
    """The whole file; `scenes.robots.robot.Robot` says what each key means.

    Palms may be missing, and with both of them `shoulder`, `arm_reach` and `max_palm_translation`. An effector's frame is a
    link of the model or one of `changes.frames`.
    """

    format: Literal["drakeplan-robot"]
    version: Literal[1]
    name: Annotated[str, AfterValidator(_plain_name)]
    model: Text | None = None
    changes: ModelChanges | None = None
    package: PackageEntry | None = None
    base_body: str
    torso_body: str
    effectors: Annotated[dict[str, EffectorEntry], AfterValidator(_known_effectors)]
    nominal: dict[str, Number]
    shoulder: Point | None = None
    hip: Point
    arm_reach: Range | None = None
    leg_reach: Range
    com_height: Heights
    torso_box: TorsoBoxEntry
    max_foot_translation: Positive
    max_palm_translation: Positive | None = None
    max_step_height: Positive
    foot_separation: Range

    @model_validator(mode="after")
    def _one_source(self) -> RobotEntry:
        if (self.model is None) == (self.package is None):
            raise ValueError("expected either model (a URDF, SDF or MJCF file) or package")
        if self.package is not None and self.changes is not None:
            raise ValueError("changes: expected them inside package")
        return self

    @model_validator(mode="after")
    def _arms_of_palms(self) -> RobotEntry:
        if self.has_palms:
            for key in PALM_KEYS:
                if getattr(self, key) is None:
                    raise ValueError(f"{key}: expected it for a robot with palms")
        return self

    @property
    def has_palms(self) -> bool:
        """Whether at least one palm is described."""
        return any(name in self.effectors for name in EFFECTORS[2:])


def read_robot_file(path: Path) -> RobotEntry:
    """Reads and checks a robot's YAML file.

    Raises:
        InputError: it is missing, too large, no YAML, or a key is wrong; the line names file and key.
    """
    data = load_yaml(read_text(path), str(path))
    if not isinstance(data, dict) or data.get("format") != "drakeplan-robot":
        raise InputError(f"{path}: format: expected a robot file that says 'format: drakeplan-robot'")
    try:
        return RobotEntry.model_validate(data)
    except ValidationError as error:
        problems = error.errors(include_url=False)
        first = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
        where = key_path(list(first["loc"]))
        raise InputError(
            f"{path}: {where + ': ' if where else ''}{first['msg'].removeprefix('Value error, ')}"
        ) from None
