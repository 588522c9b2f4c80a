"""Large floors and fine maps: what a whole command and a verification cost, by size."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import trimesh

from drakeplan.bench.map_accuracy import accuracy_table
from drakeplan.bench.map_imports import import_table
from drakeplan.bench.table import BenchOptions, BenchTable

COLUMNS = (
    "map",
    "triangles",
    "plan",
    "plan s",
    "search s",
    "dynamics s",
    "motion s",
    "plan MB",
    "verify",
    "verify s",
    "target s",
    "verify MB",
    "target MB",
)
DEADLINE = 60.0  # [s] of each plan
VERIFY_MEMORY = 1000.0  # [MB] that a verification may take
FAR = 1.6  # [m] from start to goal


def run(options: BenchOptions) -> tuple[BenchTable, ...]:
    """How true imported clouds are, what importing costs, and what planning on large floors and fine maps costs."""
    return accuracy_table(options), import_table(options), _plans(options)


def _plans(options: BenchOptions) -> BenchTable:
    """Plans and verifies on floors of 4 to 400 m and on height maps of 16 800 to 10^6 triangles, each in processes of its own."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, suffix, write, target in _cases():
            path, plan = Path(folder) / f"map{len(rows)}{suffix}", Path(folder) / "plan.h5"
            triangles = write(path)
            ends = ["--start", "0", "0", "--goal", str(FAR), "0", "--robot", options.robot, "--deadline", str(DEADLINE)]
            status, wall, report, memory = _timed(["plan", str(path), *ends, "--out", str(plan), "--json"])
            spent = [float(report.get(key) or np.nan) for key in ("planning_s", "dynamics_s", "motion_s")]
            row = [
                name,
                triangles,
                "verified" if status == 0 else f"no: {report.get('reason', '')}",
                wall,
                *spent,
                memory,
            ]
            if status == 0:
                held, wall, _, memory = _timed(["verify", str(plan), "--json"])
                row += ["holds" if held == 0 else "does not hold", wall, target, memory, VERIFY_MEMORY]
                plan.unlink()
            else:
                row += ["-", np.nan, target, np.nan, VERIFY_MEMORY]
            rows.append(tuple(row))
            options.tell(f"{name}: {row[2]} in {row[3]:.1f} s, verified in {row[9]:.1f} s")
    notes = (
        "Wall time of `drakeplan plan` and `drakeplan verify`, start of the process and reading of the map included.",
        "A plan file keeps what its terrain became: large planes in few triangles, so that its verification does not read the map.",
    )
    return BenchTable("maps", "Large floors and fine maps", COLUMNS, tuple(rows), notes, most_seeds=0)


def _cases() -> Iterator[tuple[str, str, Callable[[Path], int], float]]:
    """Name and suffix, what writes the map and returns its number of triangles, and the seconds that its verification may take."""
    for size in (4.0, 20.0, 400.0):
        yield f"floor of {size:g} m, a surface", ".yaml", lambda path, size=size: _surface(path, size), 3.0
    yield "floor of 400 m, a box", ".yaml", lambda path: _box(path, 400.0), 3.0
    yield "floor of 400 m, a mesh", ".stl", lambda path: _sheet(path, 400.0), 3.0
    for cell, length, width, noise, target in (
        (0.06, 2.8, 1.2, 0.0, 3.0),
        (0.03, 2.8, 1.2, 0.0, 3.0),
        (0.02, 2.8, 1.2, 0.0, 3.0),
        (0.02, 4.5, 1.5, 0.003, 5.0),
        (0.01, 9.6, 5.2, 0.002, 15.0),
    ):
        name = f"stairs, {100 * cell:g} cm cells{f', noise of {1e3 * noise:g} mm' if noise else ''}"
        yield (
            name,
            ".stl",
            lambda path, c=cell, x=length, y=width, n=noise: _height_map(path, _stairs, c, x, y, n),
            target,
        )
    yield "hills, 2 cm cells", ".stl", lambda path: _height_map(path, _hills, 0.02, 4.0, 1.7, 0.0), 5.0
    yield "hills, 2 cm cells, 200 m^2", ".stl", lambda path: _height_map(path, _hills, 0.02, 14.0, 14.0, 0.0), 15.0


def _surface(path: Path, size: float) -> int:
    corners = [[x, y, 0.0] for x, y in _square(size)]
    return _scene(path, {"surfaces": [{"name": "floor", "vertices": corners}]})


def _box(path: Path, size: float) -> int:
    box = {
        "name": "ground",
        "box": [size, size, 0.2],
        "pose": {"xyz": [0.0, 0.0, -0.1]},
        "contact": ["left_foot", "right_foot"],
    }
    return _scene(path, {"obstacles": [box]})


def _scene(path: Path, terrain: dict[str, object]) -> int:
    path.write_text(json.dumps({"format": "drakeplan-scene", "version": 1, **terrain}))  # JSON is YAML
    return 0


def _sheet(path: Path, size: float) -> int:
    corners = np.array([[x, y, 0.0] for x, y in _square(size)])
    trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False).export(path)
    return 2


def _square(size: float) -> list[tuple[float, float]]:
    half = size / 2
    return [(-half, -half), (half, -half), (half, half), (-half, half)]


def _height_map(path: Path, shape: Callable, cell: float, length: float, width: float, noise: float) -> int:
    """Writes a map about the start as a triangle mesh; how many triangles it has."""
    x, y = np.meshgrid(np.arange(-0.6, length - 0.6, cell), np.arange(-width / 2, width / 2, cell))
    z = shape(x, y) + noise * np.random.default_rng(0).standard_normal(x.shape)
    rows, columns = x.shape
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    right, over = corner + 1, corner + columns + 1
    faces = np.concatenate(
        [np.column_stack([corner, right, over]), np.column_stack([corner, over, corner + columns])],
    )
    trimesh.Trimesh(np.column_stack([x.ravel(), y.ravel(), z.ravel()]), faces, process=False).export(path)
    return len(faces)


def _stairs(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Three steps of 0.3 m and 0.12 m [m]."""
    return 0.12 * np.clip(np.floor((x - 0.5) / 0.3) + 1, 0, 3)


def _hills(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Smooth hills, up to 10 deg steep [m]."""
    return 0.06 * np.sin(2 * np.pi * x / 2.2) * np.cos(2 * np.pi * y / 2.4)


def _timed(words: list[str]) -> tuple[int, float, dict, float]:
    """Exit status, wall time [s], JSON report and greatest memory [MB] of a command in a process of its own."""
    probe = (
        "import resource, subprocess, sys; done = subprocess.run(sys.argv[1:]);"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, file=sys.stderr); sys.exit(done.returncode)"
    )
    began = time.perf_counter()
    command = [sys.executable, "-m", "drakeplan", *words]
    done = subprocess.run([sys.executable, "-c", probe, *command], capture_output=True, text=True, check=False)
    wall = time.perf_counter() - began
    memory = float(done.stderr.rstrip().rpartition("\n")[2]) / 1024.0
    report = json.loads(done.stdout) if done.stdout.strip() else {}
    return done.returncode, wall, report, memory
