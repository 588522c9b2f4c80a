"""Plans against pushes, and how likely they are to arrive: Lin 2020 fig. 7.7, every push tried by the exact question."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from drakeplan.bench.kept_rows import KeptRows
from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.campaigns.push_trials import PushTrialsCampaign, columns_of, file_sha256, region_of
from drakeplan.plan.plan_file import write_plan
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.robustness.moments import moments_of
from drakeplan.robustness.push_trial import SAMPLES
from drakeplan.robustness.report import report_of
from drakeplan.timing.step_timing import WALKING
from scenes.files.scene_source import load_scene
from scenes.robots.robot import Robot, load_robot

SCENES = {  # and how many draws it has
    "narrow_flat": 1,
    "rubble_with_wall": 5,
    "oil_platform": 1,
    "oil_platform_y": 1,
}
WAYS: dict[str, dict[str, object]] = {
    "baseline": {"capture": "worst-case", "odds": "off"},
    "swing, documented": {"capture": "swing", "odds": "poses"},
    "worst-case, documented": {"capture": "worst-case", "odds": "poses"},
    "swing": {"capture": "swing"},
    "worst-case": {"capture": "worst-case"},
}
PUBLISHED = {  # Lin 2020 fig. 7.7: P_success [%], failed pairs of all
    ("narrow_flat", "baseline"): "83.5",
    ("narrow_flat", "swing, documented"): "92.8",
    ("narrow_flat", "worst-case, documented"): "91.4",
    ("rubble_with_wall", "baseline"): "79.8",
    ("rubble_with_wall", "swing, documented"): "95.8",
    ("rubble_with_wall", "worst-case, documented"): "97.1",
    ("oil_platform", "baseline"): "92.0",
    ("oil_platform", "swing, documented"): "100",
    ("oil_platform", "worst-case, documented"): "99.7",
    ("oil_platform_y", "baseline"): "86.0",
    ("oil_platform_y", "swing, documented"): "81.5",
    ("oil_platform_y", "worst-case, documented"): "86.9",
}
IMPROVE, DEADLINE = (
    20.0,
    120.0,
)  # [s] of improvement after the first contacts, and of the whole query; the document: 60 s
KEPT = Path("out/robustness.jsonl")


def run(options: BenchOptions) -> BenchTable:
    """Every way on every scene; a run that was stopped goes on from out/robustness.jsonl."""
    robot = load_robot(options.robot)
    kept = KeptRows(KEPT)
    rows = []
    for name, draws in SCENES.items():
        for way, asked in WAYS.items():
            results = []
            for seed in range(min(options.seeds, draws)):
                key = f"{options.robot} {name} {seed} {way}"
                if key not in kept.rows:
                    kept.add(key, _trial(name, seed, robot, asked))
                row = kept.rows[key]
                options.tell(f"{name} {seed} {way}: {row['status']} P_success {row['p_success']}")
                results.append(row)
            rows.append(_row(name, way, results))
    columns = ("scene", "way", "verified", "fell in swings", "in double support", "steps", "first s", "search s",
               "P_success %", "as the search saw it %", "Lin 2020 %")  # fmt: skip
    notes = (
        f"{IMPROVE:g} s of improvement (Lin 2020: 60 s in all), timing 0.6 s and 0.4 s, feet alone; every push at every 0.1 s of the "
        f"verified plan by the exact question, up to {SAMPLES} capture poses each, the likeliest first.",
        "Baseline: no capture cost (w_cap = 0). Documented: networks and count of poses of Lin 2020 sec. 7.6, 7.7.1. The others: "
        "ensembles, motions counted once, double support too.",
        "Fell: moments and pushes without a capture, of all, means over the draws. The published robot weighs 63.5 kg, this one 76: "
        "the same impulses change its velocity less; its checks bound angular momentum, the published ones do not.",
    )
    return BenchTable("robustness", "Plans under pushes", columns, tuple(rows), notes, most_seeds=max(SCENES.values()))


def _row(name: str, way: str, results: list[dict]) -> tuple[object, ...]:
    done = [row for row in results if row["status"] == "complete"]

    def mean(key: str) -> float:
        values = [row[key] for row in done if row[key] is not None]
        return float(np.mean(values)) if values else float("nan")

    p = [100.0 * row["p_success"] for row in done]
    spread = f" ± {np.std(p):.1f}" if len(p) > 1 else ""
    success = f"{np.mean(p):.1f}{spread}" if p else "-"
    fell = [f"{mean(f'{part}_failed'):.3g} of {mean(f'{part}_pairs'):.3g}" for part in ("swing", "double")]
    published = PUBLISHED.get((name, way), "")
    return (
        name, way, f"{len(done)} of {len(results)}", *fell, mean("steps"), mean("first_s"), mean("best_s"), success,
        100.0 * mean("predicted"), published,
    )  # fmt: skip


def _trial(name: str, seed: int, robot: Robot, asked: dict[str, object]) -> dict:
    """Plans one scene one way and tries every push."""
    scene = load_scene(name, seed=seed)
    options = PlanOptions(timing=WALKING, improve=IMPROVE, deadline=DEADLINE, **asked)  # type: ignore[arg-type]
    result = plan_scene(scene, robot, options)
    report = result.report
    facts: dict = {"status": result.status, "reason": result.reason, "p_success": None}
    if result.plan is None or result.status != "complete":
        return facts
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "plan.h5")
        write_plan(result.plan, path)
        regions = tuple(region_of(d) for d in scene.disturbances)
        campaign = PushTrialsCampaign(path, file_sha256(path), robot.name, regions, SAMPLES)
        tasks = range(campaign.num_tasks())
        tried = [row for k in tasks for row in campaign.rows(np.random.SeedSequence(0, spawn_key=(k, 0)), k)]
    found = report_of(moments_of(result.plan), columns_of(tried), campaign.parameters)
    told = found.as_dict()
    parts = {}
    for part, key in (("swing", "swing"), ("double", "double_support")):
        numbers = told[key]
        assert isinstance(numbers, dict)
        parts |= {f"{part}_{what}": numbers[what] for what in ("pairs", "failed")}
    return (
        facts
        | parts
        | {
            "p_success": told["p_success"],
            "steps": int(str(report["stances"])) - 1,
            "first_s": report["time_to_first_s"],
            "best_s": report["planning_s"],
            "predicted": report["predicted_success"],
        }
    )
