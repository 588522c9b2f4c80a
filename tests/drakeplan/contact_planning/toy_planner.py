"""A planner from outside the package: short steps straight ahead, whatever the ground is like."""

from __future__ import annotations

import numpy as np

from drakeplan.contact_planning.contact_plan import ContactPlan, PlannerCounts, PlannerOptions
from drakeplan.context import QueryContext
from scenes.effector import EFFECTORS
from scenes.footholds.projection import set_down

STEP = 0.15  # [m] by which the mean of the feet advances


class StraightAhead:
    """Finds one sequence or none."""

    def __init__(self, context: QueryContext) -> None:
        self.context, self.setup_s = context, 0.0
        self.asked: list[str] = []
        self._found = False

    def start_problem(self) -> str:
        return ""

    def plans(self, limits, clock=None):
        self.asked.append("plans")
        if self._found:
            return
        context, robot = self.context, self.context.robot
        stances, foot = [context.start], 0
        far = context.goal.xyz[0] - context.goal.radius / 2
        while stances[-1].feet_mean()[0] < far:
            other = stances[-1].contacts[1 - foot].p_WC
            x, y = other[0] + STEP, stances[-1].contacts[foot].p_WC[1]
            made = set_down(context.packed, EFFECTORS[foot], x, y, 0.0, robot.effectors[foot].half_extent)
            if made is None:
                return
            stances.append(stances[-1].replace(foot, made))
            foot = 1 - foot
        self._found = True
        cost = float(np.linalg.norm(stances[-1].feet_mean() - stances[0].feet_mean()))
        yield ContactPlan(tuple(stances), ((),) * len(stances), cost, None, 1, 0.0)

    def forbid(self, plan, transition) -> None:
        self.asked.append(f"forbid {transition}")

    def ask_for_swings(self, swing_is_clear) -> None:
        self.asked.append("swings")

    def require_static_balance(self, required: bool) -> bool:
        self.asked.append(f"static balance {required}")
        return False

    def why_not(self) -> str:
        return "no ground straight ahead"

    def counts(self) -> PlannerCounts:
        return PlannerCounts(1, "exhausted")


def build(context: QueryContext, options: PlannerOptions) -> StraightAhead:
    """The planner for a query."""
    return StraightAhead(context)
