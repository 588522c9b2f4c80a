"""How close motions come to the limits of the verifier on momenta, velocities, accelerations and torques."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.timing.step_timing import Timing
from drakeplan.verifier import Report
from optimization.balance.friction import FrictionCone
from scenes.files.scene_source import load_scene
from scenes.input_error import InputError
from scenes.library import NAMED_SCENES
from scenes.robots.robot import load_robot

# Check -> what its limit should become.
TARGETS = {
    "velocities": 0.1,
    "joint accelerations": 60.0,
    "linear momentum of model": 6.0,
    "linear momentum of model, RMS": 2.0,
    "angular momentum of model": 6.0,
    "angular momentum of model, RMS": 2.0,
    "angular momentum of model, median": 1.0,
    "joint torques": 1.0,
}
MAX_SEEDS = 5
DEADLINE = 30.0  # [s] of search
QUICK = PlanOptions(dynamics="exact", cone=FrictionCone.SECOND_ORDER, timing=Timing(0.3, 0.6))
OPTIONS = {
    "slippery_slope": QUICK,
    "steep_slope": QUICK,
    "wide_gap in one stride": PlanOptions(dynamics="exact", transition_model="leap_stride"),
    "wider_gap": PlanOptions(dynamics="exact", timing=Timing(0.6, 1.0)),
    "hpp/darpa": PlanOptions(start=(-3.6, 0.0, 0.0), goal=(3.9, 0.0)),
}
ONCE = ("wide_gap in one stride", "hpp/darpa")  # beside the named scenes
OTHER_ROBOTS = (
    *(("jvrc1", name) for name in ("flat", "stairs", "rubble_field", "rubble_corridor", "wide_gap", "tilted_slab")),
    *((robot, name) for robot in ("g1", "talos") for name in ("flat", "stairs", "rubble_corridor")),
)


@dataclass(frozen=True)
class Judged:
    """One query.

    Attributes:
        seed: of scene and search.
        complete: whether the plan holds.
        report: the verifier's, None where no motion came to it.
    """

    seed: int
    complete: bool
    report: Report | None


def run(options: BenchOptions) -> BenchTable:
    """Named scenes with seeds 0 to 4, two more once, then other robots; each row has the worst of its seeds."""
    cases = [(options.robot, name) for name in (*NAMED_SCENES, *ONCE)] + list(OTHER_ROBOTS)
    rows: list[tuple[object, ...]] = []
    limits: dict[str, float] = {}
    notes = []
    for robot_name, name in cases:
        try:
            seeds = min(options.seeds, MAX_SEEDS) if name in NAMED_SCENES and robot_name == options.robot else 1
            found = [judge(robot_name, name, seed, options) for seed in range(seeds)]
        except InputError as error:
            notes.append(f"{name}, {robot_name}: {error}")
            continue
        reports = [judged.report for judged in found if judged.report is not None]
        limits |= {check.name: check.limit for report in reports for check in report.checks}
        worst = [max((report.check(check).worst for report in reports), default=np.nan) for check in TARGETS]
        rows.append((name, robot_name, len(found), sum(judged.complete for judged in found), *worst))
    measured = np.array([row[4:] for row in rows], dtype=float).reshape(-1, len(TARGETS))
    worst = [float(np.max(column[np.isfinite(column)], initial=0.0)) for column in measured.T]
    rows += [
        ("worst", "", "", "", *worst),
        ("limit", "", "", "", *(limits.get(check, np.nan) for check in TARGETS)),
        ("target", "", "", "", *TARGETS.values()),
    ]
    notes.append(
        "velocities rad/s, accelerations rad/s^2, linear momentum kg m/s, angular momentum N m s, torques as a share of the "
        "actuators' limits"
    )
    columns = ("scene", "robot", "queries", "verified", *TARGETS)
    return BenchTable(
        "verifier", "Motions and the verifier's limits", columns, tuple(rows), tuple(notes), most_seeds=MAX_SEEDS
    )


def judge(robot: str, name: str, seed: int, options: BenchOptions) -> Judged:
    """Plans one crossing and reads what the verifier says of it.

    Args:
        robot: name.
        name: of the scene, with what is special about it after a blank.
        seed: of scene and search.
        options: of the benchmark, for progress.

    Raises:
        InputError: the robot or the scene is not on this machine.
    """
    query = replace(OPTIONS.get(name, PlanOptions()), seed=seed, deadline=DEADLINE)
    found = plan_scene(load_scene(name.split()[0], seed=seed), load_robot(robot), query)
    options.tell(f"{name}, {robot}, seed {seed}: {found.status} {found.reason}")
    report = found.verification
    made = report is not None and {check.name for check in report.checks} >= set(TARGETS)
    return Judged(seed, found.status == "complete", report if made else None)
