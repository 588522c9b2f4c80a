"""What networks are taught: duplicates of angles, the linear beginning, answers at their bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from learning.labelled_transitions import TRAIN, learning_set
from learning.network import COST_OFFSET
from learning.training.lesson import Lesson, lessons, with_turned_angles
from learning.training.options import TrainingOptions
from scenes.input_error import InputError


def toy_lesson(x: np.ndarray, y: np.ndarray, **changes) -> Lesson:
    yes = np.ones(len(x), bool)
    lesson = Lesson("toy", x, yes, y, x[:0], yes[:0], y[:0], classifies=True, skip=True, bounded=True)
    return replace(lesson, **changes)


def test_angles_near_pi_are_taught_from_both_sides() -> None:
    """Lin et al. 2019 sec. VII: duplicates shifted by 2 pi mean the same rotation, and only angles near +-pi have them."""
    x = np.array([[3.0, 1.0, 0.0], [-3.1, 0.0, 7.0], [0.5, -3.0, 7.0], [1.0, 1.0, 3.0]])
    turned, origin = with_turned_angles(x, np.array([0, 1]))
    assert origin.tolist() == [0, 1, 2, 3, 0, 1, 2]
    np.testing.assert_array_equal(turned[:4], x)
    np.testing.assert_allclose(np.exp(1j * turned[:, :2]), np.exp(1j * x[origin][:, :2]), atol=1e-12)
    np.testing.assert_array_equal(turned[:, 2], x[origin, 2])
    np.testing.assert_allclose(turned[4:, 0], [3.0 - 2 * np.pi, -3.1 + 2 * np.pi, 0.5])


def test_a_linear_outcome_is_known_before_training() -> None:
    rng = np.random.default_rng(0)
    x = rng.normal(2.0, 3.0, (500, 6)).astype(np.float32)
    y = (x @ rng.normal(size=(6, 3)) + 5.0).astype(np.float32)
    lesson = toy_lesson(x, y)
    (mean, spread), (centre, scale) = lesson.input_scaling(), lesson.output_scaling()
    fit = lesson.linear_fit()
    assert fit.shape == (6, 4) and not fit[:, 0].any()  # nothing is known of a logit
    np.testing.assert_allclose((x - mean) / spread @ fit[:, 1:] * scale + centre, y, atol=0.05)


def test_a_constant_feature_or_answer_divides_nothing_by_zero() -> None:
    x, y = np.ones((20, 3), np.float32), np.full((20, 2), 7.0, np.float32)
    lesson = toy_lesson(x, y)
    assert (lesson.input_scaling()[1] == 1.0).all() and (lesson.output_scaling()[1] > 0).all()
    assert np.isfinite(lesson.linear_fit()).all()


def test_the_lessons_of_each_kind(toy_labels) -> None:
    labels = toy_labels(400, categories=(0, 5))
    data = learning_set(labels)
    (one,) = lessons(data, TrainingOptions())
    assert one.x.shape == (len(data.rows(TRAIN)), data.relative.shape[1])
    row = np.flatnonzero(one.feasible)[0]
    there = data.rows(TRAIN)[row]
    np.testing.assert_allclose(np.exp(one.y[row, 0]) - COST_OFFSET, data.cost[there], rtol=1e-4)
    assert one.worth is not None
    assert one.worth[row] == pytest.approx(1.0 / (1.0 + data.cost[there] / TrainingOptions().dear))
    np.testing.assert_allclose(one.y[row, 1:4] + data.representatives.feet_after[there], data.com[there], atol=1e-5)
    names = [lesson.name for lesson in lessons(data, TrainingOptions(members=3))]
    assert names == ["member0", "member1", "member2"]
    palms = lessons(learning_set(toy_labels(400)), TrainingOptions(kind="palms", members=2))
    assert [lesson.name for lesson in palms] == [f"palms{n}_member{k}" for n in (0, 1, 2) for k in (0, 1)]
    assert sum(len(lesson.x) for lesson in palms[::2]) == len(learning_set(toy_labels(400)).rows(TRAIN))
    held = palms[2].x[
        :, [22, 33]
    ]  # left palm, right palm, of transitions that begin with one: brought to the left side
    assert (held == [1.0, 0.0]).all()
    documented = lessons(learning_set(labels, frame="heading"), TrainingOptions(kind="documented"))
    assert [d.name for d in documented] == ["classifier0", "regressor0", "classifier5", "regressor5"]
    assert documented[1].feasible.all() and not documented[0].feasible.all()
    assert documented[0].num_outputs == 1 and documented[1].num_outputs == 7


def test_a_lesson_is_known_by_its_data_and_options() -> None:
    rng = np.random.default_rng(1)
    lesson = toy_lesson(rng.normal(size=(9, 2)).astype(np.float32), rng.normal(size=(9, 2)).astype(np.float32))
    other = lesson.x.copy()
    other[3, 1] += 1e-6
    options = TrainingOptions()
    prints = {
        lesson.fingerprint(options),
        replace(lesson, x=other).fingerprint(options),
        replace(lesson, name="another").fingerprint(options),
        lesson.fingerprint(replace(options, epochs=7)),
    }
    assert len(prints) == 4 and lesson.fingerprint(TrainingOptions()) in prints


@pytest.mark.parametrize("wrong", [{"epochs": 0}, {"recall": 0.0}, {"rate": 0.0}, {"seed": -1}, {"members": 0}])
def test_settings_that_make_no_sense_are_refused(wrong) -> None:
    with pytest.raises(InputError, match="training: "):
        TrainingOptions(**wrong)


@pytest.mark.train
def test_beyond_a_bound_on_which_the_truth_lies_is_right() -> None:
    """Censored regression: the loss of a prediction beyond the bound is that of the bound itself, and only there."""
    torch = pytest.importorskip("torch")
    from learning.training.teacher import _Loss

    x = np.random.default_rng(2).normal(size=(6, 2)).astype(np.float32)
    y = np.array([[-0.12], [0.12], [0.0], [0.05], [-0.05], [0.02]], np.float32)
    lesson = toy_lesson(x, y)
    loss = _Loss(lesson, TrainingOptions())
    feasible, weight, scaled = loss.answers(lesson.feasible, lesson.y, lesson.worth)

    def of(shift: list[float]) -> float:
        out = torch.cat([torch.full((6, 1), 50.0), scaled + torch.tensor(shift)[:, None]], dim=1)
        return float(loss(out, feasible, weight, scaled))

    exact = of([0.0] * 6)
    assert exact == pytest.approx(0.0, abs=1e-6)
    assert of([-1.0, 1.0, 0, 0, 0, 0]) == pytest.approx(exact)
    for shift in ([1.0, 0, 0, 0, 0, 0], [0, -1.0, 0, 0, 0, 0], [0, 0, 1.0, 0, 0, 0], [0, 0, 0, -1.0, 0, 0]):
        assert of(shift) > 0.05
