"""Flat regions as lists of corners: JSON with names and holes, and the plain lists that sl1m uses, in JSON, npy and text."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from scenes.effector import EFFECTORS
from scenes.imports.outline import Outline
from scenes.imports.point_file import array_of
from scenes.imports.text_file import decoded, table_of
from scenes.input_error import InputError

LISTS = ("polygons", "surfaces", "regions")
CORNERS = ("vertices", "outline", "exterior", "polygon")
KEYS = {*CORNERS, "holes", "interiors", "name", "id", "normal", "friction", "contact"}
MAX_OUTLINES = 20_000
MAX_DEPTH = 20


def polygons_of(data: bytes, path: Path) -> list[Outline]:
    """The polygons in a file: .json, .npy, or text with a blank line between two.

    Corners are rows of x y z, or, as in sl1m, columns of a 3 x N array. Lists in lists, as of the surfaces of each
    step, are taken apart.

    Args:
        data: the file.
        path: its suffix names the format.

    Raises:
        InputError: it is no such file, or a polygon has no three corners.
    """
    suffix = path.suffix.lower()
    if suffix == ".json":
        return json_polygons(load_json(data, path), path)
    if suffix == ".npy":
        array = array_of(data, path)
        if array.ndim not in (2, 3) or 3 not in array.shape[-2:]:
            raise InputError(
                f"{path}: expected polygons as an array of shape (K, N, 3) or (K, 3, N), got {array.shape}"
            )
        blocks = list(array) if array.ndim == 3 else [array]
    else:
        table = table_of(decoded(data, path), path)
        blocks = [table.rows[table.blocks == k] for k in range(int(table.blocks.max()) + 1)]
    return _outlines([(f"[{k}]", block) for k, block in enumerate(blocks)], path)


def load_json(data: bytes, path: Path) -> Any:
    """What a JSON file holds.

    Args:
        data: the file.
        path: for errors.

    Raises:
        InputError: it is no JSON.
    """
    try:
        return json.loads(decoded(data, path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not readable as JSON ({error or 'too deep'})"[:300]) from None


def json_polygons(value: Any, path: Path) -> list[Outline]:
    """The polygons in the data of a JSON file.

    Args:
        value: a list of polygons, or a mapping with one under `polygons`, `surfaces` or `regions`.
        path: for errors.

    Raises:
        InputError: it holds no polygons, or one is not what it should be.
    """
    if isinstance(value, dict) and not set(value) & set(CORNERS):
        key = next((k for k in LISTS if k in value), None)
        if key is None:
            raise InputError(f"{path}: expected a list of polygons, or one under {', '.join(LISTS)}")
        value = value[key]
    named: list[Outline] = []
    plain: list[tuple[str, np.ndarray]] = []
    _gather(value, "", path, named, plain, 0)
    found = named + _outlines(plain, path)
    if not found:
        raise InputError(f"{path}: holds no polygons")
    if len(found) > MAX_OUTLINES:
        raise InputError(f"{path}: {len(found)} polygons, expected at most {MAX_OUTLINES}")
    return found


def _gather(
    value: Any, where: str, path: Path, named: list[Outline], plain: list[tuple[str, np.ndarray]], depth: int
) -> None:
    """Adds the polygons in a value to those that say something of themselves and those that are corners only.

    Args:
        value: list, mapping or array of numbers.
        where: in the file, for errors.
        path: of the file.
        named: gets the former.
        plain: gets the latter.
        depth: of lists in lists.
    """
    if isinstance(value, dict):
        named.append(_mapped(value, where, path))
        return
    if not isinstance(value, list) or depth > MAX_DEPTH:
        raise InputError(f"{path}: {where or 'the file'}: expected a polygon as a list of [x, y, z]")
    if value and all(isinstance(v, list) and v and all(_is_number(x) for x in v) for v in value):
        plain.append((where, _corners(value, where, path)))
        return
    for k, item in enumerate(value):
        _gather(item, f"{where}[{k}]", path, named, plain, depth + 1)


def _mapped(value: dict[str, Any], where: str, path: Path) -> Outline:
    unknown = sorted(set(value) - KEYS)
    key = next((k for k in CORNERS if k in value), None)
    if key is None or unknown:
        problem = f"unknown key {unknown[0]!r}" if unknown else f"no {CORNERS[0]}"
        raise InputError(f"{path}: {where}: {problem}, expected {', '.join(sorted(KEYS))}"[:400])
    ring = _rows([_corners(value[key], f"{where}.{key}", path)])[0]
    holes = value.get("holes", value.get("interiors", []))
    if not isinstance(holes, list):
        raise InputError(f"{path}: {where}.holes: expected a list of outlines")
    cut = tuple(_rows([_corners(h, f"{where}.holes[{k}]", path)])[0] for k, h in enumerate(holes))
    normal = value.get("normal")
    if normal is not None and not (isinstance(normal, list) and len(normal) == 3 and all(map(_is_number, normal))):
        raise InputError(f"{path}: {where}.normal: expected [x, y, z]")
    friction = value.get("friction")
    if friction is not None and not (_is_number(friction) and 0 <= friction <= 10):
        raise InputError(f"{path}: {where}.friction: expected a number from 0 to 10")
    contact = value.get("contact")
    if contact is not None and not (isinstance(contact, list) and all(e in EFFECTORS for e in contact)):
        raise InputError(f"{path}: {where}.contact: expected some of {', '.join(EFFECTORS)}")
    return Outline(
        str(value.get("name", value.get("id", ""))),
        (ring,),
        cut,
        None if normal is None else np.array(normal, float),
        None if friction is None else float(friction),
        None if contact is None else tuple(contact),
    )


def _corners(value: Any, where: str, path: Path) -> np.ndarray:
    """The corners in a list, as they stand in the file: rows or columns."""
    try:
        array = np.array(value, float)
    except (ValueError, TypeError):
        array = np.zeros((0, 0))
    if array.ndim == 2 and array.shape[1] == 2 and len(array) != 3:
        array = np.column_stack([array, np.zeros(len(array))])  # level, at height 0
    if array.ndim != 2 or 3 not in array.shape or min(array.shape) < 3:
        raise InputError(f"{path}: {where or 'polygon'}: expected at least three corners [x, y, z]")
    return array


def _outlines(blocks: list[tuple[str, np.ndarray]], path: Path) -> list[Outline]:
    for where, block in blocks:
        if block.ndim != 2 or 3 not in block.shape or min(block.shape) < 3:
            raise InputError(f"{path}: {where}: expected at least three corners x y z, got shape {block.shape}")
    return [Outline("", (ring,)) for ring in _rows([block for _, block in blocks])]


def _rows(blocks: list[np.ndarray]) -> list[np.ndarray]:
    """(N, 3) each block's corners; a 3 x 3 one is read like the others, and by rows where those do not tell."""
    by_columns = any(b.shape[0] == 3 != b.shape[1] for b in blocks) and not any(
        b.shape[1] == 3 != b.shape[0] for b in blocks
    )
    rows = [b.T if b.shape[1] != 3 or (b.shape == (3, 3) and by_columns) else b for b in blocks]
    return [ring[~np.isnan(ring).all(axis=1)] for ring in rows]  # rows of NaN fill arrays of polygons up


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
