"""`drakeplan library` and what `drakeplan plan` does with a library."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from drakeplan.cli import main
from drakeplan.experience.library import Library
from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import write_plan


@pytest.fixture
def plan_file(strolling_plan: Plan, tmp_path: Path) -> Path:
    write_plan(strolling_plan, tmp_path / "plan.h5")
    return tmp_path / "plan.h5"


def said(capsys: pytest.CaptureFixture[str]) -> dict:
    return json.loads(capsys.readouterr().out)


def test_a_plan_is_added_once_and_listed(plan_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["library", "add", str(plan_file), str(plan_file), "--library", str(tmp_path / "plans"), "--json"]
    assert main(words) == 0
    first, second = said(capsys)["plans"]
    assert (first["added"], second["added"]) == (True, False)
    assert second["distance"] == pytest.approx(0.0, abs=1e-9)
    assert main(["library", "list", "--library", str(tmp_path / "plans"), "--json"]) == 0
    listed = said(capsys)["modes"]["all"]
    assert [entry["name"] for entry in listed["plans"]] == listed["representatives"] == [first["name"]]
    assert main(["library", "list", "--library", str(tmp_path / "plans")]) == 0
    assert "1 plans in   1 clusters" in capsys.readouterr().out


def test_a_plan_needs_no_terrain_file_to_be_added(plan_file: Path, tmp_path: Path) -> None:
    """The terrain that it was made on may be gone: nothing of it is stored."""
    assert main(["library", "add", str(plan_file), "--library", str(tmp_path / "plans")]) == 0
    with Library(tmp_path / "plans") as library:
        assert len(library) == 1


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("library", "is missing"),
        ("library buld", "did you mean build?"),
        ("library add --library plans", "expected one plan file or more"),
        ("library add plan.h5", "--library: expected the folder"),
        ("library build --library plans", "--count: expected 1 or more"),
        ("library build extra --library plans --count 2", "unexpected argument 'extra'"),
        ("library build --library plans --count 2 --friction 0", "--friction: expected more than 0"),
        ("library add no_such.h5 --library plans", "no_such.h5: no such plan file"),
        ("library list --library no_such", "no_such: no library there"),
        ("library match --library no_such", "expected one scene"),
        ("plan flat --library plans", "--library: goes with --planner adapt or parallel"),
        ("plan flat --planner adapt --library no_such", "no_such: no library there"),
        ("plan flat --planner adapt --dynamics exact", "needs --planner search or parallel"),
    ],
)
def test_a_mistake_gets_one_line_and_exit_2(
    words: str, named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    error = capsys.readouterr().err
    assert named in error
    assert len(error.splitlines()) == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_library_is_built_gone_on_with_and_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / "plans")
    assert main(["library", "build", "--library", folder, "--count", "2", "--seed", "1", "--json"]) == 0
    built = said(capsys)
    assert built["environments"] == 2
    assert built["plans"] == built["added"] == sum(built["modes"].values())
    assert main(["library", "build", "--library", folder, "--count", "2", "--seed", "1"]) == 2  # without --resume
    assert "--resume" in capsys.readouterr().err
    assert main(["library", "build", "--library", folder, "--count", "2", "--seed", "1", "--resume", "--json"]) == 0
    again = said(capsys)
    assert (again["added"], again["alike"]) == (0, built["plans"])
    assert main(["library", "match", "random_surfaces", "--seed", "1", "--library", folder, "--json"]) == 0
    assert isinstance(said(capsys)["plans"], list)
    with Library(folder) as library:
        assert library.facts["seed"] == 1


@pytest.mark.slow
def test_a_new_plan_joins_the_library_of_the_user(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / "plans")
    words = ["plan", "flat", "--planner", "parallel", "--library", folder, "--deadline", "60", "--json"]
    assert main(words) == 0
    captured = capsys.readouterr()
    report = json.loads(captured.out)
    assert report["verified"]["holds"]
    assert report["planner"] == "search"
    assert report["library"]["added"]
    assert "a new library is begun" in captured.err
    assert main([*words, "--seed", "1"]) == 0
    report = said(capsys)
    with Library(folder) as library:
        assert len(library) == 1 + report["library"]["added"]
