"""Height maps out of npz and npy files, their small holes filled."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

from scenes.imports.point_file import array_of
from scenes.imports.small_holes import EIGHT, small_holes
from scenes.input_error import InputError

MAX_UNPACKED = 256 * 2**20  # [bytes]
HIGHEST = 1e5  # [m]


@dataclass(frozen=True, eq=False)
class Heights:
    """A height map in its own frame and unit.

    Attributes:
        height: (rows along y, columns along x), NaN where unknown.
        resolution: edge of a cell, None where the file does not say.
        origin: (2,) x and y of the first height, None where the file does not say.
    """

    height: np.ndarray
    resolution: float | None = None
    origin: tuple[float, float] | None = None


def heights_of(data: bytes, path: Path) -> Heights:
    """The height map in a file: the array `height` of an npz file or its only one of two dimensions, or an npy file.

    An npz file may also hold `resolution` and `origin` (x and y, or x, y and z).

    Args:
        data: the file.
        path: its suffix names the format.

    Raises:
        InputError: it is no such file, holds no or several maps, or nothing in it is finite.
    """
    if path.suffix.lower() == ".npz":
        arrays = _archive(data, path)
        flat = {name: a for name, a in arrays.items() if a.ndim == 2}
        if "height" in arrays:
            height = arrays["height"]
        elif len(flat) == 1:
            height = next(iter(flat.values()))
        else:
            held = ", ".join(f"{name} {a.shape}" for name, a in arrays.items()) or "none"
            raise InputError(f"{path}: expected an array 'height', or one array of two dimensions, found {held}"[:300])
        resolution, origin = _resolution(arrays, path), _origin(arrays, path)
    else:
        height, resolution, origin = array_of(data, path), None, None
    if height.ndim != 2 or min(height.shape) < 2:
        raise InputError(f"{path}: height: expected numbers in rows and columns, got shape {height.shape}")
    height = np.where(np.isfinite(height), height, np.nan)
    if not np.isfinite(height).any():
        raise InputError(f"{path}: height: none of its {height.size} heights is finite, expected numbers")
    if origin is not None and len(origin) == 3:
        height = height + origin[2]
    return Heights(height, resolution, None if origin is None else (origin[0], origin[1]))


def without_small_holes(height: np.ndarray, width: float) -> tuple[np.ndarray, int]:
    """The map with each hole filled whose greatest circle is at most so many cells across, and how many cells that were.

    A filled cell has the mean height of those around it, from the rim of the hole inwards.

    Args:
        height: (rows, columns), NaN where unknown.
        width: of the widest hole that is filled, in cells.
    """
    fill = small_holes(~np.isnan(height), width)
    filled = height.copy()
    left = fill.copy()
    while left.any():
        known = ~np.isnan(filled)
        total = np.asarray(ndimage.convolve(np.where(known, filled, 0.0), 1.0 * EIGHT, mode="constant"))
        around = np.asarray(ndimage.convolve(known.astype(float), 1.0 * EIGHT, mode="constant"))
        now = left & (around > 0)
        filled[now] = total[now] / around[now]
        left &= ~now
    return filled, int(fill.sum())


def height_archive(height: np.ndarray) -> bytes:
    """An npz file with the array `height`; equal maps make equal files."""
    array, out = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array(array, height, allow_pickle=False)
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("height.npy"), array.getvalue(), zipfile.ZIP_DEFLATED)
    return out.getvalue()


def _archive(data: bytes, path: Path) -> dict[str, np.ndarray]:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:  # what it claims to hold, before memory is taken for it
            if sum(entry.file_size for entry in archive.infolist()) > MAX_UNPACKED:
                raise InputError(f"{path}: larger than {MAX_UNPACKED >> 20} MiB, the most that a height map may be")
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            held = {name: np.asarray(arrays[name]) for name in arrays.files}
    except InputError:
        raise
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, KeyError, NotImplementedError, RuntimeError) as error:
        raise InputError(f"{path}: not a readable npz file ({type(error).__name__}: {error})"[:300]) from None
    numbers = {name: a.astype(float) for name, a in held.items() if a.dtype.kind in "fiu"}
    if "height" in held and "height" not in numbers:
        raise InputError(f"{path}: height: expected numbers, got {held['height'].dtype}")
    return numbers


def _resolution(arrays: dict[str, np.ndarray], path: Path) -> float | None:
    if "resolution" not in arrays:
        return None
    values = np.unique(arrays["resolution"])
    if len(values) != 1 or not np.isfinite(values[0]) or values[0] <= 0:
        raise InputError(f"{path}: resolution: expected one number above 0, the edge of a cell")
    return float(values[0])


def _origin(arrays: dict[str, np.ndarray], path: Path) -> tuple[float, ...] | None:
    if "origin" not in arrays:
        return None
    values = arrays["origin"].ravel()
    if len(values) not in (2, 3) or not np.isfinite(values).all():
        raise InputError(f"{path}: origin: expected x and y of the first height, or x, y and z")
    return tuple(values.tolist())
