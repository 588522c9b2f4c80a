"""The queries behind the tables of Lin et al. 2019 sec. VIII: every planner on the rubble scenes, one thread.

A query searches once, for as long as the longest time that is asked about; what it had come to earlier is read off the times
at which its sequences were found. So all planners are compared at equal wall time, on the same seeds.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, cast

import numpy as np

from drakeplan.bench.contact_query import QueryOutcome, run_query
from drakeplan.bench.kept_cases import Case, KeptCases
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.search_planner import SearchSettings
from drakeplan.context import QueryContext
from drakeplan.query.warm_up import warm_up
from learning.surrogate import DynamicsSurrogate, load_surrogate
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_source import load_scene
from scenes.robots.robot import Robot

SCENES = ("rubble_field", "rubble_corridor")
QUASI_STATIC, LEARNED = "quasi-static", "learned"
RAW, EXACT, LAZY = "learned, uncalibrated", "exact, every branch", "exact, when popped"
PLANNERS = (QUASI_STATIC, LEARNED, RAW, EXACT, LAZY)
MAIN = (QUASI_STATIC, LEARNED)  # on all seeds, for fig. 7, 8 and 10; the others on the first `ABLATION_SEEDS`
SHORT, LONG = 2.0, 10.0  # [s] of search; 30 s in Lin et al. 2019 sec. VIII
ABLATION_SEEDS = 6  # that search for `LONG`, all others for `SHORT`
DEADLINE = 30.0  # [s] of search where no sequence was found by then


@dataclass(frozen=True, eq=False)
class Query:
    """One query of one planner.

    Attributes:
        scene, planner, seed: which.
        answer: after `SHORT` seconds of search, or after the first sequence where that came later.
        within: after exactly so many seconds, for every time that the query was searched for.
        asked: transitions whose dynamics were evaluated in the whole search, by "learned" and "exact".
        why: why there is no sequence, "" where there is.
        busy: processor time of the search over its wall time: well below one where others used the machine.
    """

    scene: str
    planner: str
    seed: int
    answer: QueryOutcome
    within: dict[float, QueryOutcome]
    asked: dict[str, int]
    why: str
    busy: float


def all_queries(
    robot: Robot, ik: WholeBodyIK, seeds: int, kept: KeptCases, tell: Callable[[str], None]
) -> list[Query]:  # fmt: skip
    """Queries for seeds 0 to `seeds` - 1 in every scene; one line of progress for each.

    Args:
        robot: that crosses.
        ik: its inverse kinematics.
        seeds: how many.
        kept: cases that are not run again.
        tell: called with one line of progress.
    """
    _load_kernels(robot, ik)
    queries = []
    for scene in SCENES:
        for seed in range(seeds):
            for planner in PLANNERS if seed < ABLATION_SEEDS else MAIN:
                seconds = LONG if seed < ABLATION_SEEDS else SHORT
                key = {"bench": "lin2019", "part": "query", "scene": scene, "planner": planner, "seed": seed,
                       "seconds": seconds, **model_and_weights(robot, planner)}  # fmt: skip
                chosen = planner_options(planner, seed, robot)
                case = kept(key, lambda c=chosen, n=scene, s=seconds: _run(robot, ik, n, c, s))
                queries.append(_query(scene, planner, seed, case))
                tell(_progress(queries[-1]))
    return queries


def planner_options(planner: str, seed: int, robot: Robot) -> tuple[PlannerOptions, SearchSettings]:
    """How each of `PLANNERS` searches.

    Without calibration nothing tells the planner where not to trust its networks either. "Every branch" is as in Lin et al. 2019: a
    program for each new branch; "when popped" is what `--dynamics exact` does.

    Args:
        planner: one of `PLANNERS`.
        seed: of the search.
        robot: whose weights are used.
    """
    options = PlannerOptions(seed=seed, dynamics="exact", footholds="fixed")
    if planner == QUASI_STATIC:
        return replace(options, dynamics="quasi-static"), SearchSettings()
    if planner in (LEARNED, RAW):
        learned, surrogate = replace(options, dynamics="learned"), load_surrogate(robot)
        if planner == RAW:
            return learned, SearchSettings(surrogate=uncalibrated(surrogate), ask_when_far=False)
        return learned, SearchSettings(surrogate=surrogate)
    return options, SearchSettings(window=0) if planner == EXACT else SearchSettings()


def model_and_weights(robot: Robot, planner: str) -> dict[str, str]:
    """What a kept case must have in common with a new one: the robot's model, and the weights of the networks used.

    Args:
        robot: its model is hashed.
        planner: one of `PLANNERS`; those without networks have no weights.
    """
    return {
        "robot": robot.model_sha256,
        "weights": weights_digest(load_surrogate(robot)) if planner in (LEARNED, RAW) else "",
    }


def uncalibrated(surrogate: DynamicsSurrogate) -> DynamicsSurrogate:
    """The same networks with their raw logits: a transition counts as feasible from probability one half."""
    one = np.ones_like(surrogate.scale)
    return replace(surrogate, scale=one, offset=0.0 * one, threshold=0.5 * one)


def weights_digest(surrogate: DynamicsSurrogate) -> str:
    """SHA-256 over all arrays of a surrogate: a kept case is that of these weights only."""
    digest = hashlib.sha256()
    for name, array in sorted(surrogate.tensors().items()):
        digest.update(name.encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def of(queries: Sequence[Query], scene: str, planner: str) -> list[Query]:
    """Those of one planner on one scene, by seed.

    Args:
        queries: of all planners and scenes.
        scene: its name.
        planner: one of `PLANNERS`.
    """
    return sorted((q for q in queries if (q.scene, q.planner) == (scene, planner)), key=lambda q: q.seed)


def mean(values: Sequence[float]) -> float:
    """Of the finite ones; NaN without any."""
    finite = [v for v in values if np.isfinite(v)]
    return float(np.mean(finite)) if finite else float("nan")


def outcome(facts: Any) -> QueryOutcome:
    """An outcome from what JSON made of it."""
    return QueryOutcome(**{**facts, "robustness": tuple(tuple(row) for row in facts["robustness"])})


def _run(
    robot: Robot, ik: WholeBodyIK, scene: str, chosen: tuple[PlannerOptions, SearchSettings], seconds: float
) -> Case:
    context = QueryContext(load_scene(scene, seed=chosen[0].seed), robot, ik, full_soles=True)
    trials = run_query(context, *chosen, seconds=seconds, deadline=DEADLINE)
    first = trials.plans[0].elapsed if trials.plans else 0.0
    times = [s for s in (SHORT, LONG) if s <= seconds]
    return {
        "answer": asdict(trials.within(max(SHORT, first))),
        "within": [[s, asdict(trials.within(s))] for s in times],
        "asked": trials.asked,
        "why": trials.why,
        "busy": trials.busy,
    }


def _query(scene: str, planner: str, seed: int, case: Case) -> Query:
    kept = cast("dict[str, Any]", case)
    within = {float(s): outcome(facts) for s, facts in kept["within"]}
    return Query(scene, planner, seed, outcome(kept["answer"]), within, kept["asked"], kept["why"], kept["busy"])


def _progress(query: Query) -> str:
    most = query.within[max(query.within)]
    return (
        f"{query.scene} seed {query.seed} {query.planner}: {most.found} sequences in {max(query.within):g} s, first "
        f"{query.answer.first_s:.3f} s, first feasible {query.answer.first_feasible_s:.3f} s, tested {most.tested} "
        f"{query.why}"
    ).rstrip()


def _load_kernels(robot: Robot, ik: WholeBodyIK) -> None:
    """Every planner once for a moment, so that no clock sees anything load."""
    warm_up(robot, ik)
    scene = load_scene("rubble_corridor", seed=0)
    for planner in PLANNERS:
        context = QueryContext(scene, robot, ik, full_soles=True)
        run_query(context, *planner_options(planner, 0, robot), seconds=0.0, deadline=0.3).within(np.inf)
