"""Where a scene comes from."""

import pytest
import trimesh

from scenes.files.scene_file import write_scene
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.meshes.mesh_path import package_folder

needs_hpp = pytest.mark.skipif(package_folder("hpp_environments") is None, reason="hpp-environments is not installed")


def test_a_scene_is_a_name_a_file_or_a_mesh(tmp_path):
    assert load_scene("flat").name == "flat"
    write_scene(load_scene("stairs"), tmp_path / "mine.yaml")
    assert load_scene(str(tmp_path / "mine.yaml")).name == "stairs"
    trimesh.creation.box((2, 2, 0.1)).export(tmp_path / "plate.ply")
    scene = load_scene(str(tmp_path / "plate.ply"))
    assert (scene.name, scene.start, scene.goal) == ("plate", None, None)
    assert all(scene.terrain.surfaces_of_meshes)


@needs_hpp
def test_hpp_names_lead_to_the_installed_meshes():
    scene = load_scene("hpp/stairs")
    assert (scene.name, scene.start) == ("hpp/stairs", None)


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("rubble_feild", "unknown scene 'rubble_feild': did you mean rubble_field"),
        ("xyzzy", "unknown scene 'xyzzy': did you mean"),
        ("", "expected a scene name, a scene file or a mesh file"),
        ("missing.yaml", "missing.yaml: no such file"),
        ("missing.stl", "missing.stl: no such mesh file"),
        ("/", "not a regular file"),
        ("a\0b", "unknown scene"),
    ],
)
def test_what_goes_by_no_name_is_refused_in_one_line(source, expected):
    with pytest.raises(InputError) as error:
        load_scene(source)
    assert expected in str(error.value)
    assert "\n" not in str(error.value)
