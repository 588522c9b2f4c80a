"""Contact sequences along a guiding path: segment by segment, each in its motion mode and in its own way (Lin 2020 ch. V).

    traversability -> guiding path on SE(2) x modes -> segments -> each by the search or from stored plans -> one sequence

Segments are planned in the order of the path: each begins with the stance in which the one before ended, so that no stance
given beforehand has to be met, as the document's order of exploration (alg. 6) asks for. A segment that fails in its way and
mode is searched in any mode (sec. 5.9); where that fails too, it is joined with the next one, whose end is then the goal.
"""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from drakeplan.contact_planning.contact_domain import PlannerWeights
from drakeplan.contact_planning.contact_plan import ContactPlan, PlannerCounts, PlannerOptions
from drakeplan.contact_planning.planner import ContactPlanner
from drakeplan.contact_planning.search_planner import LIMIT_REACHED, SearchPlanner, SearchSettings
from drakeplan.contact_planning.sequence_check import SequenceCheck
from drakeplan.context import QueryContext
from drakeplan.experience.adapt_planner import AdaptPlanner
from drakeplan.experience.retrieval import usable_modes
from drakeplan.experience.stored_plan import MODE_PALMS, MODES
from drakeplan.guide.guiding_path import GuidingPath, guiding_path
from drakeplan.guide.segments import Decision, Method, Segment, segments
from drakeplan.guide.traversability_map import traversability_map
from drakeplan.search.ana_star import Limits
from scenes.scene import Goal, Start
from scenes.stance import Stance

RADIUS = 0.3  # [m] about the end of a segment that counts as there; Lin 2020 sec. 5.11 has 0.2
MAY = SearchSettings(PlannerWeights(unheld=0.0))  # a mode says which palms may be used, not that they have to be
ANY = -1  # in place of a mode: all palms may serve
SHARE = 0.25  # of the time that is left for one try at a segment
IMPROVE = 0.2  # [s] after the first contacts of a segment for shorter ones
LAST_SHARE = 0.7  # the same for the last resort of all, the search to the goal itself


@dataclass(frozen=True, eq=False)
class _Part:
    """Contacts of one segment, or of several that were joined.

    Attributes:
        first: number of its first segment.
        end: number of the segment after its last one.
        mode: number of its motion mode, or `ANY`.
        method: how it was planned.
        planner: that found it.
        plan: what it found.
        begin: stances of the whole sequence before its first transition, less one.
        stances: from the end of the part before it; palms that it does not begin with are let go first.
    """

    first: int
    end: int
    mode: int
    method: Method
    planner: ContactPlanner
    plan: ContactPlan
    begin: int
    stances: tuple[Stance, ...]


class GuidedPlanner:
    """Plans along a guiding path; see `drakeplan.contact_planning.planner.ContactPlanner`.

    Attributes:
        context: of the query.
        path: of the torso; None where the grid knows no way, and the search has to find one.
        segments: of the path.
        setup_s: seconds to estimate traversability, to find the path and to cut it.
    """

    def __init__(
        self, context: QueryContext, options: PlannerOptions, decision: Decision = "mean", adapt: bool = True
    ) -> None:
        """Finds the guiding path and its segments.

        Args:
            context: of the query.
            options: what is asked of any planner; its estimator and its library.
            decision: whether the mean or the greatest hardness of a segment says how it is planned.
            adapt: whether stored plans may be used.

        Raises:
            InputError: start or goal missing or off the terrain; no traversability weights or stored plans of this robot.
        """
        began = time.perf_counter()
        self.context, self._options = context, options
        modes = tuple(MODES.index(mode) for mode in usable_modes(context, options.use_palms))
        known = traversability_map(context, modes, options.chosen_estimator)
        self.path: GuidingPath | None = None if known is None else guiding_path(known, modes)
        self.segments: list[Segment] = [] if self.path is None else segments(self.path, decision, adapt=adapt)
        if not self.segments:
            self.segments = [Segment(0, 0, ANY, "search")]
        self._check = SequenceCheck(context)
        self._parts: list[_Part] = []
        self._again: _Part | None = None  # whose planner goes on where a transition of it was forbidden
        self._beyond = 0  # segments that were joined: the next part ends no sooner
        self._swing_is_clear: Callable[[Stance, Stance], bool] | None = None
        self._limits, self._clock, self._until = Limits(), time.perf_counter, np.inf
        self._expansions, self._ended_by, self._reason = 0, "", ""
        self._limit = ""  # that ended a try at a segment
        self.setup_s = time.perf_counter() - began

    def start_problem(self) -> str:
        """Why the robot cannot stand at the start, "" if it can."""
        return self._check.start_problem(self.context.start)

    def plans(self, limits: Limits, clock: Callable[[], float] = time.perf_counter) -> Iterator[ContactPlan]:
        """Yields one sequence, if there is one in time; a later call resumes after what was forbidden.

        Args:
            limits: deadline [s], expansions and cancellation.
            clock: gives the time [s]; durations alone matter.
        """
        began = clock()
        self._limits, self._clock, self._expansions, self._ended_by, self._limit = limits, clock, 0, "", ""
        self._until = np.inf if limits.deadline is None else began + limits.deadline
        if self._parts and self._parts[-1].end == len(self.segments):
            self._ended_by = "exhausted"  # it was given already, and nothing was forbidden since
            return
        while not self._parts or self._parts[-1].end < len(self.segments):
            if self._over():
                self._ended_by = self._over()
                return
            first = self._parts[-1].end if self._parts else 0
            part = self._next_part(first)
            if part is not None:
                self._parts.append(part)
                self._beyond = 0
            elif self._parts:
                self._beyond = max(self._beyond, first + 1)
                self._parts.pop()
            else:
                self._ended_by = self._over() or self._limit or "exhausted"
                return
        stances = (self._parts[0].stances[0], *(s for part in self._parts for s in part.stances[1:]))
        origin = tuple(name for part in self._parts for name in part.plan.origin)
        yield ContactPlan(
            stances, (), self._check.cost(stances), None, self._expansions, self.setup_s + clock() - began,
            origin=origin, guide=tuple(self._said(part) for part in self._parts),
        )  # fmt: skip

    def forbid(self, plan: ContactPlan, transition: int) -> None:
        """Forbids a transition that failed a later, stricter check; its segment and those after it are planned again.

        Args:
            plan: the last one that this planner gave.
            transition: k, from stance k to stance k + 1.
        """
        for k, part in enumerate(self._parts):
            if transition < part.begin + len(part.stances) - 1:
                self._again, self._parts = part, self._parts[:k]
                break
        # Several transitions may be refused at once; those of later segments are planned anew anyway.
        again = self._again
        if again is not None and again.begin <= transition < again.begin + len(again.stances) - 1:
            released = len(again.stances) - len(again.plan.stances)
            again.planner.forbid(again.plan, max(transition - again.begin - released, 0))

    def ask_for_swings(self, swing_is_clear: Callable[[Stance, Stance], bool]) -> None:
        """From now on refuses every transition whose foot or palm finds no way past the terrain.

        Args:
            swing_is_clear: whether what moves from one stance to the next finds one.
        """
        self._swing_is_clear = swing_is_clear
        for part in (*self._parts, self._again):
            if part is not None:
                part.planner.ask_for_swings(swing_is_clear)

    def require_static_balance(self, required: bool) -> bool:
        """Changes nothing: every transition passes its critical configurations at rest already.

        Args:
            required: whether it must.
        """
        return False

    def counts(self) -> PlannerCounts:
        """What the last run of `plans` did."""
        return PlannerCounts(self._expansions, self._ended_by)

    def why_not(self) -> str:
        """Why there is no plan, in one line."""
        over = LIMIT_REACHED.get(self._ended_by, "")
        said = f"no contacts along the guiding path of {len(self.segments)} segments"
        return f"{over + ': ' if over else ''}{said}{'; ' + self._reason if self._reason else ''}"

    # Segments --------------------------------------------------------------------------------------------------------

    def _next_part(self, first: int) -> _Part | None:
        """Contacts from where the last part ended to the end of this segment, or of a later one."""
        if self._again is not None and self._again.first == first:
            again, self._again = self._again, None
            found = self._ask(again.planner, SHARE)
            if found is not None:
                stances = (*again.stances[: len(again.stances) - len(again.plan.stances)], *found.stances)
                return dataclasses.replace(again, plan=found, stances=stances)
        self._again = None
        last = len(self.segments)
        for end in range(max(first + 1, self._beyond), last + 1):
            for mode, method in self._tries(first, end):
                if self._over():
                    return None
                share = LAST_SHARE if end == last and mode == ANY else SHARE
                part = self._try(first, end, mode, method, share)
                if part is not None:
                    return part
        return None

    def _tries(self, first: int, end: int) -> list[tuple[int, Method]]:
        """Modes and methods, in the order in which they are tried."""
        segment = self.segments[first]
        if end > first + 1 or segment.mode == ANY:
            return [(ANY, "search")]
        tries: list[tuple[int, Method]] = [(segment.mode, segment.method), (segment.mode, "search"), (ANY, "search")]
        return list(dict.fromkeys(tries))

    def _try(self, first: int, end: int, mode: int, method: Method, share: float) -> _Part | None:
        """Contacts to the end of a segment in one mode and way, None where none are found."""
        begin = sum(len(part.stances) - 1 for part in self._parts)
        before = (self._parts[-1].stances[-1] if self._parts else self.context.start,)
        palms = () if mode == ANY else MODE_PALMS[MODES[mode]]
        if mode != ANY:
            before = self._without_palms(before, palms)
            if not before:
                self._reason = "a palm cannot be let go between two segments"
                return None
        use_palms = self._options.use_palms and (mode == ANY or bool(palms))
        asked = replace(self._options, use_palms=use_palms, lean_on=palms, dynamics="quasi-static")
        context = self._context(before[-1], end)
        planner = AdaptPlanner(context, asked) if method == "adapt" else SearchPlanner(context, asked, MAY)
        if self._swing_is_clear is not None:
            planner.ask_for_swings(self._swing_is_clear)
        if planner.start_problem():
            self._reason = planner.start_problem()
            return None
        found = self._ask(planner, share)
        if found is None:
            self._reason = planner.why_not()
            return None
        stances = (*before[:-1], *found.stances)
        return _Part(first, end, mode, method, planner, found, begin, stances)

    def _ask(self, planner: ContactPlanner, share: float) -> ContactPlan | None:
        """The planner's best sequence within a share of what is left."""
        limits = self._limits
        seconds = None if np.isinf(self._until) else share * max(self._until - self._clock(), 0.0)
        rest = None if limits.expansions is None else max(limits.expansions - self._expansions, 0)
        most = None if rest is None else min(rest, int(np.ceil(share * rest)))
        improve = IMPROVE if limits.expansions is None else 0.0
        asked = Limits(deadline=seconds, expansions=most, improve=improve, stop=limits.stop)
        plans = planner.plans(asked, self._clock)
        best = list(plans)[-1:] if limits.expansions is None else list(itertools.islice(plans, 1))
        found = best[0] if best else None
        counts = planner.counts()
        self._expansions += counts.expansions
        if found is None and counts.ended_by in LIMIT_REACHED:
            self._limit = counts.ended_by
        return found

    def _context(self, start: Stance, end: int) -> QueryContext:
        """The query of one part: from a stance to the end of a segment."""
        whole, goal = self.context, self.context.goal
        if end < len(self.segments) and self.path is not None:
            x, y, z, _ = self.path.poses[self.segments[end - 1].end].tolist()
            goal = Goal((x, y, z), RADIUS)
        kept = {key: made for key, made in whole.made.items() if key.startswith("regions of ")}
        made = {**kept, "packed": whole.packed, "robot_plant": whole.robot_plant, "usable_palms": whole.usable_palms,
                "start": start, "goal": goal}  # fmt: skip
        contacts = tuple(c for c in start.contacts if c is not None)
        mean = start.feet_mean().tolist()
        scene = replace(whole.scene, start=Start((mean[0], mean[1], mean[2]), 0.0, contacts), goal=goal)
        return replace(whole, scene=scene, made=made)

    def _without_palms(self, before: tuple[Stance, ...], palms: tuple[int, ...]) -> tuple[Stance, ...]:
        """The stance and those in which palms are let go that a mode does not have; none where balance forbids it."""
        for e in (2, 3):
            if before[-1].contacts[e] is not None and e not in palms:
                before = (*before, before[-1].replace(e, None))
        return () if self._check.why_it_fails(before) else before

    def _said(self, part: _Part) -> dict[str, object]:
        """What the plan keeps of a part: mode, method, and the guiding path along it [m]."""
        way: list[list[float]] = []
        if self.path is not None:
            steps = self.path.poses[self.segments[part.first].first : self.segments[part.end - 1].end + 1, :3]
            way = np.round(steps, 4).tolist()
        mode = "any" if part.mode == ANY else MODES[part.mode]
        return {"mode": mode, "method": part.method, "stances": len(part.stances) - 1, "way": way}

    def _over(self) -> str:
        """Which limit has fired, "" if none."""
        if self._limits.stop is not None and self._limits.stop():
            return "cancelled"
        if self._clock() >= self._until:
            return "deadline"
        if self._limits.expansions is not None and self._expansions >= self._limits.expansions:
            return "expansions"
        return ""


def build(context: QueryContext, options: PlannerOptions) -> ContactPlanner:
    """The planner "guided" of `drakeplan.contact_planning.planner.PLANNERS`.

    Args:
        context: of the query.
        options: what is asked of it.
    """
    return GuidedPlanner(
        context, options, "mean" if options.guide == "mean" else "max", adapt=options.guide != "segments"
    )
