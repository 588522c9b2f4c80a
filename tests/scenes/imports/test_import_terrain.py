"""One way in: whatever the format, the scene file that is written holds the terrain, and the report says what became of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenes.files.scene_file import read_scene
from scenes.footholds.projection import set_down
from scenes.imports.built import ImportOptions
from scenes.imports.file_kind import kind_of
from scenes.imports.height_file import height_archive, heights_of, without_small_holes
from scenes.imports.import_report import Change
from scenes.imports.import_terrain import ImportedTerrain, import_terrain, write_terrain
from scenes.input_error import InputError
from scenes.scene import Scene
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.terrain import Box
from scenes.terrain.usable_area import usable_area

HALF = (0.11, 0.06)  # sole [m]
EAST, NORTH = 431_234.5, 5_411_098.25  # [m]


def imported(path: Path, **options: object) -> tuple[ImportedTerrain, Scene]:
    """What an import gives, and the scene that its files are read back as."""
    out = path.parent / "scene" / "out ü.yaml"
    out.parent.mkdir(exist_ok=True)
    found = import_terrain(path, out, ImportOptions(**options))  # type: ignore[arg-type]
    write_terrain(found, out)
    return found, read_scene(out)


def same(found: ImportedTerrain, again: Scene) -> None:
    """Surfaces, bodies and offset are those of the report."""
    assert again.origin_offset == found.scene.origin_offset
    assert len(again.terrain.surfaces) == len(found.scene.terrain.surfaces)
    for one, two in zip(again.terrain.surfaces, found.scene.terrain.surfaces, strict=True):
        np.testing.assert_allclose(one.vertices, two.vertices, atol=2e-6)
        assert one.friction == two.friction
        assert one.effectors == two.effectors
    np.testing.assert_allclose(again.terrain.triangles, found.scene.terrain.triangles, atol=2e-6)


def stands(scene: Scene, x: float, y: float) -> float | None:
    """Height of a sole set down there [m]."""
    contact = set_down(pack_terrain(scene.terrain), "left_foot", x, y, 0.0, HALF)
    return None if contact is None else float(contact.p_WC[2])


def change(found: ImportedTerrain, what: str, things: str) -> Change:
    return next(c for c in found.report.changes if (c.what, c.things) == (what, things))


# Height maps -------------------------------------------------------------------------------------------------------


def heights(noise: float = 0.003) -> np.ndarray:
    """A step of 0.12 m in the middle of 1.6 x 1 m, in cells of 2 cm."""
    height = np.where(np.arange(80) < 40, 0.0, 0.12)[None, :].repeat(50, axis=0)
    return height + noise * np.random.default_rng(0).standard_normal(height.shape)


@pytest.mark.parametrize(
    ("name", "arrays", "options"),
    [
        ("a.npy", {}, {"resolution": 0.02, "origin": (-0.5, -0.5)}),
        ("a.npz", {"resolution": 0.02, "origin": [-0.5, -0.5]}, {}),
        ("millimetres.npz", {"resolution": 20.0, "origin": [-500.0, -500.0, 0.0]}, {"unit": "mm"}),
    ],
)
def test_height_maps_of_either_file_are_the_same_ground(tmp_path: Path, name: str, arrays: dict, options: dict) -> None:
    height = heights() * (1000.0 if "unit" in options else 1.0)
    if name.endswith(".npy"):
        np.save(tmp_path / name, height)
    else:
        np.savez(tmp_path / name, elevation=height, **arrays)
    found, again = imported(tmp_path / name, friction=0.7, **options)
    same(found, again)
    assert found.report.kind == "heights"
    assert stands(again, -0.2, 0.0) == pytest.approx(0.0, abs=0.002)
    assert stands(again, 0.8, 0.0) == pytest.approx(0.12, abs=0.002)
    assert found.report.noise == pytest.approx(0.003, rel=0.15)
    assert {s.friction for s in again.terrain.surfaces} == {0.7}


def test_a_map_that_lies_beside_the_scene_file_is_named_and_not_copied(tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    folder.mkdir()
    np.savez(folder / "ground.npz", height=heights())
    found = import_terrain(folder / "ground.npz", folder / "a.yaml", ImportOptions(resolution=0.02))
    assert write_terrain(found, folder / "a.yaml") == [folder / "a.yaml"]
    same(found, read_scene(folder / "a.yaml"))


def test_a_map_in_utm_comes_near_and_the_file_that_was_read_is_not_written_over(tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    folder.mkdir()
    height = heights()
    height[10, 10] = np.nan
    np.savez(folder / "out_heights.npz", height=height)
    before = (folder / "out_heights.npz").read_bytes()
    found = import_terrain(
        folder / "out_heights.npz", folder / "out.yaml", ImportOptions(resolution=0.02, origin=(EAST, NORTH))
    )
    written = write_terrain(found, folder / "out.yaml")
    assert (folder / "out_heights.npz").read_bytes() == before
    assert [file.name for file in written] == ["out.yaml", "out_heights_imported.npz"]
    again = read_scene(folder / "out.yaml")
    same(found, again)
    assert again.origin_offset == (431_200.0, 5_411_100.0, 0.0)
    assert stands(again, EAST - 431_200.0 + 0.3, NORTH - 5_411_100.0 + 0.6) == pytest.approx(0.0, abs=0.002)


def test_small_holes_are_filled_and_said_and_large_ones_stay_holes(tmp_path: Path) -> None:
    height = heights()
    height[10, 10], height[20:22, 30] = np.nan, np.nan  # 2 and 4 cm
    height[20:35, 5:20] = np.nan
    np.save(tmp_path / "a.npy", height)
    found, again = imported(tmp_path / "a.npy", resolution=0.02)
    assert change(found, "filled", "cells").count == 3
    assert stands(again, 0.02 * 12, 0.02 * 27) is None
    assert usable_area(again.terrain).unknown == pytest.approx(16 * 16 * 4e-4, rel=0.01)
    kept, _ = imported(tmp_path / "a.npy", resolution=0.02, close=0.0)
    assert not [c for c in kept.report.changes if c.what == "filled" and c.count]


def test_a_filled_cell_lies_between_those_around_it_and_known_cells_stay() -> None:
    height = np.add.outer(np.arange(9.0), 2 * np.arange(9.0))
    holes = height.copy()
    holes[4, 4], holes[0, 3], holes[6:8, 2] = np.nan, np.nan, np.nan
    filled, count = without_small_holes(holes, 2.0)
    assert count == 3
    assert np.isnan(filled[0, 3])
    known = ~np.isnan(holes)
    np.testing.assert_array_equal(filled[known], holes[known])
    assert filled[4, 4] == pytest.approx(height[4, 4])
    assert abs(filled[6, 2] - height[6, 2]) < 1.5


def test_equal_maps_make_equal_files() -> None:
    data = height_archive(heights())
    assert data == height_archive(heights())
    np.testing.assert_array_equal(heights_of(data, Path("a.npz")).height, heights())


# Meshes ------------------------------------------------------------------------------------------------------------


def step_mesh() -> trimesh.Trimesh:
    """A floor of 2 x 1 m with a block of 0.5 x 1 x 0.2 m on its right."""
    floor = trimesh.creation.box((2, 1, 0.1), transform=trimesh.transformations.translation_matrix((1, 0.5, -0.05)))
    block = trimesh.creation.box((0.5, 1, 0.2), transform=trimesh.transformations.translation_matrix((1.75, 0.5, 0.1)))
    return trimesh.util.concatenate([floor, block])


def turned(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices[:, [0, 2, 1]] * [1, 1, -1], mesh.faces, process=False)


def remade(vertices: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh:
    return trimesh.Trimesh(vertices, faces, process=False)


def without_bottom(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    low = (mesh.face_normals[:, 2] < -0.9) & (mesh.triangles_center[:, 2] < -0.09)
    return remade(mesh.vertices, mesh.faces[~low])


def doubled(mesh: trimesh.Trimesh, faces: np.ndarray) -> trimesh.Trimesh:
    return remade(mesh.vertices, np.concatenate([mesh.faces, faces]))


MENDED = {
    "as it is": (lambda m: m, {}),
    "inside out": (lambda m: remade(m.vertices, m.faces[:, ::-1]), {}),
    "each face twice": (lambda m: doubled(m, m.faces), {}),
    "both sides of each face": (lambda m: doubled(m, m.faces[:, ::-1]), {}),
    "corners of each face its own": (lambda m: remade(m.triangles.reshape(-1, 3), np.arange(72).reshape(-1, 3)), {}),
    "the floor has no bottom": (without_bottom, {}),
    "a needle": (lambda m: doubled(m, np.array([[0, 1, 1]])), {}),
    "centimetres": (lambda m: remade(100 * m.vertices, m.faces), {"unit": "cm"}),
    "y up": (turned, {"up": "y"}),
    "inches, y up": (lambda m: remade(turned(m).vertices / 0.0254, m.faces), {"up": "y", "unit": "inch"}),
}


@pytest.mark.parametrize("defect", MENDED)
def test_meshes_with_defects_are_the_ground_that_was_meant(tmp_path: Path, defect: str) -> None:
    change_mesh, options = MENDED[defect]
    change_mesh(step_mesh()).export(tmp_path / "a.ply")
    found, again = imported(tmp_path / "a.ply", **options)
    same(found, again)
    assert stands(again, 0.7, 0.5) == pytest.approx(0.0, abs=1e-4)
    assert stands(again, 1.75, 0.5) == pytest.approx(0.2, abs=1e-4)
    assert usable_area(again.terrain).walkable == pytest.approx(2.0, rel=1e-3)


def test_a_mesh_in_utm_comes_near_and_its_offset_is_said(tmp_path: Path) -> None:
    mesh = step_mesh()
    lines = [f"v {x + EAST!r} {y + NORTH!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    (tmp_path / "far.obj").write_text("\r\n".join(lines))
    found, again = imported(tmp_path / "far.obj")
    assert again.origin_offset == (431_200.0, 5_411_100.0, 0.0)
    assert any("origin_offset" in note for note in found.report.notes)
    assert stands(again, EAST - 431_200.0 + 0.7, NORTH - 5_411_100.0 + 0.5) == pytest.approx(0.0, abs=1e-4)


def test_a_mesh_on_its_side_is_asked_about_and_open_bodies_are_counted(tmp_path: Path) -> None:
    ground = trimesh.Trimesh(
        [[0, 0, 0], [20, 0, 0], [20, 0, -20], [0, 0, -20], [5, 1, -5], [6, 1, -5], [6, 1, -6]],
        [[0, 1, 2], [0, 2, 3], [4, 5, 6]],
        process=False,
    )
    ground.export(tmp_path / "a.stl")
    with pytest.raises(InputError, match=r"no surface to stand on.*give --up y"):
        import_terrain(tmp_path / "a.stl", tmp_path / "a.yaml")
    found, _ = imported(tmp_path / "a.stl", up="y")
    assert found.report.read == {"triangles": 3, "bodies": 2, "closed bodies": 0}
    assert any("2 of 2 bodies are open" in note for note in found.report.notes)


# Clouds, polygons, boxes -------------------------------------------------------------------------------------------


def cloud(rng: np.random.Generator) -> np.ndarray:
    floor = np.column_stack([rng.uniform(0, 2, 20_000), rng.uniform(0, 1, 20_000), np.zeros(20_000)])
    wall = np.column_stack([rng.uniform(0, 2, 10_000), np.ones(10_000), rng.uniform(0, 1, 10_000)])
    points = np.concatenate([floor, wall])
    return points + 0.003 * rng.standard_normal(points.shape)


@pytest.mark.parametrize(
    ("moved", "options"),
    [
        (lambda p: p, {}),
        (lambda p: p + np.array([EAST, NORTH, 100.0]), {}),
        (lambda p: p[:, [0, 2, 1]] * [1000.0, 1000.0, -1000.0], {"unit": "mm", "up": "y"}),
    ],
    ids=["metres", "UTM", "millimetres, y up"],
)
def test_a_cloud_becomes_floor_and_wall_wherever_it_lies(tmp_path: Path, moved, options: dict) -> None:
    np.save(tmp_path / "a.npy", moved(cloud(np.random.default_rng(0))))
    found, again = imported(tmp_path / "a.npy", robot="g1", name="hall", **options)
    same(found, again)
    assert (again.name, again.robot) == ("hall", "g1")
    areas = usable_area(again.terrain)
    assert areas.walkable == pytest.approx(2.0, rel=0.04)
    assert areas.palms == pytest.approx(2.0, rel=0.04)
    assert found.report.noise == pytest.approx(0.003, rel=0.15)
    assert found.report.explained is not None and found.report.explained > 0.95
    assert all(s.normal[1] < -0.99 for s in again.terrain.surfaces if s.tilt > 1.0)


def test_polygons_and_boxes_keep_names_friction_and_who_may_touch_them(tmp_path: Path) -> None:
    floor = {"name": "deck", "vertices": [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], "friction": 0.9}
    (tmp_path / "a.json").write_text(json.dumps([floor]))
    found, again = imported(tmp_path / "a.json", friction=0.4)
    same(found, again)
    assert [(s.name, s.friction) for s in again.terrain.surfaces] == [("deck", 0.9)]
    crates = [
        {"name": "crate", "size": [1, 1, 0.2], "xyz": [0, 0, 0.1], "rpy": [0, 0, 0.3]},
        {"name": "crate", "size": [1, 1, 0.4], "xyz": [2, 0, 0.2], "contact": ["left_foot", "right_foot"]},
        {"size": [1, 1, 0.2], "xyz": [0, 0, 0.1], "rpy": [0, 0, 0.3]},
    ]
    (tmp_path / "b.json").write_text(json.dumps({"boxes": crates}))
    found, again = imported(tmp_path / "b.json")
    same(found, again)
    assert [o.name for o in again.terrain.obstacles] == ["crate", "crate_1"]
    assert all(isinstance(o, Box) for o in again.terrain.obstacles)
    assert change(found, "merged", "boxes").count == 1
    assert stands(again, 0.0, 0.0) == pytest.approx(0.2)
    assert stands(again, 2.0, 0.0) == pytest.approx(0.4)
    assert sum(s.allows("left_palm") for s in again.terrain.surfaces) == 4


def test_the_kind_of_a_file_is_told_by_its_content(tmp_path: Path) -> None:
    ring = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
    texts = {
        "a.txt": ("points", ring),
        "b.txt": ("polygons", ring + "\n" + ring),
        "c.csv": ("boxes", "sx,sy,sz,x,y,z\n1,1,1,0,0,0\n"),
        "d.csv": ("points", "x,y,z\n0,0,0\n"),
        "e.txt": ("regions", "PR_0\nRBT,( 0, 0, 0 ), ( 0, 0, 0, 1 )\n"),
        "f.json": ("boxes", '[{"size": [1, 1, 1]}]'),
        "g.json": ("polygons", "[[[0,0,0],[1,0,0],[1,1,0]]]"),
        "h.ply": ("points", "ply\nformat ascii 1.0\nelement vertex 1\nelement face 0\nend_header\n"),
        "i.ply": ("mesh", "ply\nformat ascii 1.0\nelement vertex 3\nelement face 1\nend_header\n"),
        "j.prll": ("regions", "regionId: 1, index: 1\n"),
    }
    for name, (kind, text) in texts.items():
        (tmp_path / name).write_text(text)
        assert kind_of(tmp_path / name) == kind, name
    for name, array in (("a.npy", np.zeros((5, 3))), ("b.npy", np.zeros((5, 7))), ("c.npy", np.zeros((2, 3, 7)))):
        np.save(tmp_path / name, array)
    assert [kind_of(tmp_path / f"{n}.npy") for n in "abc"] == ["points", "heights", "polygons"]


@pytest.mark.parametrize("extent", [200.0, 0.2])
def test_a_size_that_is_not_plausible_is_asked_about(tmp_path: Path, extent: float) -> None:
    floor = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * extent
    (tmp_path / "a.json").write_text(json.dumps([floor.tolist()]))
    found, _ = imported(tmp_path / "a.json")
    assert any("--unit" in hint for hint in found.report.hints)
    assert not imported(tmp_path / "a.json", unit="m")[0].report.hints
