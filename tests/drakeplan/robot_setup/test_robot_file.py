"""What `robots add` writes is what was found, loads again, is the same each time, and says where each value comes from."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import numpy as np
import pytest
import yaml
from humanoids import Humanoid, variant

from drakeplan.robot_setup.describe import describe_robot
from drakeplan.robot_setup.model_source import find_model_source
from drakeplan.robot_setup.robot_file import robot_file_text, write_robot_file
from scenes.effector import EFFECTORS
from scenes.robots.nominal_stance import check_nominal_stance
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import ROBOTS, load_robot

USUAL = Humanoid()
DRAWN = variant(naming="hip_left", feet_by_name=True, drawn_only=True)
DIGITS = 1e-3  # [m, rad] that the file rounds to
SHIPPED = {  # installed package's model -> robot that ships with a description made by hand
    "jvrc-description/jvrc1.urdf": "jvrc1",
    "example-robot-data/talos_reduced.urdf": "talos",
    "example-robot-data/g1_29dof_rev_1_0.urdf": "g1",
}
HAND_MADE = 0.02  # [m] by which soles of a description made by hand may differ


@pytest.mark.parametrize(
    "humanoid",
    [USUAL, variant(arm_joints=0), variant(naming="hip_L", axes="y up"), variant(arm_joints=7, fingers=3, mimic=True)],
    ids=str,
)
def test_what_is_read_is_what_was_found(described, humanoid) -> None:
    found = described(humanoid)
    d, robot = found.description, found.robot
    f = d.figures
    assert robot.name == "toy" and robot.base_body == d.base and robot.torso_body == d.limbs.torso
    assert robot.nominal == d.standing.angles
    assert robot.mass == pytest.approx(d.mass)
    for mine, written in (
        (robot.hip, f.hip),
        (robot.leg_reach, f.leg_reach),
        (robot.com_height, f.com_height),
        (robot.torso_box_centre, f.torso_centre),
        (robot.torso_box_size, f.torso_size),
        (robot.foot_separation, f.foot_separation),
        (robot.com_reach[:2], np.full(2, f.com_reach[0])),
        (robot.half_extents[:2], np.tile(d.soles[0].half_extent, (2, 1))),
        (robot.max_foot_translation, f.max_foot_translation),
        (robot.max_step_height, f.max_step_height),
    ):
        np.testing.assert_allclose(mine, written, atol=0.51 * DIGITS)
    assert len(robot.palms) == (2 if d.palms else 0)
    if d.palms:
        np.testing.assert_allclose(robot.half_extents[2:], d.palms[0].half_extent, atol=0.51 * DIGITS)
        np.testing.assert_allclose((*robot.shoulder, *robot.arm_reach), (*f.shoulder, *f.arm_reach), atol=0.51 * DIGITS)
    plant = build_plant(robot).plant
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, nominal_posture(robot))
    for effector, part in zip(EFFECTORS, [*d.soles, *(d.palms or ())], strict=False):
        body = next(n for n in (part.body, f"{part.body}_link") if plant.HasBodyNamed(n) and n != effector)
        X_BE = plant.CalcRelativeTransform(context, plant.GetFrameByName(body), plant.GetFrameByName(effector))
        np.testing.assert_allclose(X_BE.GetAsMatrix4(), part.X_BE, atol=DIGITS)


def test_the_same_seed_writes_the_same_bytes_and_another_one_the_same_robot(described) -> None:
    usual, legs = described(USUAL), described(variant(arm_joints=0))
    again = describe_robot(find_model_source(str(usual.file.parent / "toy.urdf"), {}), "toy")
    assert robot_file_text(again, usual.file) == usual.file.read_text()
    other = describe_robot(find_model_source(str(legs.file.parent / "toy.urdf"), {}), "toy", seed=7).figures
    for key in ("hip", "leg_reach", "com_height", "foot_separation"):
        np.testing.assert_allclose(getattr(other, key), getattr(legs.description.figures, key), rtol=0.05, atol=0.01)


# ---- comments


def uncommented(text: str) -> list[str]:
    """Keys of a robot file whose value no comment speaks of: none beside it, above it, or beside or above what it is part of."""
    missing, parents = [], [(-1, False)]
    above = False
    for line in text.splitlines():
        if not line.strip():
            above = False
            continue
        if line.lstrip().startswith("#"):
            above = True
            continue
        depth = len(line) - len(line.lstrip())
        while parents[-1][0] >= depth:
            parents.pop()
        said = above or " #" in line or parents[-1][1]
        above = False
        if line.rstrip().endswith(":") or (" #" in line and line.partition(" #")[0].rstrip().endswith(":")):
            parents.append((depth, said))
        elif not said:
            missing.append(line.strip().partition(":")[0])
    return missing


@pytest.mark.parametrize(
    "humanoid", [USUAL, variant(arm_joints=7, fingers=3, mimic=True), variant(drawn_only=True)], ids=str
)
def test_each_value_has_a_comment_that_says_where_it_comes_from(described, humanoid) -> None:
    text = described(humanoid).file.read_text()
    assert set(uncommented(text)) <= {"format", "version", "name", "model"}
    bare = "\n".join(line.partition("#")[0] for line in text.splitlines())
    assert len(uncommented(bare)) > 20  # so the test can fail
    assert yaml.safe_load(bare) == yaml.safe_load(text)


def test_a_base_that_was_turned_has_a_comment_too(described) -> None:
    assert "base_body" not in uncommented(described(variant(naming="hip_L", axes="y up")).file.read_text())


# ---- robots described by hand


@pytest.fixture(scope="module")
def escher_again(tmp_path_factory):
    found = describe_robot(find_model_source(str(ROBOTS / "escher" / "escher.urdf"), {}), "again")
    file = tmp_path_factory.mktemp("escher") / "again.yaml"
    write_robot_file(found, file)
    return found, load_robot(file)


def test_escher_described_comes_near_its_own_robot_file(escher_again) -> None:
    (found, again), escher = escher_again, load_robot("escher")
    check_nominal_stance(again)
    assert (found.limbs.torso, found.base) == (escher.torso_body, escher.base_body)
    np.testing.assert_allclose(again.half_extents[:2], escher.half_extents[:2], atol=3e-3)
    np.testing.assert_allclose(again.half_extents[2:], escher.half_extents[2:], atol=1e-2)
    np.testing.assert_allclose(again.hip, escher.hip, atol=0.03)
    np.testing.assert_allclose(again.shoulder, escher.shoulder, atol=0.03)
    for key in ("leg_reach", "arm_reach"):
        assert getattr(again, key)[1] == pytest.approx(getattr(escher, key)[1], rel=0.03), key
    np.testing.assert_allclose(again.com_height[1:], escher.com_height[1:], atol=0.03)
    assert again.foot_separation[1] == pytest.approx(escher.foot_separation[1], abs=0.03)
    assert again.mass == pytest.approx(escher.mass)


def test_escher_described_squats_as_low_as_by_its_own_robot_file(escher_again) -> None:
    assert escher_again[1].com_height[0] == pytest.approx(load_robot("escher").com_height[0], abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("model", list(SHIPPED)[:1])
def test_soles_of_installed_robots_come_near_those_described_by_hand(model: str, tmp_path: Path) -> None:
    try:
        importlib.metadata.distribution(model.partition("/")[0])
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("pip install 'drakeplan[robots]'")
    found = describe_robot(find_model_source(model, {}), "again")
    write_robot_file(found, tmp_path / "again.yaml")
    again, shipped = load_robot(tmp_path / "again.yaml"), load_robot(SHIPPED[model])
    check_nominal_stance(again)
    by_hand = build_plant(shipped).plant
    mount = next(
        j for j in map(by_hand.get_joint, by_hand.GetJointIndices()) if j.child_body().name() == "left_foot"
    )  # fmt: skip
    foot = mount.parent_body().name()
    np.testing.assert_allclose(again.half_extents[:2], shipped.half_extents[:2], atol=HAND_MADE)
    corners = []
    for robot in (again, shipped):
        plant = build_plant(robot).plant
        X_BF = plant.CalcRelativeTransform(
            plant.CreateDefaultContext(), plant.GetFrameByName(foot), plant.GetFrameByName("left_foot")
        )
        half = np.array([*robot.effectors[0].half_extent, 0.0])
        corners.append([X_BF @ (half * s) for s in ([1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1])])
    np.testing.assert_allclose(corners[0], corners[1], atol=HAND_MADE)
