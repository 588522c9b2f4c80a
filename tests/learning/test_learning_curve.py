"""A learning curve: nested shares of the training scenes, the same test scenes, and the power law that was put in."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from learning.labelled_transitions import TEST, TRAIN, VALIDATION, split_by_scene
from learning.training.options import TrainingOptions
from scenes.input_error import InputError
from scenes.robots.robot import load_robot

pytestmark = pytest.mark.train
pytest.importorskip("torch")
TINY = TrainingOptions(kind="shared", width=16, depth=1, epochs=2, batch=64)


@settings(max_examples=30, deadline=None)
@given(st.floats(1e-3, 10.0), st.floats(-0.2, 0.8))
def test_the_power_law_that_was_put_in_is_found(scale: float, exponent: float) -> None:
    from learning.training.learning_curve import fit_power_law

    rows = np.array([1000.0, 2000.0, 4000.0, 8000.0])
    law = fit_power_law(rows, scale * rows**-exponent)
    assert law.exponent == pytest.approx(exponent, abs=1e-9)
    assert law.at(16000.0) == pytest.approx(scale * 16000.0**-exponent)


def test_no_law_is_made_of_less_than_two_errors() -> None:
    from learning.training.learning_curve import fit_power_law

    rows = np.array([10.0, 20.0, 40.0])
    for error in (np.array([np.nan, 0.0, 0.1]), np.zeros(3), np.full(3, np.nan)):
        assert np.isnan(fit_power_law(rows, error).exponent)
    assert np.isnan(fit_power_law(np.full(3, 10.0), np.ones(3)).exponent)


def test_shares_are_nested_and_leave_the_scenes_that_measure_alone() -> None:
    from learning.training.learning_curve import share_of_scenes

    scene = np.repeat(np.arange(2000), 3)
    part = split_by_scene(scene, 4)
    smaller = np.zeros(len(scene), bool)
    for share in (0.1, 0.25, 0.5, 1.0):
        chosen = share_of_scenes(scene, share, 4)
        assert chosen[part != TRAIN].all() and (chosen | ~smaller).all()
        assert chosen[part == TRAIN].mean() == pytest.approx(share, abs=0.05)
        assert (chosen.reshape(-1, 3).all(axis=1) | ~chosen.reshape(-1, 3).any(axis=1)).all()  # scenes stay whole
        smaller = chosen
    grown = share_of_scenes(np.arange(4000), 0.25, 4)
    np.testing.assert_array_equal(grown[:2000], share_of_scenes(np.arange(2000), 0.25, 4))


def test_every_share_is_measured_on_the_same_scenes_after_as_many_steps(toy_labels, tmp_path) -> None:
    from learning.training.learning_curve import learning_curve

    labels, told = toy_labels(1500, categories=(0, 4)), []
    curve = learning_curve(
        labels, load_robot("escher"), tmp_path, TINY, lambda share, p: told.append((share, p.epoch)), shares=(1.0, 0.25)
    )
    assert curve.shares == (0.25, 1.0) and curve.scenes[0] < curve.scenes[1]
    assert [e for s, e in told if s == 0.25] == list(range(1, 9)) and [e for s, e in told if s == 1.0] == [1, 2]
    rows, errors = curve.errors()
    part = split_by_scene(labels.scene, TINY.seed)
    assert rows[0] < 0.5 * rows[1] and rows[1] == (part == TRAIN).sum() and errors.shape == (2, 4)
    assert [report.rows[-1].test for report in curve.reports] == [(part == TEST).sum()] * 2
    text, facts = curve.text(), json.loads(json.dumps(curve.facts(), allow_nan=False))
    assert "feet only: move a foot" in text and text.count("\n") > 6
    assert facts["all"]["rows"] == rows.astype(int).tolist()
    assert {path.name for path in tmp_path.iterdir()} == {"share_0.25", "share_1"}
    again = learning_curve(
        labels, load_robot("escher"), tmp_path, TINY, lambda share, p: told.append(None), (0.25, 1.0)
    )
    np.testing.assert_array_equal(again.errors()[1], errors)
    assert None not in told  # nothing was left to do


def test_the_command_writes_table_data_and_picture(toy_labels, tmp_path, capsys, monkeypatch) -> None:
    import learning.labelled_transitions
    from drakeplan.cli import main

    monkeypatch.setattr(learning.labelled_transitions, "read_labels", lambda folder, robot: toy_labels(1500))
    words = ["train", "dynamics", "--data", "x", "--out", str(tmp_path), "--learning-curve", "--epochs", "1"]
    words += ["--kind", "shared", "--width", "8", "--depth", "1", "--members", "1"]
    assert main(words) == 0
    said = capsys.readouterr()
    assert "Fitted error = a rows^-b" in said.out and "epoch 8 of 8" in said.err
    facts = json.loads((tmp_path / "learning_curve.json").read_text())
    assert facts["shares"] == [0.125, 0.25, 0.5, 1.0]
    assert (tmp_path / "learning_curve.png").stat().st_size > 10_000
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == facts


def test_a_share_that_is_none_and_a_share_without_scenes_are_refused(toy_labels, tmp_path) -> None:
    from learning.training.learning_curve import learning_curve

    labels = toy_labels(200)
    for shares in ((), (0.0,), (0.5, 1.5)):
        with pytest.raises(InputError, match=r"shares must lie in \(0, 1\]"):
            learning_curve(labels, load_robot("escher"), tmp_path, TINY, lambda share, p: None, shares)
    few = replace(labels, scene=labels.scene % 40)
    assert (split_by_scene(few.scene, 0) == VALIDATION).any()
    with pytest.raises(InputError, match="too few scenes, none is left to train on"):
        learning_curve(few, load_robot("escher"), tmp_path, TINY, lambda share, p: None, (0.001,))
