"""`robots check` says yes of a robot that can, and of one that cannot it says which key to look at."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from humanoids import Humanoid, variant

from drakeplan.robot_setup import check
from drakeplan.robot_setup.check import Finding, check_robot, level_ground, stair
from scenes.robots.robot import Robot, load_robot

QUESTIONS = ["stands", "shifts", "steps", "leans", "climbs"]


@pytest.fixture
def changed(described, tmp_path: Path) -> Callable[..., Robot]:
    """The usual humanoid's robot file with another model below it, or changed itself."""

    def make(model: str | None = None, edit: Callable[[dict[str, Any]], None] = lambda data: None) -> Robot:
        usual = described(Humanoid())
        (tmp_path / "toy.urdf").write_text(model or usual.humanoid.urdf())
        data = yaml.safe_load(usual.file.read_text()) | {"model": "toy.urdf"}
        edit(data)
        (tmp_path / "toy.yaml").write_text(yaml.safe_dump(data))
        return load_robot(tmp_path / "toy.yaml")

    return make


@pytest.fixture
def no_crossings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Walks are taken to succeed: the questions about posture come alone."""
    monkeypatch.setattr(check, "_crosses", lambda name, *_: Finding(name, True, "not tried"))


def first_no(robot: Robot) -> Finding:
    return next(f for f in check_robot(robot) if not f.ok)


@pytest.mark.slow
def test_a_good_robot_can_do_all_of_it(described) -> None:
    said: list[str] = []
    findings = list(check_robot(described(Humanoid()).robot, say=said.append))
    assert [f.name for f in findings] == QUESTIONS
    assert all(f.ok for f in findings), findings
    assert len(said) == len(QUESTIONS)
    assert not any(f.keys for f in findings)


def test_a_robot_without_palms_is_not_asked_to_lean(described, no_crossings) -> None:
    findings = list(check_robot(described(variant(arm_joints=0)).robot))
    assert [f.name for f in findings] == [q for q in QUESTIONS if q != "leans"]
    assert all(f.ok for f in findings), findings


def test_a_knee_that_cannot_bend_as_far_as_the_nominal_posture_is_named(changed) -> None:
    findings = list(check_robot(changed(variant(knee=(0.0, 0.5)).urdf())))
    assert [f.name for f in findings] == ["stands"]  # the rest needs that it stands
    assert findings[0].keys[0].startswith("nominal.left_knee")
    assert "limits 0 to 0.5" in findings[0].says


def test_a_centre_of_mass_before_the_toes_is_named(changed) -> None:
    (finding,) = check_robot(changed(variant(torso_ahead=0.5).urdf()))
    assert not finding.ok and finding.name == "stands"
    assert re.search(r"CoM is \+\d+ mm before the middle of the feet", finding.says)
    assert "nominal" in finding.keys


def test_a_sole_that_faces_the_wrong_way_is_named(changed) -> None:
    def turn(data: dict[str, Any]) -> None:
        data["changes"]["frames"][data["effectors"]["right_foot"]["frame"]]["rpy"] = [np.pi, 0, 0]

    (finding,) = check_robot(changed(edit=turn))
    assert not finding.ok and finding.keys == ("effectors.right_foot.frame",)


def test_hips_and_ankles_that_do_not_roll_let_no_weight_shift(changed) -> None:
    text = Humanoid().urdf()
    for name in ("hip_roll", "ankle_roll", "hip_yaw"):
        text = re.sub(rf'({name}_joint".*?<limit) lower="\S+" upper="\S+"', r'\1 lower="-0.01" upper="0.01"', text)
    finding = list(islice(check_robot(changed(text)), 2))[-1]
    assert finding.name == "shifts" and not finding.ok
    assert "the CoM does not come over the left_foot" in finding.says
    assert "foot_separation" in finding.keys


def test_a_palm_that_faces_into_its_hand_is_named(changed, no_crossings) -> None:
    def turn(data: dict[str, Any]) -> None:
        data["changes"]["frames"]["left_palm"]["rpy"] = [np.pi, 0, 0]

    finding = first_no(changed(edit=turn))
    assert finding.name in ("stands", "leans")
    assert "effectors.left_palm.frame" in finding.keys


def test_an_arm_that_cannot_turn_its_palm_to_a_wall_is_named(changed, described, no_crossings) -> None:
    text = variant(waist=False).urdf()
    for name in ("right_shoulder_roll", "right_shoulder_yaw", "right_wrist_yaw", "left_hip_yaw", "right_hip_yaw"):
        angle = described(Humanoid()).robot.nominal.get(
            f"{name}_joint", 0.0
        )  # swings ahead and back are left, and bows
        limits = f'lower="{angle - 0.02:g}" upper="{angle + 0.02:g}"'
        text = re.sub(rf'({name}_joint".*?<limit) lower="\S+" upper="\S+"', rf"\1 {limits}", text)
    finding = first_no(changed(text))
    assert finding.name == "leans" and "right_palm" in finding.says
    assert "effectors.right_palm.frame" in finding.keys and "arm_reach" in finding.keys


@pytest.mark.parametrize("scale", [0.4, 1.3])
def test_the_ground_and_the_stair_are_as_large_as_the_robot_needs(described, scale: float) -> None:
    robot = described(variant(scale=scale) if scale < 1 else variant(scale=scale, naming="leg_left_hip")).robot
    ground, steps = level_ground(robot), stair(robot)
    assert ground.goal is not None
    assert ground.goal.xyz[0] <= max(s.vertices[:, 0].max() for s in ground.terrain.surfaces)
    heights = [s.vertices[0, 2] for s in steps.terrain.surfaces]
    assert len(heights) == 4 and (np.diff(heights) < robot.max_step_height).all() and max(heights) > 0
    for tread in steps.terrain.surfaces[1:]:
        assert np.ptp(tread.vertices[:, 0]) > 2 * robot.half_extents[0, 0]
        assert np.ptp(tread.vertices[:, 1]) > robot.foot_separation[1] + 2 * robot.half_extents[0, 1]
