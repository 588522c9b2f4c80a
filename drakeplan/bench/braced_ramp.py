"""A wheeled robot that walks along a wall with its palms: standard heuristic beside traversability (Lin 2020 sec. 5.10)."""

from __future__ import annotations

from pathlib import Path

from drakeplan.bench.table import BenchOptions, BenchTable, middle_and_high
from drakeplan.bracing.braced_planner import BracedPlan, Heuristic, plan_braced
from drakeplan.bracing.bracer import Bracer
from drakeplan.bracing.page import write_braced_page
from scenes.library.braced_ramp import braced_ramp

MOST_SEEDS = 50
DEADLINE = 30.0  # [s]
PAGE = Path("out/braced_ramp.html")
WAYS: dict[str, tuple[Heuristic, str]] = {
    "standard": ("grid", "3.52 s, 8 steps"),
    "traversability": ("traversability", "0.11 s, 10 steps"),
}


def run(options: BenchOptions) -> BenchTable:
    """Every way on every draw of the wall's tilts."""
    bracer = Bracer()
    plan_braced(braced_ramp(0), bracer, "traversability")  # compiled before the clock runs
    found: dict[str, list[BracedPlan | None]] = {way: [] for way in WAYS}
    for seed in range(min(options.seeds, MOST_SEEDS)):
        for way, (heuristic, _) in WAYS.items():
            found[way].append(plan_braced(braced_ramp(seed), bracer, heuristic, seed, DEADLINE))
        options.tell(f"seed {seed}: {', '.join(f'{way} {_said(plans[-1])}' for way, plans in found.items())}")
    rows = []
    for way, (_, documented) in WAYS.items():
        plans = [plan for plan in found[way] if plan is not None]
        search = [plan.seconds - plan.checked_s for plan in plans]
        steps = [plan.steps for plan in plans]
        rows.append((way, len(found[way]), len(plans), *middle_and_high(search),
                     middle_and_high([plan.seconds for plan in plans])[0],
                     middle_and_high([plan.expansions for plan in plans])[0],
                     f"{min(steps)} to {max(steps)}" if steps else "", documented))  # fmt: skip
    shown = next((plan for plan in found["traversability"] if plan is not None), None)
    if shown is not None:
        write_braced_page(shown, braced_ramp(found["traversability"].index(shown)), PAGE)
    columns = (
        "heuristic",
        "walls",
        "planned",
        "median s",
        "p95 s",
        "with Drake's checks s",
        "expansions",
        "steps",
        "Lin 2020",
    )
    notes = (
        "Seconds of set-up and search; Drake's inverse kinematics and a linear program then check every step.",
        f"The first plan is drawn in {PAGE}. The document's wall and robot are known from a picture: sizes and tilts here are ours.",
    )
    title = "A wheeled robot braced on a wall along a steep ramp"
    return BenchTable("braced_ramp", title, columns, tuple(rows), notes, most_seeds=MOST_SEEDS)


def _said(plan: BracedPlan | None) -> str:
    return "none" if plan is None else f"{plan.steps} steps {plan.seconds:.2f} s"
