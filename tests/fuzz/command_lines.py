"""Command lines that are nearly right, and the answers of `drakeplan.cli.main` to them, with stand-ins for what takes long."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import os
from functools import lru_cache
from pathlib import Path
from random import Random

import numpy as np
from mesh_mutants import MESHES, stl_bytes
from mutation import TEXTS, changed_name, mutate_bytes, to_document
from robot_mutants import write_robot
from scene_mutants import good_scenes

from drakeplan.cli import COMMANDS, main
from drakeplan.cli.arguments import Numbers, _words
from scenes.input_error import InputError

SECONDS = 10.0
NAMES_FILE = False  # what is wrong may be a word alone
INTEGERS = (
    "0",
    "1",
    "3",
    "-1",
    "1.5",
    "1e3",
    "x",
    "",
    "007",
    "+4",
    "99999999999999999999",
    "9" * 5000,
    "0x10",
    "1_0",
    "\u0663",
    "nan",
)
FLOATS = (
    "0",
    "1",
    "0.3",
    "-1",
    "1e-300",
    "1e300",
    "-0.0",
    "nan",
    "inf",
    "x",
    "",
    "1,5",
    "1_0",
    "30",
    "\u0663",
    "9" * 400,
)
NAMES = (
    "flat",
    "stairs",
    "flatt",
    "rubble_corridor",
    "hpp/darpa",
    "hpp/",
    "hpp/../x",
    "list",
    "show",
    "export",
    "dynamics",
    "first",
    "escher",
    "nobody",
)
FILES = (
    "scene.yaml", "mesh.stl", "robot.yaml", "walker.urdf", "wrong.yaml", "empty.yaml", "wrong.h5", "empty.h5", "cut.h5",
    "wrong.stl", "nothing.yaml",
    "nothing.h5", "folder", "folder/", ".", "", "/", "/dev/null", "/dev/full", "/dev/zero", "/proc/self/mem", "/proc/x.h5",
    "no/such/x.h5",
    "out.h5", "out.html", "out.yaml", "scene.yaml/x.h5", "n" * 300, "n" * 5000 + ".yaml", "a\nb.yaml", "a\x00b.yaml",
    "~/x.yaml", "loop.yaml", "dangling.h5",
)  # fmt: skip
USUAL = {
    "SCENE": ("flat", "stairs", "scene.yaml", "mesh.stl", "wrong.yaml", "wrong.stl", "hpp/darpa"),
    "PLAN.h5": ("wrong.h5", "cut.h5", "empty.h5", "nothing.h5", "scene.yaml", "folder"),
    "FILE": ("out.yaml", "folder/out.yaml", "no/such/x.yaml"),
    "NAME": ("first", "scale"),
    "CAMPAIGN": ("dynamics",),
    "SURROGATE": ("dynamics",),
}
RIGHT = {
    "--robot": ("escher", "robot.yaml"),
    "--out": ("out.h5", "folder"),
    "--html": ("out.html",),
    "--package": ("n=folder",),
    "--planner": ("search",),
}
STATUSES = {0, 1, 2, 3}


def make(rng: Random, folder: Path) -> Path:
    """Writes the files of a folder and the words of one command line, and returns the file with the words."""
    scene = to_document(good_scenes()["stones"]).encode()
    (folder / "scene.yaml").write_bytes(scene)
    (folder / "wrong.yaml").write_bytes(mutate_bytes(rng, scene))
    (folder / "mesh.stl").write_bytes(stl_bytes(MESHES["sheet"]))
    (folder / "wrong.stl").write_bytes(mutate_bytes(rng, stl_bytes(MESHES["sheet"])))
    (folder / "wrong.h5").write_bytes(rng.randbytes(2000))
    (folder / "cut.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + rng.randbytes(500))
    for name in ("empty.yaml", "empty.h5"):
        (folder / name).touch()
    (folder / "folder").mkdir()
    (folder / "loop.yaml").symlink_to("loop.yaml")
    (folder / "dangling.h5").symlink_to("no/where.h5")
    write_robot("walker.urdf", folder)
    path = folder / "words.json"
    path.write_text(json.dumps(words(rng)), encoding="utf-8")
    return path


def words(rng: Random) -> list[str]:
    """A command with some of its arguments, right or wrong."""
    command = rng.choice(sorted(COMMANDS))
    module = importlib.import_module(f"drakeplan.cli.{command.replace('-', '_')}")
    options, places = _words(module.Arguments)
    line = [command if rng.random() < 0.97 else changed_name(rng, command)]
    for place in places:
        if place.required or rng.random() < 0.6:
            usual = rng.choice(place.choices or USUAL.get(place.name, FILES))
            line.append(usual if rng.random() < 0.8 else rng.choice(NAMES + FILES))
    for name in rng.sample(sorted(options), min(len(options), rng.choice((0, 1, 1, 2, 3, 6)))):
        option = options[name]
        values = _values(rng, option.type, option.choices)
        if name in RIGHT and rng.random() < 0.5:
            values = [rng.choice(RIGHT[name])]
        if rng.random() < 0.03:
            name = changed_name(rng, name)
        line += [f"{name}={values[0]}"] if values and rng.random() < 0.1 else [name, *values]
    if rng.random() < 0.12:
        extra = rng.choice(("--json", "--", "-", "-x", "--seed", "--help", "--json=1", "--out", "---", *TEXTS))
        line.insert(rng.randrange(len(line) + 1), extra)
    if rng.random() < 0.05:
        line = rng.sample(line, len(line))
    return line


def _values(rng: Random, kind: object, choices: tuple[str, ...]) -> list[str]:
    if rng.random() < 0.03:
        return []
    if kind is bool:
        return []
    if kind is int:
        return [rng.choice(INTEGERS[:3]) if rng.random() < 0.7 else rng.choice(INTEGERS)]
    if kind is float:
        return [rng.choice(FLOATS[:3]) if rng.random() < 0.7 else rng.choice(FLOATS)]
    if kind == Numbers:
        return [rng.choice(FLOATS[:4] if rng.random() < 0.9 else FLOATS) for _ in range(rng.choice((1, 2, 2, 3, 3, 4)))]
    if choices and rng.random() < 0.7:
        return [rng.choice(choices)]
    return [rng.choice((*NAMES, *FILES, *FILES, *TEXTS, "n=folder", "=", "n=", "n=nothing"))]


@lru_cache(maxsize=1)
def use_stand_ins() -> None:
    """Puts quick work in place of planning, benchmarks and campaigns."""
    import drakeplan.query.planning
    from drakeplan.cli import bench, campaign_bar

    drakeplan.query.planning.plan_scene = _no_plan
    bench._run_one = lambda name, arguments, page: ()
    campaign_bar.Crew.start = _no_workers


def _no_plan(scene, robot, options, progress=None):
    """What a query refuses before it searches, then no plan."""
    from drakeplan.query.options import check_options, with_options
    from drakeplan.query.result import PlanResult
    from scenes.footholds.start_stance import check_goal, start_stance
    from scenes.terrain.packed_terrain import pack_terrain

    check_options(options)
    scene = with_options(scene, options)
    packed = pack_terrain(scene.terrain)
    stance = start_stance(scene, packed, robot)
    check_goal(scene, packed, robot, float(stance.feet_mean()[2]))
    return PlanResult("none", "not looked for", None, {"status": "none", "reason": "not looked for", "cost": np.nan})


def _no_workers(crew, campaign):
    raise InputError("no workers here")


def read(path: Path) -> None:
    """Runs a command line in the folder of its files.

    Raises:
        InputError: the command ended with status 2, with its line.
        AssertionError: another status than those promised, more than one line, or something half-written.
    """
    use_stand_ins()
    line = json.loads(path.read_text(encoding="utf-8"))
    folder = path.parent
    before = {p: p.stat().st_mtime_ns for p in folder.rglob("*") if p.is_file()}
    out, err, where = io.StringIO(), io.StringIO(), Path.cwd()
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = main(line)
    finally:
        os.chdir(where)
    said = err.getvalue()
    assert status in STATUSES, f"status {status} of {line}: {said[-3000:]}"
    assert "Traceback" not in said, said[-3000:]
    after = {p for p in folder.rglob("*") if p.is_file()}
    assert not [p for p in after if p.suffix in (".tmp", ".partial") or p.name.startswith(".")], (
        f"left behind by {line}"
    )
    if status != 2:
        return
    assert len(said.splitlines()) == 1, f"{line}: {said}"
    if "--json" in line:
        assert json.loads(out.getvalue())["status"] == "bad input", f"{line}: {out.getvalue()}"
    else:
        assert not out.getvalue(), f"{line}: {out.getvalue()[:300]}"
    new = [p.name for p in after if p not in before and p.suffix not in (".sqlite", ".sqlite-wal", ".sqlite-shm")]
    assert not new, f"{line} was refused and wrote {new}"
    raise InputError(said.strip())
