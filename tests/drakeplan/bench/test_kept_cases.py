"""A benchmark that was stopped runs nothing twice."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from drakeplan.bench.kept_cases import RESUME, Case, KeptCases


def test_a_case_is_run_once_in_all_processes_that_keep_the_same_file(tmp_path: Path) -> None:
    ran: list[int] = []

    def case(seed: int) -> Case:
        ran.append(seed)
        return {"seed": seed, "time": 0.1 + seed, "nothing": float("nan")}

    first, second = KeptCases(tmp_path / "new" / "cases.jsonl"), None
    assert first({"seed": 1}, lambda: case(1)) is first({"seed": 1}, lambda: case(1))
    second = KeptCases(tmp_path / "new" / "cases.jsonl")
    again = second({"seed": 1}, lambda: case(1))
    assert (again["seed"], again["time"], ran) == (1, 1.1, [1])
    assert math.isnan(again["nothing"])  # type: ignore[arg-type]
    second({"seed": 2}, lambda: case(2))
    assert ran == [1, 2]


def test_the_order_of_a_key_does_not_matter_but_everything_in_it_does() -> None:
    kept = KeptCases(None)
    kept({"scene": "a", "seed": 1}, lambda: {"n": 1})
    assert kept({"seed": 1, "scene": "a"}, lambda: {"n": 2}) == {"n": 1}
    assert kept({"seed": 1, "scene": "a", "weights": "x"}, lambda: {"n": 3}) == {"n": 3}


@pytest.mark.parametrize("garbage", ['{"key": {"seed": 1}, "ca', "[1, 2]", '{"other": 1}', "\x00"])
def test_a_line_that_is_cut_off_or_foreign_is_run_again_and_spoils_no_other(tmp_path: Path, garbage: str) -> None:
    file = tmp_path / "cases.jsonl"
    KeptCases(file)({"seed": 0}, lambda: {"n": 0})
    with file.open("a") as out:
        out.write(garbage)
    KeptCases(file)({"seed": 1}, lambda: {"n": 1})
    kept = KeptCases(file)
    assert [kept({"seed": s}, lambda: {"n": 9})["n"] for s in range(3)] == [0, 1, 9]


def test_without_the_variable_nothing_is_written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(RESUME, raising=False)
    KeptCases.asked_for()({"seed": 1}, lambda: {"n": 1})
    assert not list(tmp_path.iterdir())
