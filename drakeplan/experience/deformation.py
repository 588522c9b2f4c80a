"""A verified plan deformed to a terrain that has changed, instead of planned again (Lin 2020 sec. 4.5).

    contacts -> fit (regions, elastic strip) -> dynamics and motion -> verifier

Dynamics and motion are made anew over the contacts that come out of the fit. A place that the motion breaks at counts as
further away from then on, as one that the strip breaks at does.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from drakeplan.context import QueryContext
from drakeplan.experience.fit import Fit
from drakeplan.experience.key_motion import MAX_PER_PHASE, PER_PHASE, complete_parts, key_motion
from drakeplan.experience.strip_setup import Sampling, goal_gathering, start_gathering, warm_up
from drakeplan.motion.assembly import assemble_plan
from drakeplan.motion.maker import MotionMaker, MotionResult
from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import read_plan
from drakeplan.plan.robot_of_plan import RobotMark, find_robot
from drakeplan.plan.verified import verify_plan
from drakeplan.progress import ProgressEvent
from drakeplan.verifier import Report
from optimization.balance.friction import FrictionCone
from optimization.elastic_strip.problem import StripEstimate, StripOptions
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.files.scene_file import scene_from_yaml
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.scene import Scene
from scenes.stance import Stance

REPORTED = ("deform_s", "regions_s", "strip_s", "dynamics_s", "motion_s", "verification_s", "iterations", "configurations",
            "repairs", "moved_mean", "moved_most")  # fmt: skip
WORTH_VERIFYING = 3  # problems a motion may report and still be shown to the verifier


@dataclass(frozen=True)
class DeformOptions:
    """How a plan is deformed.

    Attributes:
        strip: of the elastic strip; its cone is the plan's, whatever is said here.
        per_phase: configurations of each phase in the strip, 1 to 10.
        furthest: distance (Lin 2020 eq. 4.4) beyond which a region is no place for a contact [m].
        repairs: times that contacts are sent elsewhere where strip or motion breaks, and the plan is deformed again.
        deadline: processor time of regions and strips together, after which no further repair is begun [s].
        motion: whether dynamics and motion are made anew and verified; False ends with the contacts.
        progress: told what is going on.
    """

    strip: StripOptions = field(default_factory=lambda: StripOptions(turn=0.06))
    per_phase: int = PER_PHASE
    furthest: float = 0.5
    repairs: int = 4
    deadline: float = 5.0
    motion: bool = True
    progress: Callable[[ProgressEvent], None] | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.per_phase <= MAX_PER_PHASE:
            raise InputError(f"deform: per_phase must be 1 to {MAX_PER_PHASE}, got {self.per_phase}")
        for key in ("furthest", "deadline"):
            if not (np.isfinite(getattr(self, key)) and getattr(self, key) > 0.0):
                raise InputError(f"deform: {key} must be finite and positive, got {getattr(self, key)}")
        if self.repairs < 0:
            raise InputError(f"deform: repairs must not be negative, got {self.repairs}")


@dataclass(frozen=True, eq=False)
class DeformResult:
    """The result of a deformation.

    Attributes:
        status: "complete" (the verifier holds), "contacts" (the strip holds, its motion does not or was not asked for),
            "strip" (the strip breaks; `strip` is the best so far, its faults say where) or "none" (a contact has
            nowhere to go).
        reason: one line; "" when complete.
        plan: complete, or with contacts alone; None where the strip breaks.
        strip: the last elastic strip, None where there was none.
        verification: the verifier's report where it was asked.
        report: numbers: deform_s (regions and strips), regions_s, strip_s, dynamics_s, motion_s, verification_s,
            iterations, configurations, repairs, moved_mean and moved_most (of contacts) [m].
    """

    status: Literal["complete", "contacts", "strip", "none"]
    reason: str
    plan: Plan | None
    strip: StripEstimate | None
    verification: Report | None
    report: dict[str, float]


def deform(
    plan: Plan | str | Path, scene: Scene, options: DeformOptions | None = None, *, robot: Robot | None = None
) -> DeformResult:
    """Deforms a plan to a scene whose surfaces have moved.

    Args:
        plan: a complete plan, or the path of its file.
        scene: with the surfaces of the plan's scene, moved; its start and goal are kept to where it has them.
        options: see `DeformOptions`.
        robot: the plan's; loaded by its name where it is not given.

    Raises:
        InputError: a plan without motion, a scene with other surfaces than the plan's, another robot, or options that
            cannot be.
    """
    options = options or DeformOptions()
    plan = plan if isinstance(plan, Plan) else read_plan(plan)
    complete_parts(plan)
    robot = robot or find_robot(RobotMark.of(plan))
    if robot.model_sha256 != plan.robot_model_sha256:
        raise InputError(f"deform: the plan was made with another model of robot {plan.robot!r} than {robot.model}")
    _check_surfaces(plan, scene)
    return _Deformation(plan, scene, robot, options).run()


def _check_surfaces(plan: Plan, scene: Scene) -> None:
    before = scene_from_yaml(plan.scene_yaml, f"plan of {plan.scene_name}", mesh_triangles=plan.triangles).terrain
    names = [s.name for s in before.surfaces], [s.name for s in scene.terrain.surfaces]
    if names[0] == names[1]:
        return
    if len(names[0]) != len(names[1]):
        raise InputError(
            f"deform: {scene.name}: surfaces: expected the {len(names[0])} of the plan, the scene has {len(names[1])}"
        )
    old, new = next((a, b) for a, b in zip(*names, strict=True) if a != b)
    raise InputError(f"deform: {scene.name}: surfaces: expected {old!r} as in the plan, the scene has {new!r}")


class _Deformation:
    """One plan on one scene: fits its contacts, makes a motion over them and has it verified, until that holds."""

    def __init__(self, plan: Plan, scene: Scene, robot: Robot, options: DeformOptions) -> None:
        self.plan, self.scene, self.robot, self.options = plan, scene, robot, options
        self.tell = options.progress or (lambda _: None)
        self.cone = FrictionCone(plan.friction_cone)
        self.context = QueryContext(scene, robot, WholeBodyIK(robot), self.cone)
        warm_up(robot, self.context.ik)
        motion = key_motion(plan, options.per_phase)
        gatherings = (*start_gathering(motion, scene), *goal_gathering(motion, scene.goal))
        sampling = Sampling(options.furthest, options.strip.turn)
        self.fit = Fit(motion, self.context, sampling, options.strip, gatherings=gatherings)
        self.report: dict[str, float] = dict.fromkeys(REPORTED, 0.0)
        self.report["regions_s"] = self.report["deform_s"] = self.fit.regions_s
        self._maker: MotionMaker | None = None

    def run(self) -> DeformResult:
        if self.fit.problem:
            return DeformResult("none", self.fit.problem, None, None, None, dict(self.report))
        best: DeformResult | None = None
        for attempt in range(self.options.repairs + 1):
            self.report["repairs"] = float(attempt)
            strip = self._deform_strip()
            transitions: Sequence[int] = ()
            if strip.feasible:
                result, transitions = self._follow(strip)
            else:
                result = DeformResult("strip", strip.reason, None, strip, None, dict(self.report))
            best = result if best is None or _rank(result) > _rank(best) else best
            if result.status == "complete" or self.report["deform_s"] > self.options.deadline:
                break
            if not (self.fit.leave_transitions(transitions) if strip.feasible else self.fit.leave_broken_places()):
                break
        assert best is not None
        return replace(best, report=dict(self.report))

    def _deform_strip(self) -> StripEstimate:
        began = time.process_time()
        strip = self.fit.solve(max(self.options.deadline - self.report["deform_s"], 0.5))
        self.report["iterations"] += len(strip.iterations)
        self.report["configurations"] = float(len(self.fit.motion.t))
        spent = time.process_time() - began
        self.report["strip_s"] += spent
        self.report["deform_s"] += spent
        self.tell(ProgressEvent("deform", strip.reason or f"{len(strip.iterations)} iterations, {strip.ended_by}"))
        return strip

    def _follow(self, strip: StripEstimate) -> tuple[DeformResult, Sequence[int]]:
        """Motion and verification over the strip's contacts; on failure also returns the transitions at fault."""
        stances, moved = self.fit.stances(), self.fit.moved()
        self.report["moved_mean"], self.report["moved_most"] = float(np.mean(moved)), float(np.max(moved))
        if not self.options.motion:
            return self._result("contacts", "no motion was asked for", stances, strip, None), ()
        motion = self._move(stances)
        report = None
        if motion.centroidal is not None and len(motion.problems) <= WORTH_VERIFYING:
            report, plan = self._verify(stances, motion)
            if report.holds:
                return DeformResult("complete", "", plan, strip, report, dict(self.report)), ()
        reason = motion.reason
        if motion.ok and report is not None:
            reason = "verification failed: " + ", ".join(report.failed)
        return self._result("contacts", reason, stances, strip, report), motion.failed_transitions

    def _move(self, stances: list[Stance]) -> MotionResult:
        if self._maker is None:
            self._maker = MotionMaker(self.context)
        motion = self._maker.run(stances, self.tell)
        for key in ("dynamics_s", "motion_s"):
            self.report[key] += motion.timings.get(key, 0.0)
        return motion

    def _verify(self, stances: list[Stance], motion: MotionResult) -> tuple[Report, Plan]:
        began = time.process_time()
        plan = self._assemble(stances, motion)
        report = verify_plan(plan)
        self.report["verification_s"] += time.process_time() - began
        return report, plan

    def _assemble(self, stances: list[Stance], motion: MotionResult | None) -> Plan:
        provenance = {"deformed_from": self.plan.scene_name, "deformation": dict(self.report)}
        return assemble_plan(self.scene, self.robot, stances, motion, cone=self.cone, provenance=provenance)

    def _result(
        self,
        status: Literal["contacts"],
        reason: str,
        stances: list[Stance],
        strip: StripEstimate,
        report: Report | None,
    ) -> DeformResult:
        return DeformResult(status, reason, self._assemble(stances, None), strip, report, dict(self.report))


def _rank(result: DeformResult) -> int:
    return ("none", "strip", "contacts", "complete").index(result.status)
