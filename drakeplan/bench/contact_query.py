"""One contact planning query as Lin et al. 2019 count it: search, then the program of the whole sequence, last result first."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drakeplan.bench.momentum_columns import COLUMNS, robustness_sums
from drakeplan.contact_planning.contact_plan import ContactPlan, PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner, SearchSettings
from drakeplan.contact_planning.sequence_dynamics import sequence_dynamics, sequence_problem
from drakeplan.context import QueryContext
from drakeplan.search.ana_star import Limits
from optimization.balance.friction import FrictionCone
from optimization.centroidal.estimate import CentroidalEstimate
from scenes.robots.robot import Robot
from scenes.transition_model import transition_model

NOTHING = float("nan")


@dataclass(frozen=True)
class QueryOutcome:
    """The results of a query after some seconds of search.

    Attributes:
        found: contact sequences.
        first_s: seconds of search and queries until the first of them; NaN where there is none.
        first_feasible_s: until the first that proves dynamically feasible; NaN where none does.
        confirm_s: seconds of the program that proved it.
        tested: sequences whose program was solved, from the last to the first, until one was feasible.
        objective: of the dynamics of that one, which the query returns; NaN where there is none.
        predicted: sum of its transitions' objectives as the search saw them; NaN where it saw none.
        first_objective, first_predicted: those of the first feasible sequence, NaN where it is the same.
        palms: whether it makes a palm contact.
        transitions: in it.
        robustness: (2, 8) sums and numbers of its samples (`robustness_sums`).
    """

    found: int = 0
    first_s: float = NOTHING
    first_feasible_s: float = NOTHING
    confirm_s: float = NOTHING
    tested: int = 0
    objective: float = NOTHING
    predicted: float = NOTHING
    first_objective: float = NOTHING
    first_predicted: float = NOTHING
    palms: bool = False
    transitions: int = 0
    robustness: tuple[tuple[float, ...], ...] = ((0.0,) * len(COLUMNS),) * 2

    @property
    def feasible(self) -> bool:
        """Whether the query returns a dynamically feasible sequence."""
        return bool(np.isfinite(self.objective))


class SequenceTrials:
    """Contact sequences in the order in which they were found; the program of each is solved once, on first use.

    Attributes:
        plans: the sequences.
        why: why there are none, "" where there are.
        asked: transitions whose dynamics were evaluated, by "learned" and "exact".
        busy: processor time of the search over its wall time.
    """

    def __init__(
        self, robot: Robot, cone: FrictionCone, plans: Sequence[ContactPlan], why: str = "", asked: dict[str, int] | None = None,
        busy: float = NOTHING,
    ) -> None:  # fmt: skip
        """Keeps the sequences; no program is solved yet.

        Args:
            robot: of the query.
            cone: friction cone of every contact.
            plans: the sequences, in the order in which they were found.
            why: why there are none, "" where there are.
            asked: number of transitions whose dynamics were evaluated, by "learned" and "exact".
            busy: processor time of the search over its wall time.
        """
        self.robot, self.cone, self.plans = robot, cone, tuple(plans)
        self.why, self.asked, self.busy = why, asked or {}, busy
        self._answers: dict[int, tuple[CentroidalEstimate, float]] = {}

    def estimate(self, k: int) -> CentroidalEstimate:
        """The dynamics of sequence k from rest to rest."""
        if k not in self._answers:
            began = time.perf_counter()
            estimate = sequence_dynamics(self.robot, self.plans[k].stances, self.cone)
            self._answers[k] = estimate, time.perf_counter() - began
        return self._answers[k][0]

    @property
    def last_program_s(self) -> float:
        """Seconds of the program of the last sequence that was solved and is feasible; NaN where none is."""
        times = [seconds for _, (estimate, seconds) in sorted(self._answers.items()) if estimate.feasible]
        return times[-1] if times else NOTHING

    def within(self, seconds: float) -> QueryOutcome:
        """The results of the search after so many seconds."""
        found = [k for k, plan in enumerate(self.plans) if plan.elapsed <= seconds]
        if not found:
            return QueryOutcome()
        first_s = self.plans[0].elapsed
        last = next((k for k in reversed(found) if self.estimate(k).feasible), None)
        if last is None:
            return QueryOutcome(len(found), first_s, tested=len(found))
        first = next(k for k in found if self.estimate(k).feasible)
        chosen, estimate = self.plans[last], self.estimate(last)
        assert estimate.trajectory is not None
        schedule = sequence_problem(self.robot, chosen.stances).schedule
        sums = robustness_sums(schedule, estimate.trajectory, self.robot.mass, self.robot.half_extents)
        return QueryOutcome(
            found=len(found),
            first_s=first_s,
            first_feasible_s=self.plans[first].elapsed,
            confirm_s=self._answers[first][1],
            tested=len(found) - found.index(last),
            objective=float(estimate.cost),
            predicted=_predicted(chosen),
            first_objective=float(self.estimate(first).cost) if first != last else NOTHING,
            first_predicted=_predicted(self.plans[first]) if first != last else NOTHING,
            palms=chosen.palms_used > 0,
            transitions=len(chosen.stances) - 1,
            robustness=tuple(tuple(row) for row in sums.tolist()),
        )


def _predicted(plan: ContactPlan) -> float:
    return NOTHING if plan.predicted_effort is None else float(plan.predicted_effort)


def run_query(
    context: QueryContext,
    options: PlannerOptions,
    settings: SearchSettings | None = None,
    *,
    seconds: float,
    deadline: float,
) -> SequenceTrials:
    """Searches for so many seconds; where there is no sequence by then, on until the first or the deadline.

    Args:
        context: scene, robot and cone; packing of the terrain counts unless it was done before.
        options: what is asked of any planner; the transition model is the scene's.
        settings: of the search.
        seconds: of search [s].
        deadline: most seconds until the first sequence [s].
    """
    began, cpu = time.perf_counter(), time.process_time()
    model = transition_model(context.scene.transition_model or "experiments")
    planner = SearchPlanner(context, replace(options, model=model), settings)
    plans: list[ContactPlan] = []

    def enough() -> bool:
        return bool(plans) and time.perf_counter() - began >= seconds

    for plan in planner.plans(Limits(deadline=deadline, stop=enough)):
        plans.append(plan)
    busy = (time.process_time() - cpu) / (time.perf_counter() - began)
    asked, why = dict(planner.counts().transitions_judged), "" if plans else planner.why_not()
    return SequenceTrials(context.robot, context.cone, plans, why, asked, busy)
