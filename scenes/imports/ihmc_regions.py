"""Planar regions as IHMC's software exports them: a folder of files, one file of sections, or the short form of its tests.

A folder has a file `header.txt`, a line a region,

    regionId: 11, index: 1, origin: X, Y, Z, normal: X, Y, Z, concave hull size: 4, number of convex polygons: 1, [4]

and a file `region11_1` each with the corners `x, y` of the concave hull and of the convex polygons in the region's own
frame. Newer files have `orientation: X, Y, Z, ANGLE`, an axis and an angle, in place of the normal. In one file, sections
that begin with a line `*` and a line `region11_1` follow the header, whose first line may place the sensor in the world.
The short form is a line `PR_0`, a line `RBT,( x, y, z ), ( qx, qy, qz, qs )` and corners `x, y, z`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.imports.outline import Outline
from scenes.imports.text_file import decoded, read_bytes
from scenes.input_error import InputError

HEADER = "header.txt"
MAX_REGIONS = 10_000
_NUMBERS = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:NaN|Infinity)", re.IGNORECASE)
_LINE = re.compile(
    r"regionId:\s*(?P<id>-?\d+)\s*,(?:\s*index:\s*(?P<index>\d+)\s*,)?\s*origin:(?P<origin>[^:]*),\s*"
    r"(?P<kind>normal|orientation):(?P<turn>[^:]*),\s*concave hull size:\s*(?P<hull>\d+)\s*,\s*"
    r"number of convex polygons:\s*(?P<count>\d+)\s*,?\s*\[(?P<sizes>[^\]]*)\]"
)


@dataclass(frozen=True)
class _Entry:
    """A line of the header: where the region is, and how many corners its outlines have."""

    name: str
    X: np.ndarray
    hull: int
    sizes: tuple[int, ...]


def is_ihmc(text: str) -> bool:
    """Whether a text begins like one of these files."""
    return re.match(r"\s*(regionId:|sensor position:|PR_\d+\s*\n\s*RBT)", text) is not None


def regions_of(path: Path) -> list[Outline]:
    """The planar regions in a folder, its header, or a file of sections.

    Args:
        path: of the folder or the file.

    Raises:
        InputError: no such file, a region's file is missing, or one is not what it should be.
    """
    if path.is_dir() or path.name == HEADER:
        folder = path if path.is_dir() else path.parent
        text = decoded(read_bytes(folder / HEADER), folder / HEADER)
        X_WS, entries = _header(text, folder / HEADER)

        def section(name: str) -> str:
            for file in (folder / name, folder / f"{name}.txt"):
                if file.is_file():
                    return decoded(read_bytes(file), file)
            raise InputError(f"{folder}: expected a file {name}, which {HEADER} names")

        return [_region(entry, section(entry.name), X_WS, folder / entry.name) for entry in entries]
    text = decoded(read_bytes(path), path)
    if re.match(r"\s*PR_\d+", text):
        return _short_form(text, path)
    head, *parts = re.split(r"^\*[ \t]*\n", text, flags=re.MULTILINE)
    sections = {name.strip(): body for name, _, body in (part.partition("\n") for part in parts)}
    X_WS, entries = _header(head, path)
    absent = [entry.name for entry in entries if entry.name not in sections]
    if absent:
        raise InputError(f"{path}: expected a section '* {absent[0]}' with the corners of that region")
    return [_region(entry, sections[entry.name], X_WS, path) for entry in entries]


def _header(text: str, path: Path) -> tuple[np.ndarray, list[_Entry]]:
    X_WS, entries = np.eye(4), []
    seen: dict[str, int] = {}
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip():
            continue
        if line.lstrip().startswith("sensor position:"):
            place, _, turn = line.partition("sensor orientation:")
            X_WS = _pose(_numbers(place, 3, path, number), _axis_angle(_numbers(turn, 4, path, number)))
            continue
        found = _LINE.search(line)
        if found is None:
            raise InputError(
                f"{path}: line {number}: expected 'regionId: N, index: N, origin: X, Y, Z, normal: X, Y, Z, "
                f"concave hull size: N, number of convex polygons: N, [N]', got {line.strip()[:60]!r}"
            )
        turn = _numbers(found["turn"], 3 if found["kind"] == "normal" else 4, path, number)
        R = _from_vertical(turn) if found["kind"] == "normal" else _axis_angle(turn)
        seen[found["id"]] = seen.get(found["id"], 0) + 1
        sizes = tuple(int(size) for size in found["sizes"].replace(",", " ").split())
        if len(sizes) != int(found["count"]):
            raise InputError(f"{path}: line {number}: {found['count']} convex polygons, but {len(sizes)} sizes")
        name = f"region{found['id']}_{found['index'] or seen[found['id']]}"
        entries.append(_Entry(name, _pose(_numbers(found["origin"], 3, path, number), R), int(found["hull"]), sizes))
        if len(entries) > MAX_REGIONS:
            raise InputError(f"{path}: more than {MAX_REGIONS} regions, expected fewer")
    if not entries:
        raise InputError(f"{path}: holds no regions")
    return X_WS, entries


def _region(entry: _Entry, text: str, X_WS: np.ndarray, path: Path) -> Outline:
    lines = [(k, line) for k, line in enumerate(text.split("\n"), 1) if line.strip()]
    corners = np.array([_numbers(line, 2, path, k) for k, line in lines]).reshape(-1, 2)
    if len(corners) < entry.hull + sum(entry.sizes):
        raise InputError(
            f"{path}: {entry.name}: expected {entry.hull + sum(entry.sizes)} corners, as the header says, got {len(corners)}"
        )
    X_WR = X_WS @ entry.X
    ends = np.cumsum([entry.hull, *entry.sizes])
    hull, *convex = np.split(corners[: ends[-1]], ends[:-1])
    rings = [ring for ring in convex if len(ring) >= 3] or [hull]
    lifted = tuple(X_WR[:3, 3] + ring @ X_WR[:3, :2].T for ring in rings)
    return Outline(entry.name, lifted, normal=X_WR[:3, 2])


def _short_form(text: str, path: Path) -> list[Outline]:
    found = []
    for number, part in enumerate(re.split(r"^\s*(?=PR_\d+)", text, flags=re.MULTILINE)[1:]):
        name, *lines = [line.strip() for line in part.split("\n") if line.strip()]
        if not lines or not lines[0].startswith("RBT"):
            raise InputError(f"{path}: {name}: expected a line 'RBT,( x, y, z ), ( qx, qy, qz, qs )'")
        place = _numbers(lines[0][3:], 7, path, number)
        if np.linalg.norm(place[3:]) < 1e-6:
            raise InputError(f"{path}: {name}: expected a quaternion that is not zero")
        x, y, z, s = place[3:] / np.linalg.norm(place[3:])
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        X = _pose(place[:3], np.eye(3) + 2 * s * cross + 2 * cross @ cross)
        corners = np.array([_numbers(line, 3, path, number) for line in lines[1:]]).reshape(-1, 3)
        found.append(Outline(name, (X[:3, 3] + corners @ X[:3, :3].T,), normal=X[:3, 2]))
    return found


def _numbers(text: str, count: int, path: Path, line: int) -> np.ndarray:
    found = np.array([float(word) for word in _NUMBERS.findall(text)])
    if len(found) != count or not np.isfinite(found).all():
        raise InputError(f"{path}: line {line}: expected {count} finite numbers, got {text.strip()[:60]!r}")
    return found


def _pose(xyz: np.ndarray, R: np.ndarray) -> np.ndarray:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, xyz
    return X


def _axis_angle(turn: np.ndarray) -> np.ndarray:
    """(3, 3) the rotation about an axis by an angle [rad]; none about an axis of no length."""
    length = np.linalg.norm(turn[:3])
    if length < 1e-9:
        return np.eye(3)
    x, y, z = turn[:3] / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(turn[3]) * cross + (1 - np.cos(turn[3])) * cross @ cross


def _from_vertical(normal: np.ndarray) -> np.ndarray:
    """(3, 3) the shortest rotation that takes the vertical to a normal; half a turn about x where that points down."""
    axis = np.cross([0.0, 0.0, 1.0], normal)
    length, rise = np.linalg.norm(axis), normal[2]
    if length < 1e-12 * max(abs(rise), 1e-300):
        return np.eye(3) if rise >= 0 else np.diag([1.0, -1.0, -1.0])
    return _axis_angle(np.array([*axis, np.arctan2(length, rise)]))
