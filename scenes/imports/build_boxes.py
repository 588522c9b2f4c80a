"""A list of boxes as terrain: solids whose sides are surfaces."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from scenes.effector import EFFECTORS
from scenes.files.box_sides import box_sides
from scenes.imports.box_list import BoxEntry, json_boxes, table_boxes
from scenes.imports.built import Built, ImportOptions
from scenes.imports.import_report import Change
from scenes.imports.placement import placement_of
from scenes.imports.polygon_file import load_json
from scenes.imports.text_file import decoded, read_bytes, table_of
from scenes.pose import pose_matrix, rpy_rotation
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box


def build_boxes(path: Path, options: ImportOptions, out: Path) -> Built:
    """Reads a list of boxes; their sides are surfaces for whom the list names, else by tilt.

    Args:
        path: of the JSON or CSV file.
        options: how to understand it.
        out: of the scene file.

    Raises:
        InputError: the file cannot be used.
    """
    data = read_bytes(path)
    if path.suffix.lower() == ".json":
        entries = json_boxes(load_json(data, path), path)
    else:
        entries = table_boxes(table_of(decoded(data, path), path), path)
    corners = np.concatenate([_corners(entry) for entry in entries])
    place = placement_of(corners, path, options.unit, options.up)
    boxes: dict[tuple[object, ...], Box] = {}
    surfaces: list[Surface] = []
    names: set[str] = set()
    for number, entry in enumerate(entries):
        key = (*np.round(np.concatenate([entry.size, entry.xyz, entry.rpy]), 9).tolist(),)
        if key in boxes:
            continue
        name = "".join(c if c.isprintable() else "_" for c in entry.name)[:180] or f"box_{number}"
        while name in names:
            name = f"{name}_{number}"
        names.add(name)
        X_WO = pose_matrix(place.points(entry.xyz), (0.0, 0.0, 0.0))
        X_WO[:3, :3] = place.R @ rpy_rotation(entry.rpy)
        box = boxes[key] = Box(name, place.scale * entry.size, X_WO)
        friction = options.friction if entry.friction is None else entry.friction
        sides = box_sides(box, EFFECTORS if entry.contact is None else entry.contact, friction)
        if entry.contact is None:  # by tilt
            sides = [dataclasses.replace(side, effectors=None) for side in sides]
        surfaces += sides
    twins = len(entries) - len(boxes)
    changes = (Change("merged", twins, "boxes", "listed more than once"),) if twins else ()
    return Built(
        tuple(surfaces),
        tuple(boxes.values()),
        False,
        {"boxes": len(entries)},
        place.offset,
        changes,
        place.notes,
        place.hints,
    )


def _corners(entry: BoxEntry) -> np.ndarray:
    half = entry.size / 2
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return entry.xyz + (signs * half) @ rpy_rotation(entry.rpy).T
