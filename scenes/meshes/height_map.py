"""Height maps in NumPy files: two triangles a cell, none where a height is not known."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.input_error import InputError
from scenes.meshes.mesh_file import MAX_BYTES, MAX_TRIANGLES
from scenes.meshes.mesh_import import MeshImport, surfaces_of_mesh
from scenes.meshes.mesh_orientation import Bodies
from scenes.terrain.terrain import TriangleMesh


@dataclass(frozen=True, eq=False)
class ImportedHeightMap(TriangleMesh):
    """A height map that was read from a file, already in W.

    Attributes:
        reference: the `file:` entry, relative to a scene file or `package://`.
        path: the file itself.
        resolution: edge of a cell [m].
        origin: (2,) x and y of the first height, as the scene file gives them [m].
        friction: of all its surfaces [-].
        unknown: area of its triangles with a corner that is not known, in the plan view [m^2].
    """

    reference: str
    path: Path
    resolution: float
    origin: tuple[float, float]
    friction: float
    unknown: float = 0.0


def import_height_map(
    path: Path,
    *,
    reference: str,
    name: str,
    resolution: float,
    origin: tuple[float, float],
    friction: float,
    shift: tuple[float, float] = (0.0, 0.0),
) -> MeshImport:
    """Reads a height map and cuts surfaces out of it.

    Args:
        path: of the npz file; its array `height` has rows along y, columns along x [m], NaN where unknown.
        reference: how a scene file names it.
        name: of the obstacle that it becomes.
        resolution: edge of a cell [m].
        origin: (2,) x and y of the first height as the scene file gives them [m].
        friction: of every surface [-].
        shift: (2,) subtracted from the origin, for a georeferenced map [m].

    Raises:
        InputError: the file cannot be used, or no cell of it is known.
    """
    height = read_heights(path)
    rows, columns = height.shape
    if 2 * (rows - 1) * (columns - 1) > MAX_TRIANGLES:
        raise InputError(
            f"{path}: {rows} x {columns} heights, expected at most {MAX_TRIANGLES // 2} cells; crop or thin the map"
        )
    x = origin[0] - shift[0] + resolution * np.arange(columns)
    y = origin[1] - shift[1] + resolution * np.arange(rows)
    points = np.stack([*np.meshgrid(x, y), height], axis=-1)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    triangles = np.concatenate([np.stack([a, b, c], axis=-2), np.stack([a, c, d], axis=-2)]).reshape(-1, 3, 3)
    triangles = triangles[np.isfinite(triangles).all(axis=(1, 2))]
    if not len(triangles):
        raise InputError(f"{path}: height: no cell has three known heights, expected numbers")
    notes: list[str] = []
    missing = ((rows - 1) * (columns - 1) - len(triangles) / 2) * resolution**2
    unknown = float(np.mean(~np.isfinite(height)))
    if unknown:
        notes.append(f"{unknown:.1%} of its heights are not known; nothing steps there")
    triangles, surfaces, fitted = surfaces_of_mesh(Bodies(triangles), name, friction)
    obstacle = ImportedHeightMap(name, triangles, reference, path, resolution, origin, friction, missing)
    return MeshImport(obstacle, surfaces, tuple(f"{path.name}: {note}" for note in (*notes, *fitted)))


def read_heights(path: Path) -> np.ndarray:
    """(rows, columns) the array `height` of an npz file [m]; infinite heights are unknown too.

    Raises:
        InputError: no such file, no npz file, too large, or no such array of numbers.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such height map, expected an npz file")
    try:
        with zipfile.ZipFile(path) as archive:  # what it claims to hold, before memory is taken for it
            if sum(entry.file_size for entry in archive.infolist()) > MAX_BYTES:
                raise InputError(f"{path}: larger than {MAX_BYTES >> 20} MiB, the most that a height map may be")
        with np.load(path, allow_pickle=False) as arrays:
            if "height" not in arrays:
                raise InputError(f"{path}: expected an array 'height', found {', '.join(arrays.files) or 'none'}"[:300])
            height = np.asarray(arrays["height"])
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, KeyError) as error:
        raise InputError(f"{path}: not a readable npz file ({type(error).__name__}: {error})"[:300]) from None
    if height.ndim != 2 or min(height.shape) < 2 or height.dtype.kind not in "fiu":
        raise InputError(
            f"{path}: height: expected numbers in rows and columns, got {height.dtype} of shape {height.shape}"
        )
    height = height.astype(float)
    known = np.isfinite(height)
    if np.abs(height[known]).max(initial=0.0) > 1e5:
        raise InputError(f"{path}: height: expected metres below 100 km; give NaN where it is not known")
    return np.where(known, height, np.nan)
