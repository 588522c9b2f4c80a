"""What `drakeplan scenes import` costs, by format: a whole process each, reading, surfaces and scene file."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from drakeplan.bench.map_accuracy import cloud_of, made_up_ground
from drakeplan.bench.table import BenchOptions, BenchTable

COLUMNS = (
    "file",
    "MB",
    "read",
    "surfaces",
    "boxes",
    "walkable m2",
    "processor s",
    "wall s",
    "target s",
    "peak MB",
)
NOISE = 0.003  # [m]
ONE_THREAD = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def import_table(options: BenchOptions) -> BenchTable:
    """Clouds of 10^5 and 10^6 points in three formats, and height maps, each in a process of its own."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, suffix, words, write, target in _cases():
            path, out = Path(folder) / f"terrain{suffix}", Path(folder) / "scene.yaml"
            write(path)
            command = [
                sys.executable,
                "-m",
                "drakeplan",
                "scenes",
                "import",
                str(path),
                "--out",
                str(out),
                "--json",
                *words,
            ]
            probe = (
                "import resource, subprocess, sys; done = subprocess.run(sys.argv[1:]);"
                "u = resource.getrusage(resource.RUSAGE_CHILDREN);"
                "print(u.ru_maxrss, u.ru_utime + u.ru_stime, file=sys.stderr); sys.exit(done.returncode)"
            )
            began = time.perf_counter()
            done = subprocess.run(
                [sys.executable, "-c", probe, *command], capture_output=True, text=True, check=False, env=ONE_THREAD
            )
            wall = time.perf_counter() - began
            memory, spent = (float(word) for word in done.stderr.split()[-2:])
            report = json.loads(done.stdout) if done.returncode == 0 else {}
            terrain = report.get("terrain", {})
            rows.append((
                name,
                path.stat().st_size / 1e6,
                ", ".join(f"{count} {things}" for things, count in report.get("read", {}).items()) or "refused",
                terrain.get("surfaces", 0),
                terrain.get("obstacles", 0),
                float(terrain.get("areas", {}).get("walkable_m2", np.nan)),
                spent,
                wall,
                target,
                memory / 1024.0,
            ))  # fmt: skip
            options.tell(f"{name}: {rows[-1][3]} surfaces in {wall:.1f} s, {memory / 1024.0:.0f} MB")
    notes = ("Ground as in the table of accuracy, noise of 3 mm; each row is a process of its own, on one thread.",)
    return BenchTable("maps_imports", "Importing terrain", COLUMNS, tuple(rows), notes, "maps", most_seeds=0)


def _cases() -> Iterator[tuple[str, str, list[str], Callable[[Path], None], float]]:
    """Name, suffix, further words, what writes the file, and the seconds that it may take."""
    for count, target in ((100_000, 5.0), (1_000_000, 10.0)):
        points = cloud_of(made_up_ground(0), count, NOISE, 0)
        yield f"cloud of {count:g} points, .npy", ".npy", [], lambda path, p=points: np.save(path, p), target
    yield "the same, binary .ply", ".ply", [], lambda path, p=points: _ply(path, p), 10.0
    yield "the same, text", ".xyz", [], lambda path, p=points: np.savetxt(path, p, fmt="%.4f"), 10.0
    for size in (300, 700):
        x, y = np.meshgrid(0.02 * np.arange(size), 0.02 * np.arange(size))
        z = 0.12 * np.floor(x) + NOISE * np.random.default_rng(0).standard_normal(x.shape)
        z[(x + y) % 1.7 < 0.1] = np.nan
        words = ["--resolution", "0.02"]
        yield f"height map of {size} x {size}, .npy", ".npy", words, lambda path, z=z: np.save(path, z), 20.0


def _ply(path: Path, points: np.ndarray) -> None:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    path.write_bytes(head.encode() + points.astype("<f4").tobytes())
