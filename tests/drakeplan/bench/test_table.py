"""Where results of benchmarks are kept: nothing that was measured is lost to a run that measured nothing or cannot write."""

from __future__ import annotations

import re
import sqlite3
from pathlib import Path

import pytest

from drakeplan.bench import momentumopt
from drakeplan.bench.table import BenchOptions, BenchTable, record, write_markdown
from drakeplan.cli import main

MEASURED = BenchTable("momentumopt", "Measured", ("variant", "objective"), (("a|b", 1.0),), most_seeds=0)


def test_a_skipped_benchmark_leaves_page_and_database_as_they_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DRAKEPLAN_CASES", raising=False)
    page, database = tmp_path / "page.md", tmp_path / "runs.sqlite"
    write_markdown(MEASURED, 50, page)
    record(MEASURED, BenchOptions(), database)
    before = page.read_bytes()
    assert main(["bench", "momentumopt", "--page", str(page), "--database", str(database)]) == 0
    assert page.read_bytes() == before
    with sqlite3.connect(database) as connection:
        assert connection.execute("SELECT count(*) FROM runs").fetchone() == (1,)


def test_a_table_replaces_that_of_its_name_and_no_other(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    other = BenchTable("other", "Other", ("n",), ((1,),), most_seeds=10)
    again = BenchTable("momentumopt", "Measured again", ("variant", "objective"), (("c", 2.0),), most_seeds=0)
    for table in (MEASURED, other, again):
        write_markdown(table, 4, page)
    text = page.read_text(encoding="utf-8")
    assert text.count("<!-- momentumopt -->") == text.count("<!-- end momentumopt -->") == 1
    assert "Measured again" in text and r"a\|b" not in text
    assert "### Other" in text


@pytest.mark.parametrize(
    ("asked", "most", "said"),
    [(50, None, "50 seeds"), (60, None, "60 seeds"), (4, None, "4 of 50 seeds"), (50, 10, "10 seeds"),
     (4, 10, "4 of 10 seeds"), (4, 3, "3 seeds"), (50, 0, "no seeds")],
)  # fmt: skip
def test_a_table_says_how_many_seeds_it_has_and_how_many_it_lacks(asked: int, most: int | None, said: str) -> None:
    table = BenchTable("other", "Other", ("n",), ((1,),), most_seeds=most)
    assert f"`drakeplan bench other`, {said}: date " in table.markdown(asked)
    assert table.text(asked).splitlines()[0] == f"Other ({said})"


def test_every_table_of_the_documentation_says_how_many_seeds_it_has() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    heads = [line for line in page.splitlines() if line.startswith("`drakeplan bench ")]
    assert len(heads) == page.count("\n### ") > 20
    assert not [line for line in heads if not re.search(r"`, (no|\d+|\d+ of \d+) seeds: date ", line)]


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
