"""A verified plan deformed to a terrain that has changed, instead of planned again (Lin 2020 sec. 4.5).

    contacts -> nearest contact regions -> elastic strip -> dynamics and motion -> verifier

Each contact goes to the circle nearest to it by the distance of Lin 2020 eq. 4.4; the elastic strip moves contacts and postures
together until limits, contact, balance and clearance hold; dynamics and motion are made anew over the contacts that come
out. A place that the strip or the motion breaks at counts as further away from then on, until a contact goes elsewhere.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from drakeplan.context import QueryContext
from drakeplan.experience.strip_setup import (
    Sampling,
    choose_region,
    complete_parts,
    contact_choices,
    make_problem,
    stands_alone,
    warm_up,
)
from drakeplan.motion.assembly import assemble_plan
from drakeplan.motion.maker import MotionMaker, MotionResult
from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import read_plan
from drakeplan.plan.robot_of_plan import RobotMark, find_robot
from drakeplan.plan.verified import verify_plan
from drakeplan.progress import ProgressEvent
from drakeplan.verifier import Report
from optimization.balance.friction import FrictionCone
from optimization.elastic_strip.problem import CONTACT, StripEstimate, StripOptions
from optimization.elastic_strip.program import ElasticStrip
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.contact import Contact
from scenes.files.scene_file import scene_from_yaml
from scenes.footholds.contact_regions import ContactRegions
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.scene import Scene
from scenes.stance import Stance

MAX_PER_PHASE = 10  # configurations; more make the strip slower and no better
Choice = tuple[Contact, ContactRegions]  # where a contact goes, and the circles that it may move in
PENALTY, MAX_PENALTIES = 0.04, 12  # [m] added to the distance of a region that failed, and how often for one repair
BYSTANDER = 0.4  # share of the penalty for contacts that are held where another contact, or the CoM, is at fault
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
    per_phase: int = 3
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
    """One plan on one scene, with the penalties added so far."""

    def __init__(self, plan: Plan, scene: Scene, robot: Robot, options: DeformOptions) -> None:
        self.plan, self.scene, self.robot, self.options = plan, scene, robot, options
        self.tell = options.progress or (lambda _: None)
        self.cone = FrictionCone(plan.friction_cone)
        self.context = QueryContext(scene, robot, WholeBodyIK(robot), self.cone)
        self.ik, self.packed = self.context.ik, self.context.packed
        warm_up(robot, self.ik)
        self.strip_options = replace(options.strip, cone=self.cone)
        self.sampling = Sampling(options.per_phase, options.furthest, options.strip.turn)
        self.planned = tuple(plan.contact(c) for c in range(len(plan.contacts)))
        self.penalty: list[dict[int, float]] = [{} for _ in self.planned]
        self.report: dict[str, float] = dict.fromkeys(
            (
                "deform_s",
                "regions_s",
                "strip_s",
                "dynamics_s",
                "motion_s",
                "verification_s",
                "iterations",
                "configurations",
                "repairs",
                "moved_mean",
                "moved_most",
            ),
            0.0,
        )
        self._maker: MotionMaker | None = None

    def run(self) -> DeformResult:
        best = self._without_region()
        tried: set[tuple[int, ...]] = set()
        chosen = self._choose() if best is None else []
        for attempt in range(self.options.repairs + 1 if best is None else 0):
            self.report["repairs"] = float(attempt)
            tried.add(_places(chosen))
            result, blamed = self._attempt(chosen)
            best = result if best is None or _rank(result) > _rank(best) else best
            if result.status == "complete" or not blamed or self.report["deform_s"] > self.options.deadline:
                break
            chosen = self._choose_again(chosen, blamed, tried)
            if not chosen:
                break
        assert best is not None
        return replace(best, report=dict(self.report))

    def _without_region(self) -> DeformResult | None:
        """Finds the regions of every contact; the answer where one has none."""
        began, alone = time.process_time(), stands_alone(self.plan)
        self.choices = []
        for c, contact in enumerate(self.planned):
            cone = self.cone if alone[c] else None
            self.choices.append(contact_choices(contact, self.robot, self.packed, self.sampling, cone))
            if not len(self.choices[c]):
                self._spend("regions_s", began)
                what = "no contact region flat enough to stand on alone" if alone[c] else "no contact region"
                where = f"within {self.options.furthest:g} m of where it was"
                reason = f"contact {c} ({contact.effector}): {what} {where}"
                return DeformResult("none", reason, None, None, None, dict(self.report))
        self._spend("regions_s", began)
        return None

    def _choose(self) -> list[Choice]:
        """The region of each contact: the nearest, with penalties added for regions that failed before."""
        places = zip(self.planned, self.choices, self.penalty, strict=True)
        return [choose_region(contact, regions, self.packed, penalty) for contact, regions, penalty in places]

    def _choose_again(
        self, chosen: list[Choice], blamed: dict[int, float], tried: set[tuple[int, ...]]
    ) -> list[Choice]:
        """Other regions: the penalties of the contacts at fault grow until the choice changes; none if it does not."""
        for _ in range(MAX_PENALTIES):
            for c, share in blamed.items():
                surface = chosen[c][0].surface
                self.penalty[c][surface] = self.penalty[c].get(surface, 0.0) + share * PENALTY
            chosen = self._choose()
            if _places(chosen) not in tried:
                return chosen
        return []

    def _attempt(self, chosen: list[Choice]) -> tuple[DeformResult, dict[int, float]]:
        """Solves one strip, then motion and verification; on failure also returns the contacts at fault."""
        strip = self._deform_strip(chosen)
        if not strip.feasible:
            return DeformResult("strip", strip.reason, None, strip, None, dict(self.report)), self._blame(strip)
        stances = [Stance(tuple(strip.contacts[c] if c >= 0 else None for c in row)) for row in self.plan.stances]
        self._note_contacts(strip)
        if not self.options.motion:
            return self._result("contacts", "no motion was asked for", stances, None, strip, None), {}
        motion = self._move(stances)
        report = None
        if motion.centroidal is not None and len(motion.problems) <= WORTH_VERIFYING:
            report, plan = self._verify(stances, motion)
            if report.holds:
                return DeformResult("complete", "", plan, strip, report, dict(self.report)), {}
        reason = motion.reason
        if motion.ok and report is not None:
            reason = "verification failed: " + ", ".join(report.failed)
        return self._result("contacts", reason, stances, None, strip, report), self._blame_motion(motion)

    def _deform_strip(self, chosen: list[Choice]) -> StripEstimate:
        began = time.process_time()
        problem = self._problem = make_problem(self.plan, self.scene, self.planned, chosen, self.sampling)
        left = max(self.options.deadline - self.report["deform_s"], 0.5)
        options = replace(self.strip_options, time_limit=min(self.strip_options.time_limit, left))
        model = self.ik.model
        strip = ElasticStrip(self.robot, self.ik.kinematics, model.capsules, self.packed, problem, options).solve()
        self.report["iterations"] += len(strip.iterations)
        self.report["configurations"] = float(len(problem.t))
        self._spend("strip_s", began)
        self.tell(ProgressEvent("deform", strip.reason or f"{len(strip.iterations)} iterations, {strip.ended_by}"))
        return strip

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
        motion: MotionResult | None,
        strip: StripEstimate,
        report: Report | None,
    ) -> DeformResult:
        return DeformResult(status, reason, self._assemble(stances, motion), strip, report, dict(self.report))

    def _blame(self, strip: StripEstimate) -> dict[int, float]:
        """Contacts at which a strip fails, with their shares of the fault: contacts missed, and those held there."""
        blamed: dict[int, float] = {}
        worst = strip.faults[0].value / strip.faults[0].limit
        for fault in strip.faults:
            weight = fault.value / fault.limit / worst
            if fault.task == CONTACT:
                blamed[fault.contact] = max(blamed.get(fault.contact, 0.0), weight)
            for c in self._problem.held[fault.configuration] if fault.configuration >= 0 else ():
                if c >= 0:
                    blamed[int(c)] = max(blamed.get(int(c), 0.0), BYSTANDER * weight)
        return blamed

    def _blame_motion(self, motion: MotionResult) -> dict[int, float]:
        """Where a motion fails: the contact that the failing transition makes, or the last one made before; the others
        held there less.
        """
        blamed: dict[int, float] = {}
        table = self.plan.stances
        for transition in motion.failed_transitions:
            k = min(transition, len(table) - 2)
            for c in table[k : k + 2].ravel():
                if c >= 0:
                    blamed[int(c)] = max(blamed.get(int(c), 0.0), BYSTANDER)
            while k >= 0:
                new = table[k + 1][(table[k + 1] >= 0) & (table[k + 1] != table[k])]
                if len(new):
                    blamed[int(new[0])] = 1.0
                    break
                k -= 1
        return blamed

    def _note_contacts(self, strip: StripEstimate) -> None:
        moved = [np.linalg.norm(a.p_WC - b.p_WC) for a, b in zip(strip.contacts, self.planned, strict=True)]
        self.report["moved_mean"], self.report["moved_most"] = float(np.mean(moved)), float(np.max(moved))

    def _spend(self, key: str, began: float) -> None:
        spent = time.process_time() - began
        self.report[key] += spent
        self.report["deform_s"] += spent


def _places(chosen: list[Choice]) -> tuple[int, ...]:
    return tuple(contact.surface for contact, _ in chosen)


def _rank(result: DeformResult) -> int:
    return ("none", "strip", "contacts", "complete").index(result.status)
