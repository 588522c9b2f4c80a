"""Nothing is compiled while a query's clock runs: the first one on a machine would spend its whole deadline on that."""

from __future__ import annotations

import subprocess
import sys

import pytest

FRESH = """
import sys
from numba.core.dispatcher import Dispatcher
from drakeplan.contact_planning.contact_plan import PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.context import QueryContext
from drakeplan.motion.maker import MotionMaker
from drakeplan.search.ana_star import Limits
from drakeplan.query.warm_up import warm_up
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.robots.robot import load_robot
from scenes.files.scene_source import load_scene

def compiled():
    ours = [m for name, m in list(sys.modules.items()) if name.split(".")[0] in ("drakeplan", "learning", "optimization", "scenes")]
    return {(f.py_func.__module__, f.py_func.__name__, str(s)) for m in ours for f in vars(m).values()
            if isinstance(f, Dispatcher) for s in f.signatures}

robot = load_robot("escher")
ik = WholeBodyIK(robot)
warm_up(robot, ik)
before = compiled()
assert before
for name in ("rubble_corridor", "stairs"):
    context = QueryContext(load_scene(name, seed=0), robot, ik)
    planner = SearchPlanner(context, PlannerOptions(dynamics=sys.argv[1]))
    plans = list(planner.plans(Limits(expansions=100)))
    assert plans
    MotionMaker(context).run(plans[-1].stances[:4], lambda event: None)
print(*sorted(compiled() - before), sep="\\n", end="")
"""


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", ["quasi-static", "learned"])
def test_search_and_motion_after_the_warm_up_compile_and_load_no_kernel(dynamics: str) -> None:
    fresh = subprocess.run([sys.executable, "-c", FRESH, dynamics], capture_output=True, text=True, timeout=300)
    assert fresh.returncode == 0, fresh.stderr
    assert fresh.stdout == ""


WHOLE = """
from drakeplan.deadline import compile_clock
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from scenes.files.scene_source import load_scene
from scenes.robots.robot import load_robot

result = plan_scene(load_scene("flat"), load_robot("escher"), PlanOptions(start=(0, 0, 0), goal=(1, 0)))
print(result.status, compile_clock.seconds())
"""


@pytest.mark.slow
def test_a_start_and_goal_in_whole_numbers_compile_no_kernel() -> None:
    fresh = subprocess.run([sys.executable, "-c", WHOLE], capture_output=True, text=True, timeout=300)
    assert fresh.stdout.split() == ["complete", "0.0"], fresh.stderr
