"""Where the meshes of a scene file may lie."""

from pathlib import Path

import pytest

from scenes.input_error import InputError
from scenes.meshes import mesh_path as module
from scenes.meshes.mesh_path import hpp_meshes, hpp_reference, mesh_path, package_folder

HPP = "package://hpp_environments/meshes/multicontact/darpa.stl"
needs_hpp = pytest.mark.skipif(package_folder("hpp_environments") is None, reason="hpp-environments is not installed")


def test_a_relative_path_starts_at_the_scene_file(tmp_path):
    assert mesh_path("parts/rock.stl", tmp_path, "it") == tmp_path / "parts" / "rock.stl"


@pytest.mark.parametrize("reference", ["../x.stl", "a/../../x.stl", "/etc/passwd", "a\\..\\x.stl", "x\0.stl"])
def test_a_relative_path_stays_in_the_folder_of_the_scene_file(reference, tmp_path):
    with pytest.raises(InputError, match=r"it: expected a path inside the scene file's folder"):
        mesh_path(reference, tmp_path, "it")


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    (tmp_path / "scene").mkdir()
    (tmp_path / "secret.stl").write_text("x")
    (tmp_path / "scene" / "link.stl").symlink_to(tmp_path / "secret.stl")
    with pytest.raises(InputError, match="leads out of it"):
        mesh_path("link.stl", tmp_path / "scene", "it")


def test_without_a_folder_only_packages_can_be_named():
    with pytest.raises(InputError, match="expected package://"):
        mesh_path("rock.stl", None, "it")


@needs_hpp
def test_a_package_path_leads_into_the_installed_package():
    assert mesh_path(HPP, None, "it").is_file()


@needs_hpp
@pytest.mark.parametrize("rest", ["../../x.stl", "meshes/../../../x", "/etc/passwd", ""])
def test_a_package_path_stays_in_its_package(rest):
    with pytest.raises(InputError, match="it: expected a path inside the package hpp_environments"):
        mesh_path(f"package://hpp_environments/{rest}", None, "it")


@pytest.mark.parametrize("package", ["", "..", "nowhere", "numpy", "a b"])
def test_a_package_that_is_not_there_is_named(package):
    with pytest.raises(InputError, match=r"it: no installed package has a folder share/"):
        mesh_path(f"package://{package}/x.stl", None, "it")


@needs_hpp
def test_meshes_of_hpp_environments_go_by_their_name():
    assert hpp_reference("darpa") == HPP
    assert hpp_reference("darpa.stl") == HPP
    assert hpp_reference("hrp2/floor").endswith("meshes/hrp2/floor.dae")
    assert hpp_reference("car").endswith("car.stl"), "of two formats the STL is meant"
    assert hpp_reference("car.dae").endswith("car.dae")
    for reference in hpp_meshes().values():
        assert mesh_path(reference, None, "it").is_file()


@needs_hpp
def test_a_misspelt_mesh_gets_the_nearest_names():
    with pytest.raises(InputError, match="unknown mesh 'hpp/darpaa': did you mean hpp/darpa"):
        hpp_reference("darpaa")


def test_a_missing_package_says_how_to_install_it(monkeypatch):
    monkeypatch.setattr(module, "hpp_meshes", dict)
    with pytest.raises(InputError, match=r"hpp/darpa: .* pip install --no-deps hpp-environments"):
        hpp_reference("darpa")
    monkeypatch.setattr(module, "package_folder", lambda package: None)
    with pytest.raises(InputError, match="pip install --no-deps hpp-environments"):
        mesh_path(HPP, Path(), "it")
