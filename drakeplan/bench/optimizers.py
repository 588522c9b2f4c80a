"""Formulations and solvers side by side: success, cost, violation by a recomputation, time and memory.

Centroidal questions are asked of every cone and solver, with fixed and with free timing, and of an exact-Hessian interior
point; whole-body and mixed-integer formulations on questions of their own.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drakeplan.bench.centroidal import gap_walk, sequence_options, sequence_problem, slope_walk
from drakeplan.bench.peers import interior_point
from drakeplan.bench.random_transitions import random_transition
from drakeplan.bench.table import BenchOptions, BenchTable, spread
from drakeplan.bench.trial import Method, Trial, exact_hessian, free_timing, ours, run_trial
from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.transition_dynamics import TransitionDynamics
from optimization.convex import piqp_adapter
from scenes.robots.robot import Robot, load_robot

Question = tuple[CentroidalProblem, CentroidalOptions]
COLUMNS = (
    "formulation", "solver", "cone", "size", "asked", "succeed", "false claims", "cost", "cost / best", "violation",
    "residual M g", "build CPU ms", "solve CPU ms", "p95 CPU ms", "memory MB",
)  # fmt: skip
TITLE = "Optimisers side by side"
PICTURE = Path("out/optimizers.png")
MAX_SEEDS = 20
TURNS = 3  # of each whole sequence; the least time counts
PEER_LONGEST = {FrictionCone.INNER: 100, FrictionCone.SQUARE: 20}  # intervals: it takes seconds to build for more
NOTES = (
    "succeed: claimed and confirmed on world forces alone; false claims: claimed and refuted. cost: median over what this"
    " row solved; cost / best: median over questions, the best answer of any row with the same cone and timing being 1.",
    "violation: worst constraint over its tolerance among claimed answers, 0 where all hold; residual: Newton and Euler,"
    " summed again here. Times: medians over questions of the least turn; memory: most that the process's peak rose.",
    "free timing: durations within half and twice the given ones, no longer in all; solve contains its programs' building.",
    "second_order with piqp is the 16-gon inscribed in the true cone.",
)


def run(options: BenchOptions) -> BenchTable:
    """`seeds` random transitions of two categories (`MAX_SEEDS` at most), 10 and 31 contacts; the picture goes to out/."""
    robot = load_robot(options.robot)
    trials = centroidal_trials(centroidal_questions(robot, min(options.seeds, MAX_SEEDS)), methods(), options)
    rows = centroidal_rows(trials)
    from drakeplan.bench.whole_body_trials import whole_body_rows  # loads planner and motion: only here

    others, notes = whole_body_rows(robot, options)
    table = BenchTable("optimizers", TITLE, COLUMNS, (*rows, *others), (*NOTES, *notes), most_seeds=MAX_SEEDS)
    if PICTURE.parent.is_dir() or not PICTURE.parent.exists():
        from drakeplan.bench.optimizer_plots import save

        save(table, PICTURE)
    return table


def methods() -> list[Method]:
    """What is compared on centroidal questions, as far as it is installed."""
    found = []
    for cone in (FrictionCone.INNER, FrictionCone.SQUARE, FrictionCone.SECOND_ORDER):
        solvers = ["piqp", "clarabel"] if piqp_adapter.available() else ["clarabel"]
        found += [Method("centroidal", solver, cone, ours(solver)) for solver in solvers]
        if cone in PEER_LONGEST and interior_point.available():
            found.append(Method("centroidal", "ipopt, exact Hessian", cone, exact_hessian(), PEER_LONGEST[cone]))
    return [*found, Method("centroidal, free timing", "auto", DEFAULT_CONE, free_timing("auto"))]


def centroidal_questions(robot: Robot, seeds: int) -> dict[str, list[Question]]:
    """Questions by size: random transitions, a walk over a gap, and a walk down a slope.

    Args:
        robot: for which they are made.
        seeds: random transitions of each category.
    """
    dynamics = TransitionDynamics(robot)
    questions: dict[str, list[Question]] = {}
    for category in ("feet", "one palm"):
        drawn = [random_transition(np.random.default_rng(seed), robot, category) for seed in range(seeds)]
        questions[f"transition, {category}"] = [
            (dynamics.problem(t.before, t.after, t.com, t.linear_momentum), dynamics.options) for t in drawn
        ]
    for size, stances in (("10 contacts", gap_walk()), ("31 contacts", slope_walk(31))):
        chosen = sequence_options(robot, DEFAULT_CONE, "auto")
        questions[size] = [(sequence_problem(robot, stances, chosen), chosen)]
    return questions


def centroidal_trials(
    questions: dict[str, list[Question]], chosen: list[Method], options: BenchOptions
) -> dict[tuple[str, Method], list[Trial]]:
    """Every method on every question that is not too long for it.

    Args:
        questions: by size.
        chosen: the methods.
        options: progress.
    """
    trials: dict[tuple[str, Method], list[Trial]] = {}
    first = next(iter(questions.values()))[0]
    for method in chosen:
        run_trial(method, *first)  # what is loaded and compiled once is not the first question's
    for size, asked in questions.items():
        for method in chosen:
            if method.longest is not None and len(asked[0][0].schedule.dt) > method.longest:
                continue
            turns = TURNS if len(asked) == 1 and method.longest is None else 1
            trials[size, method] = [run_trial(method, *question, turns=turns) for question in asked]
            good = sum(t.claimed and t.holds for t in trials[size, method])
            options.tell(f"{size}: {method.formulation}, {method.solver}, {method.cone}: {good} of {len(asked)}")
    return trials


def centroidal_rows(trials: dict[tuple[str, Method], list[Trial]]) -> list[tuple[object, ...]]:
    """One row for each size and method."""
    return [_row(size, method, found, _best(trials, size, method)) for (size, method), found in trials.items()]


def _best(trials: dict[tuple[str, Method], list[Trial]], size: str, method: Method) -> np.ndarray:
    """(questions,) least cost of a confirmed answer by any method of the same cone and formulation."""
    rivals = [
        [t.cost if t.claimed and t.holds else np.inf for t in found]
        for (other_size, other), found in trials.items()
        if other_size == size and (other.cone, other.formulation) == (method.cone, method.formulation)
    ]
    return np.min(rivals, axis=0)


def _row(size: str, method: Method, found: list[Trial], best: np.ndarray) -> tuple[object, ...]:
    good = np.array([t.claimed and t.holds for t in found])
    cost = np.array([t.cost for t in found])
    claimed = [t for t in found if t.claimed]
    ratio = cost[good] / best[good]
    times = spread([1e3 * t.solve for t in found])
    return (
        method.formulation, method.solver, method.cone, size, len(found), int(good.sum()), len(claimed) - int(good.sum()),
        spread(cost[good].tolist())["median"], spread(ratio.tolist())["median"], max((t.violated for t in claimed), default=np.nan),
        max((t.residual for t in claimed), default=np.nan), spread([1e3 * t.build for t in found])["median"],
        times["median"], times["p95"], float(np.max([t.memory for t in found])),
    )  # fmt: skip
