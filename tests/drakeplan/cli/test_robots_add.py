"""`drakeplan robots add` and `check`: exit status, files, names, one JSON object."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import os
import sys
from importlib import import_module
from pathlib import Path

import platformdirs
import pytest
import yaml

from drakeplan.cli import main
from drakeplan.robot_setup import add as adding
from drakeplan.robot_setup import check as questions
from drakeplan.robot_setup.check import Finding
from drakeplan.robot_setup.describe import describe_robot
from scenes.files.whole_file import write_whole
from scenes.input_error import InputError
from scenes.robots.nominal_stance import check_nominal_stance
from scenes.robots.robot import Robot, load_robot, own_robot_names, own_robots_folder, robot_names

sys.path.insert(0, str(Path(__file__).parents[1] / "robot_setup"))
humanoids = import_module("humanoids")

KEYS = {"name", "path", "sha256", "mass", "effectors", "file", "picture", "notes", "seconds"}
PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A user who has added the robot "toy" from a model in a folder with a space and an umlaut, as Windows writes it."""
    folder = tmp_path_factory.mktemp("home")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_DATA_HOME", str(folder / "data"))
        patch.setattr(platformdirs, "user_cache_dir", lambda name: str(folder / "cache" / name))
        models = folder / "Modelle für Tests"
        models.mkdir()
        text = humanoids.Humanoid(naming="LeftHip").urdf().replace("><", ">\r\n<")
        (models / "mein Läufer.urdf").write_bytes(b"\xef\xbb\xbf" + text.encode())
        found = []
        patch.setattr(adding, "describe_robot", lambda *a, **k: found.append(describe_robot(*a, **k)) or found[-1])
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
            status = main(["robots", "add", str(models / "mein Läufer.urdf"), "--name", "toy"])
        assert status == 0
        patch.setattr(adding, "describe_robot", describe_robot)
        yield folder, models / "mein Läufer.urdf", said.getvalue(), found[0]


@pytest.fixture
def quick(home, monkeypatch):
    """Describing takes no time: what was found of the toy is found of every model, and no picture is drawn but a white one."""
    monkeypatch.setattr(
        adding, "describe_robot", lambda found, name, *_, **__: dataclasses.replace(home[3], found=found, name=name)
    )
    monkeypatch.setattr(adding, "write_pictures", lambda robot, file: write_whole(file, PNG))


@pytest.fixture
def few_robots(monkeypatch):
    """Those that come with drakeplan from other packages take seconds to adapt in an empty cache."""
    monkeypatch.setattr("drakeplan.cli.robots.robot_names", lambda: ["escher", *sorted(own_robot_names())])


def line(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line on standard error; standard output must be empty."""
    said = capsys.readouterr()
    assert said.out == ""
    lines = [text for text in said.err.splitlines() if not text.endswith(" ...")]
    assert len(lines) == 1 and "Traceback" not in said.err, said.err
    return lines[0]


# ---- what add leaves


def test_an_added_robot_is_found_by_its_name(home, few_robots, capsys) -> None:
    folder, model, said, _ = home
    file = folder / "data" / "drakeplan" / "robots" / "toy" / "toy.yaml"
    assert own_robots_folder() == file.parents[1]
    assert {p.name for p in file.parent.iterdir()} == {"toy.yaml", "toy.png"}
    assert file.with_suffix(".png").read_bytes().startswith(PNG)
    assert own_robot_names() == {"toy"} and "toy" in robot_names()
    robot = load_robot("toy")
    check_nominal_stance(robot)
    assert robot.name == "toy" and robot.source == file.resolve() and robot.given_by_path
    assert yaml.safe_load(file.read_text(encoding="utf-8"))["model"] == str(model)
    assert main(["robots"]) == 0
    assert any(text.startswith("toy ") and "added by you" in text for text in capsys.readouterr().out.splitlines())
    assert main(["robots", "--path", "toy"]) == 0
    assert capsys.readouterr().out.strip() == str(robot.model)
    for words in (
        "robot        toy, 68.8 kg",
        "base         pelvis",
        "left foot    LeftFoot, 220 x 100 mm",
        f"written      {file}",
    ):
        assert words in said
    assert "next         drakeplan robots check toy" in said


def test_a_name_that_is_taken_needs_replace(home, quick, capsys) -> None:
    _, model, *_ = home
    file = own_robots_folder() / "toy" / "toy.yaml"
    before = file.read_bytes()
    assert main(["robots", "add", str(model), "--name", "toy"]) == 2
    assert "toy.yaml: there is a robot of this name: add --replace, or choose another --name" in line(capsys)
    assert file.read_bytes() == before
    file.write_text("format: something else\n")
    assert main(["robots", "add", str(model), "--name", "toy", "--replace"]) == 0
    assert file.read_bytes() == before


def test_a_description_that_fails_leaves_the_robot_of_before(home, capsys) -> None:
    _, model, *_ = home
    file = own_robots_folder() / "toy" / "toy.yaml"
    before = file.read_bytes()
    try:
        words = ["--name", "toy", "--replace", "--left-foot", "LeftHand"]
        assert main(["robots", "add", str(model), *words]) == 2
        assert file.read_bytes() == before
    finally:
        file.write_bytes(before)


def test_json_is_one_object_with_what_was_made(home, quick, few_robots, tmp_path, capsys) -> None:
    _, model, *_ = home
    picture = tmp_path / "Bild eins.png"
    words = ["robots", "add", str(model), "--out", str(tmp_path / "ein Ordner"), "--picture", str(picture), "--json"]
    assert main(words) == 0
    said = json.loads(capsys.readouterr().out)
    assert set(said) == KEYS
    assert said["name"] == "mein_Läufer" and Path(said["file"]) == tmp_path / "ein Ordner" / "mein_Läufer.yaml"
    assert Path(said["picture"]).read_bytes().startswith(PNG)
    assert load_robot(said["file"]).model_sha256 == said["sha256"]
    assert said["effectors"]["left_foot"]["half_extent"] == [0.11, 0.05]
    assert said["mass"] == pytest.approx(68.8) and isinstance(said["notes"], list) and said["seconds"] >= 0
    assert main(["robots", "--json"]) == 0
    assert "toy" in [r["name"] for r in json.loads(capsys.readouterr().out)["robots"]]


def test_python_adds_a_robot_as_the_command_does(home, quick, tmp_path) -> None:
    said: list[str] = []
    added = adding.add_robot(
        home[1], name="other", folder=tmp_path / "new", links={"left_foot": "LeftFoot"}, say=said.append
    )
    assert added.file == tmp_path / "new" / "other.yaml" and added.robot.name == "other"
    assert added.picture.read_bytes() == PNG and added.description.name == "other" and said[-1] == "draw"
    with pytest.raises(InputError, match="add --replace"):
        adding.add_robot(home[1], name="other", folder=tmp_path / "new")


# ---- places and names that cannot be


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--name", "../x"], "--name ../x: expected letters, digits"),
        (["--name", ""], "--name : expected letters, digits"),
        (["--name", "x" * 65], "at most 64"),
        (["--name", "escher"], "--name escher: a robot of this name comes with drakeplan: choose another"),
        (["--out", "/dev/null"], "/dev/null: cannot be made (File exists): choose a folder with --out DIR"),
        (["--out", "/dev/null/below"], "cannot be made (Not a directory)"),
        (["--out", "/proc/robots"], "/proc/robots: cannot be made"),
        (["--picture", "no/such/folder/x.png"], "there is no folder no/such/folder"),
        (["--picture", "/dev/null"], "/dev/null: cannot be written"),
        (["--seed", "-1"], "--seed: expected 0 or more, got -1"),
        (["--path", "x"], "--path: goes with drakeplan robots, not with drakeplan robots add"),
        (["--package", "x"], "--package: expected NAME=DIR"),
    ],
)
def test_what_cannot_be_written_is_said_before_the_model_is_read(home, words, message, capsys, monkeypatch) -> None:
    monkeypatch.setattr(adding, "describe_robot", lambda *_, **__: pytest.fail("it was read"))
    assert main(["robots", "add", str(home[1]), "--name", "other", *words]) == 2
    assert message in line(capsys)


@pytest.mark.parametrize("data", ["/proc", "/dev/null"])
def test_a_data_folder_that_cannot_be_written_names_the_option(home, few_robots, data, capsys, monkeypatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", data)
    assert main(["robots", "add", str(home[1])]) == 2
    assert "cannot be made" in (said := line(capsys)) and said.endswith("choose a folder with --out DIR")
    assert own_robot_names() == set()
    assert main(["robots"]) == 0  # the robots that come with drakeplan are there all the same


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is read-only for root")
def test_a_folder_without_permission_is_said(home, tmp_path, capsys) -> None:
    tmp_path.chmod(0o555)
    for out in (tmp_path, tmp_path / "below"):
        assert main(["robots", "add", str(home[1]), "--out", str(out)]) == 2
        assert "ermission" in line(capsys)


def test_a_picture_in_the_robot_files_place_is_refused(home, quick, tmp_path, capsys) -> None:
    words = [
        "robots",
        "add",
        str(home[1]),
        "--name",
        "x",
        "--out",
        str(tmp_path),
        "--picture",
        str(tmp_path / "x.yaml"),
    ]
    assert main(words) == 2
    assert "same file" in line(capsys)


def test_a_robot_of_a_user_that_cannot_be_read_is_listed_with_the_reason(home, few_robots, capsys) -> None:
    broken = own_robots_folder() / "broken"
    broken.mkdir()
    try:
        (broken / "broken.yaml").write_text("format: drakeplan-robot\nversion: 1\n")
        (own_robots_folder() / "stray.yaml").write_text("")
        assert main(["robots"]) == 0
        said = capsys.readouterr().out
        assert "broken" in said and "not usable here" in said and "stray" not in said
        assert main(["robots", "check", "broken"]) == 2
        assert "broken.yaml: name" in line(capsys)
    finally:
        (broken / "broken.yaml").unlink()
        broken.rmdir()
        (own_robots_folder() / "stray.yaml").unlink()


# ---- check


@pytest.mark.parametrize(("ok", "status"), [(True, 0), (False, 1)])
def test_check_exits_by_what_the_robot_can_do(home, ok, status, capsys, monkeypatch, tmp_path) -> None:
    def asked(robot: Robot, *, seed: int, say) -> list[Finding]:
        say("stand")
        assert robot.name == "toy" and seed == 3
        return [Finding("stands", True, "flat"), Finding("steps", ok, "how", () if ok else ("leg_reach", "nominal"))]

    monkeypatch.setattr(questions, "check_robot", asked)
    picture = tmp_path / "toy.png"
    draw = ["--picture", str(picture)] if ok else []
    assert main(["robots", "check", "toy", "--seed", "3", *draw]) == status
    said = capsys.readouterr().out.splitlines()
    assert said[0].split() == ["stands", "yes", "flat"]
    assert said[1].split() == ["steps", "yes" if ok else "NO", "how"]
    assert said[2:] == ([] if ok else [f"{'':<13} look at leg_reach, nominal in {load_robot('toy').source}"])
    assert picture.exists() is ok and (not ok or picture.read_bytes().startswith(PNG))
    assert main(["robots", "check", str(load_robot("toy").source), "--seed", "3", "--json"]) == status
    said = json.loads(capsys.readouterr().out)
    assert said["robot"] == "toy" and said["ok"] is ok
    keys = [] if ok else ["leg_reach", "nominal"]
    assert said["findings"][1] == {"name": "steps", "ok": ok, "says": "how", "keys": keys}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["toyy"], "unknown robot 'toyy': did you mean toy"),
        (["none.yaml"], "none.yaml"),
        (
            ["model.urdf"],
            "model.urdf: a model, expected a robot's name or its YAML file: drakeplan robots add model.urdf makes one",
        ),
        ([], "drakeplan robots check: expected NAME"),
        (["toy", "--left-foot", "x"], "--left-foot: goes with drakeplan robots add"),
        (["toy", "--name", "x"], "--name: goes with drakeplan robots add"),
        (["toy", "--replace"], "--replace: goes with drakeplan robots add"),
        (["toy", "--picture", "no/such/folder/x.png"], "there is no folder no/such/folder"),
    ],
)
def test_what_cannot_be_checked_is_exit_2(home, words, message, capsys) -> None:
    assert main(["robots", "check", *words]) == 2
    assert message in line(capsys)


def test_a_model_that_has_gone_is_named(home, quick, tmp_path, capsys) -> None:
    model = tmp_path / "gone.urdf"
    model.write_bytes(home[1].read_bytes())
    assert main(["robots", "add", str(model), "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    model.unlink()
    assert main(["robots", "check", str(tmp_path / "gone.yaml")]) == 2
    assert f"gone.yaml: model: there is no file {model}" in line(capsys)


@pytest.mark.slow
def test_an_added_robot_walks_by_its_name(home, tmp_path, capsys) -> None:
    out = tmp_path / "walk.h5"
    assert main(["plan", "flat", "--robot", "toy", "--first", "--expansions", "500", "--out", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["status"] == "complete" and said["verified"] == {"holds": True, "failed": []}
    assert main(["verify", str(out)]) == 0
