"""What experience is worth: stored plans, the search, and both at once on the same scenes (Lin 2020 fig. 4.5 and 4.6).

The first table asks random_surfaces, seeds from 0; the library's plans are of other draws. The second makes the ground
sparser: fewer quadrilaterals a square metre. Its curve of success against density goes to out/experience.png.
"""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path

import numpy as np

from drakeplan.bench.kept_rows import KeptRows
from drakeplan.bench.retrieval import ranking_times
from drakeplan.bench.table import BenchOptions, BenchTable, middle_and_high
from drakeplan.experience.library import Library
from drakeplan.experience.shipped import library_folder
from drakeplan.query.one_planner import load_kernels
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.library.random_surfaces import LENGTH, crossing
from scenes.robots.robot import Robot, load_robot
from scenes.scene import Scene

MOST_SEEDS = 100
DEADLINE = 20.0  # [s] of each query; Lin 2020 allowed 300
SIZES = (20, 60, 200)  # plans of the smaller libraries
DENSITIES = (9.0, 5.0, 3.0, 2.5, 2.0, 1.5)  # quadrilaterals per square metre
DENSITY_SEEDS = 20  # of each density; random numbers of their own
OUT = Path("out")
PICTURE = OUT / "experience.png"
WAYS: dict[str, dict[str, object]] = {
    "search, fixed steps": {"planner": "search", "footholds": "fixed", "dynamics": "quasi-static"},
    "search": {"planner": "search"},
    **{f"adapt {size}": {"planner": "adapt", "search_too": False, "plans": size} for size in SIZES},
    "adapt": {"planner": "adapt", "search_too": False},
    "adapt, strip alone": {"planner": "adapt", "search_too": False, "fit": "strip"},
    "adapt, strip, balance at its ends": {"planner": "adapt", "search_too": False, "fit": "strip_ends"},
    "parallel": {"planner": "parallel"},
}
SPARSE_WAYS = ("search, fixed steps", "search", "adapt", "parallel")


def run(options: BenchOptions) -> tuple[BenchTable, ...]:
    """Both tables; a run that was stopped goes on from out/experience.jsonl."""
    robot = load_robot(options.robot)
    load_kernels(robot, WholeBodyIK(robot), "parallel", lambda event: None)
    kept = KeptRows(OUT / "experience.jsonl")
    libraries = _Libraries(robot)
    found: dict[tuple[str, float], list[dict]] = {}
    for density, seed, way in _cases(options.seeds):
        key = f"{options.robot} {density:g} {seed} {way}"
        if key not in kept.rows:
            kept.add(key, _query(_scene(density, seed), robot, seed, WAYS[way], libraries))
            row = kept.rows[key]
            options.tell(
                f"density {density:g} seed {seed} {way}: {row['status']} {row['total_s']:.1f} s {row['reason']}"
            )
        found.setdefault((way, density), []).append(kept.rows[key])
    _draw(found)
    return _by_way(found, libraries), _by_density(found), ranking_times(robot, libraries.entries)


def _cases(seeds: int) -> list[tuple[float, int, str]]:
    """Density, seed and way, seed by seed, so that a short run has all ways; 0 stands for the named scene."""
    cases: list[tuple[float, int, str]] = []
    for seed in range(min(seeds, MOST_SEEDS)):
        cases += [(0.0, seed, way) for way in WAYS]
        if seed < DENSITY_SEEDS:
            cases += [(density, seed, way) for density in DENSITIES for way in SPARSE_WAYS]
    return cases


def _scene(density: float, seed: int) -> Scene:
    if not density:
        return load_scene("random_surfaces", seed=seed)
    rng = np.random.default_rng([seed, round(10 * density)])
    return crossing(rng, float(rng.uniform(*LENGTH)), density=density)


def _query(scene: Scene, robot: Robot, seed: int, way: dict[str, object], libraries: _Libraries) -> dict:
    asked = {key: value for key, value in way.items() if key != "plans"}
    library = "" if way["planner"] == "search" else libraries.folder(way.get("plans"))
    result = plan_scene(scene, robot, PlanOptions(seed=seed, deadline=DEADLINE, library=library, **asked))  # type: ignore[arg-type]
    numbers = {name: result.report[name] for name in ("total_s", "planning_s", "palms_used", "planner")}
    return {"status": result.status, "reason": result.reason, **numbers}


class _Libraries:
    """The library that comes with the robot, and smaller ones with the first plans of each motion mode in turn."""

    def __init__(self, robot: Robot) -> None:
        self._robot, self._made = robot, {}
        self.whole = library_folder(robot)
        with Library(self.whole, robot) as library:
            self.entries = library.entries()

    def folder(self, plans: object) -> str:
        """The folder of a library with so many plans; None for all."""
        if plans is None:
            return str(self.whole)
        if plans not in self._made:
            path = OUT / "libraries" / f"{self._robot.name}_{plans}"
            shutil.rmtree(path, ignore_errors=True)
            with Library(self.whole, self._robot) as whole, Library.create(path, self._robot) as part:
                for entry in self.entries:
                    if len(part) == plans:
                        break
                    part.add(whole.plan(entry.name))
            self._made[plans] = str(path)
        return self._made[plans]


def _by_way(found: dict[tuple[str, float], list[dict]], libraries: _Libraries) -> BenchTable:
    rows = []
    for way, asked in WAYS.items():
        results = found.get((way, 0.0), [])
        status = Counter(row["status"] for row in results)
        done = [row["total_s"] for row in results if row["status"] == "complete"]
        plans = "" if asked["planner"] == "search" else asked.get("plans", len(libraries.entries))
        first = sum(row["planner"] == "adapt" for row in results if row["status"] == "complete")
        rows.append((way, plans, len(results), status["complete"], status["contacts"], status["none"],
                     *middle_and_high(done), first if asked["planner"] == "parallel" else ""))  # fmt: skip
    columns = ("way", "plans", "queries", "verified", "contacts only", "no plan", "median s", "p95 s", "adapt first")
    notes = (
        f"random_surfaces; --deadline {DEADLINE:g} for the whole query; seconds of the verified ones.",
        "Lin 2020 fig. 4.5, 4.6 (other draws of such scenes, 300 s): 35 of 100 by search, 79 adapting 200 plans, 84 both.",
        "A library has plans of four motion modes together; adapt first: verified plans of parallel that were adapted.",
    )
    return BenchTable("experience", "What experience is worth", columns, tuple(rows), notes, most_seeds=MOST_SEEDS)


def _by_density(found: dict[tuple[str, float], list[dict]]) -> BenchTable:
    rows = []
    for density in DENSITIES:
        for way in SPARSE_WAYS:
            results = found.get((way, density), [])
            done = [row["total_s"] for row in results if row["status"] == "complete"]
            rows.append((density, way, len(results), len(done), *middle_and_high(done)))
    columns = ("surfaces a m2", "way", "queries", "verified", "median s", "p95 s")
    notes = (f"Draws of the family random_surfaces with fewer surfaces; --deadline {DEADLINE:g}; curve in {PICTURE}.",)
    title = "Search and experience where footholds get rare"
    return BenchTable(
        "experience_density", title, columns, tuple(rows), notes, bench="experience", most_seeds=DENSITY_SEEDS
    )


def _draw(found: dict[tuple[str, float], list[dict]]) -> None:
    """Success against density, a curve for each way."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    axes = figure.subplots()
    for way in SPARSE_WAYS:
        points = [(d, found[way, d]) for d in DENSITIES if found.get((way, d))]
        shares = [100.0 * np.mean([row["status"] == "complete" for row in rows]) for _, rows in points]
        axes.plot([d for d, _ in points], shares, "o-", label=way)
    axes.invert_xaxis()
    axes.set_xlabel("surfaces per square metre of ground")
    axes.set_ylabel(f"verified within {DEADLINE:g} s [%]")
    axes.set_ylim(-3.0, 103.0)
    axes.grid(alpha=0.3)
    axes.legend()
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE, dpi=150)
