"""Point clouds out of PLY, PCD, NumPy and text files."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.imports.pcd_file import read_pcd
from scenes.imports.text_file import Table, decoded, table_of
from scenes.input_error import InputError

MAX_POINTS = 20_000_000
POINT_SUFFIXES = (".ply", ".pcd", ".npy", ".xyz", ".txt", ".csv", ".asc", ".pts")


@dataclass(frozen=True, eq=False)
class Cloud:
    """The points of a file, in its own frame and unit.

    Attributes:
        points: (N, 3) finite.
        lost: how many points of the file are not finite.
        normals: (N, 3) where the file has them, else None.
        viewpoint: (3,) of the sensor where the file names it, else None.
    """

    points: np.ndarray
    lost: int
    normals: np.ndarray | None = None
    viewpoint: np.ndarray | None = None


def cloud_of(data: bytes, path: Path) -> Cloud:
    """The point cloud in a file.

    Args:
        data: the file.
        path: its suffix names the format.

    Raises:
        InputError: it is no such file, holds no points, or none of them is finite.
    """
    suffix = path.suffix.lower()
    normals = viewpoint = None
    if suffix == ".pcd":
        points, normals, viewpoint = read_pcd(data, path)
    elif suffix == ".ply":
        points, normals = _ply(data, path)
    elif suffix == ".npy":
        points = array_of(data, path)
        if points.ndim != 2 or points.shape[1] < 3:
            raise InputError(f"{path}: expected an array of shape (N, 3), got {points.shape}")
        points = points[:, :3]
    else:
        points, normals = _columns(table_of(decoded(data, path), path), path)
    points = np.asarray(points, float)
    if len(points) > MAX_POINTS:
        raise InputError(f"{path}: {len(points)} points, expected at most {MAX_POINTS}; thin it")
    if not len(points):
        raise InputError(f"{path}: holds no points")
    finite = np.isfinite(points).all(axis=1)
    if not finite.any():
        raise InputError(f"{path}: none of its {len(points)} points is finite, expected numbers")
    if normals is not None:
        normals = np.nan_to_num(np.asarray(normals, float)[finite])
        normals = normals if np.abs(normals).max(initial=0.0) > 0 else None
    return Cloud(points[finite], int((~finite).sum()), normals, viewpoint)


def array_of(data: bytes, path: Path) -> np.ndarray:
    """The array of numbers in a npy file; objects, which could run code, are refused.

    Args:
        data: the file.
        path: for errors.

    Raises:
        InputError: it is no such file or holds no numbers.
    """
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path}: not a readable npy file ({type(error).__name__}: {error})"[:300]) from None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        raise InputError(f"{path}: expected an array of numbers, got {getattr(array, 'dtype', type(array).__name__)}")
    return array.astype(float)


def has_faces(data: bytes) -> bool:
    """Whether a PLY file is a mesh."""
    head = data[:10_000].partition(b"end_header")[0].split()
    return any(head[k : k + 2] == [b"element", b"face"] and head[k + 2 : k + 3] != [b"0"] for k in range(len(head)))


def _ply(data: bytes, path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    import trimesh  # 0.5 s

    if not data.startswith(b"ply"):
        raise InputError(f"{path}: expected a PLY file, which begins with 'ply'")
    if b"format ascii" in data[:200]:
        data = data.replace(b"\r\n", b"\n")
    try:
        with np.errstate(all="ignore"):
            loaded = trimesh.load(io.BytesIO(data), file_type="ply", process=False)
        points = np.asarray(getattr(loaded, "vertices", np.zeros(0)), float)
        fields = loaded.metadata.get("_ply_raw", {}).get("vertex", {}).get("data", None)
    except Exception as error:  # a format has exceptions of its own, and none of them is our bug
        raise InputError(f"{path}: not a readable PLY file ({type(error).__name__}: {error})"[:300]) from None
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{path}: not a readable PLY file (expected x, y and z of each vertex)")
    names = getattr(getattr(fields, "dtype", None), "names", None) or (fields if isinstance(fields, dict) else ())
    normals = None
    if fields is not None and all(n in names for n in ("nx", "ny", "nz")):
        normals = np.stack([np.asarray(fields[n], float).ravel() for n in ("nx", "ny", "nz")], axis=1)
        normals = normals if normals.shape == points.shape else None
    return points, normals


def _columns(table: Table, path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """x, y and z of a table, and normals where its heading names them."""
    if table.rows.shape[1] < 3:
        raise InputError(f"{path}: expected three columns x y z, got {table.rows.shape[1]}")
    if len(table.names) == table.rows.shape[1] and {"x", "y", "z"} <= set(table.names):
        at = [table.names.index(name) for name in "xyz"]
        along = [table.names.index(n) for n in ("nx", "ny", "nz") if n in table.names]
        return table.rows[:, at], table.rows[:, along] if len(along) == 3 else None
    return table.rows[:, :3], None
