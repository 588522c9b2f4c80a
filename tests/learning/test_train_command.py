"""`drakeplan train dynamics`: a table and weights from labels, one line for a mistake."""

from __future__ import annotations

import json

import pytest

import learning.labelled_transitions
from drakeplan.cli import main
from learning.surrogate import load_surrogate

WORDS = ["train", "dynamics", "--data", "labels", "--epochs", "2", "--width", "16", "--depth", "1"]


@pytest.fixture
def toy_data(toy_labels, monkeypatch) -> None:
    monkeypatch.setattr(learning.labelled_transitions, "read_labels", lambda folder, robot: toy_labels(1500))


@pytest.mark.train
@pytest.mark.parametrize("kind", ["palms", "shared", "documented"])
def test_training_prints_the_table_and_leaves_weights_curves_and_report(kind, toy_data, tmp_path, capsys) -> None:
    out = tmp_path / "weights"
    assert main([*WORDS, "--out", str(out), "--kind", kind]) == 0
    said = capsys.readouterr()
    assert "feet only: move a foot" in said.out and "Lin et al. 2019" in said.out and "wrote" in said.out
    assert "epoch 2 of 2" in said.err
    assert {"dynamics.safetensors", "dynamics.json", "curves.csv", "curves.png", "report.json"} <= {
        path.name for path in out.iterdir()
    }
    assert load_surrogate("escher", out).card["kind"] == kind
    assert main([*WORDS, "--out", str(out), "--kind", kind, "--json"]) == 0  # nothing is left to do
    facts = json.loads(capsys.readouterr().out)
    assert facts["kind"] == kind and len(facts["categories"]) == 11 and facts["weights"].endswith(".safetensors")


@pytest.mark.train
def test_a_folder_that_cannot_be_written_is_named(toy_data, tmp_path, capsys) -> None:
    (tmp_path / "file").write_text("")
    assert main([*WORDS, "--out", str(tmp_path / "file" / "weights")]) == 2
    assert "--out" in capsys.readouterr().err


def test_without_torch_it_says_how_to_get_it(toy_data, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("drakeplan.cli.train.find_spec", lambda name: None)
    assert main([*WORDS, "--out", str(tmp_path)]) == 2
    assert "pip install 'drakeplan[train]'" in capsys.readouterr().err


def test_wrong_settings_and_missing_data_get_one_line(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("drakeplan.cli.train.find_spec", lambda name: object())
    for words, named in (
        (["--data", str(tmp_path), "--out", "x", "--epochs", "0"], "epochs must be at least 1"),
        (["--data", str(tmp_path / "nowhere"), "--out", "x"], "nowhere"),
        (["--data", str(tmp_path), "--out", "x", "--robot", "nobody"], "unknown robot"),
    ):
        assert main(["train", "dynamics", *words]) == 2
        said = capsys.readouterr().err
        assert named in said and len(said.splitlines()) == 1
