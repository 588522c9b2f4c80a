"""What the verifier refuses to judge, in one line that says why."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from drakeplan.plan.plan import Plan
from drakeplan.verifier import UnreadablePlan, verify


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("format", "weather", "expected format"),
        ("version", 7, "expected format"),
        ("friction_cone", "ice cream", "friction_cone: expected one of"),
        ("status", "fine", "attribute status"),
        ("mass", "heavy", "attribute mass"),
        ("robot_model_sha256", "0" * 64, "made for another robot model"),
        ("robot_model", "/no/such/model.urdf", "there is no robot model"),
    ],
)
def test_a_foreign_attribute_is_refused_in_one_line(
    good: Path, tmp_path: Path, name: str, value: object, expected: str
) -> None:
    path = Path(shutil.copy(good, tmp_path / "plan.h5"))
    with h5py.File(path, "r+") as file:
        file.attrs[name] = value
    with pytest.raises(UnreadablePlan, match=expected) as caught:
        verify(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("contacts/X_WC", None, "contacts/X_WC: the dataset is missing"),
        ("motion/q", np.zeros((3, 34)), "motion/q: expected a length of"),
        ("motion/v", np.zeros(5), "motion/v: expected 2 dimensions"),
        ("stances/contact", np.zeros((5, 4)), "stances/contact: expected integers"),
        ("effectors", ["left_foot", "right_foot", "right_palm", "left_palm"], "effectors: expected"),
        ("scene/yaml", "surfaces: 3", "scene/yaml: not a scene"),
        ("scene/yaml", "- [" * 1, "scene/yaml: not a scene"),
        ("scene/yaml", "[" * 100_000, "nested too deep"),
        ("scene/yaml", "- " * 100_000, "nested too deep"),
        ("scene/yaml", "surfaces: [{vertices: [[0, 0, 0], [1, 1, 0], [2, 2, 0]]}]", "encloses no area"),
        (
            "scene/yaml",
            "surfaces: [{vertices: [[0, 0, .nan], [1, 1, 0], [2, 0, 0]]}]",
            "convert string to float: '.nan'",
        ),
        ("scene/yaml", "surfaces: [{vertices: [[0, 0, nan], [1, 1, 0], [2, 0, 0]]}]", "finite numbers"),
        ("scene/yaml", "a: &a [1]\nsurfaces: *a", "aliases are not allowed"),
        ("scene/yaml", "surfaces: []\nsurfaces: []", "duplicate key"),
        ("scene/yaml", "{a: 1}\n---\n{b: 1}", "expected one document"),
        ("scene/yaml", "surfaces: []\nobstacles: [{box: [1, 2]}]", "scene/yaml: not a scene"),
    ],
)
def test_a_misshapen_dataset_is_refused_in_one_line(
    good: Path, tmp_path: Path, name: str, value: object, expected: str
) -> None:
    path = Path(shutil.copy(good, tmp_path / "plan.h5"))
    with h5py.File(path, "r+") as file:
        del file[name]
        if value is not None:
            file[name] = value
    with pytest.raises(UnreadablePlan, match=expected) as caught:
        verify(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value) or name in str(caught.value)


def test_a_scene_without_start_or_goal_is_refused(good: Path, tmp_path: Path) -> None:
    path = Path(shutil.copy(good, tmp_path / "plan.h5"))
    with h5py.File(path, "r+") as file:
        text = file["scene/yaml"].asstr()[()]
        file["scene/yaml"][()] = text.split("start:")[0]
    with pytest.raises(UnreadablePlan, match="start or goal is missing"):
        verify(path)


def test_truncated_foreign_and_missing_files_are_refused(good: Path, tmp_path: Path) -> None:
    whole = good.read_bytes()
    path = tmp_path / "plan.h5"
    for content in (whole[: len(whole) // 2], b"walk there", b""):
        path.write_bytes(content)
        with pytest.raises(UnreadablePlan):
            verify(path)
    with pytest.raises(UnreadablePlan, match="no such plan file"):
        verify(tmp_path / "nowhere.h5")


def test_another_model_is_refused_even_if_it_would_do(good: Path, stepping_plan: Plan, tmp_path: Path) -> None:
    lighter = tmp_path / "escher.urdf"
    lighter.write_text(Path(stepping_plan.robot_model).read_text() + "<!-- -->")
    with pytest.raises(UnreadablePlan, match="made for another robot model"):
        verify(good, robot_model=lighter)
    same = shutil.copy(stepping_plan.robot_model, tmp_path / "same.urdf")
    assert verify(good, robot_model=same).holds
