"""Decides whether a plan file holds, from the file and the robot's model alone.

It shares no code with what made the plan: it imports NumPy, SciPy, h5py, yaml and pydrake, and a test holds it to that.
It is one file, long as it is, so that whoever doubts a plan can read one file from top to bottom and run it by itself
(`python verifier.py PLAN.h5`). The sections: what is demanded; the report; reading; contacts; stances and phases;
forces and momentum; motion; collision; where it starts and ends.

Every check names its worst value, its limit and the place. The plan holds when every check does.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportReturnType=false

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
import scipy.optimize
import scipy.sparse
import yaml
from pydrake.geometry import Convex, Role
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder

# ---- what is demanded

FORMAT, VERSION = "drakeplan-plan", 1
EFFECTORS = ("left_foot", "right_foot", "left_palm", "right_palm")
GRAVITY = np.array([0.0, 0.0, -9.81])  # [m/s^2] W

ON_SURFACE = 1e-3  # [m] contact point off its surface
INSIDE = 1e-3  # [m] corner of a patch outside its surface's outline
ALONG_NORMAL = 1e-3  # [rad] contact frame's z off the surface's normal
COVERED = 3e-3  # [m] what rises less than this over a patch does not cover it
BESIDE = 3e-3  # [m] plates that touch a patch's rim by less than this do not cover it
HEAD_ROOM = {"foot": 0.09, "palm": 0.05}  # [m] height over a patch that the foot or hand itself fills
FOOT_MAX_TILT, PALM_TILT = np.deg2rad(45.0), (np.deg2rad(45.0), np.deg2rad(135.0))  # where a surface names no effectors
PATCH_OFF_BODY = 0.01  # [m] corner of a sole or palm patch off the body that should carry it

SAME_TIME = 1e-6  # [s]
KNOT_SPACING, FRAME_SPACING = 0.2001, 0.0201  # [s] between momentum knots; 50 Hz between frames
RESIDUAL = 1e-6  # [M g, M g m, m] of the discrete equations
WRENCH = 1e-6  # [M g, M g m] of a contact wrench from the admissible set
AT_REST = 1e-3  # [m/s, m^2/s per kg, rad/s] at start and end
BALANCE = 1e-4  # [M g, M g m] of gravity from what the first and last contacts can carry

HELD_POSITION, HELD_ANGLE = 5e-3, np.deg2rad(1.0)  # [m, rad] of an end effector that holds a contact
JOINT_LIMIT, SPEED_LIMIT = 1e-4, 1e-3  # [rad, rad/s] past a joint's limits
VELOCITY = 0.4  # [rad/s, m/s] velocities against differences of the positions: curvature within one frame
QUATERNION = 1e-6  # norm off one
COM = 0.02  # [m] the model's CoM off the plan's
PENETRATION, SOLE_PENETRATION = 5e-3, 0.01  # [m]
MASS = 1e-6  # relative
START_DISTANCE, START_YAW = 0.15, np.deg2rad(5.0)  # [m, rad] set-down may move the feet off rough ground
START_EXACT, START_EXACT_ANGLE = 1e-3, 1e-3  # [m, rad] where the scene gives the stance itself
GOAL_YAW = np.deg2rad(15.0)

PLATE_THICKNESS = 0.02  # [m] a surface that stands alone is a plate that reaches this far behind its face
TOUCH = 1e-4  # [m] what overlaps less is touching
TRIANGLE_DEPTH = 0.01  # [m] a mesh's triangle reaches this far behind its face, tapered so that ridges stay sharp
MAX_FILE, MAX_YAML = 1 << 30, 1 << 26  # [bytes]


@dataclass(frozen=True)
class Cone:
    """A friction cone whose cross-section is a regular polygon; `sides` 0 is the true, round cone.

    Attributes:
        sides: of the polygon.
        radius: circumradius at unit friction and unit normal force.
        phase: angle of the first vertex from the contact frame's x axis [rad].
    """

    sides: int
    radius: float = 1.0
    phase: float = 0.0

    def gauge(self, tangential: np.ndarray) -> np.ndarray:
        """(...,) least friction coefficient whose cone holds unit normal force and `tangential` (..., 2)."""
        if not self.sides:
            return np.linalg.norm(tangential, axis=-1)
        middle = self.phase + np.pi * (2 * np.arange(self.sides) + 1) / self.sides
        rows = np.stack([np.cos(middle), np.sin(middle)]) / (self.radius * np.cos(np.pi / self.sides))
        return (tangential @ rows).max(axis=-1)

    def rays(self, friction: float) -> np.ndarray:
        """(3, G) generators with unit normal force; the round cone is replaced by its inscribed 32-gon.

        The 32-gon holds every vertex of the octagon and of the 16-gon, and reaches 99.5 % of the round cone elsewhere.
        """
        sides = self.sides or 32
        angle = self.phase + 2 * np.pi * np.arange(sides) / sides
        reach = friction * self.radius
        return np.stack([reach * np.cos(angle), reach * np.sin(angle), np.ones(sides)])


TRUE_CONE = Cone(0)
CONES = {
    "inner": Cone(8),  # regular octagon inscribed in the true cone
    "square": Cone(4, 1.0, np.pi / 4),  # |fx|, |fy| <= mu / sqrt 2 fz
    "second_order": TRUE_CONE,
    "diamond": Cone(4, math.sqrt(2.0)),  # |fx| + |fy| <= sqrt 2 mu fz: reaches outside the true cone
}


# ---- the report


class UnreadablePlan(ValueError):  # noqa: N818
    """The file cannot be judged at all; the text is one line that says why."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))


@dataclass(frozen=True)
class Check:
    """One demand on the plan.

    Attributes:
        name: of the check.
        ok: whether the plan meets it; never when `worst` is not a number.
        worst: the worst value found; NaN where there was nothing to look at.
        limit: greatest value that is allowed.
        unit: of both; empty for counts.
        where: the place of the worst value.
    """

    name: str
    ok: bool
    worst: float
    limit: float
    unit: str
    where: str


@dataclass(frozen=True)
class Report:
    """What the verifier found.

    Attributes:
        path: the plan file.
        checks: in the order of the verifier's sections. When the data cannot be interpreted the list ends early.
        remark: why the list ends early, empty when it does not.
    """

    path: str
    checks: tuple[Check, ...]
    remark: str = ""

    @property
    def holds(self) -> bool:
        """Whether every check was made and met."""
        return bool(self.checks) and not self.remark and all(check.ok for check in self.checks)

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the checks that the plan does not meet."""
        return tuple(check.name for check in self.checks if not check.ok)

    def check(self, name: str) -> Check:
        """The check of this name."""
        return next(check for check in self.checks if check.name == name)

    def table(self) -> str:
        """One line a check, then the verdict."""
        width = max((len(check.name) for check in self.checks), default=0)
        lines = []
        for c in self.checks:
            sign, verdict = ("<=", "ok  ") if c.ok else ("> ", "FAIL")
            line = f"{verdict}  {c.name:<{width}}  {c.worst:11.4g} {sign} {c.limit:<9.4g} {c.unit:<6} {c.where}"
            lines.append(line.rstrip())
        verdict = "the plan holds" if self.holds else f"the plan does not hold: {', '.join(self.failed)}"
        return "\n".join([*lines, *([self.remark] if self.remark else []), verdict])

    def __str__(self) -> str:
        return self.table()

    def as_dict(self) -> dict[str, object]:
        """The same as plain data for JSON; numbers that are not finite become null."""

        def number(value: float) -> float | None:
            return float(value) if math.isfinite(value) else None

        checks = [
            {"name": c.name, "ok": c.ok, "worst": number(c.worst), "limit": number(c.limit), "unit": c.unit}
            | {"where": c.where}
            for c in self.checks
        ]
        failed = list(self.failed)
        return {"path": self.path, "holds": self.holds, "failed": failed, "remark": self.remark, "checks": checks}


Place = Callable[[tuple[int, ...]], str]


@dataclass
class _Sheet:
    """Collects checks."""

    checks: list[Check] = field(default_factory=list)

    def add(self, name: str, values: object, limit: float, unit: str, where: Place | str, *, empty: str = "") -> bool:
        """Adds a check that no entry of `values` exceeds `limit`; returns whether it is met.

        Args:
            name: of the check.
            values: array of any shape.
            limit: greatest value allowed.
            unit: of both.
            where: the place, or a function from the index of the worst entry to its place.
            empty: what to say where no entries are right and proper; without it no entries is a failure.
        """
        array = np.atleast_1d(np.asarray(values, dtype=float))
        if not array.size:
            self.checks.append(
                Check(name, bool(empty), 0.0 if empty else np.nan, limit, unit, empty or "nothing there")
            )
            return bool(empty)
        # A NaN is worse than any number, and argmax finds it first.
        index = np.unravel_index(int(np.argmax(array)), array.shape)
        worst = float(array[index])
        ok = bool(worst <= limit)
        nowhere = ok and worst == limit == 0 and not isinstance(where, str)  # nothing was counted, so nothing is worst
        place = where if isinstance(where, str) else "" if nowhere else where(tuple(int(i) for i in index))
        self.checks.append(Check(name, ok, worst, limit, unit, place))
        return ok


# ---- verification


def verify(path: str | Path, robot_model: str | Path | None = None) -> Report:
    """Checks a plan file.

    Args:
        path: the plan file.
        robot_model: the model that Drake's parser loads alone; by default the path that the file names.

    Raises:
        UnreadablePlan: missing, truncated or foreign file, data of the wrong shape, or a plan for another model.
    """
    plan = _read_plan(Path(path))
    model = _find_model(plan, robot_model)
    sheet = _Sheet()
    with np.errstate(all="ignore"):  # absurd numbers overflow; what comes of that fails its check
        remark = _check_data(sheet, plan)
        if not remark:
            _check_plan(sheet, plan, model)
    return Report(str(path), tuple(sheet.checks), remark)


def _check_plan(sheet: _Sheet, plan: _PlanFile, model: Path) -> None:
    scene, robot = _read_scene(plan.text["scene/yaml"]), _RobotModel(model)
    _check_contacts(sheet, plan, scene)
    _check_patches_on_robot(sheet, plan, robot)
    _check_stances(sheet, plan)
    if plan.complete:
        _check_phases(sheet, plan)
        _check_forces(sheet, plan)
        _check_momentum(sheet, plan, robot)
        _check_motion(sheet, plan, robot, scene)
    _check_ends(sheet, plan, scene)


# ---- reading

# Dataset -> kind (f real, i integer, s text) and shape; a letter is a length that must agree wherever it stands.
Layout = dict[str, tuple[str, tuple[int | str, ...]]]
ALWAYS: Layout = {
    "scene/yaml": ("s", ()),
    "scene/triangles": ("f", ("K", 3, 3)),
    "effectors": ("s", (4,)),
    "effectors_half_extent": ("f", (4, 2)),
    "contacts/X_WC": ("f", ("C", 4, 4)),
    "contacts/effector": ("i", ("C",)),
    "contacts/surface": ("i", ("C",)),
    "contacts/friction": ("f", ("C",)),
    "stances/contact": ("i", ("S", 4)),
}
WHEN_COMPLETE: Layout = {
    "phases/start": ("f", ("P",)),
    "phases/end": ("f", ("P",)),
    "phases/contact": ("i", ("P", 4)),
    "centroidal/t": ("f", ("N",)),
    "centroidal/com": ("f", ("N", 3)),
    "centroidal/linear_momentum": ("f", ("N", 3)),
    "centroidal/angular_momentum": ("f", ("N", 3)),
    "centroidal/contact": ("i", ("N", 4)),
    "centroidal/force_W": ("f", ("N", 4, 3)),
    "centroidal/cop_C": ("f", ("N", 4, 2)),
    "centroidal/torque_n": ("f", ("N", 4)),
    "motion/t": ("f", ("T",)),
    "motion/q": ("f", ("T", "nq")),
    "motion/v": ("f", ("T", "nv")),
}
TEXTS = ("format", "robot", "robot_model", "robot_model_sha256", "friction_cone", "scene_name", "status", "provenance")


@dataclass(frozen=True, eq=False)
class _PlanFile:
    """The file's content by name."""

    path: Path
    attributes: dict[str, str]
    mass: float
    data: dict[str, np.ndarray]
    text: dict[str, str]
    names: dict[str, tuple[str, ...]]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.data[name]

    @property
    def complete(self) -> bool:
        return self.attributes["status"] == "complete"

    def held(self, contact: int) -> str:
        """What a contact is, for people."""
        return f"contact {contact} ({EFFECTORS[self['contacts/effector'][contact]]})"


def _read_plan(path: Path) -> _PlanFile:
    if not path.is_file():
        raise UnreadablePlan(f"{path}: no such plan file")
    if path.stat().st_size > MAX_FILE:
        raise UnreadablePlan(f"{path}: larger than {MAX_FILE} bytes, which no plan is")
    try:
        with h5py.File(path, "r") as file:
            return _read_content(path, file)
    except UnreadablePlan as error:
        raise UnreadablePlan(f"{path}: {error}") from None
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        raise UnreadablePlan(f"{path}: not a plan file, truncated or damaged ({error})") from None


def _read_content(path: Path, file: h5py.File) -> _PlanFile:
    if file.attrs.get("format") != FORMAT or file.attrs.get("version") != VERSION:
        raise UnreadablePlan(f"expected format {FORMAT!r} version {VERSION}")
    attributes = {key: value for key in TEXTS if isinstance(value := file.attrs.get(key), str)}
    missing = [key for key in TEXTS if key not in attributes]
    if missing:
        raise UnreadablePlan(f"attribute {missing[0]}: expected text")
    if attributes["status"] not in ("complete", "contacts"):
        raise UnreadablePlan(f"attribute status: expected 'complete' or 'contacts', got {attributes['status']!r}")
    if attributes["friction_cone"] not in CONES:
        raise UnreadablePlan(f"attribute friction_cone: expected one of {', '.join(CONES)}")
    mass = file.attrs.get("mass")
    if not isinstance(mass, int | float | np.number):
        raise UnreadablePlan("attribute mass: expected a number")
    layout = ALWAYS | (WHEN_COMPLETE if attributes["status"] == "complete" else {})
    lengths: dict[str, int] = {}
    data, text, names = {}, {}, {}
    for name, (kind, shape) in layout.items():
        dataset = _dataset(file, name, kind, shape, lengths)
        if kind == "s" and shape:
            names[name] = tuple(str(entry) for entry in dataset.asstr("utf-8")[()])
        elif kind == "s":
            text[name] = str(dataset.asstr("utf-8")[()])
        else:
            data[name] = dataset[()].astype(float if kind == "f" else np.int64)
    if names["effectors"] != EFFECTORS:
        raise UnreadablePlan(f"effectors: expected {', '.join(EFFECTORS)}")
    if attributes["status"] == "complete":
        for key in ("position_names", "velocity_names"):
            names[key] = tuple(str(entry) for entry in file["motion"].attrs.get(key, ()))
    return _PlanFile(path, attributes, float(mass), data, text, names)


def _dataset(
    file: h5py.File, name: str, kind: str, shape: tuple[int | str, ...], lengths: dict[str, int]
) -> h5py.Dataset:
    link = file.get(name, getlink=True) if name in file else None
    dataset = file.get(name)
    if not isinstance(link, h5py.HardLink) or not isinstance(dataset, h5py.Dataset):
        raise UnreadablePlan(f"{name}: the dataset is missing")
    found = "s" if h5py.check_string_dtype(dataset.dtype) else dataset.dtype.kind.replace("u", "i")
    if found != kind:
        raise UnreadablePlan(f"{name}: expected {dict(f='real numbers', i='integers', s='text')[kind]}")
    if dataset.nbytes > MAX_FILE or dataset.shape is None or len(dataset.shape) != len(shape):
        raise UnreadablePlan(f"{name}: expected {len(shape)} dimensions, got shape {dataset.shape}")
    for letter, length in zip(shape, dataset.shape, strict=True):
        expected = lengths.setdefault(letter, length) if isinstance(letter, str) else letter
        if length != expected:
            raise UnreadablePlan(
                f"{name}: expected a length of {expected} where it has {length}, shape {dataset.shape}"
            )
    return dataset


def _find_model(plan: _PlanFile, robot_model: str | Path | None) -> Path:
    model = Path(robot_model if robot_model is not None else plan.attributes["robot_model"])
    if not model.is_file():
        raise UnreadablePlan(f"{plan.path}: there is no robot model {model}; give the model it was made for")
    if hashlib.sha256(model.read_bytes()).hexdigest() != plan.attributes["robot_model_sha256"]:
        raise UnreadablePlan(f"{plan.path}: made for another robot model than {model} (their sha256 differ)")
    return model


def _check_data(sheet: _Sheet, plan: _PlanFile) -> str:
    """Whether the numbers can be interpreted at all; returns why not, or nothing."""
    sheet.add("complete", float(not plan.complete), 0, "", f"status is {plan.attributes['status']!r}")
    real = [name for name, array in plan.data.items() if array.dtype.kind == "f"]
    infinite = [np.count_nonzero(~np.isfinite(plan[name])) for name in real]
    finite = sheet.add(
        "numbers finite", [*infinite, not math.isfinite(plan.mass)], 0, "", lambda i: [*real, "mass"][i[0]]
    )
    least = {"contacts/effector": 1, "stances/contact": 1}
    if plan.complete:
        least |= {"phases/start": 1, "centroidal/t": 2, "motion/t": 2}
    lacking = [max(0, count - len(plan[name])) for name, count in least.items()]
    filled = sheet.add("nothing empty", lacking, 0, "", lambda i: list(least)[i[0]])
    num_contacts = len(plan["contacts/effector"])
    ranges = {"contacts/effector": (0, 4), "contacts/surface": (0, np.inf), "stances/contact": (-1, num_contacts)}
    if plan.complete:
        ranges |= {"phases/contact": (-1, num_contacts), "centroidal/contact": (-1, num_contacts)}
    outside = [np.count_nonzero((plan[name] < low) | (plan[name] >= high)) for name, (low, high) in ranges.items()]
    indexed = sheet.add("indices in range", outside, 0, "", lambda i: list(ranges)[i[0]])
    if not (finite and filled and indexed):
        return "the data cannot be interpreted, so nothing else was checked"
    if plan.complete:
        steps = {name: np.diff(plan[name]) for name in ("centroidal/t", "motion/t")}
        steps["phases/start"] = plan["phases/end"] - plan["phases/start"]
        forward = sheet.add(
            "time runs forward",
            [np.count_nonzero(dt <= 0) for dt in steps.values()],
            0,
            "",
            lambda i: list(steps)[i[0]],
        )
        sheet.add("knot spacing", steps["centroidal/t"], KNOT_SPACING, "s", lambda i: f"after knot {i[0]}")
        sheet.add("frame spacing", steps["motion/t"], FRAME_SPACING, "s", lambda i: f"after frame {i[0]}")
        if not forward:
            return "time does not run forward, so nothing else was checked"
    return ""


@dataclass(frozen=True, eq=False)
class _Plate:
    """A surface of the scene: convex polygon (K, 3), outward normal, friction, who may touch it."""

    name: str
    vertices: np.ndarray
    normal: np.ndarray
    friction: float
    allowed: frozenset[str]


@dataclass(frozen=True, eq=False)
class _Scene:
    """What the file says of the surroundings."""

    plates: tuple[_Plate, ...]
    boxes: tuple[tuple[np.ndarray, np.ndarray], ...]  # (4, 4) pose of the centre, (3,) full edges
    start: dict
    goal: dict

    def surface(self, name: str) -> int:
        return next((k for k, plate in enumerate(self.plates) if plate.name == name), -1)


def _read_scene(text: str) -> _Scene:
    if len(text) > MAX_YAML:
        raise UnreadablePlan(f"scene/yaml: longer than {MAX_YAML} characters")
    try:
        scene = _plain(text)
        if not isinstance(scene, dict):
            raise TypeError("expected a mapping")
        friction = float(scene.get("friction", 0.5))
        plates = tuple(_read_plate(entry, k, friction) for k, entry in enumerate(scene.get("surfaces") or ()))
        boxes = tuple((_pose(entry.get("pose") or {}), _triple(entry["box"])) for entry in scene.get("obstacles") or ())
        start, goal = scene.get("start") or {}, scene.get("goal") or {}
        if not isinstance(start, dict) or not isinstance(goal, dict):
            raise TypeError("start and goal must be mappings")
    except (yaml.YAMLError, TypeError, ValueError, KeyError, AttributeError) as error:
        raise UnreadablePlan(f"scene/yaml: not a scene ({type(error).__name__}: {error})") from None
    return _Scene(plates, boxes, start, goal)


def _plain(text: str) -> object:
    """What YAML says, as dicts, lists, texts and None.

    Built from the parser's events: PyYAML's own constructor recurses, so that deep nesting takes the interpreter with
    it, follows aliases, reads 1e-3 as text and takes ten seconds for 14000 surfaces.
    """
    found: list[object] = []
    opened = [(found, False)]  # the list being filled, and whether it will be a mapping
    for event in yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
        items = opened[-1][0]
        if isinstance(event, yaml.ScalarEvent):
            items.append(None if event.implicit[0] and event.value in ("", "~", "null") else event.value)
        elif isinstance(event, yaml.CollectionStartEvent):
            opened.append(([], isinstance(event, yaml.MappingStartEvent)))
        elif isinstance(event, yaml.CollectionEndEvent):
            items, mapping = opened.pop()
            pairs = dict(zip(items[::2], items[1::2], strict=True)) if mapping else {}
            if len(pairs) < len(items) // 2 * mapping:
                raise ValueError("a key stands twice")
            opened[-1][0].append(pairs if mapping else items)
        elif isinstance(event, yaml.AliasEvent):
            raise ValueError("aliases are not for scenes")
        if len(opened) > 50:
            raise ValueError("nested too deep")
    if len(found) != 1:
        raise ValueError("expected one document")
    return found[0]


def _read_plate(entry: dict, index: int, friction: float) -> _Plate:
    vertices = np.array([_triple(row) for row in entry["vertices"]])
    doubled = np.cross(vertices - vertices[0], np.roll(vertices, -1, axis=0) - vertices[0]).sum(axis=0)
    if not np.linalg.norm(doubled) > 1e-9:
        raise ValueError(f"surface {index} encloses no area")
    normal = doubled / np.linalg.norm(doubled)  # Newell's method
    given = entry.get("normal")
    if given is not None and _triple(given) @ normal < 0:
        vertices, normal = vertices[::-1], -normal
    tilt = np.arccos(np.clip(normal[2], -1.0, 1.0))
    feet, palms = tilt <= FOOT_MAX_TILT + 1e-9, PALM_TILT[0] - 1e-9 <= tilt <= PALM_TILT[1] + 1e-9
    by_tilt = [e for e in EFFECTORS if (feet if e.endswith("foot") else palms)]
    contact = entry.get("contact")
    allowed = frozenset(by_tilt if contact is None else contact)
    own = entry.get("friction")
    name = str(entry.get("name") or f"surface {index}")
    return _Plate(name, vertices, normal, friction if own is None else float(own), allowed)


def _pose(entry: dict) -> np.ndarray:
    """(4, 4) from xyz [m] and rpy [rad] as Drake's RollPitchYaw."""
    rpy, xyz = entry.get("rpy") or (0.0, 0.0, 0.0), entry.get("xyz") or (0.0, 0.0, 0.0)
    return RigidTransform(RollPitchYaw(_triple(rpy)), _triple(xyz)).GetAsMatrix4()


def _triple(entry: Sequence) -> np.ndarray:
    """(3,) finite numbers. One by one, so that nested lists cannot become an array of any size."""
    x, y, z = (float(number) for number in entry)
    if not math.isfinite(x + y + z):
        raise ValueError("expected finite numbers")
    return np.array([x, y, z])


# ---- contacts


def _check_contacts(sheet: _Sheet, plan: _PlanFile, scene: _Scene) -> None:
    X_WC, effector, surface = plan["contacts/X_WC"], plan["contacts/effector"], plan["contacts/surface"]
    half = plan["effectors_half_extent"]
    rows = range(len(X_WC))
    orthonormal = np.abs(np.swapaxes(X_WC[:, :3, :3], 1, 2) @ X_WC[:, :3, :3] - np.eye(3)).max(axis=(1, 2))
    off = np.maximum(orthonormal, np.abs(X_WC[:, 3] - [0, 0, 0, 1]).max(axis=1))
    off = np.maximum(off, np.abs(np.linalg.det(X_WC[:, :3, :3]) - 1))
    sheet.add("contact pose", off, 1e-6, "", lambda i: plan.held(i[0]))
    sheet.add("patch size", 1e-3 - half, 0, "m", lambda i: EFFECTORS[i[0]])
    known = surface < len(scene.plates)
    if not sheet.add("contact surface exists", ~known, 0, "", lambda i: plan.held(i[0])):
        return
    plates = [scene.plates[k] for k in surface]
    forbidden = [EFFECTORS[effector[c]] not in plates[c].allowed for c in rows]

    def on(index: tuple[int, ...]) -> str:
        return f"{plan.held(index[0])} on {plates[index[0]].name}"

    sheet.add("contact allowed", forbidden, 0, "", on)
    friction = np.array([plate.friction for plate in plates])
    sheet.add("contact friction", np.abs(plan["contacts/friction"] - friction), 1e-9, "", on)
    distance = [abs((X_WC[c, :3, 3] - plates[c].vertices[0]) @ plates[c].normal) for c in rows]
    sheet.add("contact on surface", distance, ON_SURFACE, "m", on)
    # atan2 of cross and dot keeps small angles exact, where arccos does not.
    normals = np.array([plate.normal for plate in plates])
    across = np.linalg.norm(np.cross(X_WC[:, :3, 2], normals), axis=1)
    sheet.add("contact normal", np.arctan2(across, (X_WC[:, :3, 2] * normals).sum(1)), ALONG_NORMAL, "rad", on)
    outside = [_outside(plates[c], _corners(X_WC[c], half[effector[c]])) for c in rows]
    sheet.add("patch inside", outside, INSIDE, "m", on)
    sheet.add("patch uncovered", *_covered(plan, scene))


def _corners(X_WC: np.ndarray, half: np.ndarray) -> np.ndarray:
    """(4, 3) corners of a patch in W [m]."""
    signs = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    return X_WC[:3, 3] + (signs * [*half, 0.0]) @ X_WC[:3, :3].T


def _outside(plate: _Plate, points: np.ndarray) -> float:
    """How far the farthest of `points` (n, 3) lies outside the plate's outline [m], negative inside."""
    edges = np.roll(plate.vertices, -1, axis=0) - plate.vertices
    outward = np.cross(edges, plate.normal)
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-300)
    long = np.linalg.norm(edges, axis=1) > 1e-9
    return float((outward[long] @ points.T - (outward[long] * plate.vertices[long]).sum(1)[:, None]).max())


def _covered(plan: _PlanFile, scene: _Scene) -> tuple[np.ndarray, float, str, Place]:
    """How high another surface or obstacle stands in the column over each patch, and what it is.

    The column is the patch less `BESIDE` all around, up to the head room: neighbours that touch at edges are outside.
    """
    X_WC, effector, surface = plan["contacts/X_WC"], plan["contacts/effector"], plan["contacts/surface"]
    polygons = [plate.vertices for plate in scene.plates] + list(plan["scene/triangles"])
    low = np.array([p.min(axis=0) for p in polygons])
    high = np.array([p.max(axis=0) for p in polygons])
    heights, by = np.zeros(len(X_WC)), np.full(len(X_WC), -1)
    for c, X in enumerate(X_WC):
        half = np.maximum(plan["effectors_half_extent"][effector[c]] - BESIDE, 1e-4)
        room = HEAD_ROOM["foot" if effector[c] < 2 else "palm"]
        reach = np.hypot(np.linalg.norm(half), room)
        near = np.all((low <= X[:3, 3] + reach) & (high >= X[:3, 3] - reach), axis=1)
        near[surface[c]] = False
        for k in np.flatnonzero(near):
            inside = _clip((polygons[k] - X[:3, 3]) @ X[:3, :3], [*-half, 0.0], [*half, room])
            if len(inside) and inside[:, 2].max() > heights[c]:
                heights[c], by[c] = inside[:, 2].max(), k
        for k, (X_WO, size) in enumerate(scene.boxes):
            middle = X_WO[:3, :3].T @ (X[:3, 3] + 0.5 * room * X[:3, 2] - X_WO[:3, 3])
            if np.all(np.abs(middle) < size / 2):
                heights[c], by[c] = room, len(polygons) + k

    def where(index: tuple[int, ...]) -> str:
        k, names = by[index[0]], [plate.name for plate in scene.plates]
        kind = "nothing" if k < 0 else names[k] if k < len(names) else f"obstacle triangle {k - len(names)}"
        if k >= len(polygons):
            kind = f"box {k - len(polygons)}"
        return f"{plan.held(index[0])} under {kind}"

    return heights, COVERED, "m", where


def _clip(polygon: np.ndarray, low: np.ndarray | Sequence[float], high: np.ndarray | Sequence[float]) -> np.ndarray:
    """The part (n, 3) of a convex polygon inside the box between `low` and `high` (Sutherland & Hodgman 1974)."""
    for axis in range(3):
        for sign, bound in ((1.0, high[axis]), (-1.0, -low[axis])):
            if not len(polygon):
                return polygon
            height = sign * polygon[:, axis] - bound  # positive is outside
            if height.max() <= 0:
                continue
            kept = []
            for a, b, ha, hb in zip(polygon, np.roll(polygon, -1, 0), height, np.roll(height, -1), strict=True):
                if ha <= 0:
                    kept.append(a)
                if (ha <= 0) != (hb <= 0):
                    kept.append(a + (b - a) * (ha / (ha - hb)))
            polygon = np.array(kept).reshape(-1, 3)
    return polygon


# ---- stances and phases


def _check_stances(sheet: _Sheet, plan: _PlanFile) -> None:
    stances = plan["stances/contact"]
    sheet.add("stance effectors", _wrong_effector(plan, stances), 0, "", lambda i: f"stance {i[0]}, {EFFECTORS[i[1]]}")
    changes = np.abs((stances[1:] != stances[:-1]).sum(axis=1) - 1)
    sheet.add("one change a stance", changes, 0, "", lambda i: f"stance {i[0]} to {i[0] + 1}", empty="a single stance")
    sheet.add("stance holds", (stances < 0).all(axis=1), 0, "", lambda i: f"stance {i[0]} holds nothing")


def _wrong_effector(plan: _PlanFile, table: np.ndarray) -> np.ndarray:
    """Where a table (..., 4) of contacts names one that belongs to another end effector."""
    return (table >= 0) & (plan["contacts/effector"][np.maximum(table, 0)] != np.arange(4))


def _check_phases(sheet: _Sheet, plan: _PlanFile) -> None:
    start, end, contact = plan["phases/start"], plan["phases/end"], plan["phases/contact"]
    sheet.add(
        "phases contiguous",
        np.abs(start[1:] - end[:-1]),
        SAME_TIME,
        "s",
        lambda i: f"after phase {i[0]}",
        empty="one phase",
    )
    span = {name: plan[name][[0, -1]] - [start[0], end[-1]] for name in ("centroidal/t", "motion/t")}
    sheet.add("one time span", np.abs(list(span.values())), SAME_TIME, "s", lambda i: list(span)[i[0]])
    sheet.add("phase effectors", _wrong_effector(plan, contact), 0, "", lambda i: f"phase {i[0]}, {EFFECTORS[i[1]]}")
    sheet.add("phase holds", (contact < 0).all(axis=1), 0, "", lambda i: f"phase {i[0]} holds nothing")
    # From one stance to the next the contacts that both hold stay; the moving one carries nothing in between.
    stances = plan["stances/contact"]
    expected = [stances[0]]
    for before, after in itertools.pairwise(stances):
        expected += [np.where(before == after, before, -1), after]
    wanted, _ = _merged(expected)
    got, first = _merged(list(contact))
    differ = [a != b for a, b in zip(wanted, got, strict=False)] + [True] * abs(len(wanted) - len(got))

    def where(index: tuple[int, ...]) -> str:
        return f"phase {first[index[0]]}" if index[0] < len(first) else "phases end too early"

    sheet.add("phases follow stances", differ, 0, "", where)
    t = plan["centroidal/t"]
    phase = np.clip(np.searchsorted(start, t[:-1] + SAME_TIME, side="right") - 1, 0, len(start) - 1)
    crosses = (t[1:] > end[phase] + SAME_TIME) | (t[:-1] < start[phase] - SAME_TIME)
    disagree = (plan["centroidal/contact"][:-1] != contact[phase]).any(axis=1) | crosses
    sheet.add("phases agree with forces", disagree, 0, "", lambda i: f"knot {i[0]}, t = {t[i[0]]:.3f} s")


def _merged(rows: list[np.ndarray]) -> tuple[list[tuple[int, ...]], list[int]]:
    """Rows without immediate repetitions, and the index of the first of each."""
    merged, first = [], []
    for k, row in enumerate(rows):
        if not merged or merged[-1] != tuple(row):
            merged.append(tuple(row))
            first.append(k)
    return merged, first


# ---- forces and momentum


def _check_forces(sheet: _Sheet, plan: _PlanFile) -> None:
    t, contact, force = plan["centroidal/t"], plan["centroidal/contact"], plan["centroidal/force_W"]
    weight = plan.mass * -GRAVITY[2]

    def at(index: tuple[int, ...]) -> str:
        return f"knot {index[0]}, t = {t[index[0]]:.3f} s, {EFFECTORS[index[1]]}"

    idle = np.where(contact < 0, np.abs(force).max(axis=2) + np.abs(plan["centroidal/torque_n"]), 0.0)
    sheet.add("no force without contact", idle / weight, 1e-9, "M g", at)
    last = [
        np.abs(plan[f"centroidal/{name}"][-1] - plan[f"centroidal/{name}"][-2]).max() for name in ("contact", "force_W")
    ]
    sheet.add("last row repeats", last, 1e-9, "", lambda i: ("contact", "force_W")[i[0]])
    knot, effector = np.nonzero(contact >= 0)
    which = contact[knot, effector]
    R_WC, friction = plan["contacts/X_WC"][which, :3, :3], plan["contacts/friction"][which]
    f_C = np.einsum("kji,kj->ki", R_WC, force[knot, effector]) / weight
    pull = np.zeros(contact.shape)
    pull[knot, effector] = -f_C[:, 2]
    sheet.add("unilateral", pull, 1e-9, "M g", at)
    cop, torque = plan["centroidal/cop_C"][knot, effector], plan["centroidal/torque_n"][knot, effector] / weight
    half = plan["effectors_half_extent"][effector]
    for name, cone in (("true", TRUE_CONE), ("named", CONES[plan.attributes["friction_cone"]])):
        distance = np.zeros(contact.shape)
        distance[knot, effector] = wrench_distance(cone, f_C, cop, torque, half, friction)
        sheet.add(f"wrench in {name} cone", distance, WRENCH, "M g", at)


def wrench_distance(
    cone: Cone, f_C: np.ndarray, cop_C: np.ndarray, torque_n: np.ndarray, half: np.ndarray, friction: np.ndarray
) -> np.ndarray:
    """(K,) how far each contact wrench is from a sum of four corner forces inside the cone, in units of the force.

    Most wrenches pass a closed form: share the force among the corners by the bilinear weights that put it at the
    centre of pressure, and turn it about that point until the torque is right. The rest go to one linear program.

    Args:
        cone: of the corner forces.
        f_C: (K, 3) force in the contact frame.
        cop_C: (K, 2) centre of pressure in the contact frame [m].
        torque_n: (K,) torque about the normal at the centre of pressure.
        half: (K, 2) half extents of the patch [m].
        friction: (K,) coefficients.
    """
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    distance = np.zeros(len(f_C))
    weights = np.prod(1 + signs * (cop_C / half)[:, None], axis=2) / 4  # (K, 4), sum 1
    arms = signs * half[:, None] - cop_C[:, None]  # (K, 4, 2) from the centre of pressure to the corners
    inertia = (weights * (arms**2).sum(2)).sum(1)  # [m^2], 0 at a corner: no torque there
    turn = torque_n / np.maximum(inertia, 1e-9)
    tangential = f_C[:, None, :2] + turn[:, None, None] * np.stack([-arms[..., 1], arms[..., 0]], axis=2)
    used = weights > 1e-9
    load = np.maximum(f_C[:, 2], 1e-12)
    needed = np.where(used, cone.gauge(tangential / load[:, None, None]), 0.0).max(axis=1)
    simple = (weights.min(axis=1) >= 0) & (f_C[:, 2] > 0) & (needed <= friction * (1 + 1e-9))
    simple &= (inertia > 1e-9) | (np.abs(torque_n) < 1e-10)
    simple |= (np.abs(f_C).max(axis=1) < 1e-10) & (np.abs(torque_n) < 1e-10)
    rest = np.flatnonzero(~simple)
    if not len(rest):
        return distance
    moment = np.stack([cop_C[:, 1] * f_C[:, 2], -cop_C[:, 0] * f_C[:, 2]], axis=1)
    about_z = cop_C[:, 0] * f_C[:, 1] - cop_C[:, 1] * f_C[:, 0] + torque_n
    wrenches = np.column_stack([f_C, moment, about_z])
    blocks = [_corner_wrenches(np.eye(4), half[k], cone.rays(friction[k]), np.zeros(3)) for k in rest]
    distance[rest] = _distance_to_cones(blocks, wrenches[rest])
    return distance


def _corner_wrenches(X_WC: np.ndarray, half: np.ndarray, rays: np.ndarray, about: np.ndarray) -> np.ndarray:
    """(6, 4 G) force and moment about a point of W of every generator at every corner of a patch."""
    forces = X_WC[:3, :3] @ rays
    columns = [np.vstack([forces, np.cross(p - about, forces.T).T]) for p in _corners(X_WC, half)]
    return np.hstack(columns)


def _distance_to_cones(blocks: Sequence[np.ndarray], wrenches: np.ndarray) -> np.ndarray:
    """(K,) the l1 distance of each wrench (K, 6) from the cone that the columns of its block (6, G) span.

    One sparse linear program for all: min sum |slack| s.t. block x + slack = wrench, x >= 0.
    """
    distances = []
    for first in range(0, len(blocks), 128):
        part = blocks[first : first + 128]
        slack = scipy.sparse.identity(6 * len(part), format="csc")
        cones = scipy.sparse.block_diag(part, format="csc")
        A = scipy.sparse.hstack([cones, slack, -slack], format="csc")
        num_rays = sum(block.shape[1] for block in part)
        cost = np.concatenate([np.zeros(num_rays), np.ones(12 * len(part))])
        target = wrenches[first : first + 128].ravel()
        answer = scipy.optimize.linprog(cost, A_eq=A, b_eq=target, method="highs")
        if answer.x is None:
            distances.append(np.full(len(part), np.nan))
            continue
        # The solver's word is not taken: the distance is what its forces leave of the wrench.
        rest = cones @ np.maximum(answer.x[:num_rays], 0.0) - target
        distances.append(np.abs(rest).reshape(-1, 6).sum(axis=1))
    return np.concatenate(distances)


def _check_momentum(sheet: _Sheet, plan: _PlanFile, robot: _RobotModel) -> None:
    sheet.add("mass", abs(plan.mass / robot.mass - 1), MASS, "", f"file {plan.mass:.6g} kg, model {robot.mass:.6g} kg")
    t, com, force = plan["centroidal/t"], plan["centroidal/com"], plan["centroidal/force_W"]
    momentum, spin = plan["centroidal/linear_momentum"], plan["centroidal/angular_momentum"]
    contact = plan["centroidal/contact"]
    weight, dt = plan.mass * -GRAVITY[2], np.diff(t)[:, None]

    def at(index: tuple[int, ...]) -> str:
        return f"knot {index[0]}, t = {t[index[0]]:.3f} s, {'xyz'[index[1]]}"

    # force_W[n] acts over [t_n, t_n+1); the moment is taken about com[n+1].
    newton = np.diff(momentum, axis=0) / dt - (force[:-1].sum(axis=1) + plan.mass * GRAVITY)
    sheet.add("newton", np.abs(newton) / weight, RESIDUAL, "M g", at)
    sheet.add("com integration", np.abs(np.diff(com, axis=0) - dt * momentum[1:] / plan.mass), RESIDUAL, "m", at)
    X_WC = plan["contacts/X_WC"][np.maximum(contact, 0)]
    cop = np.concatenate([plan["centroidal/cop_C"], np.zeros((*contact.shape, 1))], axis=2)
    p_cop = X_WC[..., :3, 3] + np.einsum("neij,nej->nei", X_WC[..., :3, :3], cop)
    moment = np.cross(p_cop[:-1] - com[1:, None], force[:-1])
    moment = moment + plan["centroidal/torque_n"][:-1, :, None] * X_WC[:-1, :, :3, 2]
    moment = np.where(contact[:-1, :, None] >= 0, moment, 0.0).sum(axis=1)
    sheet.add("euler", np.abs(np.diff(spin, axis=0) / dt - moment) / weight, RESIDUAL, "M g m", at)
    ends = np.stack([momentum[[0, -1]], spin[[0, -1]]]) / plan.mass
    sheet.add(
        "momentum at rest", np.abs(ends), AT_REST, "m/s", lambda i: f"{('linear', 'angular')[i[0]]}, {_end(i[1])}"
    )
    balance = [_imbalance(plan, contact[n], com[n]) for n in (0, -1)]
    sheet.add("balance at rest", balance, BALANCE, "M g", lambda i: _end(i[0]))


def _end(index: int) -> str:
    return ("at the start", "at the end")[index]


def _imbalance(plan: _PlanFile, held: np.ndarray, com: np.ndarray) -> float:
    """Distance of the robot's weight from what these contacts can carry inside the true cone [M g]."""
    rows = [c for c in held if c >= 0]
    if not rows:
        return np.inf
    half = plan["effectors_half_extent"][plan["contacts/effector"]]
    blocks = [
        _corner_wrenches(plan["contacts/X_WC"][c], half[c], TRUE_CONE.rays(float(plan["contacts/friction"][c])), com)
        for c in rows
    ]
    return float(_distance_to_cones([np.hstack(blocks)], np.array([[0, 0, 1.0, 0, 0, 0]]))[0])


# ---- motion


class _RobotModel:
    """The robot as Drake's parser gives it, with whatever stands around it on the world body."""

    def __init__(self, model: Path, solids: Sequence[np.ndarray] = ()) -> None:
        self.model = model
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        try:
            Parser(self.plant).AddModels(model)
            for k, points in enumerate(solids):
                hull, name, friction = Convex(points.T, "solid"), f"solid {k}", CoulombFriction(1.0, 1.0)
                self.plant.RegisterCollisionGeometry(self.plant.world_body(), RigidTransform(), hull, name, friction)
            self.plant.Finalize()
            frames = [self.plant.GetFrameByName(name) for name in EFFECTORS]
        except RuntimeError as error:
            raise UnreadablePlan(f"{model}: not a model of this robot ({error})") from None
        base = list(self.plant.GetFloatingBaseBodies())
        free = [self.plant.get_body(index) for index in base]
        if len(free) != 1 or not free[0].has_quaternion_dofs() or free[0].floating_positions_start() != 0:
            raise UnreadablePlan(f"{model}: expected a model with one floating base whose positions come first")
        self.frames = frames
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.scene_context = self.scene_graph.GetMyContextFromRoot(self.context)
        self.mass = self.plant.CalcTotalMass(self.plant_context)

    def colliding_bodies(self) -> tuple[list[RigidBody], np.ndarray]:
        """The bodies that have collision shapes, and (B,) radii about their origins that hold the shapes [m]."""
        inspector, bodies, radii = self.scene_graph.model_inspector(), [], []
        for index in self.plant.GetBodyIndices(self.frames[0].model_instance()):
            body, reach = self.plant.get_body(index), 0.0
            for geometry in self.plant.GetCollisionGeometriesForBody(body):
                obb = inspector.GetObbInGeometryFrame(geometry)
                centre = (inspector.GetPoseInFrame(geometry) @ obb.pose()).translation() if obb else np.zeros(3)
                reach = max(reach, np.linalg.norm(centre) + np.linalg.norm(obb.half_width()) if obb else np.inf)
            if reach:
                bodies.append(body)
                radii.append(reach)
        return bodies, np.array(radii)

    @property
    def carriers(self) -> frozenset[int]:
        """Indices of the bodies that carry a sole or a palm."""
        return frozenset(int(b.index()) for f in self.frames for b in self.plant.GetBodiesWeldedTo(f.body()))


def _check_patches_on_robot(sheet: _Sheet, plan: _PlanFile, robot: _RobotModel) -> None:
    """A sole larger than the robot's would balance anything."""
    query = robot.scene_graph.get_query_output_port().Eval(robot.scene_context)
    distances = np.full((4, 4), np.nan)
    for e, frame in enumerate(robot.frames):
        welded = robot.plant.GetBodiesWeldedTo(frame.body())
        own = {g for body in welded for g in robot.plant.GetCollisionGeometriesForBody(body)}
        X_WE = frame.CalcPoseInWorld(robot.plant_context).GetAsMatrix4()
        for k, corner in enumerate(_corners(X_WE, plan["effectors_half_extent"][e])):
            found = [d.distance for d in query.ComputeSignedDistanceToPoint(corner) if d.id_G in own]
            distances[e, k] = min(found, default=np.nan)
    sheet.add("patch on robot", distances, PATCH_OFF_BODY, "m", lambda i: EFFECTORS[i[0]])


@dataclass(frozen=True, eq=False)
class _Track:
    """What the motion does with the model: (T, 4, 4, 4) X_WE, (T, 3) CoM, (T, B, 3) origins of the bodies [m]."""

    X_WE: np.ndarray
    com: np.ndarray
    origins: np.ndarray


def _check_motion(sheet: _Sheet, plan: _PlanFile, robot: _RobotModel, scene: _Scene) -> None:
    t, q, v, plant = plan["motion/t"], plan["motion/q"], plan["motion/v"], robot.plant
    names = tuple(plant.GetPositionNames()), tuple(plant.GetVelocityNames())
    if names != (plan.names["position_names"], plan.names["velocity_names"]):
        raise UnreadablePlan(f"{plan.path}: motion: its position or velocity names are not those of the model")
    if (len(names[0]), len(names[1])) != (q.shape[1], v.shape[1]) or q.shape[1] != v.shape[1] + 1:
        raise UnreadablePlan(f"{plan.path}: motion: expected {len(names[0])} positions and {len(names[1])} velocities")

    def at(index: tuple[int, ...], labels: Sequence[str] = ()) -> str:
        label = f", {labels[index[1]]}" if labels else ""
        return f"frame {index[0]}, t = {t[index[0]]:.3f} s{label}"

    norm = np.linalg.norm(q[:, :4], axis=1)
    unit = sheet.add("quaternion unit", np.abs(norm - 1), QUATERNION, "", at)
    sheet.add("quaternion sign", -(q[1:, :4] * q[:-1, :4]).sum(axis=1), 0, "", at)
    over = np.maximum(plant.GetPositionLowerLimits() - q, q - plant.GetPositionUpperLimits())
    sheet.add("joint limits", over, JOINT_LIMIT, "rad", lambda i: at(i, names[0]))
    difference = _difference(t, q) if norm.min() > 1e-3 else np.full((len(t) - 1, v.shape[1]), np.nan)
    lower, upper = plant.GetVelocityLowerLimits(), plant.GetVelocityUpperLimits()
    over = np.maximum(lower - v, v - upper)
    over[1:] = np.maximum(over[1:], np.maximum(lower - difference, difference - upper))
    sheet.add("joint speeds", over, SPEED_LIMIT, "rad/s", lambda i: at(i, names[1]))
    sheet.add("velocities", _velocity_error(v, difference), VELOCITY, "rad/s", lambda i: at(i, names[1]))
    sheet.add("posture at rest", np.abs(v[[0, -1]]), AT_REST, "rad/s", lambda i: f"{_end(i[0])}, {names[1][i[1]]}")
    if not unit:
        return
    bodies, radii = robot.colliding_bodies()
    track = _follow(robot, q, bodies)
    _check_held(sheet, plan, track)
    planned = np.stack([np.interp(t, plan["centroidal/t"], plan["centroidal/com"][:, k]) for k in range(3)], axis=1)
    sheet.add("com of model", np.linalg.norm(track.com - planned, axis=1), COM, "m", at)
    _check_collisions(sheet, plan, robot, scene, track.origins, radii)


def _difference(t: np.ndarray, q: np.ndarray) -> np.ndarray:
    """(T-1, nv) mean velocity over each frame: base turn in W [rad/s], base point [m/s], joints [rad/s]."""
    dt = np.diff(t)[:, None]
    unit = q[:, :4] / np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    (w0, u0), (w1, u1) = (unit[:-1, :1], unit[:-1, 1:4]), (unit[1:, :1], unit[1:, 1:4])
    # q1 times the conjugate of q0 is the turn in W.
    scalar = w1 * w0 + (u1 * u0).sum(axis=1, keepdims=True)
    vector = w0 * u1 - w1 * u0 - np.cross(u1, u0)
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    angle = 2 * np.arctan2(length, scalar)
    turn = vector * np.where(length > 1e-12, angle / np.maximum(length, 1e-12), 2.0)
    return np.hstack([turn, np.diff(q[:, 4:], axis=0)]) / dt


def _velocity_error(v: np.ndarray, difference: np.ndarray) -> np.ndarray:
    """(T-1, nv) how far velocities (T, nv) are from the mean velocity over each frame (T-1, nv), by the kinder rule.

    Velocities sampled from a curve: the mean lies between those at its ends, but for the curvature. Velocities that are
    differences themselves: each is the mean of the differences beside it.
    """
    between = np.maximum(np.minimum(v[:-1], v[1:]) - difference, difference - np.maximum(v[:-1], v[1:]))
    beside = np.concatenate([difference[:1], (difference[:-1] + difference[1:]) / 2, difference[-1:]])
    centred = np.abs(v - beside)
    return np.minimum(between, np.maximum(centred[:-1], centred[1:]))


def _follow(robot: _RobotModel, q: np.ndarray, bodies: Sequence[RigidBody]) -> _Track:
    plant, context = robot.plant, robot.plant_context
    X_WE, com, origins = np.empty((len(q), 4, 4, 4)), np.empty((len(q), 3)), np.empty((len(q), len(bodies), 3))
    for k, row in enumerate(q):
        plant.SetPositions(context, row)
        X_WE[k] = [frame.CalcPoseInWorld(context).GetAsMatrix4() for frame in robot.frames]
        com[k] = plant.CalcCenterOfMassPositionInWorld(context)
        origins[k] = [plant.EvalBodyPoseInWorld(context, body).translation() for body in bodies]
    return _Track(X_WE, com, origins)


def _check_held(sheet: _Sheet, plan: _PlanFile, track: _Track) -> None:
    """Forward kinematics of every end effector that a phase says is held, both phases at their common instant."""
    t, X_WC = plan["motion/t"], plan["contacts/X_WC"]
    position, angle = np.full((len(t), 4), -np.inf), np.full((len(t), 4), -np.inf)
    phases = zip(plan["phases/start"], plan["phases/end"], plan["phases/contact"], strict=True)
    seen = np.zeros(len(t), dtype=bool)
    for start, end, contact in phases:
        frames = np.flatnonzero((t >= start - SAME_TIME) & (t <= end + SAME_TIME))
        seen[frames] = True
        for e, c in enumerate(contact):
            if c < 0:
                continue
            X = track.X_WE[frames, e]
            position[frames, e] = np.maximum(position[frames, e], np.linalg.norm(X[:, :3, 3] - X_WC[c, :3, 3], axis=1))
            angle[frames, e] = np.maximum(angle[frames, e], _angle(X[:, :3, :3], X_WC[c, :3, :3]))

    def at(index: tuple[int, ...]) -> str:
        return f"frame {index[0]}, t = {t[index[0]]:.3f} s, {EFFECTORS[index[1]]}"

    position[~seen], angle[~seen] = np.nan, np.nan
    sheet.add("held contacts stay", position, HELD_POSITION, "m", at)
    sheet.add("held contacts keep level", angle, HELD_ANGLE, "rad", at)


def _angle(R_WA: np.ndarray, R_WB: np.ndarray) -> np.ndarray:
    """(n,) angle between rotations (n, 3, 3) and (3, 3) [rad]: |R - I|_F = 2 sqrt 2 |sin angle/2|, exact when small."""
    chord = np.linalg.norm(R_WA - R_WB, axis=(1, 2)) / (2 * np.sqrt(2))
    return 2 * np.arcsin(np.clip(chord, 0.0, 1.0))


# ---- collision


@dataclass(frozen=True, eq=False)
class _Face:
    """One outer face of something solid: a convex polygon (K, 3), its outward normal, and what to call it.

    A tapered one leans inwards behind the face, so that its solid does not poke out of the next face of a mesh where
    the ridge between them is 45 deg or blunter.
    """

    name: str
    polygon: np.ndarray
    normal: np.ndarray
    tapered: bool

    def solid(self, low: np.ndarray, high: np.ndarray) -> np.ndarray | None:
        """(n, 3) corners of the convex solid behind the part of the face between `low` and `high`; None for slivers."""
        polygon = _clip(self.polygon, low, high)
        if len(polygon) < 3:
            return None
        edges = np.roll(polygon, -1, axis=0) - polygon
        long = np.linalg.norm(edges, axis=1) > 1e-6
        inward = np.cross(self.normal, edges[long])
        inward /= np.linalg.norm(inward, axis=1, keepdims=True)
        middle = polygon.mean(axis=0)
        radius = (inward * (middle - polygon[long])).sum(axis=1).min(initial=np.inf)
        if not 1e-4 < radius < np.inf:
            return None  # its neighbours cover it
        if not self.tapered:
            return np.concatenate([polygon, polygon - PLATE_THICKNESS * self.normal])
        depth = min(TRIANGLE_DEPTH, 0.9 * radius)
        return np.concatenate([polygon, middle + (polygon - middle) * (1 - depth / radius) - depth * self.normal])


def _check_collisions(
    sheet: _Sheet, plan: _PlanFile, robot: _RobotModel, scene: _Scene, origins: np.ndarray, radii: np.ndarray
) -> None:
    faces = [*_plates(plan, scene), *_triangles(plan["scene/triangles"]), *_boxes(scene)]
    limits: dict[str, float] = dict.fromkeys(("self collision", "terrain collision"), PENETRATION)
    limits["sole and palm collision"] = SOLE_PENETRATION
    nothing = (0.0, "nowhere") if len(radii) else (np.nan, "the model has no collision shapes")
    worst: dict[str, tuple[float, str]] = dict.fromkeys(limits, nothing)
    for frames, near in _groups(origins, radii, faces) if len(radii) else ():
        low = origins[frames].min(axis=(0, 1)) - radii.max() - MARGIN
        high = origins[frames].max(axis=(0, 1)) + radii.max() + MARGIN
        solids = {k: solid for k in near if (solid := faces[k].solid(low, high)) is not None}
        world = _RobotModel(robot.model, list(solids.values()))
        _penetrate(plan, world, [faces[k].name for k in solids], frames, worst)
    for name, (depth, where) in worst.items():
        sheet.add(name, depth, limits[name], "m", where)


def _plates(plan: _PlanFile, scene: _Scene) -> Iterator[_Face]:
    """Every surface, but for those that lie on the obstacles' own triangles: the mesh is their body."""
    triangles, normals = _upright(plan["scene/triangles"])
    for plate in scene.plates:
        if not _on_mesh(plate, triangles, normals):
            yield _Face(plate.name, plate.vertices, plate.normal, tapered=False)


def _triangles(triangles: np.ndarray) -> Iterator[_Face]:
    """One by one: Drake would take a whole mesh for its convex hull."""
    for triangle, normal in zip(*_upright(triangles), strict=True):
        yield _Face("an obstacle's triangle", triangle, normal, tapered=True)


def _upright(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The (n, 3, 3) triangles that enclose an area, and (n, 3) their outward normals."""
    doubled = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(doubled, axis=1)
    keep = length > 1e-10
    return triangles[keep], doubled[keep] / length[keep, None]


def _on_mesh(plate: _Plate, triangles: np.ndarray, normals: np.ndarray) -> bool:
    """Whether a surface's corners and middle all lie on triangles that face the same way."""
    facing = normals @ plate.normal > 0.999
    triangles, normals = triangles[facing], normals[facing]
    if not len(triangles):
        return False
    middle = plate.vertices.mean(axis=0)
    for point in [middle, *(middle + 0.98 * (plate.vertices - middle))]:
        from_corner = point - triangles
        outward = np.cross(np.roll(triangles, -1, axis=1) - triangles, normals[:, None])
        outward /= np.linalg.norm(outward, axis=2, keepdims=True)
        beside = (outward * from_corner).sum(axis=2).max(axis=1)
        height = np.abs((normals * from_corner[:, 0]).sum(axis=1))
        if not np.any((beside < COVERED) & (height < COVERED)):
            return False
    return True


def _boxes(scene: _Scene) -> Iterator[_Face]:
    for k, (X_WO, size) in enumerate(scene.boxes):
        for axis, sign in itertools.product(range(3), (1, -1)):
            R = sign * np.roll(X_WO[:3, :3], 2 - axis, axis=1)  # the outward axis comes last
            half = np.roll(size, 2 - axis) / 2
            corners = np.array([[1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1]]) * half
            polygon = X_WO[:3, 3] + corners @ R.T
            yield _Face(f"box {k}", polygon[::sign], R[:, 2], tapered=True)


# Registering n solids costs Drake n^2, and its signed distance never returns where a sole touches a plate of 30 m:
# a long way is checked stretch by stretch, on what lies around each.
MAX_FACES, BLOCK, STRETCH, MARGIN = 250, 100, 3.0, 0.5


def _groups(origins: np.ndarray, radii: np.ndarray, faces: Sequence[_Face]) -> Iterator[tuple[slice, np.ndarray]]:
    """Stretches of frames and the faces that any body's bounds come near in them.

    Args:
        origins: (T, B, 3) of the bodies in W [m].
        radii: (B,) about the origins that hold the bodies [m].
        faces: of everything that stands still.
    """
    low = np.array([f.polygon.min(axis=0) for f in faces]).reshape(-1, 3) - PLATE_THICKNESS
    high = np.array([f.polygon.max(axis=0) for f in faces]).reshape(-1, 3) + PLATE_THICKNESS
    first, gathered = 0, np.zeros(len(faces), dtype=bool)
    for start in range(0, len(origins), BLOCK):
        swept = origins[start : start + BLOCK]
        least, most = swept.min(axis=0) - radii[:, None], swept.max(axis=0) + radii[:, None]
        near = ((low <= most[:, None]) & (high >= least[:, None])).all(axis=2).any(axis=0)
        extent = np.ptp(origins[first : start + BLOCK, 0], axis=0).max()
        if start > first and (extent > STRETCH or (gathered | near).sum() > MAX_FACES):
            yield slice(first, start), np.flatnonzero(gathered)
            first, gathered = start, near
        else:
            gathered |= near
    yield slice(first, len(origins)), np.flatnonzero(gathered)


def _penetrate(
    plan: _PlanFile, world: _RobotModel, names: Sequence[str], frames: slice, worst: dict[str, tuple[float, str]]
) -> None:
    """Deepens `worst` by what overlaps in these frames; `names` are those of the solids.

    Point-pair penetration finds all overlaps at once, but bounds their depth from above only: a sole 3 mm deep in a
    small triangle may come out as 17 mm. Depths that would matter are asked again as signed distances.
    """
    inspector = world.scene_graph.model_inspector()
    owner: dict = {}
    for geometry in inspector.GetAllGeometryIds(Role.kProximity):
        body = world.plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
        still = body.index() == world.plant.world_body().index()
        label = names[int(inspector.GetName(geometry).rpartition(" ")[2])] if still else body.name()
        owner[geometry] = (still, int(body.index()) in world.carriers, label)
    port, t = world.scene_graph.get_query_output_port(), plan["motion/t"]
    for k, q in enumerate(plan["motion/q"][frames], start=frames.start):
        world.plant.SetPositions(world.plant_context, q)
        query = port.Eval(world.scene_context)
        for pair in query.ComputePointPairPenetration():
            (still_a, carrier_a, label_a), (still_b, carrier_b, label_b) = owner[pair.id_A], owner[pair.id_B]
            kind = "self collision"
            if still_a or still_b:
                kind = "sole and palm collision" if carrier_a or carrier_b else "terrain collision"
            depth = pair.depth
            if depth <= worst[kind][0]:
                continue
            if depth > TOUCH:
                with contextlib.suppress(RuntimeError):  # the bound from above stands
                    depth = min(depth, -query.ComputeSignedDistancePairClosestPoints(pair.id_A, pair.id_B).distance)
            if depth > worst[kind][0]:
                worst[kind] = (depth, f"frame {k}, t = {t[k]:.3f} s, {label_a} in {label_b}")


# ---- where it starts and ends


def _check_ends(sheet: _Sheet, plan: _PlanFile, scene: _Scene) -> None:
    stances = plan["stances/contact"]
    try:
        if scene.start.get("stance"):
            _check_start_stance(sheet, plan, scene, scene.start["stance"])
        else:
            xyz, yaw = _triple(scene.start["xyz"]), float(scene.start.get("yaw") or 0.0)
            mean, heading = _feet(plan, stances[0])
            sheet.add("start", np.linalg.norm(mean[:2] - xyz[:2]), START_DISTANCE, "m", _spot(mean))
            sheet.add("start heading", abs(_wrap(heading - yaw)), START_YAW, "rad", f"heading {heading:.3f}")
        xyz, radius = _triple(scene.goal["xyz"]), float(scene.goal.get("radius", 0.2))
        mean, heading = _feet(plan, stances[-1])
        sheet.add("goal", np.linalg.norm(mean[:2] - xyz[:2]), radius + 1e-9, "m", _spot(mean))
        if scene.goal.get("yaw") is not None:
            off = abs(_wrap(heading - float(scene.goal["yaw"])))
            sheet.add("goal heading", off, GOAL_YAW + 1e-9, "rad", f"heading {heading:.3f}")
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UnreadablePlan(f"scene/yaml: start or goal is missing or wrong ({error})") from None


def _check_start_stance(sheet: _Sheet, plan: _PlanFile, scene: _Scene, wanted: dict) -> None:
    """The first stance is the one that the scene gives, contact by contact."""
    distance, angle = [], []
    for e, name in enumerate(EFFECTORS):
        entry, c = wanted.get(name), plan["stances/contact"][0, e]
        if entry is None or c < 0:
            distance.append(0.0 if entry is None and c < 0 else np.inf)
            angle.append(0.0)
            continue
        X, X_WC = _pose(entry), plan["contacts/X_WC"][c]
        same = scene.surface(str(entry["surface"])) == plan["contacts/surface"][c]
        distance.append(np.linalg.norm(X[:3, 3] - X_WC[:3, 3]) if same else np.inf)
        angle.append(_angle(X[None, :3, :3], X_WC[:3, :3])[0])
    sheet.add("start", distance, START_EXACT, "m", lambda i: EFFECTORS[i[0]])
    sheet.add("start heading", angle, START_EXACT_ANGLE, "rad", lambda i: EFFECTORS[i[0]])


def _feet(plan: _PlanFile, stance: np.ndarray) -> tuple[np.ndarray, float]:
    """(3,) mean of the feet in W [m] and their mean heading [rad]; NaN without feet."""
    X = plan["contacts/X_WC"][[c for c in stance[:2] if c >= 0]]
    if not len(X):
        return np.full(3, np.nan), np.nan
    # A foot's x is its heading projected on a tilted surface; undo that along the normal.
    forward = X[:, :2, 0] - X[:, 2:3, 0] / X[:, 2:3, 2] * X[:, :2, 2]
    forward = (forward / np.linalg.norm(forward, axis=1, keepdims=True)).sum(axis=0)
    return X[:, :3, 3].mean(axis=0), float(np.arctan2(forward[1], forward[0]))


def _spot(point: np.ndarray) -> str:
    return f"mean of the feet at x {point[0]:.3f}, y {point[1]:.3f}"


def _wrap(angle: float) -> float:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def main(arguments: Sequence[str]) -> int:
    """Prints the table of `python verifier.py PLAN.h5 [--json]`; returns 0 if it holds, 1 if not, 2 if unreadable."""
    try:
        report = verify(arguments[0])
    except UnreadablePlan as error:
        print(error, file=sys.stderr)
        return 2
    print(json.dumps(report.as_dict()) if "--json" in arguments else report.table())
    return 0 if report.holds else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
