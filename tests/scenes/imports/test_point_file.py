"""Point files: every format gives the same points; odd files are read, wrong ones are refused in one line."""

from __future__ import annotations

import contextlib
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes.imports.pcd_file import _unpacked
from scenes.imports.point_file import cloud_of
from scenes.input_error import InputError

POINTS = np.round(np.random.default_rng(0).uniform(-2, 2, (500, 3)), 4)
PCD = (
    "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH {n}\nHEIGHT 1\n"
    "VIEWPOINT {v} 1 0 0 0\nPOINTS {n}\nDATA {kind}\n"
)


def lzf(data: bytes) -> bytes:
    """Packed as LZF does: runs as they are, and copies of what came before where four bytes repeat."""
    out, at, run, seen = bytearray(), 0, bytearray(), {}

    def flush() -> None:
        for k in range(0, len(run), 32):
            piece = run[k : k + 32]
            out.append(len(piece) - 1)
            out.extend(piece)
        run.clear()

    while at < len(data):
        key = data[at : at + 4]
        start = seen.get(key, -1)
        seen[key] = at
        if len(key) == 4 and start >= 0 and at - start <= 8192:
            length = 4
            while length < 264 and at + length < len(data) and data[start + length] == data[at + length]:
                length += 1
            flush()
            back = at - start - 1
            if length - 2 < 7:
                out.append(((length - 2) << 5) | (back >> 8))
            else:
                out.extend((0xE0 | (back >> 8), length - 9))
            out.append(back & 255)
            at += length
        else:
            run.append(data[at])
            at += 1
    flush()
    return bytes(out)


def packed(data: bytes) -> bytes:
    small = lzf(data)
    return struct.pack("<II", len(small), len(data)) + small


def pcd(points: np.ndarray, kind: str, viewpoint: str = "0 0 0") -> bytes:
    head = PCD.format(n=len(points), v=viewpoint, kind=kind).encode()
    record = np.zeros(len(points), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])
    for k, name in enumerate("xyz"):
        record[name] = points[:, k]
    if kind == "ascii":
        return head + "".join(f"{x} {y} {z} 4278190080\n" for x, y, z in points).encode()
    if kind == "binary":
        return head + record.tobytes()
    return head + packed(b"".join(record[name].tobytes() for name in record.dtype.names))


def ply(points: np.ndarray, kind: str) -> bytes:
    head = f"ply\nformat {kind} 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    if kind == "ascii":
        return head.encode() + "".join(f"{x} {y} {z}\n" for x, y, z in points).encode()
    return head.encode() + points.astype("<f4" if kind == "binary_little_endian" else ">f4").tobytes()


def text(points: np.ndarray, between: str = " ", head: str = "", end: str = "\n") -> bytes:
    return (head + "".join(between.join(f"{x:.4f}" for x in row) + end for row in points)).encode()


FILES = {
    "a.pcd": pcd(POINTS, "ascii"),
    "b.pcd": pcd(POINTS, "binary"),
    "c.pcd": pcd(POINTS, "binary_compressed"),
    "a.ply": ply(POINTS, "ascii"),
    "b.ply": ply(POINTS, "binary_little_endian"),
    "c.ply": ply(POINTS, "binary_big_endian"),
    "a.xyz": text(POINTS),
    "b.txt": text(POINTS, "\t", "// by hand\n"),
    "c.csv": text(POINTS, ",", "x,y,z\n"),
    "d.csv": text(POINTS, ";").replace(b".", b","),
    "windows.csv": b"\xef\xbb\xbf" + text(POINTS, ", ", "X, Y, Z\r\n", "\r\n"),
    "wide.txt": text(np.column_stack([POINTS, POINTS])),
    "swapped.csv": text(POINTS[:, [2, 0, 1]], ",", "z,x,y\n"),
    "count.pts": text(POINTS, head="500\n"),
    "wide.xyz": "".join(f"{x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in POINTS).encode("utf-16"),
}


@pytest.mark.parametrize("name", FILES)
def test_every_format_gives_the_same_points(name: str) -> None:
    cloud = cloud_of(FILES[name], Path(name))
    np.testing.assert_allclose(cloud.points, POINTS, atol=1e-6)
    assert cloud.lost == 0
    assert cloud.normals is None and cloud.viewpoint is None


def test_points_that_are_not_finite_are_left_out_and_counted() -> None:
    holes = POINTS.copy()
    holes[::7, 1] = np.nan
    holes[3, 2] = np.inf
    for name, data in (("a.pcd", pcd(holes, "binary")), ("a.ply", ply(holes, "ascii")), ("a.xyz", text(holes))):
        cloud = cloud_of(data, Path(name))
        assert cloud.lost == 73
        np.testing.assert_allclose(cloud.points, holes[np.isfinite(holes).all(axis=1)], atol=1e-6)


def test_the_place_of_the_sensor_and_normals_are_read_where_they_are_given() -> None:
    place = cloud_of(pcd(POINTS, "binary", "1.5 -2 0.75"), Path("a.pcd")).viewpoint
    assert place is not None
    np.testing.assert_allclose(place, [1.5, -2.0, 0.75])
    rows = np.column_stack([POINTS, np.tile([0.0, 0.6, 0.8], (len(POINTS), 1))])
    normals = cloud_of(text(rows, ",", "x,y,z,nx,ny,nz\n"), Path("a.csv")).normals
    assert normals is not None
    np.testing.assert_allclose(normals, rows[:, 3:], atol=1e-4)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n"
    head += "".join(f"property float {n}\n" for n in ("x", "y", "z", "nx", "ny", "nz")) + "end_header\n"
    normals = cloud_of(head.encode() + rows.astype("<f4").tobytes(), Path("a.ply")).normals
    assert normals is not None
    np.testing.assert_allclose(normals, rows[:, 3:], atol=1e-4)


@pytest.mark.parametrize(
    ("name", "data", "expected"),
    [
        ("a.xyz", b"1 2 3\n4 five 6\n", "line 2: expected numbers, got 'five'"),
        ("a.xyz", b"1 2 3\n4 5\n", "line 2: expected 3 numbers like the lines before, got 2"),
        ("a.xyz", b"1 2\n4 5\n", "expected three columns x y z, got 2"),
        ("a.xyz", b"# nothing\n", "holds no numbers"),
        ("a.xyz", b"x y z\n", "holds no numbers"),
        ("a.xyz", b"1 2 3\0", "binary file of no known format"),
        ("a.xyz", b"nan nan nan\n" * 4, "none of its 4 points is finite"),
        ("a.ply", b"solid", "expected a PLY file"),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n1\n2\n3\n",
            "not a readable PLY",
        ),
        ("a.pcd", b"VERSION 0.7\n", "its head has no FIELDS"),
        ("a.pcd", pcd(POINTS, "binary")[:-40], "cut off"),
        ("a.pcd", pcd(POINTS, "ascii")[:-40], "cut off"),
        ("a.pcd", pcd(POINTS, "binary").replace(b"FIELDS x y z", b"FIELDS x y w"), "expected x, y and z"),
        ("a.pcd", pcd(POINTS, "binary").replace(b"POINTS 500", b"POINTS 999999999"), "thin it"),
        ("a.pcd", pcd(POINTS, "binary").replace(b"TYPE F F F U", b"TYPE F F F"), "do not agree"),
        ("a.pcd", pcd(POINTS, "binary").replace(b"DATA binary", b"DATA packed"), "expected ascii, binary"),
        ("a.pcd", pcd(POINTS, "binary_compressed")[:-9], "compressed"),
        ("a.npy", b"no array", "not a readable npy file"),
    ],
)
def test_wrong_files_are_refused_in_one_line(name: str, data: bytes, expected: str) -> None:
    with pytest.raises(InputError) as error:
        cloud_of(data, Path(name))
    assert expected in str(error.value)
    assert str(error.value).startswith(name)


def test_arrays_of_objects_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[1, 2, None]], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="not a readable npy file"):
        cloud_of((tmp_path / "a.npy").read_bytes(), tmp_path / "a.npy")


@settings(max_examples=60)
@given(st.lists(st.sampled_from([b"a", b"bb", b"abcd", b"\0\0\0\0", bytes(range(40))]), max_size=200))
def test_what_lzf_has_packed_comes_back(parts: list[bytes]) -> None:
    data = b"".join(parts)
    if data:
        assert _unpacked(packed(data), len(data), Path("a.pcd")) == data


@settings(max_examples=60)
@given(name=st.sampled_from(sorted(FILES)), at=st.floats(0, 1), junk=st.binary(min_size=1, max_size=8))
def test_damaged_files_are_read_or_refused_never_more(name: str, at: float, junk: bytes) -> None:
    data = bytearray(FILES[name])
    place = int(at * (len(data) - 1))
    data[place : place + len(junk)] = junk
    with contextlib.suppress(InputError):
        assert np.isfinite(cloud_of(bytes(data), Path(name)).points).all()
