"""What a benchmark returns, and where it is kept: SQLite for every run, docs/benchmarks.md for the latest table."""

from __future__ import annotations

import json
import os
import platform
import re
import sqlite3
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from scenes.files.whole_file import write_whole
from scenes.input_error import InputError

DEFAULT_SEEDS = 50
PACKAGES = ("drakeplan", "drake", "numpy", "numba", "scipy", "piqp", "hpp-centroidal-dynamics", "hpp-environments")


@dataclass(frozen=True)
class BenchOptions:
    """What all benchmarks share.

    Attributes:
        seeds: how many seeds, from 0.
        robot: name.
        tell: called with one line of progress.
        case: file with a published case, for the benchmarks that read one.
    """

    seeds: int = DEFAULT_SEEDS
    robot: str = "escher"
    tell: Callable[[str], None] = field(default=lambda line: None)
    case: Path | None = None


@dataclass(frozen=True)
class BenchTable:
    """One table of results.

    Attributes:
        name: of the benchmark.
        title: one line.
        columns: headings.
        rows: cells, numbers or text.
        notes: lines below the table.
        bench: the command that makes it, "" where that has its name.
        most_seeds: how many seeds it uses at most, None without a limit, 0 where nothing in it is drawn at random.
    """

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]
    notes: tuple[str, ...] = ()
    bench: str = ""
    most_seeds: int | None = field(kw_only=True)

    def used_seeds(self, seeds: int) -> str:
        """How many seeds the table is made of where `seeds` were asked for, and how many it has by default if that is more."""
        if self.most_seeds == 0:
            return "no seeds"
        used, usual = (n if self.most_seeds is None else min(n, self.most_seeds) for n in (seeds, DEFAULT_SEEDS))
        return f"{used} seeds" if used >= usual else f"{used} of {usual} seeds"

    def markdown(self, seeds: int) -> str:
        """The table as Markdown, with seeds, machine and versions.

        Args:
            seeds: how many were asked for.
        """
        head = f"{_line(self.columns)}|{'---|' * len(self.columns)}\n"
        body = "".join(_line([_cell(c) for c in row]) for row in self.rows)
        notes = "".join(f"- {note}\n" for note in self.notes)
        where = ", ".join(f"{k} {v}" for k, v in machine().items())
        made = f"`drakeplan bench {self.bench or self.name}`, {self.used_seeds(seeds)}: {where}"
        return f"### {self.title}\n\n{made}\n\n{head}{body}\n{notes}"

    def text(self, seeds: int) -> str:
        """The table for a terminal, with its seeds.

        Args:
            seeds: how many were asked for.
        """
        cells = [list(self.columns)] + [[_cell(c) for c in row] for row in self.rows]
        widths = [max(len(row[k]) for row in cells) for k in range(len(self.columns))]
        lines = ["  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in cells]
        return "\n".join([f"{self.title} ({self.used_seeds(seeds)})", *lines, *self.notes])


def spread(values: Sequence[float]) -> dict[str, float]:
    """Median, 5th and 95th percentile, least and greatest of the finite values."""
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    if not len(finite):
        return dict.fromkeys(("median", "p5", "p95", "min", "max"), float("nan"))
    p5, median, p95 = np.percentile(finite, [5, 50, 95])
    return {"median": median, "p5": p5, "p95": p95, "min": finite.min(), "max": finite.max()}


def middle_and_high(values: Sequence[float]) -> tuple[float, float]:
    """Median and 95th percentile, NaN without any."""
    return (float(np.median(values)), float(np.percentile(values, 95))) if values else (np.nan, np.nan)


def machine() -> dict[str, str]:
    """Processor, cores, Python and the versions of what matters."""
    info = {"date": time.strftime("%Y-%m-%d"), "cpu": _cpu(), "cores": str(os.cpu_count())}
    info["python"] = sys.version.split()[0]
    for package in PACKAGES:
        try:
            info[package] = version(package)
        except PackageNotFoundError:
            continue
    return info


def open_database(database: Path) -> sqlite3.Connection:
    """The SQLite file of all runs (WAL mode), made when missing; the caller closes it.

    Raises:
        InputError: it cannot be made, or is no such file.
    """
    with _named(database):
        database.parent.mkdir(parents=True, exist_ok=True)
        connection = sqlite3.connect(database)
        try:
            connection.execute("PRAGMA journal_mode=WAL")
            connection.execute(
                "CREATE TABLE IF NOT EXISTS runs (id INTEGER PRIMARY KEY, at TEXT, bench TEXT, seeds INTEGER, robot TEXT,"
                " machine TEXT, columns TEXT, rows TEXT, notes TEXT)"
            )
        except BaseException:
            connection.close()
            raise
        return connection


@contextmanager
def _named(database: Path) -> Iterator[None]:
    """Inside, what goes wrong with the file is the user's to mend."""
    try:
        yield
    except (OSError, sqlite3.Error) as error:
        raise InputError(f"{database}: cannot be used as a database of runs ({error})") from error


def record(table: BenchTable, options: BenchOptions, database: Path) -> None:
    """Appends a run to the SQLite file, making it when missing.

    Args:
        table: of the run.
        options: seeds and robot.
        database: the SQLite file.

    Raises:
        InputError: the file cannot be written.
    """
    with _named(database), closing(open_database(database)) as connection, connection:
        connection.execute(
            "INSERT INTO runs (at, bench, seeds, robot, machine, columns, rows, notes) VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            (
                time.strftime("%Y-%m-%dT%H:%M:%S"),
                table.name,
                options.seeds,
                options.robot,
                json.dumps(machine()),
                json.dumps(table.columns),
                json.dumps(table.rows, default=str),
                json.dumps(table.notes),
            ),
        )


def write_markdown(table: BenchTable, seeds: int, page: Path) -> None:
    """Puts the table into the page in place of the one of the same name, or at its end.

    Args:
        table: what was measured.
        seeds: how many were asked for.
        page: Markdown file, made when missing.

    Raises:
        InputError: the page is not text, or cannot be written.
    """
    text = read_page(page)
    block = f"<!-- {table.name} -->\n{table.markdown(seeds)}<!-- end {table.name} -->\n"
    pattern = re.compile(rf"<!-- {table.name} -->\n.*?<!-- end {table.name} -->\n", re.DOTALL)
    text = pattern.sub(lambda _: block, text) if pattern.search(text) else f"{text.rstrip()}\n\n{block}"
    write_whole(page, text.encode())


def read_page(page: Path) -> str:
    """What the page says; the head of a new one where there is none.

    Raises:
        InputError: it is not text.
    """
    try:
        return page.read_text(encoding="utf-8") if page.exists() else "# Benchmarks\n\nMade by `drakeplan bench`.\n\n"
    except (OSError, UnicodeDecodeError):
        raise InputError(f"{page}: expected a Markdown page") from None


def _line(cells: Sequence[str]) -> str:
    """A row of Markdown; a bar inside a cell would end it."""
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |\n"


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "-" if not np.isfinite(value) else f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return str(value)


def _cpu() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
