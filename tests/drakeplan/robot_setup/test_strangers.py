"""Models of strangers that cannot be used are refused in one line that says what to do; nothing is written."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh
from humanoids import Humanoid, variant

from drakeplan.cli import main

USUAL = Humanoid().urdf()
TABLE = (
    '<robot name="table"><link name="top"><inertial><mass value="9"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    '</inertial><collision><geometry><box size="1 1 0.05"/></geometry></collision></link></robot>'
)
TORSO, HEAD = '<box size="0.18 0.3 0.34"/>', re.findall(r'<link name="head">.*?</link>', USUAL)[0]
NECK = re.findall(r'<joint name="neck_yaw".*?</joint>', USUAL)[0]


def less(*patterns: str) -> str:
    """The usual model without what matches."""
    text = USUAL
    for pattern in patterns:
        text, count = re.subn(pattern, "", text)
        assert count
    return text


def but(old: str, new: str, count: int = -1) -> str:
    """The usual model with something else in it."""
    assert old in USUAL
    return USUAL.replace(old, new, count)


def fault(name: str, text: str, message: str):
    return pytest.param(text, message, id=name)


LEG = (
    r'<link name="right_(hip|thigh|shin|ankle|foot)\w*">.*?</link>',
    r'<joint name="right_(hip|knee|ankle)\w*".*?</joint>',
)
LEGS = tuple(p.replace("right_", "(left|right)_") for p in LEG)
MESH = '<mesh filename="{}"/>'
FAULTS = [
    fault("no inertia", less(r"<inertial>.*?</inertial>"), r"'pelvis' carries the others and has no mass: give it an <inertial>"),
    fault("massless", re.sub(r'mass value="\S+"', 'mass value="0"', USUAL), r"has no mass: give it an <inertial>"),
    fault("unknown package", but(TORSO, MESH.format("package://none/a.stl")), r"add --package none=DIR with its folder"),
    fault("no mesh file", but(TORSO, MESH.format("meshes/a.stl")), r"meshes/a\.stl: there is no file"),
    fault("mesh without faces", but(TORSO, MESH.format("empty.stl")), r"empty\.stl: holds no faces"),
    fault("mesh in millimetres", but(TORSO, MESH.format("torso_mm.stl")), r"torso_mm\.stl: .*is it in millimetres\?"),
    fault("one leg", less(*LEG), r"no pair of legs .*ends in 'left_foot', and no other link mirrors it: name the feet"),
    fault("no legs", less(*LEGS), r"no pair of legs"),
    fault("a table", TABLE, r"no pair of legs"),
    fault("ball feet", variant(foot="sphere").urdf(), r"'left_foot': its sole is 2\d x 2\d mm, a point or a line"),
    fault("point feet", variant(foot="point").urdf(), r"'left_foot': its sole is 1 x 1 mm, a point or a line"),
    fault("feet that lie on a rounding", variant(foot="lying cylinder").urdf(), r"'left_foot': its sole is .* a point or a line"),
    fault("link twice", USUAL.replace("</robot>", HEAD + "</robot>"), r"'head'"),
    fault("joint twice", USUAL.replace("</robot>", NECK + "</robot>"), r"neck_yaw"),
    fault("a link without a name", but('<link name="head">', "<link>"), r"name"),
    fault("a joint without a name", but('<joint name="neck_yaw"', "<joint"), r"joint.* name"),
    fault("a joint to nowhere", but('<child link="left_shin"/>', '<child link="left_chin"/>'), r"'left_chin'"),
    fault("a joint to itself", but('<parent link="left_shin"/>', '<parent link="left_ankle"/>'), r"left_ankle"),
    fault(
        "a loop", but("</robot>", '<joint name="x" type="fixed"><parent link="left_foot"/><child link="right_foot"/></joint></robot>'),
        r"loop",
    ),
    fault(
        "a circle", but("</robot>", '<joint name="x" type="fixed"><parent link="left_foot"/><child link="pelvis"/></joint></robot>'),
        r"expected one link that all others hang on, the model has 0",
    ),
    fault("a loose link", but("</robot>", '<link name="loose"/></robot>'), r"expected one link that all others hang on"),
    fault("a ball joint", but('knee_joint" type="revolute"', 'knee_joint" type="ball"'), r"'left_knee_joint' is ball, expected"),
    fault("no type of joint", but('knee_joint" type="revolute"', 'knee_joint"'), r"'left_knee_joint' is None, expected revolute"),
    fault("limits that cross", but('lower="0" upper="2.3"', 'lower="2.3" upper="0"'), r"upper"),
    fault("no axis", but('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>'), r"'left_hip_pitch_joint' axis is zero"),
    fault("knees of wood", variant(knee=(0.0, 0.01)).urdf(), r"cannot stand|no posture"),
    fault("negative mass", but('mass value="22"', 'mass value="-22"'), r"mass\.value: expected finite numbers, got '-22'"),
    fault("mass NaN", but('mass value="22"', 'mass value="nan"'), r"mass\.value: expected finite numbers, got 'nan'"),
    fault("mass in words", but('mass value="22"', 'mass value="heavy"'), r"mass\.value: expected finite numbers, got 'heavy'"),
    fault("mass beyond numbers", but('mass value="22"', 'mass value="1e400"'), r"mass\.value: expected finite numbers"),
    fault("mass of a galaxy", but('mass value="22"', 'mass value="1e300"'), r"Drake cannot read this model"),
    fault("a box of no size", but('<box size="0.22 0.1 0.03"/>', '<box size="0.22 0 0.03"/>'), r"Drake cannot read this model"),
    fault("a box of two numbers", but('<box size="0.22 0.1 0.03"/>', '<box size="0.22 0.1"/>'), r"box\.size: expected three numbers"),
    fault("huge lengths", but('"0 0 -0.38"', '"0 0 -1e30"'), r"metres"),
    fault("a huge torso", but(TORSO, '<box size="1e30 1e30 1e30"/>'), r"metres"),
    fault("too small", variant(scale=0.05).urdf(), r"no pair of legs|m large"),
    fault("not unfolded", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="a"/></robot>', r"expand it first"),
    fault("empty", "", r"not XML"),
    fault("words", "hello\n", r"not XML"),
    fault("cut off", USUAL[: len(USUAL) // 2], r"not XML"),
    fault("a web page", "<html></html>", r"expected a URDF, whose root element is <robot>, got <html>"),
    fault("an entity", '<!DOCTYPE robot [<!ENTITY a "b">]><robot name="x"/>', r"declares a document type"),
    fault("nothing in it", '<robot name="x"/>', r"expected one link"),
]  # fmt: skip


@pytest.fixture
def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs `robots add` on a model, expects exit status 2 and no file; returns the one line that is said."""

    def add(model: str | Path, *words: str, out: Path | None = None) -> str:
        folder = out or tmp_path / "out"
        status = main(["robots", "add", str(model), "--out", str(folder), *words])
        said = capsys.readouterr()
        assert status == 2, said.err
        assert said.out == ""
        lines = [line for line in said.err.splitlines() if not re.fullmatch(r"  \S.* \.\.\.", line)]  # but for progress
        assert len(lines) == 1 and "Traceback" not in said.err, said.err
        assert not [p for p in folder.rglob("*")] if folder.is_dir() else True
        return lines[0]

    return add


@pytest.mark.parametrize(("text", "message"), FAULTS)
def test_one_line_says_what_is_wrong_with_a_model(text: str, message: str, tmp_path: Path, refused) -> None:
    (tmp_path / "empty.stl").write_bytes(b"")
    trimesh.creation.box((180, 300, 340)).export(tmp_path / "torso_mm.stl")
    model = tmp_path / "stranger.urdf"
    model.write_text(text)
    line = refused(model)
    assert re.search(message, line), line
    assert str(tmp_path) in line, line


@pytest.mark.parametrize("foot", ["sphere", "point"])
def test_a_foot_without_a_sole_is_named_with_its_file(foot: str, tmp_path: Path, refused) -> None:
    assert "toy.urdf" in refused(variant(foot=foot).write(tmp_path))


@pytest.mark.parametrize("more", [HEAD, NECK], ids=["link", "joint"])
def test_what_is_there_twice_is_said_in_the_users_words(more: str, tmp_path: Path, refused) -> None:
    (tmp_path / "twice.urdf").write_text(USUAL.replace("</robot>", more + "</robot>"))
    line = refused(tmp_path / "twice.urdf")
    assert "twice" in line.replace("twice.urdf", "") and "draft" not in line


def test_a_model_in_millimetres_is_refused_at_once(tmp_path: Path, refused, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drakeplan.robot_setup.describe._measure", lambda *_: pytest.fail("a giant is measured"))
    assert "metres" in refused(variant(scale=1000.0).write(tmp_path))


def test_not_even_a_folder_is_left(tmp_path: Path, refused) -> None:
    (tmp_path / "stranger.urdf").write_text(TABLE)
    refused(tmp_path / "stranger.urdf", out=tmp_path / "robots" / "new")
    assert not (tmp_path / "robots").exists()


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("a.sdf", "", r"a\.sdf: not XML"),
        ("a.sdf", "<sdf/>", r"a\.sdf: Drake cannot read this model"),
        ("a.sdf", '<sdf version="1.9"><model name="a"/></sdf>', r"a\.sdf: .*at least one link"),
        ("a.xml", '<mujoco model="a"><worldbody/></mujoco>', r"a\.xml: "),
        ("a.xml", USUAL, r"a\.xml: .*mujoco"),
        ("a.urdf.xacro", USUAL, r"xacro a\.urdf\.xacro > a\.urdf$"),
        ("a.stl", "solid", r"expected a model that ends in one of \.urdf, \.sdf, \.xml, \.mjcf"),
    ],
)
def test_files_of_other_formats_are_refused(file: str, content: str, message: str, tmp_path: Path, refused) -> None:
    (tmp_path / file).write_text(content)
    line = refused(tmp_path / file)
    assert re.search(message, line), line


def test_bytes_that_are_no_text_are_refused(tmp_path: Path, refused) -> None:
    (tmp_path / "a.urdf").write_bytes(but("torso", "t\xe4rso").encode("latin-1"))
    assert "a.urdf" in refused(tmp_path / "a.urdf")
    (tmp_path / "a.urdf").write_bytes(b"\0\0\0")
    assert "a.urdf: not XML" in refused(tmp_path / "a.urdf")


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("nothing/at.urdf", r"nothing/at\.urdf: there is no such file, and no Python package nothing is installed"),
        ("numpy/at.urdf", r"the package has no model"),
        ("numpy", r"the package has no model"),
        ("/nowhere/a.urdf", r"/nowhere/a\.urdf: there is no such file$"),
        ("  ", r"there is no such file"),
        ("a\0b", r"there is no such file"),
        ("n" * 5000, r"there is no such file"),
        (".", r"there is no such file"),
    ],
)
def test_what_is_neither_a_file_nor_a_package_is_refused(model: str, message: str, refused) -> None:
    assert re.search(message, refused(model))


def test_a_package_of_many_models_is_asked_about(refused) -> None:
    line = refused("example-robot-data")
    if "no Python package" in line:
        pytest.skip("pip install 'drakeplan[robots]'")
    assert "which of its models" in line
    assert "2 models end in" in refused("example-robot-data/anymal.urdf")
    assert "no model of the package ends in 'none.urdf'" in refused("example-robot-data/none.urdf")


# ---- parts that the user names


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--left-foot nope", r"--left-foot: the model has no link 'nope'"),
        ("--right-palm nope", r"--right-palm: the model has no link 'nope'"),
        ("--left-foot torso", r"--right-foot: expected it beside --left-foot: no link mirrors 'torso' by its name"),
        ("--left-foot left_foot --right-foot left_foot", r"left_foot"),
        ("--left-foot left_foot --right-foot right_hand", r"no posture has both soles flat"),
        ("--right-foot left_foot", r"no link mirrors 'left_foot' by its name"),
    ],
)  # fmt: skip
def test_a_part_that_cannot_be_is_named(words: str, message: str, tmp_path: Path, refused) -> None:
    line = refused(Humanoid().write(tmp_path), *words.split())
    assert re.search(message, line), line


@pytest.mark.parametrize(
    ("words", "option"),
    [
        fault("the pelvis for both feet", "--left-foot pelvis --right-foot pelvis", "foot"),
        fault("the pelvis for both palms", "--left-palm pelvis --right-palm pelvis", "palm"),
        fault("the head for both palms", "--left-palm head --right-palm head", "palm"),
        fault("one hand for both palms", "--left-palm left_hand --right-palm left_hand", "palm"),
        fault("a hand and its forearm", "--left-palm left_hand --right-palm left_forearm", "palm"),
        fault("feet for palms", "--left-palm left_foot", "palm"),
        fault("hands for feet", "--left-foot left_hand", "foot"),
    ],
)  # fmt: skip
def test_a_link_that_cannot_be_a_foot_or_palm_is_refused(words: str, option: str, tmp_path: Path, refused) -> None:
    line = refused(Humanoid().write(tmp_path), *words.split())
    assert option in line and "toy.urdf" in line


# ---- names that are taken


def test_a_link_called_as_the_frame_that_becomes_the_base_does_no_harm(described) -> None:
    from drakeplan.robot_setup.describe import describe_robot
    from drakeplan.robot_setup.model_source import find_model_source

    usual = described(variant(naming="hip_L", axes="y up"))
    model = usual.file.parent / "front.urdf"
    model.write_text(usual.humanoid.urdf().replace('"head"', '"front"'))
    assert describe_robot(find_model_source(str(model), {}), "toy").figures is not None
