"""What a file holds, by its name and its first bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from scenes.imports.box_list import is_box_table
from scenes.imports.ihmc_regions import HEADER, is_ihmc
from scenes.imports.point_file import array_of, has_faces
from scenes.imports.polygon_file import CORNERS, LISTS, load_json
from scenes.imports.text_file import decoded, read_bytes, table_of
from scenes.input_error import InputError
from scenes.meshes.mesh_file import MESH_SUFFIXES

Kind = Literal["heights", "points", "mesh", "regions", "polygons", "boxes"]
KINDS: tuple[str, ...] = get_args(Kind)
TEXTS = (".xyz", ".txt", ".csv", ".asc", ".pts")
KNOWN = (".npz", ".npy", ".ply", ".pcd", *TEXTS, ".json", ".stl", ".obj", ".dae")
FEW_ROWS = 100  # blocks of more rows than this are no polygons
HEAD = 20_000  # [bytes] that tell most formats


def kind_of(path: Path) -> Kind:
    """What a file or folder holds.

    Args:
        path: of the file, or of a folder with IHMC's planar regions.

    Raises:
        InputError: it is missing, empty, or of no known kind.
    """
    suffix = path.suffix.lower()
    if path.is_dir():
        if (path / HEADER).is_file():
            return "regions"
        raise InputError(f"{path}: a folder without {HEADER}; expected a file, or a folder of IHMC's planar regions")
    data = read_bytes(path)
    if path.name == HEADER:
        return "regions"
    if suffix == ".npz":
        return "heights"
    if suffix == ".npy":
        return _of_array(array_of(data, path))
    if suffix == ".pcd":
        return "points"
    if suffix == ".ply":
        return "mesh" if has_faces(data) else "points"
    if suffix in MESH_SUFFIXES:
        return "mesh"
    if suffix == ".json":
        return _of_json(load_json(data, path), path)
    if suffix in TEXTS or is_ihmc(data[:HEAD].decode("utf-8-sig", "replace").replace("\r", "")):
        return _of_text(data, path)
    raise InputError(f"{path}: expected a file that ends in one of {', '.join(KNOWN)}, or give --kind")


def _of_array(array: np.ndarray) -> Kind:
    if array.ndim == 3 and 3 in array.shape[1:]:
        return "polygons"
    return "points" if array.ndim == 2 and array.shape[1] == 3 else "heights"


def _of_json(value: Any, path: Path) -> Kind:
    if isinstance(value, dict):
        if "boxes" in value:
            return "boxes"
        if any(key in value for key in (*LISTS, *CORNERS)):
            return "polygons"
    if isinstance(value, list) and value:
        return "boxes" if isinstance(value[0], dict) and "size" in value[0] else "polygons"
    raise InputError(f"{path}: expected a list of polygons or boxes, or one under {', '.join((*LISTS, 'boxes'))}")


def _of_text(data: bytes, path: Path) -> Kind:
    text = decoded(data, path)
    if is_ihmc(text[:HEAD]):
        return "regions"
    if len(text) > 1_000_000:  # the heading tells boxes, and nobody lists so many polygons
        text = text[: text.rfind("\n", 0, 1_000_000)]
    table = table_of(text, path)
    if is_box_table(table):
        return "boxes"
    sizes = np.bincount(table.blocks)
    listed = len(sizes) > 1 and sizes.min() >= 3 and sizes.max() <= FEW_ROWS
    return "polygons" if listed and (table.rows.shape[1] == 3 or (sizes == 3).all()) else "points"
