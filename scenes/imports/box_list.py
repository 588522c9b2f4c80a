"""Lists of boxes, in JSON or CSV: size, place and rpy of each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scenes.effector import EFFECTORS
from scenes.imports.text_file import Table
from scenes.input_error import InputError

MAX_BOXES = 5000
COLUMNS = ("sx", "sy", "sz", "x", "y", "z", "roll", "pitch", "yaw")
OTHER_NAMES = {
    "size_x": "sx", "size_y": "sy", "size_z": "sz", "length": "sx", "width": "sy", "height": "sz", "dx": "sx", "dy": "sy",
    "dz": "sz", "rx": "roll", "ry": "pitch", "rz": "yaw",
}  # fmt: skip
KEYS = ("size", "xyz", "rpy", "name", "friction", "contact")


@dataclass(frozen=True, eq=False)
class BoxEntry:
    """A box of a list, in the file's unit.

    Attributes:
        name: "" where it has none.
        size: (3,) full edge lengths.
        xyz: (3,) place of its middle.
        rpy: (3,) roll, pitch and yaw [rad].
        friction: of its sides [-], None for the scene's.
        contact: end effectors that may touch it, None for all.
    """

    name: str
    size: np.ndarray
    xyz: np.ndarray
    rpy: np.ndarray
    friction: float | None = None
    contact: tuple[str, ...] | None = None


def json_boxes(value: Any, path: Path) -> list[BoxEntry]:
    """The boxes in the data of a JSON file: a list of mappings, or one under `boxes`.

    Args:
        value: the data.
        path: for errors.

    Raises:
        InputError: a box is not what it should be.
    """
    items = value.get("boxes") if isinstance(value, dict) else value
    if not isinstance(items, list) or not items:
        raise InputError(f"{path}: boxes: expected a list of {{size: [x, y, z], xyz: [x, y, z], rpy: [r, p, y]}}")
    boxes = []
    for k, item in enumerate(items):
        where = f"{path}: boxes[{k}]"
        if not isinstance(item, dict) or "size" not in item:
            raise InputError(f"{where}: expected a mapping with size, xyz and rpy")
        unknown = sorted(set(item) - set(KEYS))
        if unknown:
            raise InputError(f"{where}: unknown key {unknown[0]!r}, expected {', '.join(KEYS)}"[:300])
        size = _triple(item["size"], f"{where}.size")
        place, turn = (_triple(item.get(key, [0, 0, 0]), f"{where}.{key}") for key in ("xyz", "rpy"))
        friction, contact = item.get("friction"), item.get("contact")
        if friction is not None and (not isinstance(friction, int | float) or not 0 <= friction <= 10):
            raise InputError(f"{where}.friction: expected a number from 0 to 10")
        if contact is not None and not (isinstance(contact, list) and all(e in EFFECTORS for e in contact)):
            raise InputError(f"{where}.contact: expected some of {', '.join(EFFECTORS)}")
        boxes.append(
            BoxEntry(
                str(item.get("name", "")), size, place, turn, friction, None if contact is None else tuple(contact)
            )
        )
    return _checked(boxes, path)


def is_box_table(table: Table) -> bool:
    """Whether the heading of a table names the edges of boxes."""
    return {"sx", "sy", "sz"} <= set(_columns(table.names))


def table_boxes(table: Table, path: Path) -> list[BoxEntry]:
    """The boxes in a table: columns by their names, or size, place and rpy in this order.

    Args:
        table: its rows.
        path: for errors.

    Raises:
        InputError: columns are missing, or a size is not positive.
    """
    names = _columns(table.names)
    if len(names) != table.rows.shape[1]:
        names = COLUMNS[: table.rows.shape[1]]
    lacking = [c for c in COLUMNS[:6] if c not in names]
    if lacking:
        raise InputError(
            f"{path}: expected columns {' '.join(COLUMNS)} (the last three may be left out), no {lacking[0]}"
        )
    empty = np.zeros(len(table.rows))
    column = {c: table.rows[:, names.index(c)] if c in names else empty for c in COLUMNS}
    values = np.stack([column[c] for c in COLUMNS], axis=1)
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
        raise InputError(f"{path}: box {row}: expected finite numbers")
    labels = table.labels or ("",) * len(values)
    return _checked([BoxEntry(n, r[:3], r[3:6], r[6:]) for n, r in zip(labels, values, strict=True)], path)


def _columns(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(OTHER_NAMES.get(name, name) for name in names)


def _checked(boxes: list[BoxEntry], path: Path) -> list[BoxEntry]:
    if len(boxes) > MAX_BOXES:
        raise InputError(f"{path}: {len(boxes)} boxes, expected at most {MAX_BOXES}")
    for k, box in enumerate(boxes):
        if (box.size <= 0).any():
            raise InputError(f"{path}: box {k}: size: expected lengths above 0, got {box.size.tolist()}")
    return boxes


def _triple(value: Any, where: str) -> np.ndarray:
    try:
        triple = np.array(value, float)
    except (ValueError, TypeError):
        triple = np.zeros(0)
    if triple.shape != (3,) or not np.isfinite(triple).all():
        raise InputError(f"{where}: expected three finite numbers")
    return triple
