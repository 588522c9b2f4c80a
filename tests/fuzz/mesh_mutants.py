"""Mesh files that are nearly right, in all formats, and the way a user's mesh takes: imported and packed."""

from __future__ import annotations

import struct
from pathlib import Path
from random import Random

import numpy as np
from mutation import mutate_bytes

from scenes.files.scene_source import load_scene
from scenes.terrain.packed_terrain import pack_terrain

SECONDS = 5.0
FORMATS = ("stl", "ascii.stl", "obj", "ply", "binary.ply", "dae")
BOX_FACES = ((0, 3, 2), (0, 2, 1), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6),
    (3, 0, 4), (3, 4, 7))  # fmt: skip
Mesh = tuple[np.ndarray, np.ndarray]


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    (a, b, c), (x, y, z) = low, high
    corners = [(a, b, c), (x, b, c), (x, y, c), (a, y, c), (a, b, z), (x, b, z), (x, y, z), (a, y, z)]
    return np.array(corners, float), np.array(BOX_FACES)


def joined(*meshes: Mesh) -> Mesh:
    shifts = np.cumsum([0, *(len(v) for v, _ in meshes[:-1])])
    return np.concatenate([v for v, _ in meshes]), np.concatenate(
        [f + s for (_, f), s in zip(meshes, shifts, strict=True)]
    )


def sheet(cells: int, rough: float) -> Mesh:
    """A square sheet of 0.1 m cells, raised at random by up to `rough` [m]."""
    n = cells + 1
    x, y = np.meshgrid(0.1 * np.arange(n), 0.1 * np.arange(n))
    z = np.random.default_rng(1).uniform(-rough, rough, n * n)
    k = (np.arange(cells)[:, None] * n + np.arange(cells)).ravel()
    faces = np.concatenate([np.stack([k, k + 1, k + n + 1], 1), np.stack([k, k + n + 1, k + n], 1)])
    return np.stack([x.ravel(), y.ravel(), z], axis=1), faces


MESHES: dict[str, Mesh] = {
    "box": box((0, 0, 0), (2, 1, 0.2)),
    "stairs": joined(*(box((0.4 * k, -0.5, 0), (0.4 * k + 0.4, 0.5, 0.15 * (k + 1))) for k in range(4))),
    "sheet": sheet(8, 0.0),
    "rough": sheet(8, 0.004),
    "triangle": (np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]), np.array([[0, 1, 2]])),
    "wedge": (np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.3, 0.3, 0.15]]), np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])),
}  # fmt: skip


def stl_bytes(mesh: Mesh) -> bytes:
    """Binary STL."""
    vertices, faces = mesh
    rows = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("extra", "<u2")])
    with np.errstate(over="ignore", invalid="ignore"):
        rows["corners"] = vertices[faces]
    return b"solid in name only".ljust(80) + struct.pack("<I", len(faces)) + rows.tobytes()


def text_of(mesh: Mesh, kind: str) -> str:
    """ASCII STL, OBJ, PLY or DAE; numbers and indices as they are, right or not."""
    vertices, faces = mesh
    rows = [" ".join(f"{v:.9g}" for v in vertex) for vertex in vertices]
    if kind == "ascii.stl":
        body = "".join(
            "facet normal 0 0 0\nouter loop\n"
            + "".join(f"vertex {rows[k % max(len(rows), 1)]}\n" for k in face)
            + "endloop\nendfacet\n"
            for face in faces
        )
        return f"solid mesh\n{body}endsolid mesh\n"
    if kind == "obj":
        return "".join(f"v {r}\n" for r in rows) + "".join(
            "f " + " ".join(str(k + 1) for k in face) + "\n" for face in faces
        )
    if kind == "ply":
        head = (
            f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\nproperty float x\nproperty float y\nproperty float z\n"
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
        )
        return head + "".join(f"{r}\n" for r in rows) + "".join(f"{len(f)} {' '.join(map(str, f))}\n" for f in faces)
    places = " ".join(rows)
    indices = " ".join(str(k) for face in faces for k in face)
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">\n'
        '<asset><unit name="metre" meter="1"/><up_axis>Z_UP</up_axis></asset>\n<library_geometries><geometry id="g" name="g"><mesh>\n'
        f'<source id="p"><float_array id="pa" count="{3 * len(rows)}">{places}</float_array><technique_common><accessor source="#pa" '
        f'count="{len(rows)}" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>'
        '</accessor></technique_common></source>\n<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>\n'
        f'<triangles count="{len(faces)}"><input semantic="VERTEX" source="#v" offset="0"/><p>{indices}</p></triangles>\n'
        '</mesh></geometry></library_geometries>\n<library_visual_scenes><visual_scene id="s"><node id="n">'
        '<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>\n'
        '<scene><instance_visual_scene url="#s"/></scene>\n</COLLADA>\n'
    )


def bytes_of(mesh: Mesh, kind: str) -> bytes:
    """A mesh as a file of one of `FORMATS`."""
    if kind == "stl":
        return stl_bytes(mesh)
    if kind == "binary.ply":
        vertices, faces = mesh
        head, _, _ = text_of(mesh, "ply").partition("end_header\n")
        with np.errstate(over="ignore", invalid="ignore"):
            body = vertices.astype("<f4").tobytes()
        lists = b"".join(struct.pack(f"<B{len(f)}i", len(f), *(int(k) for k in f)) for f in faces)
        return head.replace("ascii", "binary_little_endian").encode() + b"end_header\n" + body + lists
    return text_of(mesh, kind).encode()


def make(rng: Random, folder: Path) -> Path:
    """Writes one mesh that is nearly right and returns its path."""
    kind = rng.choice(FORMATS)
    mesh = MESHES[rng.choice(sorted(MESHES))]
    of_bytes = rng.random() < 0.4
    if not of_bytes or rng.random() < 0.3:
        mesh = changed_mesh(rng, mesh)
    if kind == "stl" and (mesh[1] < 0).any() | (mesh[1] >= len(mesh[0])).any():
        kind = "obj"  # an STL file has no indices that could be wrong
    if kind == "binary.ply" and np.abs(mesh[1]).max(initial=0) >= 2**31:
        kind = "ply"
    data = bytes_of(mesh, kind)
    if of_bytes:
        data = rng.choice((mutate_bytes, mutate_bytes, with_changed_word))(rng, data)
    path = folder / f"mesh.{kind.rpartition('.')[2]}"
    path.write_bytes(data)
    return path


def with_changed_word(rng: Random, data: bytes) -> bytes:
    """A file with a word of its own replaced: a count, a type, an axis, a unit, an entity."""
    swaps = (
        (b"element vertex ", b"element vertex 9"), (b"element face ", b"element face 999999999"), (b"uchar", b"float"),
        (b"float x", b"list uchar int x"),
        (b"ascii", b"binary_big_endian"), (b"binary_little_endian", b"ascii"), (b"Z_UP", rng.choice((b"Y_UP", b"X_UP", b"UP", b""))),
        (b'meter="1"', rng.choice((b'meter="0"', b'meter="nan"', b'meter="-1"', b'meter="0.001"', b'meter="1e308"', b""))),
        (b'count="', b'count="9'), (b'stride="3"', rng.choice((b'stride="0"', b'stride="-3"', b'stride="300000000"', b""))),
        (b"<COLLADA",
        b'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">]><COLLADA'),
        (b"<p>", b"<p>-1 "), (b'url="#g"', b'url="#n"'), (b'url="#s"', b'url="other.dae#s"'), (b"facet normal", b"facet"),
        (b"endloop", b""), (b"solid", b""),
        (b"f 1", rng.choice((b"f 0", b"f -1", b"f 1/1/1", b"f 1//", b"f 99999999999999999999", b"f 1e3", b"f 1 2 3 4 5 6 7"))),
        (b"v ", b"vn "),
        (b"v 0", rng.choice((b"mtllib ../../x.mtl\nv 0", b"call x\nv 0", b"usemtl \x00\nv 0", b"v 0 0 0 0 0 0 0 0"))),
    )  # fmt: skip
    if data[:5] == b"solid" and data[79:80] == b" " and rng.random() < 0.8:
        return data[:80] + struct.pack("<I", rng.choice((0, 1, 13, 2**31, 2**32 - 1))) + data[84:]
    fitting = [(old, new) for old, new in swaps if old in data]
    old, new = rng.choice(fitting or [(b"0", b"1")])
    return data.replace(old, new, rng.choice((1, 1, -1)))


def changed_mesh(rng: Random, mesh: Mesh) -> Mesh:
    """A mesh with one to three things wrong, or only unusual."""
    vertices, faces = mesh[0].copy(), mesh[1].copy()
    for _ in range(rng.choice((1, 1, 2, 3))):
        if not len(vertices) or not len(faces):
            break
        v, f, axis = rng.randrange(len(vertices)), rng.randrange(len(faces)), rng.randrange(3)
        kind = rng.randrange(17)
        if kind == 0:
            vertices[v, axis] = rng.choice((np.nan, np.inf, -np.inf, 1e308, -1e38, 1e39, 1e5, 5e-324, 1e-40))
        elif kind == 1:
            faces[f] = faces[f][::-1]
        elif kind == 2:
            faces = faces[:, ::-1]
        elif kind == 3:
            faces = np.concatenate([faces, faces])
        elif kind == 4:
            faces = np.concatenate([faces, faces[:, ::-1]])
        elif kind == 5:
            faces = np.delete(faces, f, axis=0)
        elif kind == 6:
            faces[f, axis] = faces[f, axis - 1]
        elif kind == 7:
            faces[f, axis] = rng.choice((-1, len(vertices), 10**6, 2**31 - 1, -(2**31), 2**40))
        elif kind == 8:
            vertices[:, axis] = vertices[:, axis] * rng.choice((0.0, -1.0, 1e-9, 1e-4))
        elif kind == 9:
            vertices = vertices * rng.choice((1e-9, 1e-3, 1e3, 1e6, 39.37))
        elif kind == 10:
            vertices = vertices + 10.0 ** rng.uniform(0, 7) * np.eye(3)[axis]
        elif kind == 11:
            vertices[v, axis] += rng.choice((-1, 1)) * 10.0 ** rng.uniform(-9, 2)
        elif kind == 12:
            vertices = vertices[:, [(axis + k) % 3 for k in range(3)]]
        elif kind == 13:
            noise = np.random.default_rng(rng.randrange(2**32)).normal(size=vertices.shape)
            vertices = vertices + 10.0 ** rng.uniform(-8, -1) * noise
        elif kind == 14:
            vertices = vertices[rng.choice((0, 1, 2)) : rng.choice((3, 4, len(vertices)))]
        elif kind == 15:
            angle = rng.choice((10.0 ** rng.uniform(-9, 0), np.pi / 4, np.pi / 2))
            c, s = np.cos(angle), np.sin(angle)
            vertices = vertices @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        else:
            faces = faces[:0] if rng.random() < 0.2 else np.random.default_rng(v).permutation(faces)
    return vertices, faces


def read(path: Path) -> None:
    """Imports a mesh as `plan MESH` does.

    Raises:
        InputError: the mesh is not right.
        AssertionError: what was read is not sound.
    """
    scene = load_scene(str(path))
    assert all("\n" not in note for note in scene.notes)
    assert np.isfinite(scene.terrain.triangles).all()
    packed = pack_terrain(scene.terrain)
    assert all(np.isfinite(a).all() for a in (packed.normal, packed.offset, packed.edge_normal, packed.edge_offset))
