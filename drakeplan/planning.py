"""One query from scene to verified plan: search, dynamics, motion, verification, and the numbers of each."""

from __future__ import annotations

import dataclasses
import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import numpy as np

from drakeplan.contact_planner import ContactPlan, ContactPlanner, ContactPlannerOptions
from drakeplan.motion import MotionMaker, MotionOptions, MotionResult
from drakeplan.plan import Plan, PlanCentroidal, PlanMotion, PlanPhases, tabulate_stances
from drakeplan.plan_file import write_plan
from drakeplan.progress import Progress, ProgressEvent
from drakeplan.query_record import QueryRecord, SearchClock
from drakeplan.search.ana_star import Limits
from drakeplan.sequence_dynamics import sequence_dynamics
from drakeplan.verifier import Report, verify
from drakeplan.warm_up import warm_up
from optimization.whole_body_ik import WholeBodyIK
from scenes.input_error import InputError, unknown_name
from scenes.robot import Robot
from scenes.scene import Goal, Scene, Start
from scenes.scene_file import scene_to_yaml
from scenes.transition_model import transition_model

PLANNERS = ("search",)
DYNAMICS = ("quasi-static", "exact")
_WARM: set[str] = set()  # robots whose kernels this process has loaded
WORTH_VERIFYING = 3  # problems a motion may report and still be shown to the verifier
MAX_REPAIRS = 12  # times a transition that motion or verification refused is barred and the search resumed


@dataclass(frozen=True)
class PlanOptions:
    """What a user may choose about a query. Angles in radians, lengths in metres, times in seconds.

    Attributes:
        seed: of every random choice.
        start: (x, y) or (x, y, yaw) that replaces the scene's.
        goal: the same for the goal.
        goal_radius: replaces the goal's.
        friction: replaces every friction in the scene.
        cone: friction cone by name.
        planner: by name.
        dynamics: what every transition must satisfy: "quasi-static" balance, or the centroidal program ("exact").
        heuristic: "grid", "euclidean" or "admissible"; only the last gives a bound.
        transition_model: name of the foot transition model, None for the scene's or the usual one.
        deadline: limits the search alone.
        improve: the search stops this long after the first plan; without effect when `expansions` is given.
        expansions: nodes expanded at most; unlike times it makes runs repeatable.
        stop: polled by the search; True ends it and keeps the incumbent.
        command: recorded in the plan's provenance.
    """

    seed: int = 0
    start: tuple[float, ...] | None = None
    goal: tuple[float, ...] | None = None
    goal_radius: float | None = None
    friction: float | None = None
    cone: str = "inner"
    planner: str = "search"
    dynamics: str = "quasi-static"
    heuristic: Literal["grid", "euclidean", "admissible"] = "grid"
    transition_model: str | None = None
    use_palms: bool = True
    deadline: float = 30.0
    improve: float = 1.0
    expansions: int | None = None
    stop: Callable[[], bool] | None = None
    command: str = ""


@dataclass(frozen=True)
class PlanResult:
    """What came of a query.

    Attributes:
        status: "complete" (the verifier holds), "contacts" (a contact sequence without a verified motion) or "none".
        reason: one line; "" when complete.
        plan: None when there is none.
        report: numbers for people and programs, as JSON allows.
        verification: the verifier's report on the complete plan, else None.
    """

    status: Literal["complete", "contacts", "none"]
    reason: str
    plan: Plan | None
    report: dict[str, object]
    verification: Report | None = None


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
    _check_options(options)
    scene = with_options(scene, options)
    record = QueryRecord()
    tell(ProgressEvent("load", f"{robot.name} on {scene.name}", elapsed=0.0))
    ik = WholeBodyIK(robot)
    if robot.model_sha256 not in _WARM:  # kernels load before the clock of the search starts
        warm_up(robot, ik)
        _WARM.add(robot.model_sha256)
    search_options = ContactPlannerOptions(
        cone=options.cone,
        heuristic=options.heuristic,
        seed=options.seed,
        use_palms=options.use_palms,
        dynamics=options.dynamics,
    )
    planner = ContactPlanner(
        scene,
        robot,
        ik,
        search_options,
        transition_model(options.transition_model or scene.transition_model or "experiments"),
    )
    scene = _set_down(scene, planner)
    reason = planner.start_problem()
    if reason:
        return PlanResult("none", reason, None, record.as_dict("none", reason, None))
    return _Query(scene, robot, options, planner, ik, record, tell).run()


class _Query:
    """The rounds of search and motion of one query."""

    def __init__(
        self, scene: Scene, robot: Robot, options: PlanOptions, planner: ContactPlanner, ik: WholeBodyIK,
        record: QueryRecord,
        tell: Progress,
    ) -> None:  # fmt: skip
        self.scene, self.robot, self.options = scene, robot, options
        self.planner, self.record, self.tell = planner, record, tell
        self.clock = SearchClock()
        self._fell_apart = ""  # why the last contact sequence is dynamically infeasible as a whole
        self.motion = MotionMaker(robot, scene.terrain, MotionOptions(cone=options.cone), ik=ik)

    def run(self) -> PlanResult:
        refused: tuple[str, ContactPlan, Report | None] | None = None
        for _ in range(MAX_REPAIRS + 1):
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
            self.record.repairs += 1
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
        """Every incumbent of one round of search, best last."""
        first_round = self.record.time_to_first_s is None
        limits = Limits(
            deadline=max(self.options.deadline - self.record.planning_s, 0.0),
            expansions=self.options.expansions,
            improve=self._improve_for() if first_round else 0.0,
            stop=self.options.stop,
        )
        found = []
        began = self.clock()
        for plan in self.planner.plans(limits, self.clock):
            if self.record.time_to_first_s is None:
                self.record.time_to_first_s = plan.elapsed
            self.tell(ProgressEvent("search", "", plan.cost, plan.bound, plan.expansions, self.clock() - began))
            if self.options.dynamics == "quasi-static" or self._holds_together(plan):
                found.append(plan)
        self.record.planning_s += self.clock() - began
        search = self.planner.search
        if self.planner.dynamic is not None:
            self.record.transitions_judged = dict(self.planner.dynamic.evaluator.asked)
        if search is not None:
            self.record.expansions += search.expansions
            if search.ended_by != "exhausted":
                self.record.limits_fired.append(search.ended_by)
        return found

    def _holds_together(self, plan: ContactPlan) -> bool:
        """Whether transitions that are feasible one by one are so in a row (Lin et al. 2019 sec. VI)."""
        self.clock.pause()
        began = time.perf_counter()
        estimate = sequence_dynamics(self.robot, plan.stances, self.options.cone)
        self.record.sequences_tested += 1
        self.record.dynamics_s += time.perf_counter() - began
        if estimate.feasible and self.record.time_to_first_feasible_s is None:
            self.record.time_to_first_feasible_s = plan.elapsed + self.record.dynamics_s
        self._fell_apart = "" if estimate.feasible else estimate.reason
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
        contacts, stances = tabulate_stances(best.stances)
        phases = centroidal = whole_body = None
        if motion is not None:
            schedule, c = motion.schedule, motion.centroidal
            phases = PlanPhases(
                schedule.boundaries[:-1], schedule.boundaries[1:], [p.contacts for p in schedule.phases]
            )
            centroidal = PlanCentroidal(
                c.t, c.com, c.linear_momentum, c.angular_momentum, c.contact, c.force_W, c.cop_C, c.torque_n
            )
            names = motion.position_names, motion.velocity_names
            whole_body = PlanMotion(motion.t, motion.q, motion.v, *names)
        return Plan(
            robot=self.robot.name,
            robot_model=str(self.robot.model),
            robot_model_sha256=self.robot.model_sha256,
            mass=self.robot.mass,
            friction_cone=self.options.cone,
            scene_name=self.scene.name,
            scene_yaml=scene_to_yaml(self._scene_as_planned(best), meshes_as_surfaces=True),
            triangles=self.scene.terrain.triangles,
            half_extent=np.array([e.half_extent for e in self.robot.effectors]),
            contacts=contacts,
            stances=stances,
            phases=phases,
            centroidal=centroidal,
            motion=whole_body,
            provenance=self._provenance(),
        )

    def _scene_as_planned(self, best: ContactPlan) -> Scene:
        """The scene with a start on the ground: `--start X Y` leaves the height open, which no scene file can say."""
        start = self.scene.start
        if start is None or np.isfinite(start.xyz[2]):
            return self.scene
        height = float(best.stances[0].feet_mean()[2])
        return dataclasses.replace(self.scene, start=dataclasses.replace(start, xyz=(*start.xyz[:2], height)))

    def _provenance(self) -> dict[str, object]:
        packages = ("drakeplan", "drake", "numpy", "numba", "scipy")
        return {
            "versions": {name: version(name) for name in packages} | {"python": sys.version.split()[0]},
            "seed": self.options.seed,
            "command": self.options.command,
            "limits_fired": list(self.record.limits_fired),
            "expansions": self.record.expansions,
            "cost": self.record.cost,
            "bound": self.record.bound,
        }

    def _verify(self, plan: Plan) -> Report:
        self.tell(ProgressEvent("verify", "", self.record.cost, self.record.bound))
        began = time.perf_counter()
        with tempfile.TemporaryDirectory(prefix="drakeplan-") as folder:
            path = Path(folder) / "plan.h5"
            write_plan(plan, path)
            report = verify(path)
        self.record.verification_s += time.perf_counter() - began
        return report

    def _result(self, status: str, reason: str, plan: Plan | None, verification: Report | None) -> PlanResult:
        report = json.loads(json.dumps(self.record.as_dict(status, reason, verification)))
        return PlanResult(status, reason, plan, report, verification)


def _set_down(scene: Scene, planner: ContactPlanner) -> Scene:
    """The scene with start and goal at the height of the ground that they were set down on."""
    start = scene.start
    if start is not None and not start.stance:
        start = dataclasses.replace(start, xyz=(start.xyz[0], start.xyz[1], float(planner.start.feet_mean()[2])))
    return dataclasses.replace(scene, start=start, goal=planner.goal)


def with_options(scene: Scene, options: PlanOptions) -> Scene:
    """The scene with the start, goal and friction that the options ask for."""
    start, goal, terrain = scene.start, scene.goal, scene.terrain
    if options.start is not None:
        yaw = options.start[2] if len(options.start) > 2 else 0.0
        start = Start((options.start[0], options.start[1], float("nan")), yaw)  # the ground says how high
    radius = options.goal_radius if options.goal_radius is not None else (goal.radius if goal else 0.2)
    if options.goal is not None:
        goal = Goal(
            (options.goal[0], options.goal[1], float("nan")), radius, options.goal[2] if len(options.goal) > 2 else None
        )
    elif goal is not None:
        goal = dataclasses.replace(goal, radius=radius)
    if options.friction is not None:
        surfaces = tuple(dataclasses.replace(s, friction=options.friction) for s in terrain.surfaces)
        terrain = dataclasses.replace(terrain, surfaces=surfaces)
    return dataclasses.replace(scene, start=start, goal=goal, terrain=terrain)


def _check_options(options: PlanOptions) -> None:
    if options.planner not in PLANNERS:
        raise unknown_name("planner", options.planner, PLANNERS)
    if options.dynamics not in DYNAMICS:
        raise unknown_name("dynamics", options.dynamics, DYNAMICS)
    for key in ("deadline", "improve", "friction", "goal_radius"):
        value = getattr(options, key)
        if value is not None and not (np.isfinite(value) and value >= 0):
            raise InputError(f"--{key.replace('_', '-')}: expected a finite number >= 0, got {value}")
    for key in ("start", "goal"):
        value = getattr(options, key)
        if value is not None and not (len(value) in (2, 3) and np.isfinite(value).all()):
            raise InputError(f"--{key}: expected X Y or X Y YAW, finite numbers, got {value}")
