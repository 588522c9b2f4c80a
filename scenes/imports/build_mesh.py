"""A mesh as terrain; its file is kept beside the scene file, which names it with its unit and its axes."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from scenes.imports.built import Built, ImportOptions, is_inside
from scenes.imports.import_report import Change
from scenes.imports.placement import UNITS, UPWARD, placement_of
from scenes.input_error import InputError
from scenes.meshes.mesh_file import drop_degenerate, read_mesh
from scenes.meshes.mesh_import import check_up_axis, import_mesh, mesh_name
from scenes.meshes.mesh_orientation import Bodies
from scenes.terrain.polygon import area_vectors
from scenes.terrain.surface import FOOT_MAX_TILT


def build_mesh(path: Path, options: ImportOptions, out: Path) -> Built:
    """Reads a mesh, mends what is wrong with it, and cuts surfaces out of it.

    Args:
        path: of the STL, OBJ, PLY or DAE file.
        options: how to understand it.
        out: of the scene file that will name the mesh.

    Raises:
        InputError: the file cannot be used, or its size says that it is in another unit.
    """
    triangles = read_mesh(path)
    place = placement_of(triangles.reshape(-1, 3), path, options.unit, options.up)
    whole = drop_degenerate(place.points(triangles))
    X_WM = np.eye(4)
    X_WM[:3, :3] = UPWARD[options.up]
    inside = is_inside(path, out.parent)
    target = path if inside else out.parent / f"{mesh_name(out)}_mesh{path.suffix.lower()}"
    made = import_mesh(
        path,
        reference=target.name,
        name=mesh_name(target),
        X_WM=X_WM,
        scale=UNITS[options.unit or "m"],
        friction=options.friction,
    )
    obstacle = dataclasses.replace(made.obstacle, path=target)
    bodies = Bodies(whole)
    closed = int(bodies.closed().sum())
    changes = [Change("dropped", len(triangles) - len(whole), "triangles", "without an area, or listed more than once")]
    notes = [note.removeprefix(f"{path.name}: ") for note in made.notes]
    if closed < bodies.count:
        notes.append(
            f"{bodies.count - closed} of {bodies.count} bodies are open: they have no inside, and stop nothing but at their faces"
        )
    hints = list(place.hints)
    if options.up == "z":
        try:
            check_up_axis((obstacle,))
        except InputError:
            hints.append("much more of it faces +y than +z: if its y axis points up, give --up y")
    middle, level = whole.mean(axis=1), _level(whole)
    return Built(
        made.surfaces,
        (obstacle,),
        True,
        {"triangles": len(triangles), "bodies": bodies.count, "closed bodies": closed},
        made.origin_offset,
        tuple(changes),
        tuple(notes),
        tuple(hints),
        middle[level],
        {} if inside else {target.name: path.read_bytes()},
    )


def _level(triangles: np.ndarray) -> np.ndarray:
    """(K,) bool, the triangles that are level enough for feet, whichever way they face."""
    doubled = area_vectors(triangles)
    return np.abs(doubled[:, 2]) >= np.cos(FOOT_MAX_TILT) * np.linalg.norm(doubled, axis=1)
