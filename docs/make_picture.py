"""Makes the picture of the README: plans across the rubble corridor and photographs the page (`make picture`).

It takes the first seed whose plan is complete and leans on a palm, and the middle of the longest time that a palm is
held. Chromium must be installed (Debian: apt-get install chromium).

    .venv/bin/python docs/make_picture.py                     # plans, then docs/picture.png
    .venv/bin/python docs/make_picture.py PLAN.h5 [SECONDS]   # of a plan that there is, at a time of choice
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

import drakeplan
from drakeplan.playback.picture import take_picture

PICTURE = Path(__file__).with_name("picture.png")
SCENE, SEEDS = "rubble_corridor", range(20)
SIZE = (1600, 850)


def main() -> None:
    """Writes the picture and says from what."""
    if len(sys.argv) > 1:
        plan = drakeplan.read_plan(sys.argv[1])
    else:
        plan = plan_with_a_palm()
    time = float(sys.argv[2]) if len(sys.argv) > 2 else middle_of_the_longest_palm_contact(plan)
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "plan.html"
        drakeplan.write_page(plan, page)
        take_picture(page, PICTURE, time=time, size=SIZE)
    print(f"{PICTURE}: {plan.scene_name} at {time:.1f} s of {plan.duration:.1f} s, {plan.provenance.get('command')}")


def plan_with_a_palm() -> drakeplan.Plan:
    """The first complete plan that uses a palm."""
    robot = drakeplan.load_robot("escher")
    for seed in SEEDS:
        options = drakeplan.PlanOptions(seed=seed, command=f"drakeplan plan {SCENE} --seed {seed}")
        result = drakeplan.plan_scene(drakeplan.load_scene(SCENE, seed=seed), robot, options)
        print(f"seed {seed}: {result.status} {result.reason}, palms {result.report['palms_used']}", file=sys.stderr)
        if result.status == "complete" and result.plan is not None and result.report["palms_used"]:
            return result.plan
    sys.exit(f"no complete plan with a palm among the seeds {SEEDS[0]} to {SEEDS[-1]} of {SCENE}")


def middle_of_the_longest_palm_contact(plan: drakeplan.Plan) -> float:
    """Time in the plan's motion [s]; the middle of the motion when no palm is used."""
    assert plan.phases is not None
    palms = [e for e, name in enumerate(plan.effectors) if name.endswith("_palm")]
    best = (0.0, plan.duration / 2)
    for contact in np.unique(plan.phases.contact[:, palms]):
        held = (plan.phases.contact[:, palms] == contact).any(axis=1)
        if contact >= 0:
            start, end = plan.phases.start[held].min(), plan.phases.end[held].max()
            best = max(best, (float(end - start), float(start + end) / 2 - float(plan.phases.start[0])))
    return best[1]


if __name__ == "__main__":
    main()
