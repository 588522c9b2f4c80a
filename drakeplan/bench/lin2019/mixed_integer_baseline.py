"""Mixed-integer planners on the rubble field beside the search, each on one thread: first sequences, and verified plans.

The baseline of Lin et al. 2019 sec. VIII-C (Lin 2020 fig. 6.8). A first sequence counts when the program over the whole of it is
feasible, as it does for the search; a plan counts when the verifier holds, after as many repairs as that took.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

from drakeplan.bench.kept_cases import Case, KeptCases
from drakeplan.bench.lin2019.queries import MAIN, model_and_weights
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.program_planner import FORMULATIONS, ProgramPlanner
from drakeplan.contact_planning.sequence_dynamics import sequence_dynamics
from drakeplan.context import QueryContext
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.search.ana_star import Limits
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.robots.robot import Robot
from scenes.transition_model import transition_model

SCENE = "rubble_field"
SEEDS = 5
DEADLINE = 60.0  # [s] of planning
NOTHING = float("nan")


@dataclass(frozen=True)
class FirstSequence:
    """The first contact sequence of a mixed-integer planner.

    Attributes:
        planner, seed: which.
        found: whether there is one in time.
        feasible: whether the dynamics of the whole sequence are feasible.
        first_s: seconds until it came, those of programs whose answers failed inverse kinematics included.
        confirm_s: seconds of the program over the whole of it.
        solver: that answered.
    """

    planner: str
    seed: int
    found: bool
    feasible: bool
    first_s: float
    confirm_s: float
    solver: str


@dataclass(frozen=True)
class WholePlan:
    """The result of a whole query.

    Attributes:
        planner, seed: which.
        verified: whether the plan is complete and the verifier holds.
        planning_s: seconds until the contacts of that plan were found, those of refused ones included.
        total_s: with dynamics, motion and verification.
        repairs: sequences that were refused.
        reason: why it is not verified.
    """

    planner: str
    seed: int
    verified: bool
    planning_s: float
    total_s: float
    repairs: int
    reason: str


def first_sequences(
    robot: Robot, ik: WholeBodyIK, seeds: int, kept: KeptCases, tell: Callable[[str], None]
) -> list[FirstSequence]:  # fmt: skip
    """First sequences of every formulation, on seeds 0 to `SEEDS` - 1.

    Args:
        robot: that crosses.
        ik: its inverse kinematics.
        seeds: how many, at most `SEEDS`.
        kept: cases that are not run again.
        tell: called with one line of progress.
    """
    found = []
    for seed in range(min(seeds, SEEDS)):
        for planner in FORMULATIONS:
            key = {"bench": "lin2019", "part": "first", "planner": planner, "seed": seed,
                   **model_and_weights(robot, planner)}  # fmt: skip
            case = kept(key, lambda p=planner, s=seed: _first(robot, ik, p, s))
            found.append(FirstSequence(**cast("dict[str, Any]", case)))
            tell(f"{SCENE} seed {seed} {planner}: first {found[-1].first_s:.2f} s, feasible {found[-1].feasible}")
    return found


def whole_plans(
    robot: Robot, seeds: int, kept: KeptCases, tell: Callable[[str], None]
) -> list[WholePlan]:  # fmt: skip
    """Whole queries by the search and every formulation, verification included, without improving after the first sequence.

    Args:
        robot: that crosses.
        seeds: how many, at most `SEEDS`.
        kept: cases that are not run again.
        tell: called with one line of progress.
    """
    found = []
    for seed in range(min(seeds, SEEDS)):
        for planner in (*MAIN, *FORMULATIONS):
            key = {
                "bench": "lin2019",
                "part": "plan",
                "planner": planner,
                "seed": seed,
                **model_and_weights(robot, planner),
            }
            case = kept(key, lambda p=planner, s=seed: _plan(robot, p, s))
            found.append(WholePlan(**cast("dict[str, Any]", case)))
            tell(
                f"{SCENE} seed {seed} {planner}, whole plan: verified {found[-1].verified} {found[-1].reason}".rstrip()
            )
    return found


def _first(robot: Robot, ik: WholeBodyIK, name: str, seed: int) -> Case:
    scene = load_scene(SCENE, seed=seed)
    context = QueryContext(scene, robot, ik, full_soles=True)
    options = PlannerOptions(
        seed=seed, model=transition_model(scene.transition_model or "experiments"), footholds="fixed"
    )
    planner = ProgramPlanner(context, name, options)
    plans = list(planner.plans(Limits(deadline=DEADLINE, improve=0.0)))
    solver = next((note.solver for note in reversed(planner.notes) if note.solver), "")
    if not plans:
        return {"planner": name, "seed": seed, "found": False, "feasible": False, "first_s": NOTHING,
                "confirm_s": NOTHING, "solver": solver}  # fmt: skip
    began = time.perf_counter()
    estimate = sequence_dynamics(robot, plans[0].stances, context.cone)
    return {"planner": name, "seed": seed, "found": True, "feasible": bool(estimate.feasible),
            "first_s": plans[0].elapsed, "confirm_s": time.perf_counter() - began, "solver": solver}  # fmt: skip


def _plan(robot: Robot, name: str, seed: int) -> Case:
    planner, dynamics = ("search", name) if name in MAIN else (name, "quasi-static")
    options = PlanOptions(seed=seed, planner=planner, dynamics=dynamics, deadline=DEADLINE, improve=0.0)
    result = plan_scene(load_scene(SCENE, seed=seed), robot, options)
    report = cast("dict[str, Any]", result.report)
    return {"planner": name, "seed": seed, "verified": result.status == "complete", "planning_s": report["planning_s"],
            "total_s": report["total_s"], "repairs": report["repairs"], "reason": result.reason}  # fmt: skip
