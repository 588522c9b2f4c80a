"""A robot as data: a model file and a YAML file beside it that names its contact frames, limits and reaches."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import platformdirs
from lxml import etree  # type: ignore[attr-defined]

from scenes.effector import EFFECTORS, LEFT_PALM, RIGHT_PALM
from scenes.input_error import InputError, unknown_name
from scenes.robots.model_file import MODEL_SUFFIXES, find_model
from scenes.robots.schema import RobotEntry, read_robot_file

ROBOTS = Path(__file__).parent
LEAST_TORSO = 1 / 3  # of the torso box's height that stays however far the robot lowers itself


@dataclass(frozen=True)
class EffectorSpec:
    """One end effector of a robot.

    Attributes:
        name: one of `EFFECTORS`.
        frame: body of the model whose frame is the contact frame: centre of the sole or palm, z out of the surface
            it presses on, x along the toes or fingers.
        half_extent: half length along x and half width along y of the patch that may carry load [m]; 0 of a palm that
            the robot does not have.
        overhang: how far the foot reaches beyond its patch to the front, to the back and to each side [m]; it needs
            room there, but no ground. Palms have none.
    """

    name: str
    frame: str
    half_extent: tuple[float, float]
    overhang: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Robot:
    """What planning needs to know of a robot.

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
        force_limit: (4,) greatest normal force of each end effector, in multiples of M g; a foot's for a missing palm.
        com_reach: (4,) greatest distance of the CoM from each contact [m].
        source: the robot file.
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
    source: Path = Path()

    def __post_init__(self) -> None:
        for field in ("shoulder", "hip", "torso_box_centre", "torso_box_size", "force_limit", "com_reach"):
            array = np.array(getattr(self, field), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, field, array)

    @property
    def given_by_path(self) -> bool:
        """Whether it is described by a user's file, not by one that comes with drakeplan."""
        return not self.source.is_relative_to(ROBOTS.resolve())

    @property
    def palms(self) -> tuple[int, ...]:
        """The palms that the robot has, as indices into `EFFECTORS`."""
        return tuple(e for e in (LEFT_PALM, RIGHT_PALM) if min(self.effectors[e].half_extent) > 0.0)

    @cached_property
    def lowest_torso_box(self) -> tuple[np.ndarray, np.ndarray]:
        """(3,) centre in T and (3,) edges of what the torso box occupies however far the robot lowers itself [m].

        Its top comes down with the CoM, to the least height of that; its bottom stays, for the knees go forward there.
        """
        centre, size = self.torso_box_centre.copy(), self.torso_box_size.copy()
        drop = min(self.com_height[1] - self.com_height[0], (1.0 - LEAST_TORSO) * float(size[2]))
        size[2] -= drop
        centre[2] -= 0.5 * drop
        return centre, size

    @cached_property
    def half_extents(self) -> np.ndarray:
        """(4, 2) half length and half width of each patch [m], in the order of `EFFECTORS`."""
        return np.array([e.half_extent for e in self.effectors])


def own_robots_folder() -> Path:
    """Where `drakeplan robots add` puts the robots of a user: a folder each, with a robot file of the same name."""
    return Path(platformdirs.user_data_dir("drakeplan")) / "robots"


def robot_names() -> list[str]:
    """Names of the robots that come with drakeplan, then of those that the user added."""
    shipped = {p.stem for p in ROBOTS.glob("*/*.yaml") if p.stem == p.parent.name}
    return sorted(shipped) + sorted(own_robot_names() - shipped)


def own_robot_names() -> set[str]:
    """Names of the robots that the user added."""
    try:
        return {p.stem for p in own_robots_folder().glob("*/*.yaml") if p.stem == p.parent.name}
    except OSError:
        return set()


def load_robot(name: str | Path, packages: Mapping[str, Path] | None = None) -> Robot:
    """Reads a robot by name, or from a YAML file given by path.

    Args:
        name: of a robot that comes with drakeplan or was added by the user, or a path that ends in .yaml or .yml.
        packages: folders of package:// addresses by package name, besides those that the robot file names.

    Raises:
        InputError: no such robot, or a description that is wrong.
    """
    text = str(name)
    if text.endswith((".yaml", ".yml")):
        path = Path(text)
        return _robot(path, read_robot_file(path), packages)
    if Path(text).suffix.lower() in MODEL_SUFFIXES:
        raise InputError(
            f"{text}: a model, expected a robot's name or its YAML file: drakeplan robots add {text} makes one"
        )
    if text not in robot_names():
        raise unknown_name("robot", text, robot_names())
    path = robot_path(text)
    own = not path.is_relative_to(ROBOTS)
    return _named_robot(text) if not (packages or own) else _robot(path, read_robot_file(path), packages)


def robot_path(name: str) -> Path:
    """The YAML file of a robot that comes with drakeplan, or that the user added.

    Args:
        name: one of `robot_names()`.
    """
    shipped = ROBOTS / name / f"{name}.yaml"
    return shipped if shipped.is_file() else own_robots_folder() / name / f"{name}.yaml"


@lru_cache(maxsize=8)
def _named_robot(name: str) -> Robot:
    path = robot_path(name)
    return _robot(path, read_robot_file(path), None)


def _robot(path: Path, entry: RobotEntry, packages: Mapping[str, Path] | None) -> Robot:
    model = find_model(path, entry, packages or {})
    tree = _read_model(model)
    _check_names(path, entry, tree)
    torso = entry.torso_box
    described = [entry.effectors.get(n, entry.effectors[EFFECTORS[0]]) for n in EFFECTORS]  # a missing palm: as a foot
    above = (0.0, 0.0, torso.centre[2] + 0.5 * torso.size[2])  # where shoulders would be
    return Robot(
        name=entry.name,
        model=model,
        model_sha256=hashlib.sha256(model.read_bytes()).hexdigest(),
        mass=_mass(model, tree),
        effectors=tuple(_effector(entry, name) for name in EFFECTORS),
        base_body=entry.base_body,
        torso_body=entry.torso_body,
        nominal=dict(entry.nominal),
        shoulder=np.array(entry.shoulder or above),
        hip=np.array(entry.hip),
        arm_reach=entry.arm_reach or (0.0, 0.0),
        leg_reach=entry.leg_reach,
        com_height=entry.com_height,
        torso_box_centre=np.array(torso.centre),
        torso_box_size=np.array(torso.size),
        max_foot_translation=entry.max_foot_translation,
        max_palm_translation=entry.max_palm_translation or 0.0,
        max_step_height=entry.max_step_height,
        foot_separation=entry.foot_separation,
        force_limit=np.array([e.force_limit for e in described]),
        com_reach=np.array([e.com_reach for e in described]),
        source=path.resolve(),
    )


def _effector(entry: RobotEntry, name: str) -> EffectorSpec:
    """An end effector; its frame has its name, the model's own where that loads as it is."""
    found = entry.effectors.get(name)
    if found is None:
        return EffectorSpec(name, name, (0.0, 0.0))
    return EffectorSpec(name, name, found.half_extent, found.overhang)


def _read_model(model: Path) -> etree._ElementTree:
    try:
        return etree.parse(str(model), etree.XMLParser(resolve_entities=False, no_network=True))
    except (etree.XMLSyntaxError, OSError) as error:
        raise InputError(f"{model}: not a readable URDF ({error})") from None


def _mass(model: Path, tree: etree._ElementTree) -> float:
    try:
        mass = sum(float(m.get("value", "nan")) for m in tree.iterfind(".//link/inertial/mass"))
    except ValueError:
        mass = math.nan
    if not math.isfinite(mass) or mass <= 0:
        raise InputError(f"{model}: the masses of its links add up to {mass}, expected a positive number")
    return mass


def _check_names(path: Path, entry: RobotEntry, tree: etree._ElementTree) -> None:
    links, joints = ({e.get("name") for e in tree.iterfind(tag)} for tag in ("link", "joint"))
    for key, link in {"base_body": entry.base_body, "torso_body": entry.torso_body}.items():
        if link not in links:
            raise InputError(f"{path}: {key}: the model has no link {link!r}")
    still = {e.get("name") for e in tree.iterfind("joint") if e.get("type") == "fixed"}
    for joint in entry.nominal:
        if joint not in joints:
            raise InputError(f"{path}: nominal: the model has no joint {joint!r}")
        if joint in still:
            raise InputError(f"{path}: nominal.{joint}: the joint does not move in the model")
