"""The plans that figures are drawn of, made once and kept in build/figures."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from make_picture import plan_with_a_palm

import drakeplan
from scenes.files.scene_file import scene_from_yaml
from scenes.scene import Scene

KEPT = Path(__file__).resolve().parents[1] / "build" / "figures"
ROBOT = drakeplan.load_robot("escher")


@cache
def planned(scene: str, planner: str = "search") -> drakeplan.Plan:
    """A plan, made once: of seed 0, or of the first seed that leans on a palm."""
    path = KEPT / f"{scene}.h5"
    if not path.is_file():
        KEPT.mkdir(parents=True, exist_ok=True)
        if scene == "rubble_corridor":
            plan = plan_with_a_palm()
        else:
            options = drakeplan.PlanOptions(seed=0, planner=planner)
            plan = drakeplan.plan_scene(drakeplan.load_scene(scene, seed=0), ROBOT, options).plan
        if plan is None:
            raise SystemExit(f"{scene}: no plan")
        drakeplan.write_plan(plan, path)
    return drakeplan.read_plan(path)


def scene_of(plan: drakeplan.Plan) -> Scene:
    """The scene as it was planned."""
    return scene_from_yaml(plan.scene_yaml, plan.scene_name)


def palm_stance(plan: drakeplan.Plan) -> int:
    """A stance with a palm and both feet."""
    return next(
        k for k in range(len(plan.stances)) if (plan.stances[k, :2] >= 0).all() and (plan.stances[k, 2:] >= 0).any()
    )
