"""What estimates of traversability are worth to the search, and what they cost (Lin & Berenson 2017 fig. 7 and 8).

Three parallel corridors of tilted quadrilaterals, some too sparse to be crossed. The first table asks for contacts alone, since
that is what the heuristic changes; the second for the whole verified plan. The third has the regressors on held-out scenes.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from drakeplan.bench.kept_rows import KeptRows
from drakeplan.bench.table import BenchOptions, BenchTable, middle_and_high
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.guide.ground_view import MODEL, GroundView, documented_steps
from drakeplan.query.one_planner import load_kernels
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.search.ana_star import Limits
from learning.traversability import KINDS, load_traversability
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.library import three_corridors
from scenes.robots.robot import Robot, load_robot
from scenes.scene import Scene
from scenes.transition_model import transition_model

MOST_SEEDS = 100
DENSITY = (1.5, 8.0)  # quadrilaterals per square metre, drawn for each seed
CONTACTS_WITHIN = 5.0  # [s] for contacts; Lin & Berenson 2017 allowed 300
DEADLINE = 30.0  # [s] of the whole query
KEPT = Path("out/traversability.jsonl")
STANDARD = "standard"
WAYS: dict[str, dict[str, str]] = {
    **{f"{STANDARD}, fixed steps": {"footholds": "fixed"}},
    **{f"{kind}, fixed steps": {"footholds": "fixed", "estimator": kind} for kind in KINDS[:0:-1]},
    f"{STANDARD}, footholds": {"footholds": "snapped"},
    "acc-svr, footholds": {"footholds": "snapped", "estimator": "acc-svr"},
    "network, footholds": {"footholds": "snapped", "estimator": "network"},
}
WHOLE: dict[str, dict[str, str]] = {"search": {}, "search with traversability": {"heuristic": "traversability"}}


def run(options: BenchOptions) -> tuple[BenchTable, ...]:
    """All tables; a run that was stopped goes on from out/traversability.jsonl."""
    robot = load_robot(options.robot)
    ik = WholeBodyIK(robot)
    load_kernels(robot, ik, "guided", lambda event: None)
    kept = KeptRows(KEPT)
    contacts: dict[str, list[dict]] = {way: [] for way in WAYS}
    whole: dict[str, list[dict]] = {way: [] for way in WHOLE}
    for seed in range(min(options.seeds, MOST_SEEDS)):
        scene = draw(seed)
        for way, asked in WAYS.items():
            key = f"{options.robot} {seed} {way}"
            if key not in kept.rows:
                kept.add(key, _contacts(scene, robot, ik, seed, asked))
            contacts[way].append(kept.rows[key])
        for way, asked in WHOLE.items():
            key = f"{options.robot} {seed} whole {way}"
            if key not in kept.rows:
                result = plan_scene(scene, robot, PlanOptions(seed=seed, deadline=DEADLINE, **asked))  # type: ignore[arg-type]
                numbers = {name: result.report[name] for name in ("total_s", "stances", "time_to_first_s")}
                kept.add(key, {"status": result.status, "reason": result.reason, **numbers})
            whole[way].append(kept.rows[key])
        found = [way for way, rows in contacts.items() if rows[-1]["found"]]
        options.tell(f"seed {seed}: contacts by {len(found)} of {len(WAYS)} ways")
    return _by_contacts(contacts), _by_verified(whole), _by_regressor(robot)


def draw(seed: int) -> Scene:
    """The scene of one seed."""
    rng = np.random.default_rng([seed, 17])
    return three_corridors.sparse(rng, float(rng.uniform(*DENSITY)))


def _contacts(scene: Scene, robot: Robot, ik: WholeBodyIK, seed: int, asked: dict[str, str]) -> dict:
    """Whether a search finds contacts, and the seconds until then, the estimates included."""
    context = QueryContext(scene, robot, ik)
    snapped = asked["footholds"] == "snapped"
    options = PlannerOptions(
        seed=seed,
        heuristic="traversability" if "estimator" in asked else "grid",
        model=transition_model("experiments" if snapped else MODEL),
        longer=transition_model("long_stride") if snapped else None,
        **asked,  # type: ignore[arg-type]
    )
    began = time.perf_counter()
    planner = SearchPlanner(context, options)
    limits = Limits(deadline=max(CONTACTS_WITHIN - (time.perf_counter() - began), 0.0), improve=0.0)
    plan = next(iter(planner.plans(limits)), None)
    seconds = time.perf_counter() - began
    stances = 0 if plan is None else len(plan.stances)
    return {"found": plan is not None, "s": seconds, "setup_s": planner.setup_s,
            "expansions": planner.counts().expansions, "stances": stances}  # fmt: skip


def _by_contacts(found: dict[str, list[dict]]) -> BenchTable:
    rows = []
    some = [any(rows[k]["found"] for rows in found.values()) for k in range(len(found[next(iter(WAYS))]))]
    for way, results in found.items():
        done = [row for row in results if row["found"]]
        standard = found[f"{STANDARD}, {way.split(', ')[1]}"]
        first = sum(_beats(row, other) for row, other in zip(results, standard, strict=True))
        second = sum(_beats(other, row) for row, other in zip(results, standard, strict=True))
        overall = float(np.mean([row["s"] if row["found"] else CONTACTS_WITHIN for row in results]))
        rows.append((way, sum(some), len(done), *middle_and_high([row["s"] for row in done]), overall,
                     middle_and_high([row["setup_s"] for row in results])[0],
                     middle_and_high([row["expansions"] for row in done])[0],
                     middle_and_high([row["stances"] for row in done])[0], f"{first} : {second}"))  # fmt: skip
    columns = ("heuristic", "scenes", "found", "median s", "p95 s", "mean s over all", "set-up s", "expansions", "stances",
               "faster : slower")  # fmt: skip
    notes = (
        f"Three corridors of {DENSITY[0]:g} to {DENSITY[1]:g} quadrilaterals a m2; contacts, quasi-static, within "
        f"{CONTACTS_WITHIN:g} s; scenes that any way solved; what was not found counts {CONTACTS_WITHIN:g} s in the mean over all.",
        "Faster : slower: scenes in which a heuristic is faster than the standard one with the same footholds, and the reverse.",
        "Lin & Berenson 2017 fig. 7, 8 (other scenes, 300 s): ACC with SVR best, 19 % more successes and 24 % less time than the "
        "standard heuristic; ECC with nearest neighbours below it.",
    )
    return BenchTable(
        "traversability", "Traversability as a heuristic: contacts", columns, tuple(rows), notes, most_seeds=MOST_SEEDS
    )


def _beats(row: dict, other: dict) -> bool:
    return bool(row["found"] and (not other["found"] or row["s"] < other["s"]))


def _by_verified(found: dict[str, list[dict]]) -> BenchTable:
    rows = []
    for way, results in found.items():
        done = [row for row in results if row["status"] == "complete"]
        rows.append((way, len(results), len(done), *middle_and_high([row["total_s"] for row in done]),
                     middle_and_high([row["time_to_first_s"] for row in done])[0],
                     middle_and_high([row["stances"] for row in done])[0]))  # fmt: skip
    columns = ("way", "queries", "verified", "median s", "p95 s", "first contacts s", "stances")
    notes = (f"The same scenes; `drakeplan plan` with --deadline {DEADLINE:g}, motion and verification included.",)
    title = "Traversability as a heuristic: verified plans"
    return BenchTable(
        "traversability_verified", title, columns, tuple(rows), notes, bench="traversability", most_seeds=MOST_SEEDS
    )


def _by_regressor(robot: Robot) -> BenchTable:
    """Held-out errors as the cards have them, and times measured now."""
    view, torso = _poses(robot)
    rows = []
    for kind in KINDS:
        known = load_traversability(robot, MODEL, kind)
        held_out = known.card["held_out"]
        errors = [float(np.mean(list(held_out[key].values()))) for key in ("cost_error", "count_error", "rank")]
        rows.append((kind, known.card["footholds"], *errors, _microseconds(view, torso, known.exact)))
    columns = ("regressor", "labels", "error of exp(-n)", "error of log(1+n)", "rank correlation", "features us")
    notes = (
        "n: useful pairs of feet; errors and Spearman's rank correlation on held-out environments, mean over the motion modes.",
        "Features: microseconds for one torso pose and one translation (ACC) or direction (ECC), palms included. Lin & Berenson "
        "2017: 300 and 16 000.",
    )
    return BenchTable("traversability_regressors", "Regressors of traversability", columns, tuple(rows), notes,
                      bench="traversability", most_seeds=0)  # fmt: skip


def _poses(robot: Robot) -> tuple[GroundView, np.ndarray]:
    """Torso poses in the middle of the named scene's corridors."""
    context = QueryContext(three_corridors.named(0), robot, WholeBodyIK(robot))
    model, steps = documented_steps(robot)
    rng = np.random.default_rng(0)
    low, high = np.array([1.3, -2.5]), np.array([4.1, 2.5])
    torso = np.column_stack([rng.uniform(low, high, (400, 2)), np.zeros(400), rng.uniform(-np.pi, np.pi, 400)])
    return GroundView(context.packed, robot, steps, model.rays, low, high), torso


def _microseconds(view: GroundView, torso: np.ndarray, exact: bool) -> float:
    """For one pose and translation, or direction."""
    each = len(set(view.steps.direction_of_translation.tolist())) if exact else len(view.steps.translations)
    best = np.inf
    for _ in range(3):
        began = time.perf_counter()
        if exact:
            view.exact(torso)
        else:
            view.scores(torso)
            view.palm_scores(torso)
        best = min(best, time.perf_counter() - began)
    return 1e6 * best / (len(torso) * each)
