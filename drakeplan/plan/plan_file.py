"""Reads and writes plan files: HDF5, units and frames on every dataset, written in one step.

The same plan gives the same bytes: no time stamps, one order, no compression.
"""

from __future__ import annotations

import io
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import h5py
import numpy as np

from drakeplan.plan.plan import (
    COMPLETE,
    CONTACTS_ONLY,
    Plan,
    PlanCentroidal,
    PlanContacts,
    PlanMotion,
    PlanPhases,
    PlanRobustness,
)
from scenes.effector import EFFECTORS
from scenes.files.whole_file import require_writable as require_writable
from scenes.files.whole_file import write_whole
from scenes.input_error import InputError

FORMAT, VERSION = "drakeplan-plan", 2
READABLE = (1, 2)  # a file of version 1 has no supports: all patches are whole
MAX_BYTES = 1 << 30  # a file larger than this is not a plan
MAX_ATTRIBUTE = 60_000  # [bytes] HDF5 keeps attributes up to 64 KiB

# unit, frame or meaning of every dataset
DATASETS: dict[str, tuple[str, str]] = {
    "scene/yaml": ("", "the scene as planned, UTF-8"),
    "scene/triangles": ("m", "W; every obstacle and mesh, for collision"),
    "effectors": ("", "names"),
    "effectors_half_extent": ("m", "contact frame; half length along x, half width along y"),
    "contacts/X_WC": ("m", "W; pose of the contact frame, z along the surface normal, x forward"),
    "contacts/effector": ("", "index into /effectors"),
    "contacts/surface": ("", "index into the scene's surfaces"),
    "contacts/friction": ("1", "Coulomb coefficient, the least under the support"),
    "contacts/support": (
        "m",
        "contact frame; corners of the part of the patch that rests on something: convex, counter-clockwise, padded with NaN",
    ),
    "stances/contact": ("", "index into /contacts by end effector, -1 where free"),
    "phases/start": ("s", "time"),
    "phases/end": ("s", "time"),
    "phases/contact": ("", "index into /contacts by end effector, -1 where free: the contacts that may carry load"),
    "centroidal/t": ("s", "time"),
    "centroidal/com": ("m", "W; centre of mass"),
    "centroidal/linear_momentum": ("kg m/s", "W"),
    "centroidal/angular_momentum": ("kg m^2/s", "W; about the centre of mass"),
    "centroidal/contact": ("", "index into /contacts by end effector, -1 where free"),
    "centroidal/force_W": ("N", "W; on the robot, over [t_n, t_n+1)"),
    "centroidal/cop_C": ("m", "contact frame; centre of pressure"),
    "centroidal/torque_n": ("N m", "about the contact's normal at the centre of pressure, on the robot"),
    "motion/t": ("s", "time"),
    "motion/q": ("m, rad, quaternion w x y z", "W; positions in the plant's order"),
    "motion/v": ("m/s, rad/s", "W; velocities in the plant's order"),
    "motion/tau": (
        "N m",
        "torques of the actuators in the plant's order, over [t_i, t_i+1), under the planned contact forces",
    ),
    "robustness/t": ("s", "time"),
    "robustness/impulse": ("kg m/s", "W; change of the linear momentum"),
    "robustness/probability": ("1", "that the impulse happens within 0.1 s, by moment and impulse"),
    "robustness/captured": ("", "0 falls, 1 stands with what is held, 2 with one new contact, -1 not tried"),
    "robustness/capture_point": ("m", "W; where the new contact is made, 0 where none is"),
    "robustness/effector": ("", "index into /effectors of what makes it, -1 for none"),
}


def write_plan(plan: Plan, path: str | Path) -> None:
    """Writes a plan file in one step: a reader of the path sees the old file or the whole new one.

    Args:
        plan: what to write.
        path: the file.

    Raises:
        InputError: the file cannot be written there.
    """
    write_whole(path, _plan_bytes(plan))


def read_plan(path: str | Path) -> Plan:
    """Reads a plan file.

    Raises:
        InputError: missing, oversized, truncated, foreign, of another version, or holding data that cannot be.
    """
    path = Path(path)
    with _open_plan(path) as file:
        try:
            return _read_plan(file)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        except (ValueError, OSError, RuntimeError, TypeError, KeyError) as error:
            raise InputError(f"{path}: damaged plan file ({error})") from None


@dataclass(frozen=True)
class PlanSummary:
    """Main facts of a plan file; reading them needs no robot.

    Attributes:
        path: the file.
        status: "complete" or "contacts".
        scene: name of the scene.
        robot: name of the robot.
        friction_cone: name of the cone.
        triangles: how many the obstacles have.
        contacts: how many different contacts.
        stances: how many stances.
        palms_used: how many of the contacts are of palms.
        duration: of the motion [s].
        knots: of the momentum trajectory.
        frames: of the motion.
        travel: horizontal distance from the first to the last mean of the feet [m].
        provenance: what made the plan.
    """

    path: str
    status: str
    scene: str
    robot: str
    friction_cone: str
    triangles: int
    contacts: int
    stances: int
    palms_used: int
    duration: float
    knots: int
    frames: int
    travel: float
    provenance: dict[str, object]

    def as_dict(self) -> dict[str, object]:
        """The same as plain data for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        return (
            f"{self.path}: {self.status} plan of {self.robot} on {self.scene}: {self.contacts} contacts "
            f"({self.palms_used} of palms), {self.stances} stances, {self.travel:.2f} m, {self.duration:.1f} s "
            f"({self.knots} knots, {self.frames} frames), cone {self.friction_cone}"
        )


def inspect_plan(path: str | Path) -> PlanSummary:
    """Main facts of a plan file, read without loading any robot.

    Raises:
        InputError: as `read_plan`.
    """
    plan = read_plan(path)
    palms = sum(plan.effectors[e].endswith("_palm") for e in plan.contacts.effector)
    travel = 0.0
    if len(plan.stances):
        first, last = (_feet_mean(plan, index) for index in (0, -1))
        travel = float(np.linalg.norm((last - first)[:2]))
    return PlanSummary(
        path=str(path),
        status=plan.status,
        scene=plan.scene_name,
        robot=plan.robot,
        friction_cone=plan.friction_cone,
        triangles=len(plan.triangles),
        contacts=len(plan.contacts),
        stances=len(plan.stances),
        palms_used=int(palms),
        duration=plan.duration,
        knots=len(plan.centroidal) if plan.centroidal is not None else 0,
        frames=len(plan.motion) if plan.motion is not None else 0,
        travel=travel,
        provenance=dict(plan.provenance),
    )


def _feet_mean(plan: Plan, stance: int) -> np.ndarray:
    feet = [c for c, name in zip(plan.stances[stance], plan.effectors, strict=True) if c >= 0 and "_foot" in name]
    return plan.contacts.X_WC[feet, :3, 3].mean(axis=0) if feet else np.zeros(3)


# ---- writing


def _plan_bytes(plan: Plan) -> bytes:
    """The whole file in memory: HDF5 seeks back and forth, so it must not do that where others can see."""
    image = io.BytesIO()
    # Formats from 1.10 on have checksums on their metadata: without them HDF5 crashes on some damaged files.
    with h5py.File(image, "w", libver=("v110", "v110")) as file:
        for key, value in _attributes(plan).items():
            if isinstance(value, str) and len(value.encode()) > MAX_ATTRIBUTE:
                raise InputError(f"plan file: {key} is longer than {MAX_ATTRIBUTE} bytes")
            file.attrs[key] = value
        arrays = _arrays(plan)
        for name, (unit, meaning) in DATASETS.items():
            if name not in arrays:
                continue
            dataset = file.create_dataset(name, data=arrays[name], track_times=False)
            dataset.attrs["unit"] = unit
            dataset.attrs["frame"] = meaning
        if plan.motion is not None:
            file["motion"].attrs["position_names"] = list(plan.motion.position_names)
            file["motion"].attrs["velocity_names"] = list(plan.motion.velocity_names)
            if plan.motion.tau is not None:
                file["motion"].attrs["actuator_names"] = list(plan.motion.actuator_names)
        if plan.robustness is not None:
            file["robustness"].attrs["p_success"] = plan.robustness.p_success
            file["robustness"].attrs["method"] = plan.robustness.method
    return image.getvalue()


def _attributes(plan: Plan) -> dict[str, str | int | float]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "robot": plan.robot,
        "robot_model": plan.robot_model,
        "robot_model_sha256": plan.robot_model_sha256,
        "mass": plan.mass,
        "friction_cone": plan.friction_cone,
        "scene_name": plan.scene_name,
        "status": plan.status,
        "provenance": json.dumps(dict(plan.provenance), sort_keys=True, allow_nan=False),
    }


def _arrays(plan: Plan) -> dict[str, object]:
    """Dataset name -> data, without those that the plan does not have."""
    text = h5py.string_dtype("utf-8")
    arrays: dict[str, object] = {
        "scene/yaml": np.array(plan.scene_yaml, dtype=text),
        "scene/triangles": plan.triangles,
        "effectors": np.array(plan.effectors, dtype=text),
        "effectors_half_extent": plan.half_extent,
        "stances/contact": plan.stances,
    }
    parts = (
        ("contacts", plan.contacts),
        ("phases", plan.phases),
        ("centroidal", plan.centroidal),
        ("motion", plan.motion),
        ("robustness", plan.robustness),
    )
    for group, part in parts:
        if part is not None:
            for name in DATASETS:
                folder, _, leaf = name.partition("/")
                if folder == group and getattr(part, leaf) is not None:
                    arrays[name] = getattr(part, leaf)
    return arrays


# ---- reading


def _open_plan(path: Path) -> h5py.File:
    try:
        there, is_file = path.exists(), path.is_file()
    except OSError as error:  # a name that no file can have
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    if not there:
        raise InputError(f"{path}: no such plan file")
    if not is_file:
        raise InputError(f"{path}: expected a plan file, this is not a file")
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"{path}: {path.stat().st_size} bytes, a plan file has at most {MAX_BYTES}")
    try:
        return h5py.File(path, "r")
    except (OSError, RuntimeError) as error:
        reason = "truncated" if "truncated" in str(error) else "not an HDF5 file, or damaged"
        if isinstance(error, PermissionError):
            reason = "no permission to read it"
        raise InputError(f"{path}: not a plan file ({reason})") from None


def _read_plan(file: h5py.File) -> Plan:
    status = _check_header(file)
    names = _texts(file, "effectors")
    if names != EFFECTORS:
        raise InputError(f"effectors: expected {list(EFFECTORS)}, got {list(names)}")
    complete = status == COMPLETE
    plan = Plan(
        robot=_attribute(file, "robot"),
        robot_model=_attribute(file, "robot_model"),
        robot_model_sha256=_attribute(file, "robot_model_sha256"),
        mass=_number(file, "mass"),
        friction_cone=_attribute(file, "friction_cone"),
        scene_name=_attribute(file, "scene_name"),
        scene_yaml=_texts(file, "scene/yaml")[0],
        triangles=_numbers(file, "scene/triangles"),
        half_extent=_numbers(file, "effectors_half_extent"),
        contacts=_read_part(file, "contacts", PlanContacts),
        stances=_integers(file, "stances/contact"),
        phases=_read_part(file, "phases", PlanPhases) if complete else None,
        centroidal=_read_part(file, "centroidal", PlanCentroidal) if complete else None,
        motion=_read_motion(file) if complete else None,
        provenance=_read_provenance(file),
        robustness=_read_robustness(file) if "robustness" in file else None,
    )
    for name in ("phases", "centroidal", "motion", "robustness"):
        if not complete and name in file:
            raise InputError(f"status is {status!r}, but there is a group {name}")
    return plan


def _check_header(file: h5py.File) -> str:
    """Refuses another format or version; returns the status."""
    if "format" not in file.attrs:
        raise InputError(f"not a plan file: it has no attribute format, expected {FORMAT!r}")
    if _attribute(file, "format") != FORMAT:
        raise InputError(f"not a plan file: format is {_attribute(file, 'format')!r}, expected {FORMAT!r}")
    version = _number(file, "version")
    if version not in READABLE:
        raise InputError(f"version: this program reads versions {READABLE[0]} to {VERSION}, the file has {version:g}")
    status = _attribute(file, "status")
    if status not in (COMPLETE, CONTACTS_ONLY):
        raise InputError(f"status: expected {COMPLETE!r} or {CONTACTS_ONLY!r}, got {status!r}")
    return status


def _read_provenance(file: h5py.File) -> dict[str, object]:
    try:
        provenance = json.loads(_attribute(file, "provenance"))
    except (json.JSONDecodeError, RecursionError):
        raise InputError("provenance: expected JSON") from None
    if not isinstance(provenance, dict):
        raise InputError("provenance: expected a JSON object")
    return provenance


Part = TypeVar("Part", PlanContacts, PlanPhases, PlanCentroidal)


def _read_part(file: h5py.File, group: str, kind: type[Part]) -> Part:
    arrays = {}
    for name in DATASETS:
        folder, _, leaf = name.partition("/")
        if folder == group:
            if leaf == "support" and _number(file, "version") == 1:
                continue
            whole = leaf in ("contact", "effector", "surface")
            arrays[leaf] = _integers(file, name) if whole else _numbers(file, name)
    return kind(**arrays)


def _read_motion(file: h5py.File) -> PlanMotion:
    has_torques = "motion/tau" in file
    arrays = {leaf: _numbers(file, f"motion/{leaf}") for leaf in ("t", "q", "v", "tau")[: 4 if has_torques else 3]}
    names = {}
    for key in ("position_names", "velocity_names", "actuator_names")[: 3 if has_torques else 2]:
        value = file["motion"].attrs.get(key)
        if not isinstance(value, np.ndarray) or value.ndim != 1 or not all(isinstance(name, str) for name in value):
            raise InputError(f"motion: attribute {key} is missing, expected a list of names")
        names[key] = tuple(value)
    return PlanMotion(**arrays, **names)


def _read_robustness(file: h5py.File) -> PlanRobustness:
    reals, whole = ("t", "impulse", "probability", "capture_point"), ("captured", "effector")
    arrays = {leaf: _numbers(file, f"robustness/{leaf}") for leaf in reals}
    arrays |= {leaf: _integers(file, f"robustness/{leaf}") for leaf in whole}
    p_success, method = _number(file["robustness"], "p_success"), _attribute(file["robustness"], "method")
    return PlanRobustness(**arrays, p_success=p_success, method=method)


def _dataset(file: h5py.File, name: str) -> h5py.Dataset:
    dataset = file.get(name)
    if not isinstance(dataset, h5py.Dataset):
        raise InputError(f"{name}: the dataset is missing")
    if dataset.size is None or dataset.nbytes > MAX_BYTES:
        raise InputError(f"{name}: too large, or the dataset is null")
    return dataset


def _numbers(file: h5py.File, name: str) -> np.ndarray:
    dataset = _dataset(file, name)
    if dataset.dtype.kind != "f":
        raise InputError(f"{name}: expected real numbers, got {dataset.dtype}")
    return dataset[()]


def _integers(file: h5py.File, name: str) -> np.ndarray:
    dataset = _dataset(file, name)
    if dataset.dtype.kind not in "iu":
        raise InputError(f"{name}: expected integers, got {dataset.dtype}")
    return dataset[()]


def _texts(file: h5py.File, name: str) -> tuple[str, ...]:
    dataset = _dataset(file, name)
    if h5py.check_string_dtype(dataset.dtype) is None:
        raise InputError(f"{name}: expected text, got {dataset.dtype}")
    try:
        values = np.atleast_1d(dataset.asstr("utf-8")[()])
    except UnicodeDecodeError:
        raise InputError(f"{name}: expected UTF-8 text") from None
    return tuple(str(value) for value in values)


def _attribute(file: h5py.HLObject, key: str) -> str:
    value = file.attrs.get(key)
    if not isinstance(value, str):
        raise InputError(f"attribute {key}: expected text, got {'nothing' if value is None else type(value).__name__}")
    return value


def _number(file: h5py.HLObject, key: str) -> float:
    value = file.attrs.get(key)
    if not isinstance(value, int | float | np.integer | np.floating) or not np.isfinite(value):
        raise InputError(f"attribute {key}: expected a number, got {value!r}")
    return float(value)
