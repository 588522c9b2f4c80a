"""One query with one planner, in six steps: search, dynamics of the whole sequence, motion, verification, execution, bar.

    search -> whole-sequence dynamics -> motion -> verification (-> execution in physics) -> complete plan
      ^                                    |            |                |
      +------------- bar <-----------------+------------+----------------+

What a later step refuses is forbidden for the planner (`bar`), and the search resumes with its earlier results.
"""

from __future__ import annotations

import dataclasses
import json
import time
from typing import TYPE_CHECKING, Literal

from drakeplan.contact_planning.contact_plan import ContactPlan
from drakeplan.contact_planning.planner import ContactPlanner, planner_entry
from drakeplan.contact_planning.sequence_dynamics import sequence_dynamics
from drakeplan.context import QueryContext
from drakeplan.deadline import OutOfTimeError
from drakeplan.motion.assembly import assemble_plan
from drakeplan.motion.check import excess
from drakeplan.motion.course_dynamics import ComCourse
from drakeplan.motion.maker import MotionMaker, MotionOptions, MotionResult
from drakeplan.plan.plan import Plan, tabulate_stances
from drakeplan.plan.robot_of_plan import ROBOT_FILE
from drakeplan.plan.verified import verify_plan
from drakeplan.progress import Progress, ProgressEvent
from drakeplan.query.options import PlanOptions
from drakeplan.query.record import QueryRecord, SearchClock
from drakeplan.query.refusal import Refusal
from drakeplan.query.result import PlanResult, Status
from drakeplan.search.ana_star import Limits
from drakeplan.verifier import Report
from scenes.stance import Stance

if TYPE_CHECKING:
    from drakeplan.execution import ExecutionReport

# Times a limit of the motion stage that its worst problem may be; the verifier's own limits are a little wider.
WORTH_VERIFYING = 1.3
MAX_BLOCKED = 40  # refusals of swings that have no way past the terrain: they cost nothing and are no repairs
Rest = Literal["first", "only", "never"]
IMPROVE = 1.0  # [s] after the first plan, of planners that cannot count their work
IMPROVE_EXPANSIONS, MOST_IMPROVE = (
    150,
    0.15,
)  # nodes after the first plan, and the share of the deadline that they may take
STATIC_SHARE = 0.5  # of the time for searching after which a search that also asks for static balance gives up


class Query:
    """Repeats search, dynamics, motion and verification until a plan is verified or a limit is reached.

    Attributes:
        refusal: the last one of motion or verification, None before.
    """

    def __init__(
        self,
        context: QueryContext,
        options: PlanOptions,
        planner: ContactPlanner,
        record: QueryRecord,
        tell: Progress,
        rest: Rest = "first",
    ) -> None:
        """Begins a query.

        Args:
            context: of the query.
            options: what the user chose.
            planner: finds the contacts.
            record: numbers of the query; kept up to date.
            tell: told what goes on.
            rest: whether the robot shall be able to rest between transitions: asked for at first, always or never.
        """
        self.context, self.options, self.planner = context, options, planner
        self.record, self.tell, self.rest = record, tell, rest
        self.refusal: Refusal | None = None
        self._sequence: ContactPlan | None = None  # the one whose motion is made
        self._infeasible: Refusal | None = None  # the last sequence whose whole dynamics were infeasible
        # CoM of the sequences whose whole dynamics are feasible
        self._courses: dict[tuple[Stance, ...], ComCourse] = {}
        self._makers: dict[bool, MotionMaker] = {}
        self._clock, self._rounds = SearchClock(), 0
        # whether a sequence without places to rest is asked for where there is none with them
        self._may_move_on = False
        self._rests = False  # whether the search with learned dynamics asks for places to rest

    def _maker(self, sequence: ContactPlan) -> MotionMaker:
        """The motion stage, made when the first sequence needs it.

        What may have a part of the deadline alone, because the feet could walk past, has the whole of it where it uses no
        palms: the feet would walk no other way.
        """
        whole = self.context.deadline.whole if not sequence.palms_used else None
        maker = self._makers.get(whole is None)
        if maker is None:
            timing = self.options.timing
            wanted = MotionOptions(
                dt=timing.step or MotionOptions.dt, shift=timing.shift, swing=timing.swing, free=timing.free
            )
            context = self.context if whole is None else self.context.until(whole)
            maker = self._makers[whole is None] = MotionMaker(context, wanted)
        return maker

    def run(self, search_for: float, max_repairs: int) -> PlanResult:
        """The verified plan, or the result of the step that failed.

        Args:
            search_for: seconds of search at most, all rounds together; the query's deadline may end it earlier.
            max_repairs: times that a refused sequence is forbidden and the search resumes.
        """
        try:
            return self._repeat(search_for, max_repairs)
        except OutOfTimeError as over:
            self.record.limits_fired.append(self.context.deadline.why())
            self.refusal = Refusal("motion", str(over), self._sequence) if self._sequence else self.refusal
            return self._incomplete()

    def _repeat(self, search_for: float, max_repairs: int) -> PlanResult:
        self._may_move_on = self.planner.require_static_balance(self.rest != "never") and self.rest == "first"
        self._rests = self.rest != "never" and self.record.dynamics == "learned"
        began, repairs = self.record.planning_s, 0
        for _ in range(max_repairs + MAX_BLOCKED):
            sequence = self._sequence = self._search(began, search_for)
            if sequence is None:
                break
            motion = self._make_motion(sequence)
            plan, verification = self._verify(sequence, motion)
            if plan is not None and verification is not None and verification.holds:
                played = self._play(plan) if self.options.simulate else None
                if played is None or played.reached:
                    return self._result("complete", "", _with_execution(plan, played), verification)
                self.refusal = Refusal.of_execution(sequence, motion, verification, played)
            else:
                self.refusal = Refusal.of_motion(sequence, motion, verification)
            if motion.alike:  # the robot cannot walk as it is described: other contacts fail as these do
                break
            repairs += not motion.blocked
            if repairs > max_repairs or not self._bar(self.refusal):
                break
        return self._incomplete()

    # 1 Search ------------------------------------------------------------------------------------------------------

    def _search(self, began: float, search_for: float) -> ContactPlan | None:
        """The best sequence whose whole dynamics are feasible; without static balance where there is none with it.

        Dynamics alone allow what the legs can often not follow; a robot that can also rest at both ends of each transition
        can nearly always be moved. Once a sequence without rest was needed the search does not go back.
        """
        share = STATIC_SHARE if self._may_move_on and not self._rounds else 1.0
        sequence = self._last_feasible(self._incumbents(began + share * search_for))
        if sequence is None and self._may_move_on and self.planner.require_static_balance(False):
            self._rests = False
            sequence = self._last_feasible(self._incumbents(began + search_for))
        if sequence is not None:
            contacts, _ = tabulate_stances(sequence.stances)
            self.record.cost, self.record.bound = sequence.cost, sequence.bound
            self.record.contacts, self.record.stances = len(contacts), len(sequence.stances)
            self.record.palms_used = sequence.palms_used
            self.record.adapted_from = list(sequence.origin)
            self.record.guide = [dict(segment) for segment in sequence.guide]
            self.record.predicted_success = sequence.predicted_success
        return sequence

    def _incumbents(self, until: float) -> list[ContactPlan]:
        """The sequences of one round of search, best last; it ends where the record has so many seconds of search."""
        left, share = (max(seconds, 0.0) for seconds in (self.context.deadline.left(), until - self.record.planning_s))
        counts = self._counts_improvement
        limits = Limits(
            deadline=left if counts else min(left, share),
            first_within=share if counts else None,
            expansions=self.options.expansions,
            improve=self._improve_for(),
            improve_expansions=IMPROVE_EXPANSIONS if counts else None,
            stop=self.options.stop,
        )
        self._rounds += 1
        found: list[ContactPlan] = []
        began = self._clock()
        for plan in self.planner.plans(limits, self._clock):
            if self.record.time_to_first_s is None:
                self.record.time_to_first_s = plan.elapsed
            self.tell(ProgressEvent("search", "", plan.cost, plan.bound, plan.expansions, self._clock() - began))
            found.append(plan)
            if self._needs_test(plan) and not self._courses:
                self._whole_sequence_feasible(plan)
        self.record.planning_s += self._clock() - began
        counts = self.planner.counts()
        self.record.expansions += counts.expansions
        if counts.transitions_judged:
            self.record.transitions_judged = dict(counts.transitions_judged)
        if counts.ended_by != "exhausted":
            self.record.limits_fired.append(counts.ended_by)
        return found

    def _improve_for(self) -> float | None:
        """Seconds of improvement; None where a budget of expansions must give the same plan on any machine.

        A round after a refusal takes its first plan, but against pushes the first plan is the one that does not mind them.
        """
        if self.options.expansions is not None:
            return None
        improve = IMPROVE if self.options.improve is None else self.options.improve
        if not self._rounds:
            return MOST_IMPROVE * self.options.deadline if self._counts_improvement else improve
        return 0.0 if self.options.capture == "none" else improve / 2.0

    @property
    def _counts_improvement(self) -> bool:
        """Whether nodes, not seconds, end the improvement, so that the same seed gives the same plan.

        Then the query's share of time is for the first plan alone: how far the improvement got by its end would depend on the
        machine. The seconds that remain are a bound for slow ones.
        """
        options = self.options
        default = options.improve is None and options.expansions is None and options.capture == "none"
        return default and options.planner == "search"

    # 2 Dynamics of the whole sequence --------------------------------------------------------------------------------

    def _last_feasible(self, found: list[ContactPlan]) -> ContactPlan | None:
        """The last sequence whose whole dynamics are feasible, from the last to the first (Lin et al. 2019 sec. VI)."""
        for plan in reversed(found):
            if not self._needs_test(plan) or self._whole_sequence_feasible(plan):
                return plan
        return None

    def _needs_test(self, plan: ContactPlan) -> bool:
        """Whether its transitions may be feasible one by one alone; between places to rest one does not depend on another."""
        return plan.predicted_com is not None and not self._rests

    def _whole_sequence_feasible(self, plan: ContactPlan) -> bool:
        """Whether transitions that are feasible one by one are so in a row (Lin et al. 2019 sec. VI)."""
        if plan.stances in self._courses:
            return True
        self._clock.pause()
        began = time.perf_counter()
        estimate = sequence_dynamics(
            self.context.robot, plan.stances, self.context.cone, self.options.timing, self.context.reserve
        )
        self.record.sequences_tested += 1
        self.record.dynamics_s += time.perf_counter() - began
        if not estimate.feasible:
            self._infeasible = Refusal("dynamics", estimate.reason, plan)
        elif self.record.time_to_first_feasible_s is None:
            self.record.time_to_first_feasible_s = plan.elapsed + self.record.dynamics_s
        if estimate.feasible and estimate.trajectory is not None:
            self._courses[plan.stances] = ComCourse(estimate.trajectory.t, estimate.trajectory.com)
        self._clock.resume()
        return estimate.feasible

    # 3 Motion ------------------------------------------------------------------------------------------------------

    def _make_motion(self, sequence: ContactPlan) -> MotionResult:
        """The motion over places where the robot can rest; where there is none, along the CoM of the whole dynamics."""
        stances, record = sequence.stances, self.record
        if self.options.keep is not None:
            self.options.keep(self._assemble(sequence, None), self.record.as_dict("contacts", "", None))
        self.tell(ProgressEvent("dynamics", f"{len(stances)} stances", sequence.cost, sequence.bound))
        maker = self._maker(sequence)
        motion = maker.run(stances, self.tell)
        moves = motion.centroidal is None and not motion.blocked and sequence.predicted_com is not None
        if moves and self._whole_sequence_feasible(sequence):
            moving = maker.run(stances, self.tell, self._courses[stances])
            motion = min(moving, motion, key=lambda m: (not m.ok, m.centroidal is None, excess(m.problems)))
        record.dynamics_s += motion.timings.get("dynamics_s", 0.0)
        record.motion_s += motion.timings.get("motion_s", 0.0)
        if motion.centroidal is not None and record.time_to_first_feasible_s is None:
            record.time_to_first_feasible_s = (record.time_to_first_s or 0.0) + record.dynamics_s
        return motion

    # 4 Verification --------------------------------------------------------------------------------------------------

    def _verify(self, sequence: ContactPlan, motion: MotionResult) -> tuple[Plan | None, Report | None]:
        """The plan and the verifier's report on it; neither where too much is wrong with the motion already."""
        if not motion.ok and not 0.0 < excess(motion.problems) <= WORTH_VERIFYING:
            return None, None
        deadline = self.context.deadline
        (deadline.whole or deadline).check("before the verification")  # a motion that is made is worth the whole's time
        plan = self._assemble(sequence, motion)
        self.record.torque = None if motion.torque is None else dataclasses.asdict(motion.torque)
        self.tell(ProgressEvent("verify", "", self.record.cost, self.record.bound))
        began = time.perf_counter()
        report = verify_plan(plan)
        self.record.verification_s += time.perf_counter() - began
        return plan, report

    # 5 Execution -----------------------------------------------------------------------------------------------------

    def _play(self, plan: Plan) -> ExecutionReport:
        """What comes of the plan in physics."""
        from drakeplan.execution import play_plan  # a solver that nothing else in a query needs

        began, deadline = time.perf_counter(), self.context.deadline.whole or self.context.deadline

        def tell(s: float, duration: float) -> None:
            deadline.check("while the plan was played in physics")
            self.tell(ProgressEvent("simulate", f"{s:.0f} of {duration:.0f} s", self.record.cost, self.record.bound))

        played = play_plan(plan, str(self.context.robot.model), tell=tell)
        self.record.simulation_s += time.perf_counter() - began
        self.record.simulated = played.as_dict()
        return played

    # 6 Bar -----------------------------------------------------------------------------------------------------------

    def _bar(self, refusal: Refusal) -> bool:
        """Forbids the transitions at fault for the planner; False where none can be named."""
        transitions = refusal.transitions()
        if (
            refusal.motion is not None and refusal.motion.blocked
        ):  # on such terrain it pays to ask in the search already
            self.planner.ask_for_swings(self._maker(refusal.sequence).swing_is_clear)
        for transition in transitions:
            self.planner.forbid(refusal.sequence, transition)
        if transitions:
            self.tell(ProgressEvent("search", f"{refusal.reason}; searching again"))
            self.record.repairs += 1
        return bool(transitions)

    # What comes out --------------------------------------------------------------------------------------------------

    def _incomplete(self) -> PlanResult:
        """The result without a verified plan: the last refused sequence, or the reason why there is none."""
        refusal = self.refusal
        if refusal is not None:
            plan = self._assemble(refusal.sequence, None)
            reason = f"contacts found, but {refusal.reason}"
            return self._result("contacts", reason, plan, refusal.verification, refusal)
        refusal = self._infeasible
        if refusal is not None:
            tested = self.record.sequences_tested
            reason = f"{tested} contact sequences found, none dynamically feasible: {refusal.reason}"
            return self._result("none", reason, None, None, refusal)
        return self._result("none", self.planner.why_not(), None, None)

    def _assemble(self, sequence: ContactPlan, motion: MotionResult | None) -> Plan:
        facts: dict[str, object] = {
            "seed": self.options.seed,
            "command": self.options.command,
            "planner": self.options.planner,
            "dynamics": self.record.dynamics,
            "full_soles": self.options.full_soles,
            "reserve": dataclasses.asdict(self.context.reserve),
            "footholds": self.options.footholds if planner_entry(self.options.planner).judges_transitions else "",
            "limits_fired": list(self.record.limits_fired),
            "expansions": self.record.expansions,
            "cost": self.record.cost,
            "bound": self.record.bound,
        }
        if self.context.robot.given_by_path:
            facts[ROBOT_FILE] = str(self.context.robot.source)
        if sequence.origin:
            facts["adapted_from"] = list(sequence.origin)
        if sequence.guide:
            facts["guide"] = [dict(segment) for segment in sequence.guide]
        if sequence.predicted_success is not None:
            facts["predicted_success"] = sequence.predicted_success
        if sequence.predicted_com is not None:
            facts["predicted_com"] = sequence.predicted_com.tolist()
        context = self.context
        return assemble_plan(
            context.scene_on_ground, context.robot, sequence.stances, motion, cone=context.cone, provenance=facts
        )

    def _result(
        self,
        status: Status,
        reason: str,
        plan: Plan | None,
        verification: Report | None,
        refusal: Refusal | None = None,
    ) -> PlanResult:
        report = json.loads(json.dumps(self.record.as_dict(status, reason, verification)))
        return PlanResult(status, reason, plan, report, verification, tuple(self.record.notes), refusal)


def _with_execution(plan: Plan, played: ExecutionReport | None) -> Plan:
    """The plan with what came of it in physics in its provenance."""
    if played is None:
        return plan
    said = {"reached": played.reached, "com_error_m": played.com_error_m, "slips_m": played.slips_m}
    return dataclasses.replace(plan, provenance={**plan.provenance, "simulated": said})
