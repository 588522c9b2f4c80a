"""One contact planning query as Lin et al. 2019 count it: search, then the program of the whole sequence, last result first."""

from __future__ import annotations

import time
from dataclasses import dataclass

from drakeplan.contact_planner import ContactPlan, ContactPlanner, ContactPlannerOptions
from drakeplan.search.ana_star import Limits
from drakeplan.sequence_dynamics import sequence_dynamics
from optimization.centroidal_estimate import CentroidalEstimate
from optimization.whole_body_ik import WholeBodyIK
from scenes.robot import Robot
from scenes.scene import Scene
from scenes.transition_model import transition_model


@dataclass(frozen=True, eq=False)
class QueryResult:
    """What came of one query.

    Attributes:
        plans: contact sequences in the order in which they were found.
        first_s: seconds until the first of them; NaN where there is none.
        first_feasible_s: seconds of search and queries until the first that proves dynamically feasible.
        confirm_s: seconds of the program that proved it.
        chosen: the last that is dynamically feasible, None where none is.
        tested: sequences whose program was solved until that one was found, from the last to the first.
        estimate: its dynamics.
        dynamics_s: seconds of the program that found them.
        why: why there is none, "" where there is.
        asked: transitions judged, by who answered.
    """

    plans: tuple[ContactPlan, ...]
    first_s: float
    first_feasible_s: float
    confirm_s: float
    chosen: ContactPlan | None
    tested: int
    estimate: CentroidalEstimate | None
    dynamics_s: float
    why: str
    asked: dict[str, int]

    def palms_used(self) -> bool:
        """Whether the chosen sequence makes a palm contact."""
        return self.chosen is not None and self.chosen.palms_used > 0


def run_query(
    scene: Scene, robot: Robot, ik: WholeBodyIK, options: ContactPlannerOptions, *, deadline: float, improve: float | None,
    steps: str | None = None,
) -> QueryResult:  # fmt: skip
    """Searches, and solves the dynamics of what was found.

    Args:
        deadline: of the search [s].
        improve: seconds of search after the first sequence, None: until the deadline.
        steps: foot transition model, None for the scene's or the usual one.
    """
    model = transition_model(steps or scene.transition_model or "experiments")
    planner = ContactPlanner(scene, robot, ik, options, model)
    plans = tuple(planner.plans(Limits(deadline=deadline, improve=improve)))
    asked = dict(planner.dynamic.evaluator.asked) if planner.dynamic is not None else {}
    answers: dict[int, tuple[CentroidalEstimate, float]] = {}

    def solve(k: int) -> CentroidalEstimate:
        if k not in answers:
            began = time.perf_counter()
            answers[k] = sequence_dynamics(robot, plans[k].stances, options.cone), time.perf_counter() - began
        return answers[k][0]

    last = next((k for k in reversed(range(len(plans))) if solve(k).feasible), None)
    tested = len(answers)
    first = next((k for k in range(len(plans)) if solve(k).feasible), None) if last is not None else None
    why = "" if last is not None else (answers[0][0].reason if plans else planner.why_not())
    nothing = float("nan")
    return QueryResult(
        plans,
        plans[0].elapsed if plans else nothing,
        plans[first].elapsed if first is not None else nothing,
        answers[first][1] if first is not None else nothing,
        plans[last] if last is not None else None,
        tested,
        answers[last][0] if last is not None else None,
        answers[last][1] if last is not None else nothing,
        why,
        asked,
    )
