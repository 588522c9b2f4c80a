"""Contact sequences from a library: stored plans laid on the terrain, fitted to it and checked (Lin 2020 ch. IV, sec. 5.8).

    rank plans by their distance from the terrain -> fit one -> check its transitions -> a sequence, or the next plan

A plan is fitted in one of two ways. First every contact goes to the nearest point of its region and the sequence is judged by
the search's own checks: milliseconds. Plans for which that fails get the documented elastic strip afterwards, which moves
contacts and postures together: about a second each. A way that is bent, or longer than any plan, is covered by several plans,
one for each straight piece of it; the library is asked again from where the one before ends (sec. 5.8.2).
"""

from __future__ import annotations

import itertools
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from drakeplan.contact_planning.contact_domain import is_at_goal
from drakeplan.contact_planning.contact_plan import ContactPlan, PlannerCounts, PlannerOptions
from drakeplan.contact_planning.planner import ContactPlanner
from drakeplan.contact_planning.sequence_check import SequenceCheck, feet_heading
from drakeplan.context import QueryContext
from drakeplan.experience import strip_setup
from drakeplan.experience.alignment import RegionTable, align
from drakeplan.experience.fit import Fit
from drakeplan.experience.key_motion import KeyMotion
from drakeplan.experience.library import Library
from drakeplan.experience.plan_distance import PlanBatch, distances
from drakeplan.experience.retrieval import Candidate, candidates, usable_modes
from drakeplan.experience.shipped import library_folder
from drakeplan.experience.stored_plan import Outline
from drakeplan.experience.strip_setup import Sampling, goal_gathering
from drakeplan.experience.terrain_regions import TURN, TerrainRegions
from drakeplan.experience.turn import turn_towards
from drakeplan.experience.way import next_place, torso_way
from drakeplan.search.ana_star import Limits
from optimization.elastic_strip.problem import StripOptions
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.stance import Stance

FARTHEST = 0.5  # [m] distance (Lin 2020 eq. 4.4) beyond which a region is no place for a contact
REPAIRS = {"projection": 12, "strip": 4}  # times that contacts of one plan are sent elsewhere
ROUND = 60  # plans that are projected before the strip is tried on the same ones
STRIP_SECONDS = 3.0  # [s] of one strip
MOST_PARTS = 12  # plans in a row
PIECE_RADIUS = 0.3  # [m] how near a plan comes to the end of a piece of the way
PARTS_TRIED = 6  # plans tried for each part of a way that no plan covers alone


class Part(NamedTuple):
    """A stored plan that a sequence was made of.

    Attributes:
        name: of the plan.
        distance: from the terrain before it was fitted, Xi of Lin 2020 eq. 4.8 [m].
        way: how it was fitted, "projection" or "strip".
    """

    name: str
    distance: float
    way: str


class AdaptPlanner:
    """Retrieves and adapts; see `drakeplan.contact_planning.planner.ContactPlanner`.

    Attributes:
        context: of the query.
        setup_s: seconds to open the library, to find contact regions and to rank plans.
        retrieved: the stored plans that the last sequence was made of, one after the other.
    """

    def __init__(self, context: QueryContext, options: PlannerOptions) -> None:
        """Opens the library.

        Args:
            context: of the query.
            options: what is asked of any planner; its library, and how plans are fitted.

        Raises:
            InputError: no library, or one of another robot; start or goal missing or off the terrain.
        """
        began = time.perf_counter()
        self.context, self._options = context, options
        self._ways_to_fit = ("projection", "strip") if options.fit == "quick" else ("strip",)
        self._balanced = options.fit != "strip_ends"
        self._way = torso_way(context)
        modes = usable_modes(context, options.use_palms)
        with Library(library_folder(context.robot, options.library), context.robot) as self._library:
            self._entries = [entry for mode in modes for entry in self._library.entries(mode)]
        self._check = SequenceCheck(context)
        self._refused: list[int] = []
        self._failures: Counter[str] = Counter()
        self._tried = self._attempts = 0
        self._ended_by, self._until = "", np.inf
        self._limits, self._clock = Limits(), time.perf_counter
        self._sequences = self._ways((context.start,), ())
        self.retrieved: tuple[Part, ...] = ()
        self.setup_s = time.perf_counter() - began

    def start_problem(self) -> str:
        """Why the robot cannot stand at the start, "" if it can."""
        return self._check.start_problem(self.context.start)

    def plans(self, limits: Limits, clock: Callable[[], float] = time.perf_counter) -> Iterator[ContactPlan]:
        """Yields one sequence whose transitions all pass the check, if there is one in time; a later call resumes.

        Args:
            limits: deadline [s], number of attempts and cancellation, after which it ends.
            clock: gives the time [s]; durations alone matter.
        """
        began = clock()
        self._limits, self._clock, self._attempts = limits, clock, 0
        self._until = np.inf if limits.deadline is None else began + limits.deadline
        found = next(self._sequences, None)
        if found is None:
            self._ended_by = self._over() or "exhausted"
            return
        self._ended_by = "exhausted"
        elapsed = self.setup_s + clock() - began
        origin = tuple(part.name for part in self.retrieved)
        yield ContactPlan(found, (), self._check.cost(found), None, self._attempts, elapsed, origin=origin)

    def forbid(self, plan: ContactPlan, transition: int) -> None:
        """Sends the contacts of a transition that failed a later, stricter check elsewhere.

        Args:
            plan: the last one that this planner gave.
            transition: k, from stance k to stance k + 1.
        """
        self._refused.append(transition)

    def ask_for_swings(self, swing_is_clear: Callable[[Stance, Stance], bool]) -> None:
        """From now on refuses every transition whose foot or palm finds no way past the terrain.

        Args:
            swing_is_clear: whether what moves from one stance to the next finds one.
        """
        self._check.check.swing_is_clear = swing_is_clear

    def require_static_balance(self, required: bool) -> bool:
        """Changes nothing: every transition passes its critical configurations at rest already.

        Args:
            required: whether it must.
        """
        return False

    def counts(self) -> PlannerCounts:
        """What the last run of `plans` did."""
        return PlannerCounts(self._attempts, self._ended_by)

    def why_not(self) -> str:
        """Why there is no plan, in one line."""
        if not self._entries:
            return f"the library {self._library.path} holds no plan of a motion mode that this query can use"
        why = ", ".join(f"{name} {count}" for name, count in self._failures.most_common())
        over = {"deadline": "deadline", "cancelled": "cancelled", "expansions": "budget spent"}.get(self._ended_by)
        said = f"{over} after {self._tried}" if over else f"no stored plan fits: {self._tried}"
        return f"{said} of {len(self._entries)} plans tried{f', refused by: {why}' if why else ''}"

    # Sequences -------------------------------------------------------------------------------------------------------

    def _ways(self, before: tuple[Stance, ...], parts: tuple[Part, ...]) -> Iterator[tuple[Stance, ...] | None]:
        """Whole sequences that begin with these stances; None whenever the time is over."""
        if len(parts) >= MOST_PARTS:
            return
        feet = np.array([c.p_WC for c in before[-1].contacts[:2] if c is not None])
        place, is_last = next_place(self.context, self._way, feet.mean(axis=0))
        radius = self.context.goal.radius if is_last else PIECE_RADIUS
        before = turn_towards(self.context, before, place)
        feet = np.array([c.p_WC for c in before[-1].contacts[:2] if c is not None])
        turns = {"projection": 0.0, "strip": TURN}  # a strip may turn feet, and needs regions where it can
        terrain = {way: TerrainRegions(self.context, feet, place, turns[way]) for way in self._ways_to_fit}
        table = terrain[self._ways_to_fit[0]].table(self._options.use_palms)
        found = candidates(self._entries, table, feet, place, radius)
        # Strips are too slow where several plans are needed.
        ways = self._ways_to_fit if is_last and not parts else self._ways_to_fit[:1]
        if parts:
            found = itertools.islice(found, PARTS_TRIED)
        for candidate, way in _in_rounds(found, ways):
            part = Part(candidate.entry.name, candidate.distance, way)
            arrives = is_last and candidate.reaches
            for stances in self._adapted(candidate, way, before, terrain[way], arrives):
                if stances is None:
                    yield None
                elif arrives:
                    self.retrieved = (*parts, part)
                    yield stances
                else:
                    yield from self._ways(stances, (*parts, part))

    def _adapted(
        self, candidate: Candidate, way: str, before: tuple[Stance, ...], terrain: TerrainRegions, arrives: bool
    ) -> Iterator[tuple[Stance, ...] | None]:
        """Sequences that one stored plan gives in turn, after these stances; None whenever the time is over."""
        while self._over():
            yield None
        self._tried += way == self._ways_to_fit[0]
        try:
            motion = self._library.plan(candidate.entry.name).key_motion()
        except InputError:  # its file was damaged after it had been added; the others are as good as before
            self._failures["damaged file"] += 1
            return
        motion = motion.until(candidate.end).placed(candidate.X_WL)
        before = _without_palms(before, motion.stances[0])
        if not before:
            self._failures["palms at its start"] += 1
            return
        fit = self._fit(motion, arrives, before[-1], terrain)
        if fit.problem:
            self._failures["no region"] += 1
            return
        for _ in range(1 + REPAIRS[way]):
            while self._over():
                yield None
            self._attempts += 1
            stances = self._place(fit, way)
            if stances is None:
                if not (fit.leave_gatherings() if way == "projection" else fit.leave_broken_places()):
                    return
                continue
            bad = self._failed_transitions(stances, arrives)
            if not bad:
                self._refused = []
                whole = (*before, *stances[1:])
                yield whole
                offset = len(before) - 1
                bad = [k - offset for k in self._refused if offset <= k < len(whole) - 1]
                self._failures.update(["motion"] * bool(bad))
            if not bad or not fit.leave_transitions(bad):
                return

    def _failed_transitions(self, stances: Sequence[Stance], arrives: bool) -> list[int]:
        """The transitions that fail the search's check; the last one where its feet are not in the goal."""
        failed = self._check.why_it_fails(stances)
        self._failures.update({reason for _, reason in failed})
        bad = [k for k, _ in failed]
        if arrives and not is_at_goal(self.context.goal, stances[-1].feet_mean(), feet_heading(stances[-1])):
            self._failures["goal"] += 1
            bad.append(len(stances) - 2)
        return sorted(set(bad))

    def _fit(self, motion: KeyMotion, arrives: bool, start: Stance, terrain: TerrainRegions) -> Fit:
        """The plan where it was laid, its first contacts where the robot stands."""
        fixed = {int(c): start.contacts[e] for e, c in enumerate(motion.stances[0]) if c >= 0}
        return Fit(
            motion,
            self.context,
            Sampling(FARTHEST, TURN),
            StripOptions(turn=TURN),
            gatherings=goal_gathering(motion, self.context.goal) if arrives else (),
            fixed={c: contact for c, contact in fixed.items() if contact is not None},
            balanced=self._balanced,
            terrain=terrain,
        )

    def _place(self, fit: Fit, way: str) -> list[Stance] | None:
        """The contacts in their places, None where they find none together."""
        if way == "projection":
            stances = fit.project()
            self._failures.update(["goal"] * (stances is None))
            return stances
        strip = fit.solve(min(STRIP_SECONDS, max(self._until - self._clock(), 0.1)))
        if strip.feasible:
            return fit.stances()
        self._failures[f"strip: {strip.faults[0].task}"] += 1
        return None

    def _over(self) -> str:
        """Which limit has fired, "" if none."""
        if self._limits.stop is not None and self._limits.stop():
            return "cancelled"
        if self._clock() >= self._until:
            return "deadline"
        if self._limits.expansions is not None and self._attempts >= self._limits.expansions:
            return "expansions"
        return ""


def _without_palms(before: tuple[Stance, ...], first: np.ndarray) -> tuple[Stance, ...]:
    """The stances, and those that follow when palms are let go that a plan does not begin with; none where it begins with more.

    Args:
        before: stances so far.
        first: (4,) contacts of the plan's first stance, -1 where free.
    """
    for e, contact in enumerate(before[-1].contacts):
        if contact is None and first[e] >= 0:
            return ()
        if contact is not None and first[e] < 0:
            before = (*before, before[-1].replace(e, None))
    return before


def _in_rounds(found: Iterator[Candidate], ways: Sequence[str]) -> Iterator[tuple[Candidate, str]]:
    """Some plans in one way, the same in the next, then the next plans."""
    while True:
        some = list(itertools.islice(found, ROUND))
        if not some:
            return
        yield from ((candidate, way) for way in ways for candidate in some)


def warm_up(robot: Robot, ik: WholeBodyIK) -> None:
    """Loads the compiled kernels of retrieval and of the elastic strip.

    Args:
        robot: whose kernels are loaded.
        ik: its inverse kinematics.
    """
    strip_setup.warm_up(robot, ik)
    point = np.zeros((2, 3))
    outline = Outline(point, np.eye(4)[[0, 0]], np.array([0, 1]), np.zeros(2, np.int64), np.array([0.0, 1.0]))
    plans = PlanBatch.of([outline])
    distances(outline, plans)
    align(plans, np.array([1]), RegionTable.of({}), point, np.array([1.0, 0.0]), 0.2)


def build(context: QueryContext, options: PlannerOptions) -> ContactPlanner:
    """The planner "adapt" of `drakeplan.contact_planning.planner.PLANNERS`.

    Args:
        context: of the query.
        options: what is asked of it.
    """
    return AdaptPlanner(context, options)
