"""Deforming a plan to a scene whose surfaces have moved, beside planning it again from scratch.

Every surface of a scene that a verified plan crosses moves by up to 10 cm and 15 deg. The plan is deformed (Lin 2020 sec.
4.5), dynamics and motion are made anew, and the verifier reads the file; the same scene is planned from scratch.
"""

from __future__ import annotations

import dataclasses
import re
import time
from collections import Counter
from collections.abc import Callable

import numpy as np

from drakeplan.bench.kept_cases import Case, KeptCases
from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.experience.deformation import DeformOptions, DeformResult, deform
from drakeplan.plan.plan import Plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from scenes.files.scene_source import load_scene
from scenes.robots.robot import Robot, load_robot
from scenes.scene import Scene
from scenes.terrain.moved_terrain import move_surfaces

SCENES = ("rubble_field", "rubble_corridor")
PLANS = 5  # verified plans of each scene, seeds 0 to 4; move s deforms that of seed s modulo 5
TARGET, SECONDS = 0.60, 5.0  # share of what replanning solves, deformation time of each [s]
DEADLINE = 10.0  # [s] of search from scratch

VARIES = r"( for transition \d+| at [\d.]+ s:| within [\d.]+ m).*"  # the part of a reason that names one case

NO_PLAN = "no plan"  # there is nothing to deform


def run(options: BenchOptions) -> BenchTable:
    """Moves 0 and up of each scene; with the file that `DRAKEPLAN_BENCH_RESUME` names it goes on where it stopped."""
    robot = load_robot(options.robot)
    cases: dict[str, list[Case]] = {name: [] for name in SCENES}
    parts = _Parts(robot, KeptCases.asked_for())
    for seed in range(options.seeds):
        for name in SCENES:
            case = parts("deform", name, seed) | parts("replan", name, seed)
            cases[name].append(case)
            outcome = f"deformed {case['deform']} ({case['deform_reason']}), planned {case['replan']}"
            options.tell(f"{name} {seed}: {outcome}")
    rows, notes = [], []
    for name, found in cases.items():
        rows.append(_row(name, found))
        notes += _reasons(name, found)
    columns = (
        "scene",
        "moved scenes",
        "planned again",
        "deformed",
        "both",
        "share of planned",
        "target",
        "deformation median s",
        "p95",
        "target s",
        "whole deformation median s",
        "planning again median s",
    )
    notes.append(
        "Deformation: regions and strips with their repairs; whole deformation adds dynamics, motion and "
        "verification. Seconds of processor time, which do not depend on what else the machine does."
    )
    title = "Plans deformed to surfaces moved by up to 10 cm and 15 deg"
    return BenchTable("deform", title, columns, tuple(rows), tuple(notes), most_seeds=None)


def moved_scene(name: str, seed: int) -> tuple[Scene, Scene]:
    """The scene that was planned for, and the same with every surface moved.

    Args:
        name: of the scene.
        seed: of the move; the plan's is this modulo `PLANS`.
    """
    scene = load_scene(name, seed=seed % PLANS)
    terrain = move_surfaces(scene.terrain, np.random.default_rng(seed))
    return scene, dataclasses.replace(scene, name=f"{name}_moved", terrain=terrain)


class _Parts:
    """The two halves of every case, run once and kept in a file where there is one."""

    def __init__(self, robot: Robot, kept: KeptCases) -> None:
        self._robot, self._kept = robot, kept
        self._plans: dict[tuple[str, int], Plan | None] = {}

    def __call__(self, part: str, name: str, seed: int) -> Case:
        key = {"bench": "deform", "part": part, "robot": self._robot.name, "scene": name, "seed": seed}
        return self._kept(key, lambda: _run_part(self._plan, self._robot, part, name, seed))

    def _plan(self, name: str, seed: int) -> Plan | None:
        """The verified plan that a move deforms."""
        key = name, seed % PLANS
        if key not in self._plans:
            options = PlanOptions(seed=key[1], dynamics="quasi-static", deadline=DEADLINE)
            self._plans[key] = plan_scene(load_scene(name, seed=key[1]), self._robot, options).plan
        return self._plans[key]


def _run_part(plan_of: Callable[[str, int], Plan | None], robot: Robot, part: str, name: str, seed: int) -> Case:
    _, moved = moved_scene(name, seed)
    if part == "replan":
        began = time.process_time()
        again = plan_scene(moved, robot, PlanOptions(seed=seed, dynamics="quasi-static", deadline=DEADLINE))
        return {"replan": again.status, "replan_reason": again.reason, "replan_s": time.process_time() - began}
    plan = plan_of(name, seed)
    if plan is None or plan.motion is None:
        return {
            "deform": NO_PLAN,
            "deform_reason": "the unmoved scene has no verified plan",
            "deform_s": np.nan,
            "deform_total_s": np.nan,
        }
    began = time.process_time()
    result = deform(plan, moved, DeformOptions(), robot=robot)
    return {
        "deform": result.status,
        "deform_reason": _category(result),
        "deform_detail": result.reason,
        "deform_s": result.report["deform_s"],
        "deform_total_s": time.process_time() - began,
    }


def _category(result: DeformResult) -> str:
    """Why a deformation failed, without the numbers: "" where it did not."""
    if result.status == "complete":
        return ""
    if result.status == "strip" and result.strip is not None:
        return f"strip: {result.strip.faults[0].task}"
    return re.sub(r"^contact \d+ \(\w+\): ", "", re.sub(VARIES, "", result.reason)).strip()


def _row(name: str, cases: list[Case]) -> tuple[object, ...]:
    asked = [c for c in cases if c["deform"] != NO_PLAN]
    planned = [c for c in asked if c["replan"] == "complete"]
    deformed = [c for c in asked if c["deform"] == "complete"]
    both = [c for c in planned if c["deform"] == "complete"]

    def middle(found: list[Case], key: str, percent: float = 50.0) -> float:
        values = [float(c[key]) for c in found if np.isfinite(c[key])]  # type: ignore[arg-type, call-overload]
        return float(np.percentile(values, percent)) if values else float("nan")

    share = len(both) / len(planned) if planned else float("nan")
    return (
        name,
        len(asked),
        len(planned),
        len(deformed),
        len(both),
        share,
        TARGET,
        middle(asked, "deform_s"),
        middle(asked, "deform_s", 95.0),
        SECONDS,
        middle(deformed, "deform_total_s"),
        middle(planned, "replan_s"),
    )


def _reasons(name: str, cases: list[Case]) -> list[str]:
    failed = Counter(str(c["deform_reason"]) for c in cases if c["deform"] != "complete")
    return [f"{name}: {count} times {reason}" for reason, count in failed.most_common()]
