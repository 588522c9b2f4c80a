"""The transition models have the documented sizes and reach, and users may bring their own."""

from __future__ import annotations

import numpy as np
import pytest

from scenes.input_error import InputError
from scenes.library import wider_gap
from scenes.transition_model import TransitionModel, transition_model


@pytest.mark.parametrize(("name", "size"), [("planning", 57), ("training", 38), ("experiments", 60)])
def test_models_have_the_documented_number_of_steps(name: str, size: int) -> None:
    steps = transition_model(name).steps
    assert len(steps) == len(np.unique(steps, axis=0)) == size
    assert np.abs(steps[:, 0]).max() == pytest.approx(0.4)  # max stride of the documents' robot


def test_the_long_stride_crosses_the_published_gap() -> None:
    gap, foot = 0.5, 0.22  # [m] Lin 2020 sec. 6.7.1
    assert transition_model("long_stride").steps[:, 0].max() >= gap + foot


def test_feet_do_not_cross() -> None:
    for name in ("planning", "training", "experiments", "long_stride"):
        assert transition_model(name).steps[:, 1].min() > 0.1


def test_the_right_side_mirrors_the_left() -> None:
    model = transition_model()
    (left, left_rays), (right, right_rays) = model.mirrored(True), model.mirrored(False)
    np.testing.assert_array_equal(right, left * [1, -1, -1])
    np.testing.assert_array_equal(right_rays, left_rays * [1, -1, 1])
    np.testing.assert_allclose(np.linalg.norm(left_rays, axis=1), 1.0)
    assert (left_rays[:, 1] > 0).all()


def test_a_model_of_one_s_own_is_read(tmp_path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("mine: [[0.1, 0.2, 90]]\n")
    model = TransitionModel.read(path, "mine")
    np.testing.assert_allclose(model.steps, [[0.1, 0.2, np.pi / 2]])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("mine: [[0.1, 0.2]]", r"rows of finite \[x, y, yaw\]"),
        ("mine: [[0.1, .nan, 0]]", r"rows of finite \[x, y, yaw\]"),
        ("other: [[0, 0, 0]]", "transition model 'mine'"),
        ("[1, 2]", "named lists"),
        ("a: [", "readable YAML"),
    ],
)
def test_a_broken_model_file_is_one_clear_line(tmp_path, text: str, complaint: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint) as error:
        TransitionModel.read(path, "mine")
    assert "\n" not in str(error.value)


def test_the_leap_stride_crosses_the_wider_gap_and_feet_do_not_cross() -> None:
    steps = transition_model("leap_stride").steps
    assert len(steps) == len(np.unique(steps, axis=0))
    assert steps[:, 0].max() >= wider_gap.GAP + 0.22
    assert steps[:, 1].min() > 0.1
