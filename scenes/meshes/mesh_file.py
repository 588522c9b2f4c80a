"""Triangles out of STL, OBJ, PLY and DAE files, refused in one line when they are not what they claim."""

from __future__ import annotations

import contextlib
import io
import logging
import re
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from scenes.input_error import InputError
from scenes.terrain.polygon import area_vectors

MESH_SUFFIXES = (".stl", ".obj", ".ply", ".dae")
MAX_BYTES = 256 * 2**20
MAX_TRIANGLES = 2_000_000
MIN_TRIANGLE = 1e-10  # [m^2] smaller ones have no normal to speak of and bound nothing


def read_mesh(path: Path) -> np.ndarray:
    """(K, 3, 3) triangles of a mesh file in its own frame and unit, counter-clockwise from outside.

    A DAE file names its unit and its up axis: what is returned is in metres, z up. Other formats say neither.

    Raises:
        InputError: no such file, another format, too large, unreadable, no triangles, vertices that are not finite
            or triangles of vertices that do not exist.
    """
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise InputError(f"{path}: expected a mesh file that ends in one of {', '.join(MESH_SUFFIXES)}")
    try:
        if not path.is_file():
            raise InputError(f"{path}: {'is not a plain file' if path.exists() else 'no such mesh file'}")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    if len(data) > MAX_BYTES:
        raise InputError(f"{path}: larger than {MAX_BYTES >> 20} MiB, the most that a mesh may be")
    triangles = _load_triangles(data, path)
    if not np.isfinite(triangles).all():
        raise InputError(f"{path}: a vertex is not finite, expected numbers")
    if path.suffix.lower() == ".dae":
        with np.errstate(over="ignore", invalid="ignore"):  # a unit may be of any size
            triangles = triangles @ _collada_frame(data, path).T
    return triangles


def drop_degenerate(triangles: np.ndarray) -> np.ndarray:
    """(K, 3, 3) the triangles that have an area, each once: equal ones with equal winding are one [m]."""
    doubled = area_vectors(triangles)
    triangles = triangles[np.linalg.norm(doubled, axis=1) > 2 * MIN_TRIANGLE]
    corners = np.round(triangles * 1e6).astype(np.int64)
    # Each triangle starts at its lowest corner: equal ones compare equal whichever corner the file began with.
    order = np.lexsort(corners.transpose(2, 0, 1)[::-1], axis=1)[:, :1]
    turned = np.take_along_axis(corners, ((order + np.arange(3)) % 3)[:, :, None], axis=1)
    from scenes.meshes.mesh_orientation import row_numbers  # scipy: 0.2 s that named scenes do not need

    corner = row_numbers(turned.reshape(-1, 3)).reshape(-1, 3)
    _, first = np.unique(row_numbers(corner), return_index=True)
    return triangles[np.sort(first)]


def _load_triangles(data: bytes, path: Path) -> np.ndarray:
    import trimesh  # 0.5 s, and only scenes with meshes need it

    # OBJ counts from 1; trimesh takes a 0 for the last vertex.
    if path.suffix.lower() == ".obj" and re.search(rb"^f[ \t](.*[ \t])?0+[/ \t\r\n]", data + b"\n", re.MULTILINE):
        raise InputError(f"{path}: a face names vertex 0, expected 1 or more")
    if path.suffix.lower() == ".stl" and b"\0" in data:
        _check_length(data, path)
    try:
        # Without process=False trimesh drops what has NaN corners and says nothing; without a path it cannot follow
        # the names of materials and textures to other files.
        with _quiet():
            loaded = trimesh.load_scene(
                io.BytesIO(_in_utf8(data, path)), file_type=path.suffix[1:].lower(), process=False
            )
            parts = [g for g in loaded.dump() if isinstance(g, trimesh.Trimesh)]
    except ModuleNotFoundError:  # trimesh would guess the encoding
        raise InputError(f"{path}: not a readable mesh (neither UTF-8 text nor a whole binary file)") from None
    except Exception as error:  # every format has exceptions of its own, and none of them is our bug
        raise InputError(f"{path}: not a readable mesh ({type(error).__name__}: {error})"[:300]) from None
    triangles = []
    for part in parts:
        faces, vertices = np.asarray(part.faces), np.asarray(part.vertices, float)
        if faces.shape[1:] != (3,) or vertices.shape[1:] != (3,):
            raise InputError(
                f"{path}: not a readable mesh (expected vertices of three numbers and faces of three corners)"
            )
        if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
            wrong = faces.min() if faces.min() < 0 else faces.max()
            raise InputError(f"{path}: a face names vertex {wrong}, expected 0 to {len(vertices) - 1}")
        triangles.append(vertices[faces])
    count = sum(len(t) for t in triangles)
    if count == 0:
        raise InputError(f"{path}: holds no faces, expected triangles")
    if count > MAX_TRIANGLES:
        raise InputError(f"{path}: {count} triangles, expected at most {MAX_TRIANGLES}")
    return np.concatenate([t for t in triangles if len(t)])


def _check_length(data: bytes, path: Path) -> None:
    """Refuses a binary STL that is cut off or has a wrong count."""
    count = int.from_bytes(data[80:84], "little")
    if len(data) != 84 + 50 * count:
        raise InputError(
            f"{path}: not a readable mesh (a binary STL of {count} triangles has {84 + 50 * count} bytes, this one {len(data)})"
        )


def _in_utf8(data: bytes, path: Path) -> bytes:
    """An OBJ or ASCII STL file in UTF-8; names and comments may be in another encoding, and no number depends on them."""
    is_text = path.suffix.lower() == ".obj" or (
        path.suffix.lower() == ".stl" and data[:5].lower() == b"solid" and b"vertex" in data
    )
    return data.decode("utf-8", "replace").encode() if is_text and not data.isascii() else data


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Inside, what trimesh warns of is kept from the user: a file that cannot be used is refused in one line."""
    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)


def _collada_frame(data: bytes, path: Path) -> np.ndarray:
    """(3, 3) from the axes and unit that a DAE file declares to metres with z up; trimesh applies neither."""
    from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  it is compiled and has no stubs

    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)  # a large mesh is one long text
    try:
        asset = etree.fromstring(data, parser).find("{*}asset")
    except etree.XMLSyntaxError as error:
        raise InputError(f"{path}: not a readable mesh ({error})") from None
    up = asset.findtext("{*}up_axis", "Y_UP").strip() if asset is not None else "Y_UP"
    unit = asset.find("{*}unit") if asset is not None else None
    try:
        metre = float(unit.get("meter", "1")) if unit is not None else 1.0
    except ValueError:
        metre = float("nan")
    if not (np.isfinite(metre) and metre > 0):
        raise InputError(f"{path}: asset.unit: expected metres per unit, more than 0")
    turns = {
        "Z_UP": np.eye(3),
        "Y_UP": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
        "X_UP": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    }
    if up not in turns:
        raise InputError(f"{path}: asset.up_axis: expected one of {', '.join(turns)}, got {up!r}")
    return metre * turns[up]
