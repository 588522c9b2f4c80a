"""Contact sequences from mixed-integer programs and graphs of convex sets, for the same motion stage and verifier as search.

A program knows surfaces and reach, not joints, balance or limbs. So every transition of its answer is checked by
inverse kinematics and balance (`transition_check.py`), as the search does with its states; where one fails, the reach on that pair of
surfaces is narrowed, in the end to nothing, and the program is solved again until a sequence passes or time is up.
The programs want the number of contacts (Lin et al. 2019 sec. VIII-C): it starts from the distance and grows.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from drakeplan.contact_planning.contact_domain import PlannerWeights, State
from drakeplan.contact_planning.contact_plan import ContactPlan, PlannerCounts, PlannerOptions
from drakeplan.contact_planning.planner import ContactPlanner
from drakeplan.contact_planning.sequence_check import SequenceCheck, wrap
from drakeplan.context import QueryContext
from drakeplan.search.ana_star import Limits
from optimization.contact_programs.contact_query import ContactEstimate, ContactQuery, FootstepOptions
from optimization.contact_programs.footstep_program import FootstepProgram
from optimization.contact_programs.step_reach import step_reach
from optimization.mixed_integer.solver import MixedIntegerSettings, Progress
from scenes.input_error import unknown_name
from scenes.stance import Stance, changed_effector

ADVANCE = 0.24  # [m] of the mean of the feet per foot contact: a walk at ease, from which the number of contacts starts
MORE_CONTACTS = 4  # added where the program is infeasible
MAX_CONTACTS = 40
SHRINK = 0.8  # the reach on a pair of surfaces is multiplied by this after a failure there,
LEAST_SHARE = 0.5  # and the pair is barred once less than this would be left
PIECE = np.deg2rad(30.0)  # greatest interval of heading
STRAIGHT = np.deg2rad(12.0)  # headings that differ by less are one
PATIENCE = 3.0  # [s] after a first sequence that fails for a better one that passes
LONGEST = 600.0  # [s] of one program where no deadline is given
GAP = 0.05  # relative gap at which the program may stop: what comes of it is judged by others anyway


class _Program(Protocol):
    """What the planner asks of a formulation."""

    def solve(
        self,
        settings: MixedIntegerSettings | None = None,
        on_incumbent: Callable[[Progress, tuple[Stance, ...]], None] | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> ContactEstimate: ...


FORMULATIONS = ("footsteps", "contacts", "gcs")


def _build(formulation: str, query: ContactQuery, options: FootstepOptions) -> _Program:
    """The program of this name; its module is loaded now, since most queries are for the search."""
    if formulation == "contacts":
        from optimization.contact_programs.contact_momentum_program import ContactDynamicsProgram

        return ContactDynamicsProgram(query, options)
    if formulation == "gcs":
        from optimization.contact_programs.convex_set_graph import ConvexSetGraph

        return ConvexSetGraph(query, options)
    return FootstepProgram(query, options)


@dataclass
class SolveCount:
    """What the last run of the planner did, in the terms of a search.

    Attributes:
        expansions: programs solved.
        ended_by: as `AnaStar.ended_by`.
        best_cost: of the sequences found, by the search's own measure (Lin 2020 eq. 3.2).
    """

    expansions: int = 0
    ended_by: str = ""
    best_cost: float = np.inf


@dataclass(frozen=True)
class SolveNote:
    """One program that was solved: for benchmarks and messages."""

    num_contacts: int
    palms: tuple[int, ...]
    solver: str
    status: str
    time: float
    time_to_first: float
    gap: float
    peak_rss_mb: float
    failed: tuple[str, ...] = field(default=())


class _Trial:
    """Checks each incumbent as the solver finds it, and decides when the solver may stop."""

    def __init__(self, why_it_fails: Callable[[tuple[Stance, ...]], list[tuple[int, str]]], limits: Limits) -> None:
        self._why_it_fails, self._limits = why_it_fails, limits
        self._until = np.inf
        self.passed: tuple[Stance, ...] | None = None
        self.failed: tuple[tuple[Stance, ...], list[tuple[int, str]]] | None = None
        self._cost = np.inf

    def judge(self, progress: Progress, stances: tuple[Stance, ...]) -> None:
        """Tests a sequence that is cheaper than those before; the cheapest that passes is kept."""
        if progress.cost >= self._cost and self.passed is not None:
            return
        reasons = self._why_it_fails(stances)
        now = time.perf_counter()
        if reasons:
            self.failed = (stances, reasons)
            self._until = min(self._until, now + PATIENCE)
            return
        if self.passed is None:
            self._until = now + (np.inf if self._limits.improve is None else self._limits.improve)
        self.passed, self._cost = stances, progress.cost

    def stop(self) -> bool:
        """Whether the solver has had its time."""
        asked = self._limits.stop is not None and self._limits.stop()
        return asked or time.perf_counter() > self._until


class ProgramPlanner:
    """Programs that choose all contacts at once; see `drakeplan.contact_planning.planner.ContactPlanner`.

    Attributes:
        context: of the query.
        formulation: "footsteps", "contacts" or "gcs".
        setup_s: seconds to pack the terrain and set the robot down.
        query: what the programs are asked, with what has been learnt about reach.
        notes: every program that was solved.
    """

    def __init__(
        self,
        context: QueryContext,
        formulation: str,
        options: PlannerOptions | None = None,
        weights: PlannerWeights | None = None,
        solver: str = "auto",
    ) -> None:
        """Prepares the programs.

        Args:
            context: of the query.
            formulation: "footsteps", "contacts" or "gcs".
            options: what is asked of any planner.
            weights: of the cost that is reported (Lin 2020 eq. 3.2).
            solver: see `optimization.mixed_integer.solver`.

        Raises:
            InputError: unknown formulation; start or goal missing or off the terrain.
        """
        began = time.perf_counter()
        if formulation not in FORMULATIONS:
            raise unknown_name("planner", formulation, FORMULATIONS)
        self.context, options = context, options or PlannerOptions()
        robot, terrain = context.robot, context.scene.terrain
        self.sequences = SequenceCheck(context, weights)
        reach = step_reach(robot, options.model)
        self.query = ContactQuery(terrain, robot, context.start, context.goal, reach, context.cone)
        self.formulation, self._solver = formulation, solver
        self._failures: dict[str, int] = {}
        self.notes: list[SolveNote] = []
        self._count = SolveCount()
        self._why = "not planned yet"
        self._palms = context.usable_palms if options.use_palms else ()
        choices: list[tuple[int, ...]] = [(), self._palms] if self._palms else [()]
        self._attempts = [(palms, self._least_contacts(palms)) for palms in choices]
        self.setup_s = time.perf_counter() - began

    def start_problem(self) -> str:
        """Why the robot cannot stand at the start, "" if it can."""
        return self.sequences.start_problem(self.context.start)

    def plans(self, limits: Limits, clock: Callable[[], float] = time.perf_counter) -> Iterator[ContactPlan]:
        """Yields one sequence whose transitions all pass the check, if there is one in time; a later call resumes.

        Args:
            limits: deadline [s], number of programs and cancellation, after which it ends.
            clock: gives the time [s]; durations alone matter.
        """
        began = clock()
        self._count = search = SolveCount()
        while self._attempts:
            left = np.inf if limits.deadline is None else limits.deadline - (clock() - began)
            if limits.stop is not None and limits.stop():
                search.ended_by = "cancelled"
            elif left <= 0:
                search.ended_by = "deadline"
            elif limits.expansions is not None and search.expansions >= limits.expansions:
                search.ended_by = "expansions"
            if search.ended_by:
                self._why = (
                    {"deadline": "deadline", "cancelled": "cancelled", "expansions": "expansion budget spent"}[
                        search.ended_by
                    ]
                    + f" after {search.expansions} programs"
                    + self._failure_text()
                )
                return
            found = self._solve(min(left, LONGEST), limits)
            search.expansions += 1
            if found is None:
                continue
            cost = self.sequences.cost(found)
            search.best_cost, search.ended_by = cost, "exhausted"
            states = self._states(found)
            yield ContactPlan(found, states, cost, None, search.expansions, self.setup_s + clock() - began)
            return
        search.ended_by = "exhausted"
        if self._failures:
            self._why = (
                f"no program of up to {MAX_CONTACTS} contacts gives a sequence that passes{self._failure_text()}"
            )

    def forbid(self, plan: ContactPlan, transition: int) -> None:
        """Narrows the reach where a transition failed a later, stricter check, so that the next answer differs.

        Args:
            plan: one that this planner gave.
            transition: k, from stance k to stance k + 1.
        """
        narrowed = self.query.narrowed
        for stance in plan.stances[transition : transition + 2]:
            left, right = stance.contacts[:2]
            assert left is not None
            assert right is not None
            self._narrow(left.surface, right.surface)
        if self.query.narrowed == narrowed and self._attempts:  # nothing is left to narrow: smaller steps
            self._attempts = [*self._attempts[1:], *self._with_more(*self._attempts[0])]

    def ask_for_swings(self, swing_is_clear: Callable[[Stance, Stance], bool]) -> None:
        """From now on refuses every transition whose foot or palm finds no way past the terrain.

        Args:
            swing_is_clear: whether what moves from one stance to the next finds one.
        """
        self.sequences.check.swing_is_clear = swing_is_clear

    def require_static_balance(self, required: bool) -> bool:
        """Changes nothing: every transition passes its critical configurations at rest already.

        Args:
            required: whether it must.
        """
        return False

    def counts(self) -> PlannerCounts:
        """What the last run of `plans` did."""
        return PlannerCounts(self._count.expansions, self._count.ended_by)

    def why_not(self) -> str:
        """Why there is no plan, in one line."""
        return self._why

    # One program ------------------------------------------------------------------------------------------------

    def _solve(self, seconds: float, limits: Limits) -> tuple[Stance, ...] | None:
        """Solves the program in turn; a sequence whose transitions all pass, else None and something was learnt."""
        palms, count = self._attempts[0]
        options = FootstepOptions(
            count, first=self._first_foot(), palms=palms, headings=self._headings(), step=1.0, turn=0.3
        )
        settings = MixedIntegerSettings(self._solver, time_limit=seconds, gap=GAP)
        trial = _Trial(self.sequences.why_it_fails, limits)
        estimate = _build(self.formulation, self.query, options).solve(
            settings, on_incumbent=trial.judge, stop=trial.stop
        )
        if estimate.feasible:
            trial.judge(Progress(0.0, estimate.cost, -np.inf), estimate.stances)
        record = estimate.record
        failed = () if trial.passed else self._learn(trial.failed, palms, count)
        self.notes.append(
            SolveNote(
                count,
                palms,
                record.solver if record else "",
                record.status if record else "infeasible",
                record.time if record else 0.0,
                record.time_to_first if record else np.nan,
                record.gap if record else np.inf,
                record.peak_rss_mb if record else np.nan,
                failed,
            )
        )
        if trial.passed or failed:
            return trial.passed
        self._why = estimate.reason + self._failure_text()
        if not estimate.limited:
            self._attempts = [*self._attempts[1:], *self._with_more(palms, count)]
        return None

    def _learn(
        self, failed: tuple[tuple[Stance, ...], list[tuple[int, str]]] | None, palms: tuple[int, ...], count: int
    ) -> tuple[str, ...]:
        """Narrows the reach where the best sequence failed; takes more contacts where it cannot be narrowed further."""
        if failed is None:
            return ()
        narrowed = self.query.narrowed
        stances, reasons = failed
        for k, reason in reasons:
            self._failures[reason] = self._failures.get(reason, 0) + 1
            for stance in stances[k : k + 2]:
                left, right = stance.contacts[:2]
                assert left is not None
                assert right is not None
                self._narrow(left.surface, right.surface)
        if self.query.narrowed == narrowed:
            self._attempts = [*self._attempts[1:], *self._with_more(palms, count)]
        return tuple(reason for _, reason in reasons)

    @staticmethod
    def _with_more(palms: tuple[int, ...], count: int) -> list[tuple[tuple[int, ...], int]]:
        """The attempt with more contacts, unless there would be too many."""
        more = count + MORE_CONTACTS * (1 + bool(palms))
        return [(palms, more)] if more <= MAX_CONTACTS else []

    def _narrow(self, left: int, right: int) -> None:
        share = SHRINK * self.query.narrowed.get((left, right), 1.0)
        if share < LEAST_SHARE:
            share = LEAST_SHARE if left == right else 0.0  # one may always shuffle where both feet stand on one surface
        self.query = replace(self.query, narrowed={**self.query.narrowed, (left, right): share})

    def _failure_text(self) -> str:
        counts = ", ".join(f"{name} {count}" for name, count in sorted(self._failures.items()))
        return f"; transitions that failed by: {counts}" if counts else ""

    # Geometry ---------------------------------------------------------------------------------------------------

    def _least_contacts(self, palms: tuple[int, ...]) -> int:
        """Contacts with which the programs begin: whole pairs of foot contacts, and the palms between them."""
        feet = self.context.start.feet_mean()[:2]
        distance = max(float(np.hypot(*(np.array(self.context.goal.xyz[:2]) - feet))) - self.context.goal.radius, 0.0)
        steps = 2 * int(np.ceil(distance / ADVANCE / 2.0)) + 2
        return min(steps + steps // 2 * len(palms), MAX_CONTACTS)

    def _first_foot(self) -> int:
        """The foot that is farther from the goal moves first."""
        goal = np.array(self.context.goal.xyz[:2])
        left, right = (float(np.hypot(*(c.p_WC[:2] - goal))) for c in self.query.feet)
        return 0 if left >= right else 1

    def _headings(self) -> tuple[tuple[float, float], ...]:
        """Intervals of heading from the start's by way of the goal's direction to the goal's own."""
        yaw = self.query.feet[0].heading
        ahead = np.array(self.context.goal.xyz[:2]) - self.context.start.feet_mean()[:2]
        wanted = [yaw, yaw + wrap(np.arctan2(ahead[1], ahead[0]) - yaw)]
        if np.hypot(*ahead) < 1.0:
            wanted = [yaw]  # near goals are reached sideways
        if self.context.goal.yaw is not None:
            wanted.append(yaw + wrap(self.context.goal.yaw - yaw))
        low, high = min(wanted), max(wanted)
        if high - low < STRAIGHT:
            return ((yaw, yaw),)
        pieces = int(np.ceil((high - low) / PIECE))
        edges = np.linspace(low, high, pieces + 1)
        return tuple(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))

    # The search's measures ----------------------------------------------------------------------------------------

    def _states(self, stances: tuple[Stance, ...]) -> tuple[State, ...]:
        moved = [-1, *(changed_effector(a, b) for a, b in itertools.pairwise(stances))]
        states: list[State] = []
        for stance, mover in zip(stances, moved, strict=True):
            a, b, c, d = self.sequences.held(stance)
            states.append((a, b, c, d, mover))
        return tuple(states)


def build_footsteps(context: QueryContext, options: PlannerOptions) -> ContactPlanner:
    """The planner "footsteps" of `drakeplan.contact_planning.planner.PLANNERS`.

    Args:
        context: of the query.
        options: what is asked of it.
    """
    return ProgramPlanner(context, "footsteps", options)


def build_contacts(context: QueryContext, options: PlannerOptions) -> ContactPlanner:
    """The planner "contacts" of `drakeplan.contact_planning.planner.PLANNERS`.

    Args:
        context: of the query.
        options: what is asked of it.
    """
    return ProgramPlanner(context, "contacts", options)


def build_convex_set_graph(context: QueryContext, options: PlannerOptions) -> ContactPlanner:
    """The planner "gcs" of `drakeplan.contact_planning.planner.PLANNERS`.

    Args:
        context: of the query.
        options: what is asked of it.
    """
    return ProgramPlanner(context, "gcs", options)
