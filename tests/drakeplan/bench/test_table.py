"""Where results of benchmarks are kept: nothing that was measured is lost to a run that measured nothing or cannot write."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from drakeplan.bench import momentumopt
from drakeplan.bench.table import BenchOptions, BenchTable, record, write_markdown
from drakeplan.cli import main

MEASURED = BenchTable("momentumopt", "Measured", ("variant", "objective"), (("a|b", 1.0),))


def test_a_skipped_benchmark_leaves_page_and_database_as_they_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DRAKEPLAN_CASES", raising=False)
    page, database = tmp_path / "page.md", tmp_path / "runs.sqlite"
    write_markdown(MEASURED, page)
    record(MEASURED, BenchOptions(), database)
    before = page.read_bytes()
    assert main(["bench", "momentumopt", "--page", str(page), "--database", str(database)]) == 0
    assert page.read_bytes() == before
    with sqlite3.connect(database) as connection:
        assert connection.execute("SELECT count(*) FROM runs").fetchone() == (1,)


def test_a_table_replaces_that_of_its_name_and_no_other(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    other = BenchTable("other", "Other", ("n",), ((1,),))
    again = BenchTable("momentumopt", "Measured again", ("variant", "objective"), (("c", 2.0),))
    for table in (MEASURED, other, again):
        write_markdown(table, page)
    text = page.read_text(encoding="utf-8")
    assert text.count("<!-- momentumopt -->") == text.count("<!-- end momentumopt -->") == 1
    assert "Measured again" in text and r"a\|b" not in text
    assert "### Other" in text


@pytest.mark.parametrize("option", ["--page", "--database"])
def test_what_cannot_take_the_results_is_refused_before_anything_is_measured(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(momentumopt, "run", lambda options: pytest.fail("measuring began"))
    foreign = tmp_path / "foreign.h5"
    foreign.write_bytes(b"\x89HDF" * 200)
    outputs = {"--page": str(tmp_path / "page.md"), "--database": str(tmp_path / "runs.sqlite")}
    for taken in (foreign, tmp_path):
        words = [word for pair in (outputs | {option: str(taken)}).items() for word in pair]
        assert main(["bench", "momentumopt", *words]) == 2
        said = capsys.readouterr().err
        assert str(taken) in said and len(said.splitlines()) == 1
    assert foreign.read_bytes() == b"\x89HDF" * 200
