"""A height map as terrain; its map is kept beside the scene file, which names it."""

from __future__ import annotations

import dataclasses
import io
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.imports.built import Built, ImportOptions, is_inside
from scenes.imports.height_file import height_archive, heights_of, without_small_holes
from scenes.imports.import_report import Change
from scenes.imports.placement import UNITS, placement_of
from scenes.imports.text_file import read_bytes
from scenes.input_error import InputError
from scenes.meshes.height_map import import_height_map
from scenes.meshes.mesh_import import MeshImport, mesh_name


def build_heights(path: Path, options: ImportOptions, out: Path) -> Built:
    """Reads a height map, fills its small holes, and cuts surfaces out of it.

    Args:
        path: of the npz or npy file.
        options: how to understand it.
        out: of the scene file that will name the map.

    Raises:
        InputError: the file cannot be used, or nobody says how large its cells are.
    """
    if options.up != "z":
        raise InputError("--up: a height map's heights are along z, expected --up z")
    data = read_bytes(path)
    found = heights_of(data, path)
    unit = UNITS[options.unit or "m"]
    resolution = options.resolution or (None if found.resolution is None else found.resolution * unit)
    if resolution is None:
        raise InputError(f"{path}: does not say how large its cells are: give --resolution METRES")
    origin = options.origin or tuple(unit * x for x in found.origin or (0.0, 0.0))
    height = found.height * unit
    rows, columns = height.shape
    low, high = np.nanmin(height), np.nanmax(height)
    corners = np.array([[*origin, low], [origin[0] + resolution * columns, origin[1] + resolution * rows, high]])
    place = placement_of(corners, path, "m" if options.unit else None, "z")
    hints = list(place.hints)
    if options.unit is None and high - low > max(resolution * rows, resolution * columns):
        hints.append(
            f"its heights span {high - low:.3g} m, more than it is wide: if they are millimetres, give --unit mm"
        )
    height, filled = without_small_holes(height, options.close / resolution)
    changes = [Change("filled", filled, "cells", f"in holes up to {options.close:g} m wide")]

    shift = (0.0, 0.0) if place.offset is None else (float(place.offset[0]), float(place.offset[1]))
    kept = _kept_map(path, data, height, out, as_it_was=not filled and unit == 1.0)
    made = _surfaces_of(kept, path, resolution, origin, options.friction, shift)
    target = kept.file
    obstacle = dataclasses.replace(made.obstacle, path=target)
    y, x = np.nonzero(np.isfinite(height))
    grid = np.stack(
        [x * resolution + origin[0] - shift[0], y * resolution + origin[1] - shift[1], height[y, x]], axis=1
    )
    return Built(
        made.surfaces,
        (obstacle,),
        True,
        {"rows": rows, "columns": columns, "known heights": len(grid)},
        place.offset,
        tuple(changes),
        (*place.notes, *(note.removeprefix(f"{target.name}: ") for note in made.notes)),
        tuple(hints),
        grid,
        {} if kept.is_users else {target.name: kept.content},
    )


@dataclass(frozen=True)
class _KeptMap:
    """The archive that the scene file will name, and whether it is the user's own, which stays as it is."""

    file: Path
    content: bytes
    is_users: bool


def _kept_map(path: Path, data: bytes, height: np.ndarray, out: Path, *, as_it_was: bool) -> _KeptMap:
    if path.suffix.lower() == ".npz" and as_it_was and is_inside(path, out.parent) and _is_plain(data, height, path):
        return _KeptMap(path, data, True)
    target = out.parent / f"{mesh_name(out)}_heights.npz"
    if target.resolve() == path.resolve():
        target = target.with_stem(f"{target.stem}_imported")
    return _KeptMap(target, height_archive(height), False)


def _surfaces_of(
    kept: _KeptMap,
    path: Path,
    resolution: float,
    origin: tuple[float, ...],
    friction: float,
    shift: tuple[float, float],
) -> MeshImport:
    """What the scene file will make of the map; errors name the user's file."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / kept.file.name
        file.write_bytes(kept.content)
        try:
            return import_height_map(
                file,
                reference=kept.file.name,
                name=f"{mesh_name(kept.file)}_map",
                resolution=resolution,
                origin=(float(origin[0]), float(origin[1])),
                friction=friction,
                shift=shift,
            )
        except InputError as error:
            raise InputError(str(error).replace(str(file), str(path))) from None


def _is_plain(data: bytes, height: np.ndarray, path: Path) -> bool:
    """Whether a scene file can name this archive as it is: its array `height` is the map."""
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return "height" in arrays and np.array_equal(np.asarray(arrays["height"], float), height, equal_nan=True)
