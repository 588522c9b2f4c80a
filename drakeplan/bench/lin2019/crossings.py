"""Wide gap and steep slope of Lin et al. 2019 sec. VIII-A and B (Lin 2020 sec. 6.7.1 and 6.7.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict

import numpy as np

from drakeplan.bench.contact_query import QueryOutcome, run_query
from drakeplan.bench.kept_cases import Case, KeptCases
from drakeplan.bench.lin2019.queries import (
    DEADLINE,
    LAZY,
    LEARNED,
    QUASI_STATIC,
    model_and_weights,
    outcome,
    planner_options,
)
from drakeplan.bench.table import BenchTable
from drakeplan.context import QueryContext
from optimization.balance.friction import FrictionCone
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.robots.robot import Robot

CROSSINGS = (  # scene, friction cone and who plans; the dynamics under the diamond have not been learned
    ("wide_gap", FrictionCone.INNER, (QUASI_STATIC, LEARNED, LAZY)),
    ("steep_slope", FrictionCone.DIAMOND, (QUASI_STATIC, LAZY)),
)
SECONDS = 1.0  # [s] of search, or until the first sequence
# First sequence [s], dynamics of the one that is shown [s], its contacts; the slope's took 10.617 s to find.
PUBLISHED: dict[str, tuple[object, ...]] = {"wide_gap": (0.143, 1.23, ""), "steep_slope": (0.702, 6.32, 31)}
NOTES = (
    f"One query each: search for {SECONDS:g} s, or until the first sequence, {DEADLINE:g} s at most; then the program of the last "
    "feasible sequence.",
    "steep_slope: 30 deg at friction 0.5 holds no robot at the documents' timing under a cone inside the true one; diamond claims "
    "up to 1.41 times the friction across its corners, so that quasi-static balance holds there too. Nobody has learned the dynamics "
    "under it: `--dynamics learned` asks the exact program.",
)


def table(robot: Robot, ik: WholeBodyIK, kept: KeptCases, tell: Callable[[str], None]) -> BenchTable:
    """Every planner on both scenes, and the published row.

    Args:
        robot: that crosses.
        ik: its inverse kinematics.
        kept: cases that are not run again.
        tell: called with one line of progress.
    """
    rows = []
    for scene, cone, planners in CROSSINGS:
        for planner in planners:
            key = {"bench": "lin2019", "part": "crossing", "scene": scene, "cone": cone, "planner": planner,
                   **model_and_weights(robot, planner)}  # fmt: skip
            case = kept(key, lambda s=scene, c=cone, p=planner: _cross(robot, ik, s, c, p))
            rows.append(_row(scene, cone, planner, outcome(case["outcome"]), float(str(case["program_s"]))))
            tell(f"{scene} {planner}: first {rows[-1][4]:.3f} s {case['why']}".rstrip())
        first, program, contacts = PUBLISHED[scene]
        rows.append((scene, "", "learned, published", "", first, "", program, contacts, ""))
    columns = ("scene", "cone", "planner", "found", "first s", "feasible", "program s", "contacts", "objective")
    title = "Wide gap and steep slope (Lin et al. 2019 sec. VIII-A, B)"
    return BenchTable("lin2019_crossings", title, columns, tuple(rows), NOTES, bench="lin2019", most_seeds=0)


def _cross(robot: Robot, ik: WholeBodyIK, scene: str, cone: FrictionCone, planner: str) -> Case:
    context = QueryContext(load_scene(scene, seed=0), robot, ik, cone, full_soles=True)
    trials = run_query(context, *planner_options(planner, 0, robot), seconds=SECONDS, deadline=DEADLINE)
    found = trials.within(np.inf)
    return {"outcome": asdict(found), "program_s": trials.last_program_s, "why": trials.why}


def _row(scene: str, cone: FrictionCone, planner: str, found: QueryOutcome, program_s: float) -> tuple[object, ...]:
    contacts = found.transitions + 2 if found.feasible else ""
    return (scene, cone, planner, found.found, found.first_s, "yes" if found.feasible else "no", program_s, contacts,
            found.objective)  # fmt: skip
