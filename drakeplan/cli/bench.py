"""`drakeplan bench`: runs benchmarks, records them and writes their tables."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated

import tyro

from drakeplan.bench import BENCHES
from scenes.input_error import InputError, unknown_name

_LIST = "\n".join(f"  {name:<8}  {what}" for name, what in BENCHES.items())
ABOUT = f"""Measures speed and compares with peers; without names, everything.

{_LIST}

examples:
  drakeplan bench first
  drakeplan bench first --seeds 10 --json
  drakeplan bench balance scale --page docs/benchmarks.md
"""


@dataclass(frozen=True)
class Arguments:
    """What `drakeplan bench` takes."""

    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Benchmarks to run; all of them when none is named."""
    seeds: int = 50
    """Seeds 0 to SEEDS - 1 where a benchmark draws scenes."""
    robot: str = "escher"
    """Robot by name."""
    database: Path = Path("out/bench.sqlite")
    """Every run is appended to this SQLite file."""
    page: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Also put the tables into this Markdown page."""
    json: bool = False
    """One JSON object on standard output."""


def run(arguments: Arguments) -> int:
    """Runs, records and prints; 0 when all ran."""
    from drakeplan.bench.table import BenchOptions, record, write_markdown

    if arguments.seeds < 1:
        raise InputError(f"--seeds: expected at least 1, got {arguments.seeds}")
    for name in arguments.names:
        if name not in BENCHES:
            raise unknown_name("benchmark", name, BENCHES)
    options = BenchOptions(arguments.seeds, arguments.robot, lambda line: print(line, file=sys.stderr, flush=True))
    tables = {}
    for name in arguments.names or BENCHES:
        table = import_module(f"drakeplan.bench.{name}").run(options)
        record(table, options, arguments.database)
        if arguments.page is not None:
            write_markdown(table, arguments.page)
        tables[name] = {"title": table.title, "columns": table.columns, "rows": table.rows, "notes": table.notes}
        if not arguments.json:
            print(table.text(), end="\n\n", flush=True)
    if arguments.json:
        print(json.dumps(tables, default=str))
    return 0
