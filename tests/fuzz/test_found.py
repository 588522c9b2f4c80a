"""Inputs that were once answered by a traceback, by several lines, or by a name that the user does not know."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import platformdirs
import pytest
from mutation import to_document
from robot_mutants import mjcf, robot_entry, sdf, urdf, write_robot

from scenes.files.scene_file import read_scene
from scenes.input_error import LONGEST, InputError
from scenes.robots.nominal_stance import check_nominal_stance
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda name: str(tmp_path / "cache" / name))


def refused(folder: Path, entry: dict, model: str) -> str:
    """The refusal of a robot with this file and model."""
    path = write_robot("meshes.urdf", folder)
    path.write_text(to_document(entry), encoding="utf-8")
    (folder / "meshes.urdf").write_text(model, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        check_nominal_stance(load_robot(path))
    assert str(caught.value).isprintable()
    assert str(folder) in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("keys", "value", "expected"),
    [
        (("name",), "../walker", "name: expected letters, digits"),
        (("name",), "", "name: expected letters, digits"),
        (("name",), "w" * 300, "name: expected letters, digits"),
        (("model",), "x" * 20_000, "model: there is no file"),
        (("model",), "a\0b", "model: expected printable text"),
        (("changes", "fixed"), {"left_knee": 0.1}, "nominal.left_knee: the joint does not move"),
        (("changes", "one_hull"), [[]], "one_hull"),
        (("changes", "frames", "a\x01"), {"body": "pelvis", "xyz": [0, 0, 0]}, "expected printable text"),
        (("effectors", "left_foot", "ü\u202e"), 1, r"left_foot.ü\u202e"),
    ],
)
def test_a_slip_in_a_robot_file_is_one_line_that_names_its_key(
    keys: tuple, value: object, expected: str, tmp_path: Path
) -> None:
    entry = json.loads(json.dumps(robot_entry("meshes.urdf")))
    place = entry
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    assert expected in refused(tmp_path, entry, urdf())


def test_a_package_without_a_name_is_not_installed(tmp_path: Path) -> None:
    entry = robot_entry("meshes.urdf")
    del entry["model"], entry["changes"]
    assert "is not installed" in refused(
        tmp_path, {**entry, "package": {"distribution": "", "folders": {}, "urdf": "x"}}, urdf()
    )


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            '<axis xyz="0 1 0"/>',
            '<axis xyz="0 0 0"/>',
            "meshes.urdf: Drake cannot read this model (Joint 'left_hip' axis is zero",
        ),
        (
            '<box size="0.2 0.3 0.2"/>',
            '<box size="0.2 0.3"/>',
            "meshes.urdf: box.size: expected three numbers, got '0.2 0.3'",
        ),
        (
            '<box size="0.2 0.3 0.2"/>',
            "",
            "meshes.urdf: Drake cannot read this model (Warning: geometry element does not have",
        ),
        ('<mass value="20.0"/>', "<mass/>", "meshes.urdf: mass.value: expected a number"),
        ('xyz="0 0 -0.4" rpy="0 0 0"', 'xyz="0 0 -0.4 1"', "meshes.urdf: origin.xyz: expected three numbers"),
    ],
)
def test_a_slip_in_a_model_names_the_users_file(old: str, new: str, expected: str, tmp_path: Path) -> None:
    assert old in urdf()
    assert f"{tmp_path}/{expected}" in refused(tmp_path, robot_entry("meshes.urdf"), urdf().replace(old, new))


@pytest.mark.parametrize(
    ("name", "old", "new", "expected"),
    [
        ("walker.xml", 'pos="0 0 0.95"', 'pos="0 0.95"', "walker.xml: Drake cannot read this model (Expected 3 values"),
        (
            "walker.xml",
            'size="0.03 0.03 0.15"',
            'size="0.03 0.03 1e308"',
            "walker.xml: Drake cannot read this model (Failure",
        ),
        ("walker.sdf", "<child>left_thigh</child>", "<child>left_foot_body</child>", "robot.yaml: links"),
        ("walker.sdf", "<upper>1.5</upper>", "<upper></upper>", "walker.sdf: Drake cannot read this model"),
    ],
)
def test_other_formats_are_refused_alike(name: str, old: str, new: str, expected: str, tmp_path: Path, capfd) -> None:
    model = {"walker.xml": mjcf, "walker.sdf": sdf}[name]()
    assert old in model
    path = write_robot(name, tmp_path)
    (tmp_path / name).write_text(model.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        check_nominal_stance(load_robot(path))
    assert f"{tmp_path}/{expected}" in str(caught.value)
    assert "ERROR" not in capfd.readouterr().err  # what SDFormat says goes into the one line


def test_drakes_warnings_are_said_once_and_in_one_line(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = write_robot("walker.urdf", tmp_path)
    model = tmp_path / "walker.urdf"
    model.write_text(model.read_text().replace('<mass value="1.0"/>', '<mass value="0.0"/>', 1))
    with caplog.at_level("WARNING", logger="drake"):
        for _ in range(2):
            build_plant(load_robot(path))
    said = [r.getMessage() for r in caplog.records if r.name == "drake"]
    assert len(said) == len(set(said)) > 0
    assert all("\n" not in words for words in said)


def test_a_flat_collision_mesh_gives_no_warnings(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    from mesh_mutants import box, stl_bytes

    path = write_robot("meshes.urdf", tmp_path)
    vertices, faces = box((-0.1, -0.15, -0.1), (0.1, 0.15, 0.1))
    (tmp_path / "pelvis.stl").write_bytes(stl_bytes((vertices * [1, 1, 0], faces)))
    assert np.isfinite(load_robot(path).mass)
    assert not [w for w in recwarn if issubclass(w.category, RuntimeWarning)]


def test_a_collision_mesh_that_is_a_point_is_named(tmp_path: Path) -> None:
    from mesh_mutants import box, stl_bytes

    path = write_robot("meshes.urdf", tmp_path)
    vertices, faces = box((0, 0, 0), (1, 1, 1))
    (tmp_path / "pelvis.stl").write_bytes(stl_bytes((0 * vertices, faces)))
    with pytest.raises(InputError, match=r"meshes.urdf: link 'pelvis': its collision mesh is a point"):
        load_robot(path)


@pytest.mark.parametrize("key", ["\x1b[31mred", "ü\u202e", "x" * 20_000])
def test_any_key_of_a_scene_is_shown_in_one_short_printable_line(key: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(
        to_document({"format": "drakeplan-scene", "version": 1, "goal": {"xyz": [0, 0, 0], key: 1}}), encoding="utf-8"
    )
    with pytest.raises(InputError) as caught:
        read_scene(path)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < LONGEST + 10
    assert str(path) in str(caught.value)
