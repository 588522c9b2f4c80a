"""PCD files of the Point Cloud Library, version 0.7: text, binary, and binary compressed by LZF."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.imports.text_file import decoded
from scenes.input_error import InputError

MAX_UNPACKED = 512 * 2**20  # [bytes]
MAX_PACKED = 64 * 2**20  # [bytes] Python unpacks about 2 MB in a second
NO_VIEWPOINT = np.zeros(3)


def read_pcd(data: bytes, path: Path) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """(N, 3) points, (N, 3) normals or None, and the (3,) sensor's place or None, where it is the origin.

    Args:
        data: the file.
        path: for errors.

    Raises:
        InputError: it is no such file, or shorter than its head says.
    """
    head, body = _head(data, path)
    fields, count = head["FIELDS"], _count(head, path)
    kind = head["DATA"][0].lower()
    try:
        sizes, times = [int(s) for s in head["SIZE"]], [int(c) for c in head.get("COUNT", ["1"] * len(fields))]
        kinds = [f"<{ {'F': 'f', 'I': 'i', 'U': 'u'}[t.upper()] }{s}" for t, s in zip(head["TYPE"], sizes, strict=True)]
        record = np.dtype([(f"{k}", t, (c,)) for k, (t, c) in enumerate(zip(kinds, times, strict=True))])
    except (KeyError, ValueError, TypeError):
        raise InputError(f"{path}: not a readable PCD file (FIELDS, SIZE, TYPE and COUNT do not agree)") from None
    missing = [name for name in "xyz" if name not in fields]
    if missing:
        raise InputError(f"{path}: FIELDS: expected x, y and z, found {' '.join(fields)}"[:300])
    if count * record.itemsize > MAX_UNPACKED:
        raise InputError(f"{path}: {count} points, expected at most {MAX_UNPACKED >> 20} MiB of them; thin it")
    if kind == "ascii":
        columns = _ascii(body, sum(times), count, path)
        starts = np.concatenate([[0], np.cumsum(times)])

        def column(name: str) -> np.ndarray:
            return columns[:, starts[fields.index(name)]]

    elif kind in ("binary", "binary_compressed"):
        if kind == "binary_compressed":
            body = _unpacked(body, count * record.itemsize, path)
        if len(body) < count * record.itemsize:
            raise InputError(f"{path}: cut off: {count} points have {count * record.itemsize} bytes, found {len(body)}")

        def column(name: str) -> np.ndarray:
            k = fields.index(name)
            if kind == "binary":
                return np.frombuffer(body, record, count)[f"{k}"][:, 0].astype(float)
            start = count * sum(s * c for s, c in zip(sizes[:k], times[:k], strict=True))  # field after field
            return np.frombuffer(body, kinds[k], count * times[k], start)[:: times[k]].astype(float)

    else:
        raise InputError(f"{path}: DATA: expected ascii, binary or binary_compressed, got {kind[:40]!r}")
    points = np.stack([column(name) for name in "xyz"], axis=1)
    along = ("normal_x", "normal_y", "normal_z")
    normals = np.stack([column(n) for n in along], axis=1) if all(n in fields for n in along) else None
    return points, normals, _viewpoint(head)


def _head(data: bytes, path: Path) -> tuple[dict[str, list[str]], bytes]:
    head: dict[str, list[str]] = {}
    start = 0
    while start < len(data) and start < 20_000:
        end = data.find(b"\n", start)
        end = len(data) if end < 0 else end
        words = data[start:end].decode("utf-8-sig", "replace").split()
        start = end + 1
        if not words or words[0].startswith("#"):
            continue
        head[words[0].upper()] = words[1:]
        if words[0].upper() == "DATA":
            break
    lacking = [key for key in ("FIELDS", "SIZE", "TYPE", "DATA") if not head.get(key)]
    if lacking:
        raise InputError(f"{path}: not a readable PCD file (its head has no {lacking[0]})")
    return head, data[start:]


def _count(head: dict[str, list[str]], path: Path) -> int:
    try:
        if "POINTS" in head:
            count = int(head["POINTS"][0])
        else:
            count = int(head["WIDTH"][0]) * int(head["HEIGHT"][0])
    except (KeyError, ValueError, IndexError):
        count = -1
    if count < 0:
        raise InputError(f"{path}: POINTS: expected a whole number of points")
    return count


def _viewpoint(head: dict[str, list[str]]) -> np.ndarray | None:
    try:
        place = np.array([float(word) for word in head.get("VIEWPOINT", [])[:3]])
    except ValueError:
        return None
    # The origin is what is written where nobody knows the place.
    return place if place.shape == (3,) and np.isfinite(place).all() and (place != NO_VIEWPOINT).any() else None


def _ascii(body: bytes, columns: int, count: int, path: Path) -> np.ndarray:
    lines = [line for line in decoded(body, path).split("\n") if line.strip()] if body.strip() else []
    if len(lines) < count:
        raise InputError(f"{path}: cut off: expected {count} points, found {len(lines)}")
    if not count:
        return np.zeros((0, columns))
    try:
        rows = np.loadtxt(lines[:count], ndmin=2, comments=None)
    except ValueError as error:
        raise InputError(f"{path}: its points are not rows of numbers ({error})"[:300]) from None
    if rows.shape[1] != columns:
        raise InputError(f"{path}: expected {columns} numbers a point, got {rows.shape[1]}")
    return rows


def _unpacked(body: bytes, size: int, path: Path) -> bytes:
    """The bytes that LZF has packed: after their two lengths, runs as they are and copies of what came before."""
    packed, whole = (int.from_bytes(body[k : k + 4], "little") for k in (0, 4))
    if len(body) < 8 + packed or whole != size or packed > MAX_PACKED:
        raise InputError(
            f"{path}: not a readable compressed PCD file (expected {size} bytes of points, at most {MAX_PACKED >> 20} MiB packed)"
        )
    source, out = memoryview(body)[8 : 8 + packed], bytearray()
    at = 0
    try:
        while at < packed:
            control = source[at]
            at += 1
            if control < 32:
                out += source[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += source[at]
                at += 1
            back = ((control & 31) << 8) + source[at] + 1
            at += 1
            start, length = len(out) - back, length + 2
            if start < 0 or len(out) > size:
                raise IndexError
            if back >= length:
                out += out[start : start + length]
            else:  # it repeats itself
                piece = bytes(out[start:])
                out += (piece * (length // back + 1))[:length]
    except IndexError:
        out = bytearray()
    if len(out) != size:
        raise InputError(f"{path}: not a readable compressed PCD file (its packed points are damaged)")
    return bytes(out)
