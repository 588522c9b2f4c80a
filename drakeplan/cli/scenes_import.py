"""`drakeplan scenes import`: own terrain to a scene file, with a report and a picture."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from drakeplan.cli.scene_facts import print_facts, scene_facts
from scenes.input_error import InputError

if TYPE_CHECKING:
    from scenes.imports.built import ImportOptions

LARGE = 5e6  # [bytes] a file that takes more than a second or two


def import_file(file: str, *, out: str, picture: str | None, options: ImportOptions, as_json: bool) -> int:
    """Imports terrain, writes the scene file and what lies beside it, and says what was done; the exit status.

    Args:
        file: of the terrain.
        out: of the scene file.
        picture: PNG file of the scene from above, None for none.
        options: how to understand the terrain.
        as_json: whether the report is one JSON object.

    Raises:
        InputError: the file cannot be used, or a result cannot be written.
    """
    from scenes.files.whole_file import require_writable
    from scenes.imports.import_terrain import import_terrain, write_terrain

    if not out.lower().endswith((".yaml", ".yml")):
        raise InputError(f"--out: expected a scene file that ends in .yaml, got {out!r}")
    for place in (out, picture):
        if place is not None:
            require_writable(place)
    if options.robot is not None:
        from scenes.robots.robot import load_robot

        load_robot(options.robot)
    source = Path(file)
    if source.is_file() and source.stat().st_size > LARGE:
        print(f"reading {file}, {source.stat().st_size / 1e6:.0f} MB", file=sys.stderr, flush=True)
    began = time.perf_counter()
    imported = import_terrain(source, out, options)
    seconds = time.perf_counter() - began
    written = write_terrain(imported, out)
    if picture is not None:
        from drakeplan.playback.plan_view import write_plan_view

        write_plan_view(imported.scene, picture)
        written.append(Path(picture))
    facts = scene_facts(imported.scene)
    if as_json:
        from drakeplan.cli.output import print_json

        report = imported.report.facts() | {"seconds": round(seconds, 3), "files": [str(f) for f in written]}
        print_json({"status": "imported", "scene": out, **report, "terrain": facts})
        return 0
    for word, said in imported.report.lines():
        print(f"{word:<12} {said}")
    print_facts(facts, ())
    for place in written:
        print(f"written      {place}")
    return 0
