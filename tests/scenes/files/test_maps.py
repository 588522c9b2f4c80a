"""Georeferenced scenes, height maps, tiles and the other forms in which maps come."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenes.files.scene_file import read_scene, scene_from_yaml, scene_to_yaml, write_scene
from scenes.files.scene_source import load_scene
from scenes.footholds.projection import set_down
from scenes.input_error import InputError
from scenes.scene import Scene
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.usable_area import usable_area

HEAD = "format: drakeplan-scene\nversion: 1\n"
EAST, NORTH = 431_234.5, 5_411_098.25  # [m] a place in UTM
HALF = (0.11, 0.06)  # sole [m]


def floor(x: float, y: float) -> str:
    corners = ", ".join(f"[{x + a}, {y + b}, 0.5]" for a, b in ((-1, -1), (2, -1), (2, 1), (-1, 1)))
    return f"surfaces: [{{name: floor, vertices: [{corners}]}}]\n"


def scene(text: str, folder: Path | None = None) -> Scene:
    return scene_from_yaml(HEAD + text, "map.yaml", folder=folder)


def stands(of: Scene, x: float, y: float) -> bool:
    return set_down(pack_terrain(of.terrain), "left_foot", x, y, 0.0, HALF) is not None


# UTM ---------------------------------------------------------------------------------------------------------------


def test_an_offset_is_found_for_a_georeferenced_scene_and_said() -> None:
    ends = f"start: {{xyz: [{EAST}, {NORTH}, 0.5]}}\ngoal: {{xyz: [{EAST + 1}, {NORTH}, 0.5]}}\n"
    found = scene(floor(EAST, NORTH) + f"obstacles: [{{box: [1, 1, 1], pose: {{xyz: [{EAST}, {NORTH}, 3]}}}}]\n" + ends)
    assert found.origin_offset == (431_200.0, 5_411_100.0, 0.0)
    assert any("origin_offset [431200, 5411100, 0] m was subtracted" in note for note in found.notes)
    local = np.array([EAST, NORTH, 0.0]) - found.origin_offset
    np.testing.assert_allclose(found.terrain.surfaces[0].vertices[0], np.add(local, [-1, -1, 0.5]), atol=1e-6)
    np.testing.assert_allclose(found.terrain.obstacles[0].X_WO[:3, 3], np.add(local, [0, 0, 3]), atol=1e-6)
    assert found.start is not None
    assert found.goal is not None
    np.testing.assert_allclose(found.start.xyz, np.add(local, [0, 0, 0.5]), atol=1e-6)
    np.testing.assert_allclose(found.goal.xyz, np.add(local, [1, 0, 0.5]), atol=1e-6)


def test_a_given_offset_is_taken_and_local_coordinates_stay() -> None:
    text = f"origin_offset: [{EAST}, {NORTH}, 0]\n" + floor(EAST, NORTH) + "start: {xyz: [0, 0, 0.5]}\n"
    found = scene(text)
    assert found.origin_offset == (EAST, NORTH, 0.0)
    assert found.notes == ()
    np.testing.assert_allclose(found.terrain.surfaces[0].vertices[2], [2, 1, 0.5], atol=1e-6)
    assert found.start is not None
    assert found.start.xyz == (0.0, 0.0, 0.5)


def test_the_offset_is_kept_in_files_and_added_again_by_export(tmp_path: Path) -> None:
    found = scene(floor(EAST, NORTH) + f"goal: {{xyz: [{EAST}, {NORTH}, 0.5]}}\n")
    write_scene(found, tmp_path / "out.yaml")
    text = (tmp_path / "out.yaml").read_text()
    assert "origin_offset: [431200.0, 5411100.0, 0.0]" in text
    assert "5411097.25" in text
    for again in (
        read_scene(tmp_path / "out.yaml"),
        scene_from_yaml(scene_to_yaml(found, meshes_as_surfaces=True), "plan"),
    ):
        assert again.origin_offset == found.origin_offset
        assert again.notes == ()
        for a, b in zip(again.terrain.surfaces, found.terrain.surfaces, strict=True):
            np.testing.assert_allclose(a.vertices, b.vertices, atol=1e-6)
        assert again.goal is not None
        assert found.goal is not None
        np.testing.assert_allclose(again.goal.xyz, found.goal.xyz, atol=1e-6)
    assert "5411097.25" not in scene_to_yaml(found, meshes_as_surfaces=True)


def far_mesh(folder: Path) -> Path:
    mesh = trimesh.creation.box((4.0, 2.0, 0.5))
    mesh.apply_translation((EAST, NORTH, 100.0))
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    (folder / "far.obj").write_text("\n".join(lines) + "\n")
    return folder / "far.obj"


def test_a_georeferenced_mesh_is_brought_near_alone_in_a_scene_and_by_its_pose(tmp_path: Path) -> None:
    path = far_mesh(tmp_path)
    alone = load_scene(str(path))
    assert alone.origin_offset == (431_200.0, 5_411_100.0, 0.0)
    assert any("origin_offset" in note for note in alone.notes)
    listed = scene(f"meshes: [{{file: far.obj}}]\nstart: {{xyz: [{EAST}, {NORTH}, 100]}}\n", tmp_path)
    assert listed.origin_offset == alone.origin_offset
    assert listed.start is not None
    assert stands(listed, *listed.start.xyz[:2])
    posed = scene(f"meshes: [{{file: far.obj, pose: {{xyz: [{-EAST}, {-NORTH}, -100]}}}}]\n", tmp_path)
    assert posed.origin_offset is None
    assert stands(posed, 0.0, 0.0)
    for found in (listed, posed):
        write_scene(found, tmp_path / "again.yaml")
        again = read_scene(tmp_path / "again.yaml")
        assert again.origin_offset == found.origin_offset
        np.testing.assert_allclose(again.terrain.triangles, found.terrain.triangles, atol=1e-6)


def test_what_lies_far_from_the_offset_is_refused_with_the_remedy() -> None:
    with pytest.raises(
        InputError, match=r"map.yaml: reaches .* m from its origin, expected at most 100 km; give an origin_off"
    ):
        scene("origin_offset: [100000, 0, 0]\n" + floor(EAST, NORTH))


# Height maps -------------------------------------------------------------------------------------------------------


def save_map(folder: Path, height: np.ndarray) -> None:
    np.savez(folder / "map.npz", height=height)


def map_text(**other: object) -> str:
    entry = {"file": "map.npz", "resolution": 0.02, "origin": [-0.5, -0.5], "friction": 0.7} | other
    return f"heightmaps: [{{{', '.join(f'{k}: {v}' for k, v in entry.items())}}}]\n"


def rough(deviation: float, shape: tuple[int, int] = (51, 101)) -> np.ndarray:
    return np.random.default_rng(1).normal(0.0, deviation, shape)


def test_a_height_map_is_ground_with_its_own_friction_where_its_rows_run_along_y(tmp_path: Path) -> None:
    save_map(tmp_path, np.linspace(0.0, 0.2, 101)[None, :] + rough(0.002))
    found = scene(map_text() + "friction: 0.3\n", tmp_path)
    low, high = found.terrain.extent
    np.testing.assert_allclose([*low[:2], *high[:2]], [-0.5, -0.5, 1.5, 0.5], atol=1e-3)
    contact = set_down(pack_terrain(found.terrain), "left_foot", 1.0, 0.1, 0.0, HALF)
    assert contact is not None
    assert contact.friction == 0.7
    assert contact.p_WC[2] == pytest.approx(0.15, abs=0.002)
    assert any("planes were fitted within" in note for note in found.notes)


def test_unknown_cells_are_not_walkable_and_are_said(tmp_path: Path) -> None:
    height = rough(0.003)
    height[15:36, 40:61] = np.nan
    save_map(tmp_path, height)
    found = scene(map_text(), tmp_path)
    assert any(f"{21 * 21 / height.size:.1%} of its heights are not known" in note for note in found.notes)
    assert usable_area(found.terrain).unknown == pytest.approx((22 * 22 - 1) * 0.02**2)  # two corner cells keep half
    x, y = -0.5 + 0.02 * 50, 0.0
    assert not stands(found, x, y)
    assert not stands(found, x - 0.2 - HALF[0] + 0.01, y)
    assert stands(found, x - 0.24 - HALF[0] - 0.02, y)


def test_a_height_map_comes_back_from_its_file_and_in_utm(tmp_path: Path) -> None:
    save_map(tmp_path, rough(0.003))
    for origin in ([-0.5, -0.5], [EAST, NORTH]):
        found = scene(map_text(origin=origin), tmp_path)
        assert (found.origin_offset is None) == (origin[0] < 0)
        write_scene(found, tmp_path / "again.yaml")
        again = read_scene(tmp_path / "again.yaml")
        np.testing.assert_allclose(again.terrain.triangles, found.terrain.triangles, atol=1e-6)
        assert [s.friction for s in again.terrain.surfaces] == [s.friction for s in found.terrain.surfaces]


@pytest.mark.parametrize(
    ("arrays", "expected"),
    [
        ({"z": np.zeros((3, 3))}, "expected an array 'height', found z"),
        ({"height": np.zeros(3)}, "expected numbers in rows and columns"),
        ({"height": np.full((3, 3), np.nan)}, "no cell has"),
        ({"height": np.full((3, 3), 1e9)}, "expected metres below 100 km"),
        ({"height": np.array([["a", "b"], ["c", "d"]])}, "expected numbers in rows and columns"),
        ({"height": np.array([[None, 1], [2, 3]], dtype=object)}, "not a readable npz file"),
    ],
)
def test_bad_height_maps_are_refused_in_one_line(arrays: dict, expected: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "map.npz", **arrays)
    with pytest.raises(InputError) as error:
        scene(map_text(), tmp_path)
    assert expected in str(error.value)
    assert str(error.value).startswith("map.yaml: heightmaps[0].file: ")
    assert "\n" not in str(error.value)


def test_missing_and_foreign_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such height map"):
        scene(map_text(), tmp_path)
    (tmp_path / "map.npz").write_text("height")
    with pytest.raises(InputError, match="not a readable npz file"):
        scene(map_text(), tmp_path)


# Other forms -------------------------------------------------------------------------------------------------------


def test_an_l_shaped_floor_of_three_polygons_carries_a_sole_across_its_inner_corner() -> None:
    pieces = ((0, 1, 0, 1), (1, 2, 0, 1), (0, 1, 1, 2))
    text = "surfaces:\n" + "".join(
        f"  - {{name: p{k}, vertices: [[{a},{c},0],[{b},{c},0],[{b},{d},0],[{a},{d},0]]}}\n"
        for k, (a, b, c, d) in enumerate(pieces)
    )
    found = scene(text)
    packed = pack_terrain(found.terrain)
    assert len(set(packed.floor.tolist())) == 1
    for yaw in (0.8, 2.4):
        inside = set_down(packed, "left_foot", 0.9, 0.9, yaw, HALF)
        assert inside is not None
    assert set_down(packed, "left_foot", 1.0, 1.0, np.pi / 4, HALF) is None  # a corner hangs over the missing quarter


def test_a_yaw_beyond_a_turn_is_said_to_look_like_degrees() -> None:
    found = scene(floor(0, 0) + "start: {xyz: [0, 0, 0.5], yaw: 90}\ngoal: {xyz: [1, 0, 0.5], yaw: -1.57}\n")
    (note,) = found.notes
    assert "start.yaw: 90 rad" in note
    assert "1.571 rad" in note


def test_areas_count_overlapping_surfaces_once_and_name_what_is_ignored(tmp_path: Path) -> None:
    wall = "  - {name: wall, vertices: [[0,1,0],[2,1,0],[2,1,2],[0,1,2]]}\n"
    ceiling = "  - {name: ceiling, vertices: [[0,0,2],[0,1,2],[1,1,2],[1,0,2]], normal: [0,0,-1]}\n"
    floors = "".join(
        f"  - {{name: f{x}, vertices: [[{x},0,0],[{x + 2},0,0],[{x + 2},1,0],[{x},1,0]]}}\n" for x in (0, 1)
    )
    areas = usable_area(scene("surfaces:\n" + floors + wall + ceiling).terrain)
    assert areas.walkable == pytest.approx(3.0)
    assert areas.palms == pytest.approx(4.0)
    assert areas.unused == pytest.approx(1.0)
    assert areas.narrow == areas.steep == areas.downward == areas.unknown == 0.0
    trimesh.creation.box((1.0, 0.03, 0.5)).export(tmp_path / "bar.stl")  # its top is narrower than a sole
    areas = usable_area(scene(floor(0, 0) + "meshes: [{file: bar.stl}]\n", tmp_path).terrain)
    assert areas.narrow == pytest.approx(0.03, rel=1e-4)
    assert areas.downward == pytest.approx(0.03, rel=1e-4)
