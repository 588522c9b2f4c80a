"""Reads a plan file, and decides whether its numbers can be interpreted at all."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from .geometry import patch
from .limits import (
    EFFECTORS,
    FORMAT,
    FRAME_SPACING,
    KNOT_SPACING,
    MAX_FILE,
    VERSIONS,
)
from .report import Sheet
from .wrenches import CONES


class UnreadablePlan(ValueError):  # noqa: N818
    """The file cannot be judged at all; the text is one line that says why."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))


# Dataset -> kind (f real, i integer, s text) and shape; a letter is a length, the same in all shapes.
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
SUPPORTS: Layout = {"contacts/support": ("f", ("C", "V", 2))}
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
TORQUES: Layout = {"motion/tau": ("f", ("T", "na"))}  # not in files of earlier releases
TEXTS = ("format", "robot", "robot_model", "robot_model_sha256", "friction_cone", "scene_name", "status", "provenance")


@dataclass(frozen=True, eq=False)
class PlanFile:
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

    def support(self, contact: int) -> np.ndarray:
        """(n, 2) corners of a contact's support in its frame [m]: the whole patch where the file has none."""
        if "contacts/support" not in self.data:
            return patch(self["effectors_half_extent"][self["contacts/effector"][contact]])
        corners = self["contacts/support"][contact]
        return corners[~np.isnan(corners).all(axis=1)]

    def reserve(self) -> tuple[float, float]:
        """Shares of friction and of the supports that the plan says it uses at most; 1 and 1 where it says nothing."""
        try:
            said = json.loads(self.attributes["provenance"])["reserve"]
            shares = float(said["friction"]), float(said["pressure"])
        except (ValueError, KeyError, TypeError):
            return 1.0, 1.0
        return shares if all(0.0 < share <= 1.0 for share in shares) else (1.0, 1.0)

    def held(self, contact: int) -> str:
        """Index and end effector of a contact, for messages."""
        return f"contact {contact} ({EFFECTORS[self['contacts/effector'][contact]]})"


def read_plan(path: Path) -> PlanFile:
    try:
        size = path.stat().st_size if path.is_file() else None
    except OSError as error:  # a name that no file can have
        raise UnreadablePlan(f"{path}: cannot be read ({error.strerror})") from None
    if size is None:
        raise UnreadablePlan(f"{path}: no such plan file")
    if size > MAX_FILE:
        raise UnreadablePlan(f"{path}: larger than {MAX_FILE} bytes, which no plan is")
    try:
        with h5py.File(path, "r") as file:
            return _read_content(path, file)
    except UnreadablePlan as error:
        raise UnreadablePlan(f"{path}: {error}") from None
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        raise UnreadablePlan(f"{path}: not a plan file, truncated or damaged ({error})") from None


def _read_content(path: Path, file: h5py.File) -> PlanFile:
    version = file.attrs.get("version")
    if file.attrs.get("format") != FORMAT or version not in VERSIONS:
        raise UnreadablePlan(f"expected format {FORMAT!r} version {' or '.join(map(str, VERSIONS))}")
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
    complete, torques = attributes["status"] == "complete", "motion/tau" in file
    layout = ALWAYS | (SUPPORTS if version != 1 else {})
    layout |= (WHEN_COMPLETE if complete else {}) | (TORQUES if complete and torques else {})
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
    if complete:
        for key in ("position_names", "velocity_names", "actuator_names"):
            names[key] = tuple(str(entry) for entry in file["motion"].attrs.get(key, ()))
    return PlanFile(path, attributes, float(mass), data, text, names)


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


def find_model(plan: PlanFile, robot_model: str | Path | None) -> Path:
    """The model to check with, if it is the one that the plan was made for.

    Args:
        plan: the plan file.
        robot_model: path; by default the one that the plan names.

    Raises:
        UnreadablePlan: no such file, or another model.
    """
    model = Path(robot_model if robot_model is not None else plan.attributes["robot_model"])
    if not model.is_file():
        raise UnreadablePlan(f"{plan.path}: there is no robot model {model}; give the one it was made for (--robot)")
    if hashlib.sha256(model.read_bytes()).hexdigest() != plan.attributes["robot_model_sha256"]:
        raise UnreadablePlan(f"{plan.path}: made for another robot model than {model} (their sha256 differ)")
    return model


def check_data(sheet: Sheet, plan: PlanFile) -> str:
    """Whether the numbers can be interpreted at all; returns why not, or nothing.

    Args:
        sheet: takes the checks.
        plan: the plan file.
    """
    sheet.add("complete", float(not plan.complete), 0, "", f"status is {plan.attributes['status']!r}")
    padded = "contacts/support"  # with NaN; its check is among those of the contacts
    real = [name for name, array in plan.data.items() if array.dtype.kind == "f" and name != padded]
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
