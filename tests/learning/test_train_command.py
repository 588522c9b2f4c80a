"""`drakeplan train dynamics`: a table and weights from labels, one line for a mistake."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import learning.labelled_transitions
from drakeplan.cli import main
from learning.shard_file import shard_name
from learning.surrogate import load_surrogate
from learning.transition_labels import VERSION

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


def shard_damaged(folder, tables) -> None:
    path = folder / shard_name(1)
    path.write_bytes(path.read_bytes()[:-40])


FAULTS = {
    "another version": ({"version": VERSION - 1}, None, f"campaign.json: expected campaign dynamics version {VERSION}"),
    "another robot": ({"robot": "jvrc1"}, None, "robot 'jvrc1', expected 'escher'"),
    "two campaigns": ({"fingerprints": "ab"}, None, "shard-000001.parquet: comes from another campaign"),
    "a shard cut off": ({}, shard_damaged, "shard-000001.parquet: expected a readable shard"),
    "no description": (
        {},
        lambda folder, _: (folder / "campaign.json").unlink(),
        "campaign.json: expected the description",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_labels_that_do_not_fit_get_one_line_with_file_and_expectation(
    fault, toy_labels, as_table, write_folder, tmp_path, capsys, monkeypatch
) -> None:
    facts, spoil, complaint = FAULTS[fault]
    tables = [as_table(toy_labels(5)), as_table(toy_labels(5, seed=1))]
    write_folder(tmp_path, tables, **facts)
    if spoil is not None:
        spoil(tmp_path, tables)
    refused(capsys, monkeypatch, tmp_path, complaint)


@pytest.mark.parametrize("column", ["cost", "iterations"])
def test_shards_of_mixed_columns_get_one_line(
    column, toy_labels, as_table, write_folder, tmp_path, capsys, monkeypatch
):
    tables = [as_table(toy_labels(5)), as_table(toy_labels(5, seed=1)).drop([column])]
    write_folder(tmp_path, tables)
    refused(capsys, monkeypatch, tmp_path, f"shard-000001.parquet: expected the columns of dynamics version {VERSION}")


def test_a_label_that_is_no_number_gets_one_line(toy_labels, as_table, write_folder, tmp_path, capsys, monkeypatch):
    labels = toy_labels(5)
    lost = replace(labels, batch=replace(labels.batch, com=labels.batch.com * np.nan))
    write_folder(tmp_path, [as_table(labels), as_table(lost)])
    refused(capsys, monkeypatch, tmp_path, "shard-000001.parquet: column com holds a number that is not finite")


def refused(capsys, monkeypatch, folder, complaint: str) -> None:
    monkeypatch.setattr("drakeplan.cli.train.find_spec", lambda name: object())
    assert main(["train", "dynamics", "--data", str(folder), "--out", str(folder / "weights")]) == 2
    said = capsys.readouterr().err
    assert complaint in said and str(folder) in said and len(said.splitlines()) == 1
    assert not (folder / "weights").exists()


@pytest.mark.train
@pytest.mark.parametrize("kind", ["palms", "shared", "documented"])
def test_labels_of_one_class_are_refused_where_there_is_nothing_to_learn(
    kind, toy_labels, as_table, write_folder, tmp_path, capsys
) -> None:
    pytest.importorskip("torch")
    labels = toy_labels(300)
    write_folder(tmp_path, [as_table(replace(labels, feasible=np.zeros(300, bool)))])
    words = ["train", "dynamics", "--data", str(tmp_path), "--out", str(tmp_path / "weights"), "--kind", kind]
    assert main([*words, "--epochs", "1", "--width", "8", "--depth", "1"]) == 2
    said = capsys.readouterr().err
    assert "no feasible transition" in said and len(said.splitlines()) == 1
