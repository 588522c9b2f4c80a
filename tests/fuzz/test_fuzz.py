"""Inputs that are nearly right are read or refused in one line; nothing else happens. `python tests/fuzz` runs longer."""

from __future__ import annotations

from pathlib import Path

import platformdirs
import pytest
from fuzz_campaign import campaign
from good_inputs import good_inputs
from judge import READ, REFUSED, answer

SEED = 20261129
FEW = {"scenes": 200, "meshes": 150, "robots": 100, "commands": 100}
MANY = {"scenes": 12_000, "meshes": 2000, "robots": 2000, "commands": 500}


def check(kind: str, first: int, count: int, folder: Path) -> None:
    summary = campaign(kind, SEED, first, count, folder)
    wrong = "\n".join(
        f"python tests/fuzz {kind} --seed {SEED} --only {index}\n{said}" for index, said in summary.faults.items()
    )
    assert not summary.faults, f"{summary.line()}\n{wrong}"
    assert sum(summary.verdicts.values()) == count
    # A fuzzer that makes only rubbish, or only good files, tests nothing.
    assert summary.verdicts[READ] >= 0.05 * count
    assert summary.verdicts[REFUSED] >= 0.2 * count


@pytest.mark.parametrize("kind", FEW)
def test_what_mutants_are_made_of_is_read(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda name: str(tmp_path / "cache" / name))
    for path in good_inputs(kind, tmp_path):
        outcome = answer(kind, path)
        assert outcome.verdict == READ, f"{path.parent.name}: {outcome.said}"


@pytest.mark.parametrize("kind", FEW)
def test_a_few_inputs_are_read_or_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    check(kind, 0, FEW[kind], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("kind", MANY)
def test_many_inputs_are_read_or_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    check(kind, FEW[kind], MANY[kind], tmp_path)
