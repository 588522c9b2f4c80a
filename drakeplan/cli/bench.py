"""`drakeplan bench`: measures, prints, and keeps what it measured."""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from drakeplan.bench import BENCHES
from scenes.input_error import InputError, unknown_name

if TYPE_CHECKING:
    from drakeplan.bench.table import BenchTable

NAMES = "\n".join(f"  {name:<11}  {about}" for name, about in BENCHES.items())
ABOUT = f"""Runs one benchmark or all of them.

Every run is appended to a SQLite file. If there is a folder docs, its benchmarks.md gets the new table, also a table of
fewer seeds: --page names another page.

benchmarks:
{NAMES}

examples:
  drakeplan bench first
  drakeplan bench scale --seeds 5
  drakeplan bench momentumopt --case momentumopt_demo01.json
  drakeplan bench --json"""

PAGE = Path("docs/benchmarks.md")


@dataclass(frozen=True)
class Arguments:
    """Arguments of `drakeplan bench`."""

    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")] = ""
    """name of the benchmark (default: all)"""
    seeds: int = 50
    """number of seeds, starting at 0; some benchmarks use fewer"""
    robot: Annotated[str, tyro.conf.arg(metavar="NAME")] = "escher"
    """robot name"""
    case: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None
    """a published case, for momentumopt (default: from the folder that DRAKEPLAN_CASES names)"""
    database: Annotated[str, tyro.conf.arg(metavar="FILE")] = "out/bench.sqlite"
    """SQLite file that stores every run"""
    page: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None
    """Markdown page that gets the table (default: docs/benchmarks.md where there is a folder docs)"""
    json: bool = False
    """one JSON object on standard output"""


def run(arguments: Arguments) -> int:
    """Runs what was asked for, one after the other."""
    if arguments.seeds < 1:
        raise InputError(f"--seeds: expected 1 or more, got {arguments.seeds}")
    if arguments.name and arguments.name not in BENCHES:
        raise unknown_name("benchmark", arguments.name, BENCHES)
    page = Path(arguments.page) if arguments.page is not None else PAGE if PAGE.parent.is_dir() else None
    if arguments.case is not None and not Path(arguments.case).is_file():
        raise InputError(f"--case: there is no file {arguments.case}")
    _check_outputs(page, Path(arguments.database))
    tables = []
    for name in [arguments.name] if arguments.name else BENCHES:
        for table in _run_one(name, arguments, page):
            tables.append(table)
            if not arguments.json:
                print(table.text(arguments.seeds), end="\n\n", flush=True)
    if arguments.json:
        from drakeplan.bench.table import machine
        from drakeplan.cli.output import print_json

        facts = [asdict(table) for table in tables]
        print_json({"machine": machine(), "seeds": arguments.seeds, "robot": arguments.robot, "tables": facts})
    return 0


def _check_outputs(page: Path | None, database: Path) -> None:
    """Refuses, before hours of measuring, what the results cannot be written to."""
    from drakeplan.bench.table import open_database, read_page
    from scenes.files.whole_file import require_writable

    if page is not None:
        require_writable(page)
        read_page(page)
    open_database(database).close()


def _run_one(name: str, arguments: Arguments, page: Path | None) -> tuple[BenchTable, ...]:
    from drakeplan.bench.table import BenchOptions, record, write_markdown

    def tell(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    case = Path(arguments.case) if arguments.case is not None else None
    options = BenchOptions(arguments.seeds, arguments.robot, tell, case)
    result = import_module(f"drakeplan.bench.{name}").run(options)
    tables = result if isinstance(result, tuple) else (result,)
    for table in tables:
        if not table.rows:  # skipped: no reason to forget what was measured before
            continue
        record(table, options, Path(arguments.database))
        if page is not None:
            write_markdown(table, arguments.seeds, page)
    return tables
