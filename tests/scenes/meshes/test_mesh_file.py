"""Mesh files in four formats, whole and broken."""

import numpy as np
import pytest
import trimesh

from scenes.input_error import InputError
from scenes.meshes.mesh_file import drop_degenerate, read_mesh

PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 {last}
"""
DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="u" meter="{metre}"/><up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="9">0 0 0 10 0 0 0 20 0</float_array>
<technique_common><accessor source="#a" count="3" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


def volume(triangles):
    return np.einsum("ki,ki->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".dae", ".STL"])
def test_a_box_comes_back_with_its_volume_outward_from_every_format(suffix, tmp_path):
    file = tmp_path / f"box{suffix}"
    file.write_bytes(_bytes(trimesh.creation.box((1.0, 2.0, 3.0)).export(file_type=suffix[1:].lower())))
    triangles = read_mesh(file)
    assert triangles.shape == (12, 3, 3)
    assert volume(triangles) == pytest.approx(6.0)
    extent = np.ptp(triangles.reshape(-1, 3), axis=0)
    # trimesh writes DAE without an up axis, which by the COLLADA standard means y: the file's z is our -y.
    np.testing.assert_allclose(extent, [1.0, 3.0, 2.0] if suffix == ".dae" else [1.0, 2.0, 3.0])


def _bytes(data):
    return data.encode() if isinstance(data, str) else data


@pytest.mark.parametrize(
    ("up", "metre", "x_end", "y_end"),
    [
        ("Z_UP", "1", [10, 0, 0], [0, 20, 0]),
        ("Z_UP", "0.01", [0.1, 0, 0], [0, 0.2, 0]),
        ("Y_UP", "1", [10, 0, 0], [0, 0, 20]),
        ("X_UP", "1", [0, 0, 10], [-20, 0, 0]),
    ],
)
def test_a_dae_file_is_turned_and_scaled_as_it_declares(up, metre, x_end, y_end, tmp_path):
    file = tmp_path / "t.dae"
    file.write_text(DAE.format(up=up, metre=metre))
    np.testing.assert_allclose(read_mesh(file)[0, 1:], [x_end, y_end], atol=1e-12)


def test_a_dae_file_may_hold_more_text_in_one_element_than_parsers_expect(tmp_path):
    """A million triangles are an element of 20 MB."""
    file = tmp_path / "large.dae"
    file.write_text(DAE.format(up="Z_UP", metre="1").replace("0 20 0<", f"0 20 0{' ' * 10_500_000}<"))
    np.testing.assert_allclose(read_mesh(file)[0, 2], [0, 20, 0])


VERTICES = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
BROKEN = {
    "obj, bad index": (".obj", VERTICES + "f 1 2 9\n", "out of bounds"),
    "obj, vertex 0": (".obj", VERTICES + "f 1 0 2\n", "a face names vertex 0, expected 1 or more"),
    "obj, vertex 0 with texture": (".obj", VERTICES + "f 1/1 2/1 0/1", "a face names vertex 0, expected 1 or more"),
    "obj, no faces": (".obj", VERTICES, "holds no faces, expected triangles"),
    "obj, nan": (".obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "a vertex is not finite"),
    "obj, empty": (".obj", "", "holds no faces"),
    "stl, empty": (".stl", "", "holds no faces"),
    "stl, cut short": (
        ".stl",
        b"\0" * 80 + b"\x05\0\0\0" + b"\0" * 20,
        "a binary STL of 5 triangles has 334 bytes, this one 104",
    ),
    "stl, words": (".stl", "hello world " * 20, "holds no faces"),
    "ply, bad index": (".ply", PLY.format(last=7), "a face names vertex 7, expected 0 to 2"),
    "ply, negative index": (".ply", PLY.format(last=-1), "expected 0 to 2"),
    "ply, cut short": (".ply", PLY.format(last=2)[:-30], "not a readable mesh"),
    "ply, words": (".ply", "hello", "not a readable mesh"),
    "dae, words": (".dae", "<a>", "not a readable mesh"),
    "dae, unit": (".dae", DAE.format(up="Z_UP", metre="-1"), "asset.unit: expected metres per unit, more than 0"),
    "dae, axis": (".dae", DAE.format(up="W_UP", metre="1"), "asset.up_axis: expected one of Z_UP, Y_UP, X_UP"),
}


@pytest.mark.parametrize(("suffix", "content", "expected"), BROKEN.values(), ids=BROKEN)
def test_a_broken_mesh_is_one_line_that_names_the_file(suffix, content, expected, tmp_path):
    file = tmp_path / f"broken{suffix}"
    file.write_bytes(_bytes(content))
    with pytest.raises(InputError) as error:
        read_mesh(file)
    assert str(error.value).startswith(f"{file}: ")
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


def test_files_that_are_no_mesh_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such mesh file"):
        read_mesh(tmp_path / "missing.stl")
    with pytest.raises(InputError, match=r"expected a mesh file that ends in one of \.stl, \.obj, \.ply, \.dae"):
        read_mesh(tmp_path / "mesh.glb")
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(InputError, match="is not a plain file"):
        read_mesh(tmp_path / "folder.stl")


def test_a_material_does_not_lead_to_other_files(tmp_path):
    (tmp_path / "secret.mtl").write_text("newmtl x\nmap_Kd /etc/passwd\n")
    file = tmp_path / "t.obj"
    file.write_text("mtllib secret.mtl\nusemtl x\n" + VERTICES + "f 1 2 3\n")
    assert read_mesh(file).shape == (1, 3, 3)


def test_triangles_without_area_go_and_equal_ones_stay_once_but_two_sided_ones_twice():
    a, b, c, d = np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], np.ones(3)
    triangles = np.array([[a, b, c], [b, c, a], [c, b, a], [a, a, b], [a, b, d], [a, (a + b) / 2, b]])
    np.testing.assert_array_equal(drop_degenerate(triangles), triangles[[0, 2, 4]])


def test_a_cut_off_binary_file_is_refused_by_its_length(tmp_path) -> None:
    path = tmp_path / "cut.stl"
    whole = bytes(80) + (2).to_bytes(4, "little") + bytes(100)
    path.write_bytes(whole[:-7])
    with pytest.raises(InputError, match=r"binary STL of 2 triangles has 184 bytes, this one 177"):
        read_mesh(path)


def test_corners_of_two_numbers_are_refused(tmp_path) -> None:
    path = tmp_path / "flat.stl"
    path.write_text("solid a\nfacet normal 0 0\nouter loop\n" + "vertex 0 1\n" * 3 + "endloop\nendfacet\nendsolid a\n")
    with pytest.raises(InputError, match="not a readable mesh"):
        read_mesh(path)


def test_a_name_in_another_encoding_is_no_reason_to_refuse_a_mesh(tmp_path) -> None:
    path = tmp_path / "name.obj"
    path.write_bytes("o Größe\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".encode("latin-1"))
    assert read_mesh(path).shape == (1, 3, 3)


def test_the_index_that_is_wrong_is_named(tmp_path) -> None:
    path = tmp_path / "negative.ply"
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    path.write_text(
        head + "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 -5 2\n"
    )
    with pytest.raises(InputError, match="names vertex -5, expected 0 to 2"):
        read_mesh(path)
