"""Users' robots in a query: variants, robots without palms, failures that name bodies, plans that travel."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import platformdirs
import pytest

from drakeplan.cli import main
from drakeplan.motion.key_postures import KeyPostures
from drakeplan.motion.separation import Shortage
from drakeplan.plan.plan_file import read_plan
from drakeplan.plan.robot_of_plan import ROBOT_FILE, RobotMark, find_robot
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.verifier import verify
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.robots.robot import ROBOTS, load_robot


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda name: str(tmp_path / "cache" / name))


@pytest.fixture
def own_escher(tmp_path):
    """Writes escher under its own name with changed text; returns the robot file."""

    def write(*changes: tuple[str, str], model: tuple[tuple[str, str], ...] = (), folder: str = "own") -> Path:
        home = tmp_path / folder
        home.mkdir()
        for name, pairs in (("escher.yaml", changes), ("escher.urdf", model)):
            text = (ROBOTS / "escher" / name).read_text()
            for old, new in pairs:
                assert old in text
                text = text.replace(old, new)
            (home / name).write_text(text)
        return home / "escher.yaml"

    return write


LARGER = ("half_extent: [0.11, 0.05], ", "half_extent: [0.113, 0.053],")
NO_PALMS = tuple(
    (line, "")
    for line in (ROBOTS / "escher" / "escher.yaml").read_text().splitlines(keepends=True)
    if line.strip().startswith(("left_palm", "right_palm", "shoulder:", "arm_reach", "max_palm_translation"))
)
SHORT = PlanOptions(goal=(0.5, 0.0), expansions=60, deadline=300.0)


def test_a_variant_of_a_packaged_robot_is_planned_without_its_weights(own_escher):
    result = plan_scene(load_scene("flat"), load_robot(own_escher(LARGER)), SHORT)
    assert result.status == "complete", result.reason
    assert any("not for this variant" in note for note in result.notes)
    assert result.report["dynamics"] == "quasi-static"


def test_a_robot_without_palms_walks_and_the_verifier_accepts_it(own_escher, tmp_path, capsys):
    robot = own_escher(*NO_PALMS)
    out, page = tmp_path / "plan.h5", tmp_path / "page.html"
    words = [
        "plan",
        "flat",
        "--goal",
        "0.5",
        "0",
        "--robot",
        str(robot),
        "--out",
        str(out),
        "--html",
        str(page),
        "--json",
    ]
    assert main(words) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["palms_used"] == 0
    assert f"--robot {robot}" in captured.err  # what to pass elsewhere
    assert page.stat().st_size > 10_000
    plan = read_plan(out)
    assert set(plan.contacts.effector.tolist()) <= {0, 1}
    assert plan.provenance[ROBOT_FILE] == str(robot)
    assert verify(out).holds

    # The model of a robot that is not installed goes with its cache: the plan names a file that is gone.
    shutil.rmtree(tmp_path / "cache")
    assert main(["verify", str(out)]) == 0  # found by the robot file that the plan names
    moved = tmp_path / "elsewhere"
    robot.parent.rename(moved)
    shutil.rmtree(tmp_path / "cache")
    assert main(["verify", str(out)]) == 2
    assert "--robot" in capsys.readouterr().err
    assert main(["play", str(out), "--html", str(page)]) == 2
    assert "add --robot FILE" in capsys.readouterr().err
    assert main(["verify", str(out), "--robot", str(moved / "escher.yaml")]) == 0
    assert main(["play", str(out), "--html", str(page), "--robot", str(moved / "escher.yaml")]) == 0
    assert main(["verify", str(out), "--robot", "escher"]) == 2  # another model


def test_a_plan_with_a_contact_of_a_palm_of_no_size_is_refused(own_escher, tmp_path):
    import h5py

    result = plan_scene(load_scene("flat"), load_robot(own_escher(*NO_PALMS)), SHORT)
    from drakeplan.plan.plan_file import write_plan

    path = tmp_path / "plan.h5"
    write_plan(result.plan, path)
    with h5py.File(path, "r+") as file:
        file["contacts/effector"][-1] = 2
    assert {"patch size"} <= set(verify(path).failed)


@pytest.mark.parametrize("name", ["escher", "ghost"])
def test_a_robot_is_found_by_name_and_hash_or_the_option_is_named(own_escher, name):
    escher = load_robot("escher")
    assert find_robot(RobotMark("escher", escher.model_sha256)).name == "escher"
    own = own_escher(model=(('value="', 'value="0'),))
    sha = hashlib.sha256((own.parent / "escher.urdf").read_bytes()).hexdigest()
    assert find_robot(RobotMark(name, sha, str(own))).model == own.parent / "escher.urdf"
    assert find_robot(RobotMark(name, sha), own).model_sha256 == sha
    with pytest.raises(InputError, match="add --robot FILE"):
        find_robot(RobotMark(name, sha))
    with pytest.raises(InputError, match="made for another model"):
        find_robot(RobotMark(name, sha), "escher")


def test_a_mark_of_no_plan_file_is_none(tmp_path):
    (tmp_path / "x.h5").write_text("nothing")
    assert RobotMark.of_file(tmp_path / "x.h5") is None
    assert RobotMark.of_file(tmp_path / "y.h5") is None


def test_a_wrong_robot_ends_the_command_with_2_and_one_line(own_escher, capsys):
    robot = own_escher(("left_knee: 0.45", "left_knee: 4.5"))
    assert main(["plan", "flat", "--robot", str(robot)]) == 2
    assert "nominal.left_knee: 4.5 is outside" in capsys.readouterr().err
    assert main(["plan", "flat", "--robot", "escher", "--package", "x"]) == 2
    assert "expected NAME=DIR" in capsys.readouterr().err


def keys(contact_error: float = 0.0, com_error: float = 0.0, near: Shortage | None = None) -> KeyPostures:
    return KeyPostures(
        np.zeros((1, 7)),
        np.zeros((1, 3)),
        np.array([contact_error]),
        np.array([com_error]),
        (np.zeros((0, 2)),),
        ((0, 0),),
        np.array([False]),
        {} if near is None else {0: near},
    )


def test_a_posture_that_fails_names_bodies_and_distances():
    near = Shortage(("left_elbow", "torso"), 0.003, 0.01, own=True)
    assert keys(0.002, near=near).complaint(0).sentence == "left_elbow and torso 3 mm apart, 10 asked"
    assert (
        keys(0.002, near=near).complaint(0).cause == keys(0.0, near=replace(near, bodies=("a", "b"))).complaint(0).cause
    )
    assert "4 mm off its contact" in keys(0.004).complaint(0).sentence
    assert "30 mm from where" in keys(0.0, 0.03).complaint(0).sentence
    assert "balance nowhere" in keys(0.0, np.inf).complaint(0).sentence


def test_a_query_ends_when_every_transition_fails_alike(monkeypatch):
    import drakeplan.motion.maker as maker
    from drakeplan.motion.key_postures import solve_key_postures

    rounds = []

    def fails(robot, ik, schedule, regions, monitor, **options):
        rounds.append(1)
        good = solve_key_postures(robot, ik, schedule, regions, monitor, **options)
        pair = Shortage(("left_elbow", "torso"), 0.003, 0.01, own=True)
        return replace(good, contact_error=np.full(len(good.q), 0.01), near=dict.fromkeys(range(len(good.q)), pair))

    monkeypatch.setattr(maker, "solve_key_postures", fails)
    result = plan_scene(load_scene("flat"), load_robot("escher"), replace(SHORT, goal=(1.0, 0.0)))
    assert result.status == "contacts" and result.reason.endswith("left_elbow and torso 3 mm apart, 10 asked")
    assert len(rounds) <= 2  # once, and once more along the centre of mass of the whole dynamics


@pytest.mark.slow
@pytest.mark.parametrize("name", ["g1", "talos"])
def test_robots_of_a_package_walk(name):
    try:
        robot = load_robot(name)
    except InputError as error:
        pytest.skip(str(error))
    options = PlanOptions(goal=(0.6, 0.0), goal_radius=0.2, expansions=100, deadline=300.0, dynamics="quasi-static")
    result = plan_scene(load_scene("flat"), robot, options)
    assert result.status == "complete", result.reason
