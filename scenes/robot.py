"""A robot as data: a model file and a YAML file beside it that names its contact frames, limits and reaches."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from lxml import etree
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from scenes.effector import EFFECTORS
from scenes.input_error import InputError, unknown_name

ROBOTS = Path(__file__).parent / "robots"
MAX_FILE_SIZE = 1_000_000  # [bytes] no honest robot description is longer


@dataclass(frozen=True)
class EffectorSpec:
    """One end effector of a robot.

    Attributes:
        name: one of `EFFECTORS`.
        frame: body of the model whose frame is the contact frame: centre of the sole or palm, z out of the surface
            it presses on, x along the toes or fingers.
        half_extent: half length along x and half width along y of the patch that may carry load [m].
    """

    name: str
    frame: str
    half_extent: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Robot:
    """What planning needs to know of a robot; two are equal when their model and description are.

    Frame T is the approximated torso frame of Lin 2020 eq. 3.1 without its z offset: origin at the mean of the
    feet, yaw the mean of the feet's yaws. Points of the right side mirror y.

    Attributes:
        name: as users write it.
        model: the file that Drake's Parser loads alone.
        model_sha256: of that file.
        mass: [kg].
        effectors: in the order of `EFFECTORS`.
        base_body: the floating body.
        torso_body: the body that carries the arms.
        nominal: joint name -> angle of the standing posture [rad]; joints not named stand at 0.
        shoulder: (3,) left shoulder in T [m].
        hip: (3,) left hip in T [m].
        arm_reach: least and greatest distance of shoulder and palm patch [m].
        leg_reach: least and greatest distance of hip and sole [m].
        com_height: least, nominal and greatest height of the CoM over the mean of the feet [m].
        torso_box_centre: (3,) in T [m]; the box stands for trunk and thighs in searches.
        torso_box_size: (3,) full edges [m].
        max_foot_translation: how far a foot moves in one transition [m].
        max_palm_translation: how far a palm moves in one transition [m].
        max_step_height: greatest height between the feet [m].
        foot_separation: least and nominal lateral distance of the feet [m].
        force_limit: (4,) greatest normal force of each end effector, in multiples of M g.
        com_reach: (4,) greatest distance of the CoM from each contact [m].
    """

    name: str
    model: Path
    model_sha256: str
    mass: float
    effectors: tuple[EffectorSpec, ...]
    base_body: str
    torso_body: str
    nominal: dict[str, float]
    shoulder: np.ndarray
    hip: np.ndarray
    arm_reach: tuple[float, float]
    leg_reach: tuple[float, float]
    com_height: tuple[float, float, float]
    torso_box_centre: np.ndarray
    torso_box_size: np.ndarray
    max_foot_translation: float
    max_palm_translation: float
    max_step_height: float
    foot_separation: tuple[float, float]
    force_limit: np.ndarray
    com_reach: np.ndarray

    def __post_init__(self) -> None:
        for field in ("shoulder", "hip", "torso_box_centre", "torso_box_size", "force_limit", "com_reach"):
            array = np.array(getattr(self, field), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, field, array)

    @cached_property
    def half_extents(self) -> np.ndarray:
        """(4, 2) half length and half width of each patch [m], in the order of `EFFECTORS`."""
        return np.array([e.half_extent for e in self.effectors])

    @cached_property
    def q_nominal(self) -> np.ndarray:
        """(nq,) standing: soles at z = 0, mean of the feet at the origin, heading along x. Loads the model once."""
        from scenes.plant import build_plant

        q = build_plant(self).nominal_positions()
        q.setflags(write=False)
        return q


def robot_names() -> list[str]:
    """Names of the robots that come with drakeplan."""
    return sorted(p.stem for p in ROBOTS.glob("*/*.yaml") if p.stem == p.parent.name)


def load_robot(name: str | Path) -> Robot:
    """Reads a robot by name, or from a YAML file given by path.

    Raises:
        InputError: no such robot, or a description that is wrong.
    """
    text = str(name)
    if text.endswith((".yaml", ".yml")):
        path = Path(text)
    elif text in robot_names():
        path = ROBOTS / text / f"{text}.yaml"
    else:
        raise unknown_name("robot", text, robot_names())
    description = read_description(path)
    model = _model_file(path, description)
    return Robot(
        name=description.name,
        model=model,
        model_sha256=hashlib.sha256(model.read_bytes()).hexdigest(),
        mass=_mass(model),
        effectors=tuple(
            EffectorSpec(e, description.effectors[e].frame, description.effectors[e].half_extent) for e in EFFECTORS
        ),
        base_body=description.base_body,
        torso_body=description.torso_body,
        nominal=dict(description.nominal),
        shoulder=np.array(description.shoulder),
        hip=np.array(description.hip),
        arm_reach=description.arm_reach,
        leg_reach=description.leg_reach,
        com_height=description.com_height,
        torso_box_centre=np.array(description.torso_box.centre),
        torso_box_size=np.array(description.torso_box.size),
        max_foot_translation=description.max_foot_translation,
        max_palm_translation=description.max_palm_translation,
        max_step_height=description.max_step_height,
        foot_separation=description.foot_separation,
        force_limit=np.array([description.effectors[e].force_limit for e in EFFECTORS]),
        com_reach=np.array([description.effectors[e].com_reach for e in EFFECTORS]),
    )


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    if any(b < a for a, b in zip(values, values[1:], strict=False)):
        raise ValueError("expected numbers that do not decrease")
    return values


Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Point = tuple[Number, Number, Number]
Range = Annotated[tuple[Positive, Positive], AfterValidator(_ascending)]
Heights = Annotated[tuple[Positive, Positive, Positive], AfterValidator(_ascending)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class EffectorDescription(_Strict):
    """One end effector in the file."""

    frame: str
    half_extent: tuple[Positive, Positive]
    force_limit: Positive
    com_reach: Positive


class TorsoBox(_Strict):
    """Box that stands for the trunk, in T."""

    centre: Point
    size: tuple[Positive, Positive, Positive]


class RobotDescription(_Strict):
    """The YAML file; `Robot` says what each key means."""

    format: Literal["drakeplan-robot"]
    version: Literal[1]
    name: str
    model: str
    base_body: str
    torso_body: str
    effectors: dict[str, EffectorDescription]
    nominal: dict[str, Number]
    shoulder: Point
    hip: Point
    arm_reach: Range
    leg_reach: Range
    com_height: Heights
    torso_box: TorsoBox
    max_foot_translation: Positive
    max_palm_translation: Positive
    max_step_height: Positive
    foot_separation: Range


def read_description(path: Path) -> RobotDescription:
    """Reads and checks a robot's YAML file.

    Raises:
        InputError: it is missing, too large, no YAML, or a key is wrong; the line names file and key.
    """
    try:
        if path.stat().st_size > MAX_FILE_SIZE:
            raise InputError(f"{path}: larger than {MAX_FILE_SIZE} bytes, which no robot description is")
        document = yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)
        return RobotDescription.model_validate(document)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is no YAML ({error})") from None
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None


def _model_file(path: Path, description: RobotDescription) -> Path:
    model = (path.parent / description.model).resolve()
    if not model.is_file():
        raise InputError(f"{path}: model: there is no file {model}")
    return model


def _mass(model: Path) -> float:
    masses = etree.parse(str(model)).iterfind(".//link/inertial/mass")
    mass = sum(float(m.get("value")) for m in masses)
    if not math.isfinite(mass) or mass <= 0:
        raise InputError(f"{model}: the masses of its links add up to {mass}, expected a positive number")
    return mass
