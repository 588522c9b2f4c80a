"""Which model file Drake loads for a robot: the one that its YAML names, or an adapted copy where Drake cannot take it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from lxml import etree  # type: ignore[attr-defined]

from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.robots.adapter import MOVING, ModelSource, adapted_model, package_source
from scenes.robots.addresses import Addresses, is_file
from scenes.robots.schema import FrameEntry, ModelChanges, RobotEntry
from scenes.robots.urdf_file import read_urdf

MODEL_SUFFIXES = (".urdf", ".sdf", ".xml", ".mjcf")
DRAKES_MESHES = (".obj", ".gltf", ".vtk")


def find_model(path: Path, entry: RobotEntry, packages: Mapping[str, Path]) -> Path:
    """The path of a URDF that Drake's parser loads alone, with a frame for each end effector.

    Args:
        path: the robot file.
        entry: its content.
        packages: folders of package:// addresses that the user gave.

    Raises:
        InputError: no such model, or it is not what the robot file says.
    """
    if entry.package is not None:
        origin = package_source(entry.package, source=str(path), packages=packages)
    else:
        addresses = Addresses(str(path), packages)
        origin = ModelSource(_own_model(path, entry, addresses), addresses, entry.changes or ModelChanges())
    slots = _slots(entry, origin.changes)
    if entry.package is None and not slots and entry.changes is None and _loads_alone(origin.file, entry):
        return origin.file
    lacking = frozenset(EFFECTORS) - frozenset(entry.effectors)
    origin = ModelSource(origin.file, origin.addresses, _without(origin.changes, entry), slots, origin.key, lacking)
    return adapted_model(entry.name, origin, entry.base_body, entry.nominal, source=str(path))


def _own_model(path: Path, entry: RobotEntry, addresses: Addresses) -> Path:
    address = str(entry.model)
    if "://" in address:
        model = addresses.resolve(address, path.parent.resolve())
    else:
        model = (path.parent / address).resolve()
    if not is_file(model):
        raise InputError(f"{path}: model: there is no file {model}")
    if model.suffix.lower() not in MODEL_SUFFIXES:
        raise InputError(
            f"{path}: model: expected a file that ends in one of {', '.join(MODEL_SUFFIXES)}, got {model.name}"
        )
    return model


def _slots(entry: RobotEntry, changes: ModelChanges) -> dict[str, FrameEntry]:
    """Frames to add so that each end effector has one of its own name; a missing palm has one that nothing uses."""
    slots: dict[str, FrameEntry] = {}
    for name in EFFECTORS:
        effector = entry.effectors.get(name)
        if effector is None:
            slots[name] = FrameEntry(body=entry.torso_body, xyz=(0.0, 0.0, 0.0))
        elif effector.frame != name:
            slots[name] = changes.frames.get(effector.frame, FrameEntry(body=effector.frame, xyz=(0.0, 0.0, 0.0)))
    return slots


def _without(changes: ModelChanges, entry: RobotEntry) -> ModelChanges:
    """The changes less the frames that end effectors take under their own names."""
    taken = {e.frame for name, e in entry.effectors.items() if e.frame != name}
    frames = {name: frame for name, frame in changes.frames.items() if name not in taken}
    return changes.model_copy(update={"frames": frames}) if len(frames) < len(changes.frames) else changes


def _loads_alone(model: Path, entry: RobotEntry) -> bool:
    """Whether Drake takes a URDF as it is: its root floats, every mesh is an OBJ beside it, every moving joint has a motor."""
    if model.suffix.lower() != ".urdf":
        return False
    root = read_urdf(model)
    links, joints = root.findall("link"), root.findall("joint")
    children = {_link(j, "child") for j in joints}
    roots = [e.get("name") for e in links if e.get("name") not in children]
    motors = {e.get("name") for e in root.iterfind("transmission/joint")}
    return (
        roots == [entry.base_body]
        and set(EFFECTORS) <= {e.get("name") for e in links}
        and all(j.get("type") == "fixed" or (j.get("type") in MOVING[::2] and _is_plain(j, motors)) for j in joints)
        and all(_is_plain_mesh(mesh) for mesh in root.iter("mesh"))
        and _base_has_mass(root, entry.base_body)
    )


def _is_plain(joint: etree._Element, motors: set[str | None]) -> bool:
    limit = joint.find("limit")
    limited = limit is not None and all(limit.get(k) is not None for k in ("lower", "upper", "velocity"))
    return joint.get("name") in motors and limited and joint.find("mimic") is None


def _is_plain_mesh(mesh: etree._Element) -> bool:
    address = mesh.get("filename", "")
    return "://" not in address and Path(address).suffix.lower() in DRAKES_MESHES


def _base_has_mass(root: etree._Element, base_body: str) -> bool:
    return any(e.get("name") == base_body and e.find("inertial/mass") is not None for e in root.findall("link"))


def _link(joint: etree._Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")
