"""One query from scene to verified plan: search, dynamics, motion, verification, and the numbers of each."""

from __future__ import annotations

import dataclasses
import json
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from drakeplan.contact_planning.program_planner import MixedIntegerPlanner
from drakeplan.contact_planning.search_planner import ContactPlan, ContactPlanner, ContactPlannerOptions, DynamicsName
from drakeplan.contact_planning.sequence_dynamics import sequence_dynamics
from drakeplan.contact_planning.warm_up import warm_up
from drakeplan.motion.assembly import assemble_plan
from drakeplan.motion.course_dynamics import Guide
from drakeplan.motion.maker import MotionMaker, MotionOptions, MotionResult
from drakeplan.plan.plan import Plan, tabulate_stances
from drakeplan.plan.plan_file import write_plan
from drakeplan.progress import Progress, ProgressEvent
from drakeplan.query.options import PlanOptions, check_options, with_options
from drakeplan.query.record import QueryRecord, SearchClock
from drakeplan.search.ana_star import Limits
from drakeplan.verifier import Report, verify
from learning.surrogate import FRICTION_TOLERANCE, load_surrogate
from learning.weights import NoWeightsError
from optimization.balance.friction import DEFAULT_CONE
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.robots.robot import Robot
from scenes.scene import Scene
from scenes.stance import Stance
from scenes.transition_model import transition_model

Status = Literal["complete", "contacts", "none"]
_WARM: set[str] = set()  # robots whose kernels this process has loaded
COMPILING = 5.0  # [s] after which loading kernels must be compiling them
WORTH_VERIFYING = 3  # problems a motion may report and still be shown to the verifier
MAX_REPAIRS = 12  # times a transition that motion or verification refused is barred and the search resumed
TRIED_REPAIRS = 3  # the same for learned dynamics that nobody asked for


@dataclass(frozen=True)
class PlanResult:
    """What came of a query.

    Attributes:
        status: "complete" (the verifier holds), "contacts" (a contact sequence without a verified motion) or "none".
        reason: one line; "" when complete.
        plan: None when there is none.
        report: numbers for people and programs, as JSON allows.
        verification: the verifier's report on the complete plan, else None.
        notes: what was done otherwise than asked, one line each.
    """

    status: Status
    reason: str
    plan: Plan | None
    report: dict[str, object]
    verification: Report | None = None
    notes: tuple[str, ...] = ()


def plan_scene(
    scene: Scene, robot: Robot, options: PlanOptions | None = None, progress: Progress | None = None
) -> PlanResult:
    """Plans a crossing and has it verified.

    Args:
        scene: terrain, start and goal.
        robot: who crosses.
        options: see `PlanOptions`.
        progress: called with events while it runs.

    Raises:
        InputError: bad options, a start or goal off the terrain.
    """
    options = options or PlanOptions()
    tell = progress or (lambda event: None)
    check_options(options)
    scene = with_options(scene, options)
    record = QueryRecord()
    if options.cone == "diamond":
        record.notes.append(
            "cone diamond admits what real friction does not, up to 1.41 times as much: to compare only"
        )
    tell(ProgressEvent("load", f"{robot.name} on {scene.name}", elapsed=0.0))
    ik = WholeBodyIK(robot)
    if robot.model_sha256 not in _WARM:  # kernels load before the clock of the search starts
        _load_kernels(robot, ik, tell)
        _WARM.add(robot.model_sha256)
    dynamics = _dynamics(scene, robot, options, record.notes)
    for note in record.notes:
        tell(ProgressEvent("load", note))
    result = _run(scene, robot, options, dynamics, ik, record, tell)
    if options.dynamics is not None or dynamics != "learned" or result.status == "complete" or not record.expansions:
        return result
    if options.stop is not None and options.stop():
        return result
    record.notes.append(f"learned dynamics: {result.reason}; planned again with quasi-static dynamics")
    tell(ProgressEvent("search", record.notes[-1]))
    second = _run(scene, robot, options, "quasi-static", ik, record, tell)
    return result if second.status == "none" else second


def _load_kernels(robot: Robot, ik: WholeBodyIK, tell: Progress) -> None:
    """Loads what is compiled, and says so where it has to be compiled first."""
    note = ProgressEvent("load", "compiling, once on this machine: a minute or two")
    patience = threading.Timer(COMPILING, tell, [note])
    patience.daemon = True
    patience.start()
    try:
        warm_up(robot, ik)
    finally:
        patience.cancel()


def _run(
    scene: Scene, robot: Robot, options: PlanOptions, dynamics: DynamicsName, ik: WholeBodyIK, record: QueryRecord,
    tell: Progress,
) -> PlanResult:  # fmt: skip
    """One query with these dynamics; learned ones that nobody asked for leave time for another."""
    record.dynamics = "" if options.planner != "search" else dynamics
    planner = _planner(scene, robot, ik, options, dynamics)
    scene = _set_down(scene, planner)
    reason = planner.start_problem()
    if reason:
        return PlanResult("none", reason, None, record.as_dict("none", reason, None), notes=tuple(record.notes))
    tried = options.dynamics is None and dynamics == "learned"
    deadline, repairs = (options.deadline / 2, TRIED_REPAIRS) if tried else (options.deadline, MAX_REPAIRS)
    return _Query(scene, robot, options, planner, ik, record, tell, deadline, repairs).run()


def _planner(
    scene: Scene, robot: Robot, ik: WholeBodyIK, options: PlanOptions, dynamics: DynamicsName
) -> ContactPlanner | MixedIntegerPlanner:
    """Whoever is to find the contacts."""
    model = transition_model(options.transition_model or scene.transition_model or "experiments")
    search = ContactPlannerOptions(
        cone=options.cone,
        heuristic=options.heuristic,
        seed=options.seed,
        use_palms=options.use_palms,
        timing=options.timing,
    )
    if options.planner != "search":
        return MixedIntegerPlanner(scene, robot, ik, options.planner, search, model)
    return ContactPlanner(scene, robot, ik, dataclasses.replace(search, dynamics=dynamics), model)


def _dynamics(scene: Scene, robot: Robot, options: PlanOptions, notes: list[str]) -> DynamicsName:
    """What the search asks of transitions; where nothing was learned for this query, something else, and that is noted."""
    if options.planner != "search" or options.dynamics in ("quasi-static", "exact"):
        return "exact" if options.dynamics == "exact" else "quasi-static"
    why = _not_learned(scene, robot, options)
    if not why:
        return "learned"
    instead: DynamicsName = "exact" if options.dynamics == "learned" else "quasi-static"
    notes.append(f"{why}: {instead} dynamics instead")
    return instead


def _not_learned(scene: Scene, robot: Robot, options: PlanOptions) -> str:
    """Why learned dynamics do not fit this query, "" if they do."""
    if not options.timing.documented:
        return "dynamics are learned for transitions of 1 s and 1 s"
    try:
        surrogate = load_surrogate(robot)
    except NoWeightsError as error:
        return str(error).split(":")[0]
    learned = surrogate.card.get("cone", DEFAULT_CONE)
    if options.cone != learned:
        return f"dynamics are learned for the friction cone {learned!r}"
    best = max((s.friction for s in scene.terrain.surfaces), default=surrogate.friction[0])
    if best < surrogate.friction[0] - FRICTION_TOLERANCE:  # else what is slippery is left to the exact program
        return f"dynamics are learned for friction {surrogate.friction[0]:g} and above"
    return ""


class _Query:
    """The rounds of search and motion of one query."""

    def __init__(
        self, scene: Scene, robot: Robot, options: PlanOptions, planner: ContactPlanner | MixedIntegerPlanner, ik: WholeBodyIK,
        record: QueryRecord, tell: Progress, deadline: float, max_repairs: int,
    ) -> None:  # fmt: skip
        self.deadline, self.max_repairs = deadline, max_repairs
        self.scene, self.robot, self.options = scene, robot, options
        self.planner, self.record, self.tell = planner, record, tell
        self._first_round = True
        self.clock = SearchClock()
        self._guides: dict[tuple[Stance, ...], Guide] = {}  # CoM of sequences that are known to hold together
        self._fell_apart = ""  # why the last contact sequence is dynamically infeasible as a whole
        timing = options.timing
        wanted = MotionOptions(
            cone=options.cone,
            dt=timing.step or MotionOptions.dt,
            shift=timing.shift,
            swing=timing.swing,
            free=timing.free,
        )
        self.motion = MotionMaker(robot, scene.terrain, wanted, ik=ik)

    def run(self) -> PlanResult:
        refused: tuple[str, ContactPlan, Report | None] | None = None
        repairs = 0
        while repairs <= self.max_repairs:
            found = self._search()
            if not found and self._careful(False):
                found = self._search()
            if not found:
                break
            best = found[-1]
            self._note(best)
            motion = self._move(best)
            verification = None
            # The motion stage's limits are a little tighter than the verifier's, whose word counts.
            if motion.ok or 0 < len(motion.problems) <= WORTH_VERIFYING:
                plan = self._assemble(best, motion)
                verification = self._verify(plan)
                if verification.holds:
                    return self._result("complete", "", plan, verification)
            if motion.ok and verification is not None:
                failed = ", ".join(c.name for c in verification.checks if not c.ok)
                refused = (f"verification failed: {failed}", best, verification)
            else:
                refused = (motion.reason, best, verification)
            if not self._bar(best, motion):
                break
            self.tell(ProgressEvent("search", f"{refused[0]}; searching again"))
            repairs += 1
            self.record.repairs += 1
            if repairs == 1:
                self._careful(True)
        if refused is not None:
            reason, best, verification = refused
            return self._result("contacts", f"contacts found, but {reason}", self._assemble(best, None), verification)
        if self._fell_apart:
            reason = (
                f"{self.record.sequences_tested} contact sequences found, none dynamically feasible: {self._fell_apart}"
            )
            return self._result("none", reason, None, None)
        return self._result("none", self.planner.why_not(), None, None)

    def _search(self) -> list[ContactPlan]:
        """The incumbents of one round of search, best last; that one holds together, where dynamics are asked for."""
        limits = Limits(
            deadline=max(self.deadline - self.record.planning_s, 0.0),
            expansions=self.options.expansions,
            improve=self._improve_for() if self._first_round else 0.0,
            stop=self.options.stop,
        )
        self._first_round = False
        found = []
        began = self.clock()
        for plan in self.planner.plans(limits, self.clock):
            if self.record.time_to_first_s is None:
                self.record.time_to_first_s = plan.elapsed
            self.tell(ProgressEvent("search", "", plan.cost, plan.bound, plan.expansions, self.clock() - began))
            found.append(plan)
            if plan.predicted_com is not None and not self._guides:
                self._holds_together(plan)
        self.record.planning_s += self.clock() - began
        search = self.planner.search
        if isinstance(self.planner, ContactPlanner) and self.planner.dynamic is not None:
            self.record.transitions_judged = dict(self.planner.dynamic.evaluator.asked)
        if search is not None:
            self.record.expansions += search.expansions
            if search.ended_by != "exhausted":
                self.record.limits_fired.append(search.ended_by)
        while found and found[-1].predicted_com is not None and not self._holds_together(found[-1]):
            found.pop()  # from the last to the first, as the documents do
        return found

    def _careful(self, careful: bool) -> bool:
        """Has the search ask for posture and balance at rest too, or no longer; whether that is a change."""
        domain = self.planner.dynamic if isinstance(self.planner, ContactPlanner) else None
        if domain is None or domain.careful == careful:
            return False
        domain.careful = careful
        return True

    def _holds_together(self, plan: ContactPlan) -> bool:
        """Whether transitions that are feasible one by one are so in a row (Lin et al. 2019 sec. VI)."""
        if plan.stances in self._guides:
            return True
        self.clock.pause()
        began = time.perf_counter()
        estimate = sequence_dynamics(self.robot, plan.stances, self.options.cone, self.options.timing)
        self.record.sequences_tested += 1
        self.record.dynamics_s += time.perf_counter() - began
        if estimate.feasible and self.record.time_to_first_feasible_s is None:
            self.record.time_to_first_feasible_s = plan.elapsed + self.record.dynamics_s
        self._fell_apart = "" if estimate.feasible else estimate.reason
        if estimate.feasible and estimate.trajectory is not None:
            self._guides[plan.stances] = Guide(estimate.trajectory.t, estimate.trajectory.com)
        self.clock.resume()
        return estimate.feasible

    def _improve_for(self) -> float | None:
        """Seconds of improvement; none where a budget of expansions must give the same plan on any machine."""
        return self.options.improve if self.options.expansions is None else None

    def _note(self, best: ContactPlan) -> None:
        contacts, _ = tabulate_stances(best.stances)
        self.record.cost, self.record.bound = best.cost, best.bound
        self.record.contacts, self.record.stances = len(contacts), len(best.stances)
        self.record.palms_used = best.palms_used

    def _move(self, best: ContactPlan) -> MotionResult:
        self.tell(ProgressEvent("dynamics", f"{len(best.stances)} stances", best.cost, best.bound))
        motion = self.motion.run(best.stances, self.tell)
        if motion.centroidal is None and best.stances in self._guides:  # nobody stands still on that way; who moves may
            guided = self.motion.run(best.stances, self.tell, self._guides[best.stances])
            motion = min(guided, motion, key=lambda m: (not m.ok, m.centroidal is None, len(m.problems)))
        self.record.dynamics_s += motion.timings.get("dynamics_s", 0.0)
        self.record.motion_s += motion.timings.get("motion_s", 0.0)
        if motion.centroidal is not None and self.record.time_to_first_feasible_s is None:
            first = self.record.time_to_first_s or 0.0
            self.record.time_to_first_feasible_s = first + self.record.dynamics_s
        return motion

    def _bar(self, best: ContactPlan, motion: MotionResult) -> bool:
        """Bars the moves that the motion failed at; False when it does not know which.

        A swing that fails bars its own move. What fails while all contacts of a stance are held is that stance's fault,
        so the move that led to it is barred.
        """
        at = set(motion.failed_transitions)
        for problem in motion.problems:
            phase = int(motion.schedule.phase_at(np.array([problem.time]))[0])
            at.add(phase // 2 if phase % 2 else phase // 2 - 1)
            if phase % 2 == 0:
                at.discard(problem.transition)
        at = {k for k in at if 0 <= k < len(best.states) - 1}
        for k in sorted(at):
            self.planner.forbid(best.states[k], best.states[k + 1])
        return bool(at)

    def _assemble(self, best: ContactPlan, motion: MotionResult | None) -> Plan:
        facts = {
            "seed": self.options.seed,
            "command": self.options.command,
            "planner": self.options.planner,
            "dynamics": self.record.dynamics,
            "limits_fired": list(self.record.limits_fired),
            "expansions": self.record.expansions,
            "cost": self.record.cost,
            "bound": self.record.bound,
        }
        if best.predicted_com is not None:
            facts["predicted_com"] = best.predicted_com.tolist()
        cone = self.options.cone
        return assemble_plan(self.scene, self.robot, best.stances, motion, cone=cone, provenance=facts)

    def _verify(self, plan: Plan) -> Report:
        self.tell(ProgressEvent("verify", "", self.record.cost, self.record.bound))
        began = time.perf_counter()
        with tempfile.TemporaryDirectory(prefix="drakeplan-") as folder:
            path = Path(folder) / "plan.h5"
            write_plan(plan, path)
            report = verify(path)
        self.record.verification_s += time.perf_counter() - began
        return report

    def _result(self, status: Status, reason: str, plan: Plan | None, verification: Report | None) -> PlanResult:
        report = json.loads(json.dumps(self.record.as_dict(status, reason, verification)))
        return PlanResult(status, reason, plan, report, verification, tuple(self.record.notes))


def _set_down(scene: Scene, planner: ContactPlanner | MixedIntegerPlanner) -> Scene:
    """The scene with start and goal at the height of the ground that they were set down on."""
    start = scene.start
    if start is not None and not start.stance:
        start = dataclasses.replace(start, xyz=(start.xyz[0], start.xyz[1], float(planner.start.feet_mean()[2])))
    return dataclasses.replace(scene, start=start, goal=planner.goal)
