"""`drakeplan scenes import` and `export`: what a stranger types, what comes back, and one line for each mistake."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from drakeplan.cli import main
from scenes.files.scene_file import read_scene
from scenes.library.flat import named as flat

FLOOR = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.0]]


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """What was said on standard error, which must be one line; standard output must be empty."""
    said = capsys.readouterr()
    assert said.out == ""
    assert "Traceback" not in said.err
    assert len(said.err.splitlines()) == 1, said.err
    return said.err


def points(count: int = 8000) -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.column_stack([rng.uniform(0, 2, count), rng.uniform(0, 1, count), 0.003 * rng.standard_normal(count)])


def test_a_cloud_with_a_picture_and_a_report_for_a_machine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "Gelände süd"
    folder.mkdir()
    np.savetxt(folder / "wolke 1.xyz", points(), fmt="%.4f", newline="\r\n")
    out, picture = folder / "scene.yaml", folder / "von oben.png"
    words = ["scenes", "import", str(folder / "wolke 1.xyz"), "--out", str(out), "--picture", str(picture)]
    assert main([*words, "--friction", "0.7", "--robot", "escher", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["status"] == "imported" and report["kind"] == "points"
    assert report["read"] == {"points": 8000}
    assert report["noise_m"] == pytest.approx(0.003, rel=0.1)
    assert report["share_on_surfaces"] > 0.95
    assert report["files"] == [str(out), str(picture)]
    assert report["terrain"]["areas"]["walkable_m2"] == pytest.approx(2.0, rel=0.04)
    assert {c["what"] for c in report["changes"]} == {"merged"}
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert {s.friction for s in read_scene(out).terrain.surfaces} == {0.7}
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "read         " in said and "noise        3" in said and f"written      {out}" in said


@pytest.mark.parametrize("suffix", [".yaml", ".obj", ".sdf", ".xml", ".YML"])
def test_scenes_are_exported_by_suffix(suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"ein feld{suffix}"
    assert main(["scenes", "export", "flat", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["file"] == str(path)
    starts = {".obj": "# flat", ".sdf": "<?xml", ".xml": "<mujoco"}
    assert path.read_text().startswith(starts.get(suffix, "format: drakeplan-scene"))


def test_what_was_exported_as_obj_is_imported_as_the_same_ground(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["scenes", "export", "flat", str(tmp_path / "a.obj")]) == 0
    assert main(["scenes", "import", str(tmp_path / "a.obj"), "--out", str(tmp_path / "b.yaml")]) == 0
    capsys.readouterr()
    one, two = flat(0).terrain.surfaces, read_scene(tmp_path / "b.yaml").terrain.surfaces
    assert len(one) == len(two) == 1
    np.testing.assert_allclose(np.sort(one[0].vertices, axis=0), np.sort(two[0].vertices, axis=0), atol=1e-3)


def write_wrong_files(folder: Path) -> None:
    np.savez(folder / "unknown.npz", height=np.full((5, 5), np.nan), resolution=0.02)
    np.savez(folder / "two.npz", a=np.zeros((5, 5)), b=np.zeros((6, 5)))
    np.savez(folder / "empty.npz")
    np.save(folder / "heights.npy", np.zeros((30, 40)))
    np.save(folder / "nan.npy", np.full((50, 3), np.nan))
    np.save(folder / "line.npy", np.outer(np.linspace(0, 1, 500), [1.0, 2.0, 0.5]))
    np.save(folder / "same.npy", np.ones((500, 3)))
    np.save(folder / "few.npy", np.random.default_rng(0).uniform(0, 1, (10, 3)))
    np.save(folder / "wall.npy", points()[:, [0, 2, 1]])
    (folder / "one.xyz").write_text("1 2 3\n")
    (folder / "empty.xyz").write_text(" \n")
    (folder / "words.txt").write_text("this is no format\nof ours\n")
    (folder / "broken.json").write_text('{"polygons": [')
    (folder / "inf.json").write_text(json.dumps([[*FLOOR[:3], [0.0, float("inf"), 0.0]]]))
    (folder / "bent.json").write_text(json.dumps([[*FLOOR[:3], [0.0, 1.0, 0.5]]]))
    (folder / "picture.png").write_bytes(b"\x89PNG\0")
    (folder / "folder").mkdir()
    floor = trimesh.creation.box((2000.0, 1000.0, 10.0))  # 20 x 10 m in centimetres
    floor.export(folder / "centimetres.stl")
    (folder / "cut.stl").write_bytes((folder / "centimetres.stl").read_bytes()[:300])


WRONG = [
    ("unknown.npz", [], "none of its 25 heights is finite"),
    ("two.npz", [], "expected an array 'height', or one array of two dimensions, found a (5, 5), b (6, 5)"),
    ("empty.npz", [], "expected an array 'height'"),
    ("heights.npy", [], "give --resolution METRES"),
    ("nan.npy", [], "none of its 50 points is finite"),
    ("line.npy", [], "its 500 points lie in one line"),
    ("same.npy", [], "its 500 points lie in one place"),
    ("few.npy", [], "no surface to stand on"),
    ("wall.npy", [], "no surface to stand on: nothing flat faces up and is wide enough (much more of it faces along y"),
    ("one.xyz", [], "holds 1 finite point(s), expected a cloud"),
    ("empty.xyz", [], "the file is empty"),
    ("words.txt", [], "line 2: expected numbers, got 'of'"),
    ("broken.json", [], "not readable as JSON"),
    ("inf.json", [], "a corner is not finite"),
    ("bent.json", [], "no region is left (dropped 1 regions: not flat within 5 mm: polygon_0)"),
    ("picture.png", [], "expected a file that ends in one of .npz"),
    ("folder", [], "a folder without header.txt"),
    ("missing.npz", [], "no such file"),
    ("cut.stl", [], "not a readable mesh"),
    (
        "centimetres.stl",
        [],
        "2000 m across: give --unit cm (then 20 m), --unit mm (2 m), or --unit m if it is that large",
    ),
    ("line.npy", ["--kind", "mesh"], "expected a mesh file"),
    ("heights.npy", ["--resolution", "0"], "--resolution: expected a length from 0.001 to 10 m"),
    ("heights.npy", ["--resolution", "0.02", "--up", "y"], "--up: a height map's heights are along z"),
    ("heights.npy", ["--friction", "-1"], "--friction: expected a number from 0 to 10"),
    ("heights.npy", ["--close", "5"], "--close: expected a width"),
    ("heights.npy", ["--unit", "km"], "--unit: unknown 'km'"),
    ("heights.npy", ["--origin", "1", "2", "3"], "--origin: expected two numbers"),
    ("few.npy", ["--viewpoint", "1", "2"], "--viewpoint: expected three numbers"),
    ("few.npy", ["--robot", "nobody"], "unknown robot 'nobody'"),
    ("few.npy", ["--html", "a.html"], "--html: goes with scenes show, not with scenes import"),
]


@pytest.fixture(scope="module")
def wrong(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wrong files")
    write_wrong_files(folder)
    return folder


@pytest.mark.parametrize(("name", "words", "expected"), WRONG)
def test_each_mistake_is_one_line_and_writes_nothing(
    name: str, words: list[str], expected: str, wrong: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["scenes", "import", str(wrong / name), "--out", str(tmp_path / "a.yaml"), *words]) == 2
    assert expected in one_line(capsys)
    assert not list(tmp_path.iterdir())


def test_where_nothing_can_be_written_is_said_before_the_file_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.save(tmp_path / "a.npy", points())
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o555)
    words = ["scenes", "import", str(tmp_path / "a.npy")]
    assert main(words) == 2
    assert "expected --out SCENE.yaml" in one_line(capsys)
    for out, expected in (
        (str(tmp_path / "a.obj"), "expected a scene file that ends in .yaml"),
        (str(tmp_path / "no folder" / "a.yaml"), "there is no folder"),
        (str(closed / "a.yaml"), "no permission to write"),
    ):
        if "permission" in expected and os.access(closed, os.W_OK):
            continue  # root may write anywhere
        assert main([*words, "--out", out]) == 2
        assert expected in one_line(capsys)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("import", "expected: drakeplan scenes import FILE --out SCENE.yaml"),
        ("import a.npy b.yaml", "expected: drakeplan scenes import FILE --out SCENE.yaml"),
        ("show flat --out a.yaml", "--out: goes with scenes import, not with scenes show"),
        ("export flat a.yaml --unit cm", "--unit: goes with scenes import, not with scenes export"),
        ("export flat a.stl", "expected a file that ends in one of .yaml, .yml, .obj, .sdf, .xml"),
        ("imprt a.npy", "did you mean import"),
    ],
)
def test_words_that_make_no_sense_are_explained(words: str, expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes", *words.split()]) == 2
    assert expected in one_line(capsys)


def test_a_mesh_in_centimetres_is_imported_with_its_unit(
    wrong: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a.yaml"
    assert main(["scenes", "import", str(wrong / "centimetres.stl"), "--unit", "cm", "--out", str(out)]) == 0
    assert "walkable_m2 200" in capsys.readouterr().out
    assert sorted(f.name for f in tmp_path.iterdir()) == ["a.yaml", "a_mesh.stl"]
    low, high = read_scene(out).terrain.extent
    np.testing.assert_allclose(high - low, [20.0, 10.0, 0.1], atol=1e-6)
