"""A first adaptation of a model, before anything is known of it but its base: what the search for feet and hands reads."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from lxml import etree  # type: ignore[attr-defined]

from drakeplan.robot_setup.link_tree import LinkTree, read_tree
from drakeplan.robot_setup.model_source import FoundModel
from scenes.input_error import InputError
from scenes.robots.adapter import DRAKE, MOVING, adapted_model
from scenes.robots.schema import ModelChanges
from scenes.robots.urdf_file import read_urdf

GROUP = f"{{{DRAKE}}}collision_filter_group"


def find_base(found: FoundModel) -> str:
    """The link that floats: the model's root, or the first below it with a mass.

    Args:
        found: the model.

    Raises:
        InputError: no link has a mass, or the model has several roots.
    """
    if found.file.suffix.lower() == ".urdf":
        return _base_of(read_urdf(found.file), found.file)
    from scenes.robots.drake_to_urdf import urdf_from_drake

    with tempfile.TemporaryDirectory(prefix="drakeplan-model-") as scratch:
        urdf = urdf_from_drake(found.file, found.source(ModelChanges()).addresses, Path(scratch))
        return _base_of(read_urdf(urdf), found.file)


def _base_of(root: etree._Element, file: Path) -> str:
    links = {str(e.get("name")): e for e in root.findall("link")}
    below: dict[str, list[tuple[str, str]]] = {}
    children = set()
    for joint in root.findall("joint"):
        parent, child = (e.get("link", "") if (e := joint.find(tag)) is not None else "" for tag in ("parent", "child"))
        if child not in links:
            raise InputError(f"{file}: joint {joint.get('name')!r}: the model has no link {child!r}")
        below.setdefault(parent, []).append((str(joint.get("type")), child))
        children.add(child)
    roots = [name for name in links if name not in children]
    if "world" in roots and len(roots) == 1:
        roots = [child for _, child in below.get("world", [])]
    if len(roots) != 1:
        names = f": {', '.join(map(repr, roots[:3]))}" if roots else ""
        raise InputError(
            f"{file}: expected one link that all others hang on, the model has {len(roots)} of them{names}"
        )
    name = roots[0]
    while not _has_mass(links[name]):
        under = below.get(name, [])
        masses = [child for _, child in under if child in links and _has_mass(links[child])]
        if len(masses) == 1 and masses[0] in [c for kind, c in under if kind in ("fixed", "floating")]:
            return masses[0]
        if len(under) != 1 or under[0][1] not in links:
            if any(kind == "fixed" for kind, _ in under):
                return name  # something welded to it has the mass
            raise InputError(f"{file}: link {name!r} carries the others and has no mass: give it an <inertial>")
        name = under[0][1]
    return name


def _has_mass(link: etree._Element) -> bool:
    mass = link.find("inertial/mass")
    try:
        return mass is not None and float(mass.get("value", "0")) > 0.0
    except ValueError:
        return False  # the adapter names it


def draft(found: FoundModel, base_body: str, changes: ModelChanges, R_WB: np.ndarray | None = None) -> LinkTree:
    """The links of the model with these changes, and no pair of bodies left out of collisions.

    Args:
        found: the model.
        base_body: the link that floats.
        changes: joints that are welded, shapes that become one.
        R_WB: (3, 3) how the base stands in W, None for along its axes.

    Raises:
        InputError: the adapter or Drake cannot take the model.
    """
    model = adapted_model("draft", found.source(changes), base_body, {}, source=str(found.file))
    tree = etree.parse(str(model))
    for group in tree.getroot().findall(GROUP):
        tree.getroot().remove(group)
    for mesh in tree.getroot().iter("mesh"):
        mesh.set("filename", str(model.parent / mesh.get("filename", "")))
    with tempfile.TemporaryDirectory(prefix="drakeplan-model-") as scratch:
        unfiltered = Path(scratch) / "model.urdf"
        tree.write(unfiltered, xml_declaration=True, encoding="utf-8")
        return read_tree(unfiltered, R_WB)


def mimicking(found: FoundModel) -> set[str]:
    """Names of the joints that mimic another; the adapter welds them.

    Args:
        found: the model.
    """
    if found.file.suffix.lower() != ".urdf":
        return set()
    root = read_urdf(found.file)
    return {
        str(j.get("name")) for j in root.findall("joint") if j.find("mimic") is not None and j.get("type") in MOVING
    }
