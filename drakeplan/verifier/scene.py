"""Reads the scene that a plan file holds."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportReturnType=false

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import yaml
from pydrake.math import RigidTransform, RollPitchYaw

from .limits import (
    EFFECTORS,
    FOOT_MAX_TILT,
    MAX_YAML,
    PALM_TILT,
)
from .plan_file import UnreadablePlan


@dataclass(frozen=True, eq=False)
class Plate:
    """A surface of the scene: convex polygon (K, 3), outward normal, friction, end effectors that may touch it."""

    name: str
    vertices: np.ndarray
    normal: np.ndarray
    friction: float
    allowed: frozenset[str]

    @cached_property
    def low(self) -> np.ndarray:
        """(3,) lowest corner of its box [m]."""
        return self.vertices.min(axis=0)

    @cached_property
    def high(self) -> np.ndarray:
        """(3,) highest corner of its box [m]."""
        return self.vertices.max(axis=0)


@dataclass(frozen=True, eq=False)
class Scene:
    """Surfaces, boxes, start and goal."""

    plates: tuple[Plate, ...]
    boxes: tuple[tuple[np.ndarray, np.ndarray], ...]  # (4, 4) pose of the centre, (3,) full edges
    start: dict
    goal: dict

    def surface(self, name: str) -> int:
        return next((k for k, plate in enumerate(self.plates) if plate.name == name), -1)


def read_scene(text: str) -> Scene:
    if len(text) > MAX_YAML:
        raise UnreadablePlan(f"scene/yaml: longer than {MAX_YAML} characters")
    try:
        scene = _plain(text)
        if not isinstance(scene, dict):
            raise TypeError("expected a mapping")
        friction = float(scene.get("friction", 0.5))
        plates = tuple(_read_plate(entry, k, friction) for k, entry in enumerate(scene.get("surfaces") or ()))
        boxes = tuple((pose(entry.get("pose") or {}), triple(entry["box"])) for entry in scene.get("obstacles") or ())
        start, goal = scene.get("start") or {}, scene.get("goal") or {}
        if not isinstance(start, dict) or not isinstance(goal, dict):
            raise TypeError("start and goal must be mappings")
    except (yaml.YAMLError, TypeError, ValueError, KeyError, AttributeError) as error:
        raise UnreadablePlan(f"scene/yaml: not a scene ({type(error).__name__}: {error})") from None
    return Scene(plates, boxes, start, goal)


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
                raise ValueError("duplicate key")
            opened[-1][0].append(pairs if mapping else items)
        elif isinstance(event, yaml.AliasEvent):
            raise ValueError("aliases are not allowed")
        if len(opened) > 50:
            raise ValueError("nested too deep")
    if len(found) != 1:
        raise ValueError("expected one document")
    return found[0]


def _read_plate(entry: dict, index: int, friction: float) -> Plate:
    vertices = np.array([triple(row) for row in entry["vertices"]])
    doubled = np.cross(vertices - vertices[0], np.roll(vertices, -1, axis=0) - vertices[0]).sum(axis=0)
    if not np.linalg.norm(doubled) > 1e-9:
        raise ValueError(f"surface {index} encloses no area")
    normal = doubled / np.linalg.norm(doubled)  # Newell's method
    given = entry.get("normal")
    if given is not None and triple(given) @ normal < 0:
        vertices, normal = vertices[::-1], -normal
    tilt = np.arccos(np.clip(normal[2], -1.0, 1.0))
    feet, palms = tilt <= FOOT_MAX_TILT + 1e-9, PALM_TILT[0] - 1e-9 <= tilt <= PALM_TILT[1] + 1e-9
    by_tilt = [e for e in EFFECTORS if (feet if e.endswith("foot") else palms)]
    contact = entry.get("contact")
    allowed = frozenset(by_tilt if contact is None else contact)
    own = entry.get("friction")
    name = str(entry.get("name") or f"surface {index}")
    return Plate(name, vertices, normal, friction if own is None else float(own), allowed)


def pose(entry: dict) -> np.ndarray:
    """(4, 4) from xyz [m] and rpy [rad] as Drake's RollPitchYaw."""
    rpy, xyz = entry.get("rpy") or (0.0, 0.0, 0.0), entry.get("xyz") or (0.0, 0.0, 0.0)
    return RigidTransform(RollPitchYaw(triple(rpy)), triple(xyz)).GetAsMatrix4()


def triple(entry: Sequence) -> np.ndarray:
    """(3,) finite numbers. One by one, so that nested lists cannot become an array of any size."""
    x, y, z = (float(number) for number in entry)
    if not math.isfinite(x + y + z):
        raise ValueError("expected finite numbers")
    return np.array([x, y, z])
