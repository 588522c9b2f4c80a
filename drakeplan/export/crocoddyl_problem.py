"""A Python script that builds and solves a Crocoddyl problem, with the plan's arrays and the robot in a folder beside it."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
from lxml import etree  # type: ignore[attr-defined]

from drakeplan.export.formats import ExportOptions, Product
from drakeplan.export.numpy_archive import archive_bytes
from drakeplan.export.source import Source
from scenes.robots.urdf_file import read_urdf

SCRIPT = Path(__file__).with_name("crocoddyl_script.py")
KEPT = ("link", "joint")  # of the model; Crocoddyl needs kinematics and inertias, no shapes


def export(source: Source, file: Path, options: ExportOptions) -> Product:
    """The script and its data.

    Args:
        source: the plan with its robot.
        file: of the script; its folder of data is called after it.
        options: not used.
    """
    plan, samples = source.plan, source.samples
    phases, _, _ = source.parts
    low, high = _support_boxes(source)
    arrays = {
        "t": samples.t,
        "base_position": samples.base_position,
        "base_quaternion": samples.base_quaternion,
        "base_linear_velocity": samples.base_linear_velocity,
        "base_angular_velocity": samples.base_angular_velocity,
        "joint_names": np.array(samples.joint_names, dtype=str),
        "joint_position": samples.joint_position,
        "joint_velocity": samples.joint_velocity,
        "com": samples.com,
        "effectors": np.array(plan.effectors, dtype=str),
        "half_extent": plan.half_extent,
        "contact_X_WC": plan.contacts.X_WC,
        "contact_effector": plan.contacts.effector,
        "contact_friction": plan.contacts.friction,
        "support_middle": 0.5 * (low + high),
        "support_size": high - low,
        "phase_start": phases.start,
        "phase_contact": phases.contact,
        "header": np.array(json.dumps({"format": "drakeplan-crocoddyl", "version": 1, **source.header()})),
    }
    folder = f"{file.stem}_data"
    beside = {f"{folder}/plan.npz": archive_bytes(arrays), f"{folder}/robot.urdf": _bare_urdf(source.model)}
    facts = {"phases": len(phases), "duration": plan.duration, "run": shlex.join(["python", file.name])}
    return Product(SCRIPT.read_bytes(), beside, facts)


def _support_boxes(source: Source) -> tuple[np.ndarray, np.ndarray]:
    """((C, 2), (C, 2)) least and greatest corner of the box around each contact's support, in the contact's frame [m]."""
    contacts = source.plan.contacts
    corners = [contacts.corners(k) for k in range(len(contacts))]
    return (
        np.array([c.min(axis=0) for c in corners]).reshape(-1, 2),
        np.array([c.max(axis=0) for c in corners]).reshape(-1, 2),
    )


def _bare_urdf(model: Path) -> bytes:
    """The links and joints of a URDF without shapes, which other parsers may not know, and without meshes."""
    root = read_urdf(model)
    bare = etree.Element("robot", name=root.get("name", "robot"))
    bare.extend([e for e in root if e.tag in KEPT])
    for link in bare.findall("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    etree.cleanup_namespaces(bare)
    etree.indent(bare)
    return etree.tostring(bare, xml_declaration=True, encoding="utf-8")
