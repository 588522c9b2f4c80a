"""Weights that are damaged stop a plan with one line that names the file and what was expected of it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load

import learning.surrogate
from drakeplan.cli import main
from learning.weights import PRETRAINED, write_weights

WEIGHTS, CARD = "dynamics.safetensors", "dynamics.json"


def truncated(folder: Path) -> None:
    path = folder / WEIGHTS
    path.write_bytes(path.read_bytes()[:-100])


def foreign(folder: Path) -> None:
    (folder / CARD).write_text('{"model": "another"}')


def missing(folder: Path) -> None:
    (folder / WEIGHTS).unlink()


def with_nan(folder: Path) -> None:
    """Hash and shapes are right, one number is none."""
    card, tensors = json.loads((folder / CARD).read_text()), load((folder / WEIGHTS).read_bytes())
    key = min(key for key in tensors if key.endswith(".weight"))
    spoilt = tensors[key].copy()
    spoilt.flat[0] = np.nan
    facts = {k: v for k, v in card.items() if k not in ("sha256", "shapes")}
    write_weights(folder, "dynamics", tensors | {key: spoilt}, facts)


def of_another_robot(folder: Path) -> None:
    card = json.loads((folder / CARD).read_text())
    (folder / CARD).write_text(json.dumps(card | {"robot": "nobody"}))


@pytest.mark.parametrize(
    ("spoil", "named", "complaint"),
    [
        (truncated, WEIGHTS, "SHA-256 differs from its card's"),
        (foreign, CARD, "expected a card of format"),
        (missing, WEIGHTS, "missing, though its card"),
        (with_nan, WEIGHTS, ".weight must hold finite float32 numbers"),
    ],
)
def test_damaged_weights_stop_a_plan_with_one_line(
    spoil: Callable[[Path], None], named: str, complaint: str, tmp_path, monkeypatch, capsys
) -> None:
    shutil.copytree(PRETRAINED / "escher", tmp_path / "escher")
    spoil(tmp_path / "escher")
    monkeypatch.setattr(learning.surrogate, "PRETRAINED", tmp_path)
    words = ["plan", "flat", "--dynamics", "learned", "--out", str(tmp_path / "plan.h5")]
    assert main(words) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert named in said[-1] and complaint in said[-1] and sum("drakeplan" in line for line in said) == 1
    assert not (tmp_path / "plan.h5").exists()


def test_weights_of_another_robot_are_left_out_with_a_note(tmp_path, monkeypatch, capsys) -> None:
    """An own variant of a packaged robot, its name kept, is planned with the exact program."""
    shutil.copytree(PRETRAINED / "escher", tmp_path / "escher")
    of_another_robot(tmp_path / "escher")
    monkeypatch.setattr(learning.surrogate, "PRETRAINED", tmp_path)
    words = ["plan", "flat", "--goal", "0.4", "0", "--dynamics", "learned", "--out", str(tmp_path / "plan.h5")]
    assert main(words) == 0
    said = capsys.readouterr().err
    assert "another robot named 'escher'" in said and "exact dynamics are used instead" in said
    assert (tmp_path / "plan.h5").exists()
