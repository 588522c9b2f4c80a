"""`drakeplan export`: what it says, its exit status, its JSON object."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest

from drakeplan.cli import main
from drakeplan.cli.export import FormatName
from drakeplan.export import FORMATS
from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import write_plan


@pytest.fixture
def folder(stepping_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a complete plan and one of contacts only."""
    write_plan(stepping_plan, tmp_path / "plan.h5")
    write_plan(replace(stepping_plan, phases=None, centroidal=None, motion=None), tmp_path / "contacts.h5")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def fails(folder: Path, capsys: pytest.CaptureFixture[str]) -> Callable[[str], str]:
    """Runs a command that is bad input; gives its one line, after which nothing new lies in the folder."""

    def run(words: str) -> str:
        before = sorted(folder.rglob("*"))
        assert main(["export", *words.split()]) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert len(said.err.splitlines()) == 1
        assert sorted(folder.rglob("*")) == before
        return said.err

    return run


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("", "PLAN.h5 is missing"),
        ("plan.h5", "--to: a format is missing, expected one of csv, npz"),
        ("plan.h5 --to csv", "--out: a file is missing"),
        ("plan.h5 --to cvs --out x", "--to: unknown 'cvs': did you mean csv"),
        ("plan.h5 --to csv --rate 50 --out x", "only --to tracking has a rate"),
        ("plan.h5 --to tracking --rate 0 --out x", "rate: expected 1 to 1000"),
        ("plan.h5 --to tracking --rate fast --out x", "--rate: expected a whole number"),
        ("plan.h5 --to csv --out plan.h5", "plan.h5 is the plan itself"),
        ("plan.h5 --to csv --out no/such/x", "there is no folder no/such"),
        ("nothing.h5 --to csv --out x", "nothing.h5: no such plan file"),
        ("plan.h5 --to csv --robot nobody --out x", "unknown robot 'nobody'"),
        ("plan.h5 --to mujoco --package a=/no/such --out x", "there is no folder /no/such"),
        ("contacts.h5 --to csv --out x", "contacts.h5: a plan of contacts only: --to contacts exports it"),
        ("contacts.h5 --to crocoddyl --out x", "contacts.h5: a plan of contacts only"),
    ],
)
def test_a_mistake_gets_one_line_and_exit_2(words: str, named: str, fails: Callable[[str], str]) -> None:
    assert named in fails(words)


@pytest.mark.parametrize("package", ["mcap", "foxglove_schemas_protobuf"])
def test_a_missing_package_gets_exit_2_and_what_to_install(
    package: str, fails: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    assert "pip install 'drakeplan[export]'" in fails("plan.h5 --to mcap --out x")


def test_it_says_which_files_it_wrote(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "plan.h5", "--to", "crocoddyl", "--out", "solve it.py"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[:2] == ["solve it.py", "solve it_data/ (2 files)"]
    assert "  run             python 'solve it.py'" in said


def test_json_lists_files_and_facts(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "plan.h5", "--to", "tracking", "--rate", "50", "--out", "motion.csv", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["to"] == "tracking"
    assert report["files"] == ["motion.csv", "motion.csv.json"]
    assert report["facts"] == {"format": "tracking", "rows": 491, "rate": 50, "joints": 27}
    assert all((folder / name).is_file() for name in report["files"])


def test_contacts_of_both_kinds_of_plan(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for plan, phases in (("plan.h5", 9), ("contacts.h5", 5)):
        assert main(["export", plan, "--to", "contacts", "--out", "c.json", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["facts"]["phases"] == phases
        assert len(json.loads((folder / "c.json").read_text())["contact_phases"]) == phases


def test_the_option_offers_every_format() -> None:
    assert get_args(FormatName) == tuple(FORMATS)


def test_help_names_every_format(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"\n  {name} " in text for name in FORMATS)
    assert "examples:" in text
