"""Mixed-integer programs and the graph of convex sets on the rubble field of 14 surfaces: 12, 18 and 24 contacts.

The comparison of Lin et al. 2019 sec. VIII-C (Lin 2020 fig. 6.8): Gurobi 8.0 with 8 threads found the first answer of
the program with momentum in 86, 34 and 46 s on average.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable
from optimization.contact_programs.contact_momentum_program import ContactDynamicsProgram
from optimization.contact_programs.contact_query import ContactEstimate, ContactQuery, FootstepOptions
from optimization.contact_programs.convex_set_graph import ConvexSetGraph
from optimization.contact_programs.footstep_program import FootstepProgram
from optimization.contact_programs.step_reach import step_reach
from optimization.mixed_integer.solver import BACKENDS, MixedIntegerSettings
from scenes.footholds.start_stance import check_goal, start_stance
from scenes.library.rubble_field import named as rubble_field
from scenes.robots.robot import load_robot
from scenes.terrain.packed_terrain import pack_terrain
from scenes.transition_model import transition_model

CONTACTS = (12, 18, 24)
TIME_LIMIT = 30.0  # [s]
GAP = 0.01
MAX_SEEDS = 3
PUBLISHED = {12: "86 +- 56", 18: "34 +- 19", 24: "46 +- 20"}  # [s] Lin et al. 2019 fig. 7, Gurobi 8.0, 8 threads
PIECES = tuple((float(a), float(b)) for a, b in np.deg2rad([(-30, -10), (-10, 10), (10, 30)]))


def run(options: BenchOptions) -> BenchTable:
    """Every formulation, size and solver that can be used here."""
    robot = load_robot(options.robot)
    reach = step_reach(robot, transition_model())
    solvers = [b.name for b in BACKENDS if not b.missing()]
    rows = []
    for label, build, headings in _FORMULATIONS:
        for num in CONTACTS:
            for solver in solvers if build is not ConvexSetGraph else ["clarabel"]:
                found: list[tuple[ContactEstimate, float]] = []
                for seed in range(min(options.seeds, MAX_SEEDS)):
                    scene = rubble_field(seed)
                    packed = pack_terrain(scene.terrain)
                    start, goal = start_stance(scene, packed, robot), check_goal(scene, packed, robot)
                    query = ContactQuery(scene.terrain, robot, start, goal, reach)
                    began = time.perf_counter()
                    program = build(query, FootstepOptions(num, headings=headings))
                    built = time.perf_counter() - began
                    settings = MixedIntegerSettings("auto" if solver == "clarabel" else solver, TIME_LIMIT, GAP)
                    found.append((program.solve(settings), built))
                    record = found[-1][0].record
                    options.tell(
                        f"{label} {num} {solver} seed {seed}: {record.message if record else found[-1][0].reason}"
                    )
                rows.append(_row(label, num, solver, found))
    columns = ("formulation", "contacts", "solver", "answered", "closed to 1 %", "build s", "first s", "end s", "CPU s", "gap",
               "peak MB", "published first s")  # fmt: skip
    notes = (
        f"Rubble field, 14 surfaces, seeds 0 to {min(options.seeds, MAX_SEEDS) - 1}; medians; limit {TIME_LIMIT:g} s;"
        " solver's process and its start included, one thread.",
        "Published: point contacts with simplified dynamics, Gurobi 8.0, 8 threads (Lin et al. 2019 fig. 7).",
        "Gap of the graph of convex sets: rounded path to its own relaxation.",
    )
    return BenchTable(
        "mixed_integer", "Contacts by mixed-integer programs", columns, tuple(rows), notes, most_seeds=MAX_SEEDS
    )


_FORMULATIONS: tuple[tuple[str, Callable, tuple[tuple[float, float], ...]], ...] = (
    ("footsteps", FootstepProgram, ()),
    ("footsteps, 3 headings", FootstepProgram, PIECES),
    ("graph of convex sets", ConvexSetGraph, ()),
    ("contacts with momentum", ContactDynamicsProgram, ()),
)


def _row(label: str, num: int, solver: str, found: list[tuple[ContactEstimate, float]]) -> tuple[object, ...]:
    records = [e.record for e, _ in found if e.record is not None]

    def median(values: list[float]) -> float:
        finite = [v for v in values if np.isfinite(v)]
        return float(np.median(finite)) if finite else float("nan")

    answered = sum(e.feasible for e, _ in found)
    closed = sum(r.gap <= GAP for r in records)
    return (
        label, num, solver, f"{answered} of {len(found)}", f"{closed} of {len(found)}", median([b for _, b in found]),
        median([r.time_to_first for r in records]), median([r.time for r in records]), median([r.cpu_time for r in records]),
        median([r.gap for r in records]), median([r.peak_rss_mb for r in records]),
        PUBLISHED[num] if label == "contacts with momentum" else "",
    )  # fmt: skip
