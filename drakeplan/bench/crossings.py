"""Gaps and slopes that no quasi-static motion crosses, planned and verified (Lin et al. 2019 sec. VIII-A and B).

Three tables: the crossings beside the numbers of Lin et al. 2019; how far legs span a gap at rest and in motion, by Drake's inverse
kinematics; and the least speed on a slope, in closed form.
"""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass

import numpy as np

from drakeplan.bench.table import BenchOptions, BenchTable
from drakeplan.contact_planning.contact_plan import ContactPlan, DynamicsName, PlannerOptions
from drakeplan.contact_planning.search_planner import SearchPlanner
from drakeplan.contact_planning.sequence_dynamics import sequence_dynamics
from drakeplan.context import QueryContext
from drakeplan.motion.assembly import assemble_plan
from drakeplan.motion.course_dynamics import ComCourse
from drakeplan.motion.maker import MotionMaker, MotionOptions
from drakeplan.plan.plan import tabulate_stances
from drakeplan.plan.verified import verify_plan
from drakeplan.query.warm_up import warm_up
from drakeplan.search.ana_star import Limits
from drakeplan.timing.step_timing import Timing
from optimization.balance.balance_regions import balance_region
from optimization.balance.friction import FrictionCone
from optimization.centroidal.estimate import CentroidalEstimate
from optimization.inverse_kinematics.drake_posture import PostureSolver
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.gravity import GRAVITY
from scenes.library import slippery_slope, steep_slope, wide_gap, wider_gap
from scenes.library.plates import FRICTION, level_plate
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import Robot, load_robot
from scenes.scene import Scene
from scenes.terrain.terrain import Terrain
from scenes.transition_model import transition_model

DEADLINE = 10.0  # [s] of processor time for the search
SIDE = 0.1  # [m] of either foot from the middle, across the stride
RESOLUTION = 0.01  # [m] of the widest stride
HEADINGS = (0.0, 30.0, 60.0, 90.0)  # [deg] of both feet, away from the way across
PUBLISHED = (
    ("wide_gap", "learned (Lin et al. 2019)", "-", "1 + 1", 0.143, "-", "-", 1.23, "-"),
    ("steep_slope", "learned (Lin et al. 2019)", "-", "1 + 1", 0.702, "-", 31, 6.32, "-"),
)


@dataclass(frozen=True)
class Crossing:
    """One query: a scene, and how it is to be crossed.

    Attributes:
        scene: what to cross.
        name: of it in the table.
        dynamics: as for `PlannerOptions`.
        cone: friction cone.
        timing: of every transition.
        steps: foot transition model, "" for the scene's or the usual one.
    """

    scene: Scene
    name: str
    dynamics: DynamicsName
    cone: FrictionCone
    timing: Timing
    steps: str = ""


def crossings() -> tuple[Crossing, ...]:
    """The published scenes as published, and those that only motion crosses under the true cone."""
    documented, brisk, quick = Timing(), Timing(0.6, 1.0), Timing(0.3, 0.6)
    gap, wider, steep, slippery = wide_gap.named(), wider_gap.named(), steep_slope.named(), slippery_slope.named()
    long = steep_slope.named(tilt=slippery_slope.TILT)
    return (
        Crossing(gap, "wide_gap", "quasi-static", FrictionCone.INNER, documented, "leap_stride"),
        Crossing(gap, "wide_gap", "learned", FrictionCone.INNER, documented, "leap_stride"),
        Crossing(gap, "wide_gap", "exact", FrictionCone.INNER, documented, "leap_stride"),
        Crossing(wider, "wider_gap", "quasi-static", FrictionCone.INNER, brisk),
        Crossing(wider, "wider_gap", "exact", FrictionCone.INNER, brisk),
        Crossing(steep, "steep_slope", "quasi-static", FrictionCone.SECOND_ORDER, documented),
        Crossing(steep, "steep_slope", "exact", FrictionCone.DIAMOND, documented),
        Crossing(steep, "steep_slope", "exact", FrictionCone.SECOND_ORDER, quick),
        Crossing(slippery, "slippery_slope", "quasi-static", FrictionCone.SECOND_ORDER, quick),
        Crossing(slippery, "slippery_slope", "exact", FrictionCone.SECOND_ORDER, documented),
        Crossing(slippery, "slippery_slope", "exact", FrictionCone.SECOND_ORDER, quick),
        Crossing(long, "steep_slope, 27 deg", "exact", FrictionCone.SECOND_ORDER, quick),
    )


def run(options: BenchOptions) -> tuple[BenchTable, ...]:
    """One query each, the search's seed 0; processor time of one thread, everything loaded before."""
    robot = load_robot(options.robot)
    ik = WholeBodyIK(robot)
    warm_up(robot, ik)
    rows: list[tuple[object, ...]] = []
    for crossing in crossings():
        rows.append(cross(crossing, robot, ik))
        options.tell(" ".join(str(cell) for cell in rows[-1]))
    return _crossings([*rows, *PUBLISHED]), _strides(robot, options), _speeds(robot)


def cross(crossing: Crossing, robot: Robot, ik: WholeBodyIK, deadline: float = DEADLINE) -> tuple[object, ...]:
    """A row of the first table: the first contact sequence, its dynamics, and whether its motion was verified.

    Args:
        crossing: scene, dynamics, cone and timing.
        robot: that crosses.
        ik: its inverse kinematics.
        deadline: of the search, in processor time [s].
    """
    plan, asked, why = _search(crossing, robot, ik, deadline)
    timing = crossing.timing
    about = (crossing.name, crossing.dynamics, crossing.cone, f"{timing.shift:g} + {timing.swing:g}")
    nothing = float("nan")
    if plan is None:
        return (*about, nothing, asked, "-", nothing, f"no: {why}")
    began = time.process_time()
    estimate = sequence_dynamics(robot, plan.stances, crossing.cone, timing)
    program_s = time.process_time() - began
    contacts = len(tabulate_stances(plan.stances)[0])
    word = _play(crossing, robot, ik, plan, estimate) if estimate.feasible else f"no: {estimate.reason}"
    return (*about, plan.elapsed, asked, contacts, program_s, word)


def _search(crossing: Crossing, robot: Robot, ik: WholeBodyIK, deadline: float) -> tuple[ContactPlan | None, int, str]:
    """The first contact sequence, the number of transitions judged by dynamics, and why there is none."""
    model = transition_model(crossing.steps or crossing.scene.transition_model or "experiments")
    asked = PlannerOptions(dynamics=crossing.dynamics, timing=crossing.timing, model=model)
    planner = SearchPlanner(QueryContext(crossing.scene, robot, ik, crossing.cone, full_soles=True), asked)
    plan = next(planner.plans(Limits(deadline=deadline), time.process_time), None)
    judged = sum(planner.counts().transitions_judged.values())
    return plan, judged, "" if plan is not None else planner.why_not()


def _play(crossing: Crossing, robot: Robot, ik: WholeBodyIK, plan: ContactPlan, estimate: CentroidalEstimate) -> str:
    """Whether a motion through these contacts is verified, at rest between steps or else along the CoM's given course."""
    timing, trajectory, scene = crossing.timing, estimate.trajectory, crossing.scene
    assert trajectory is not None  # it is feasible
    options = MotionOptions(dt=timing.step or 0.2, shift=timing.shift, swing=timing.swing)
    maker = MotionMaker(QueryContext(scene, robot, ik, crossing.cone, full_soles=True), options)
    at = plan.stances[0].feet_mean()
    start = None if scene.start is None else dataclasses.replace(scene.start, xyz=tuple(at.tolist()))
    placed = dataclasses.replace(scene, start=start)
    word = ""
    for com_course in (None, ComCourse(trajectory.t, trajectory.com)):
        motion = maker.run(plan.stances, lambda event: None, com_course)
        if motion.centroidal is None:
            word = f"no: {motion.reason}"
            continue
        report = verify_plan(assemble_plan(placed, robot, plan.stances, motion, cone=crossing.cone, provenance={}))
        if report.holds:
            return "yes"
        word = "no: " + ", ".join(report.failed)
    return word


def _crossings(rows: list[tuple[object, ...]]) -> BenchTable:
    columns = ("scene", "planner", "cone", "shift + swing s", "first s", "transitions judged", "contacts", "program s",
               "verified")  # fmt: skip
    notes = (
        f"processor time of one thread, one query each, {DEADLINE:g} s of search at most; first: until the first contact "
        "sequence, which is then optimised (program), played and verified",
        "steep_slope under diamond is the documents' result: that cone admits what real friction does not, and the verifier, "
        "which holds every wrench against Coulomb's cone, refuses it",
        f"wider_gap {wider_gap.GAP:g} m; slippery_slope {math.degrees(slippery_slope.TILT):.0f} deg, {slippery_slope.LENGTH:g} m; "
        f"friction {FRICTION:g}",
    )
    return BenchTable(
        "crossings", "Gaps and slopes (Lin et al. 2019 sec. VIII-A and B)", columns, tuple(rows), notes, most_seeds=0
    )


# Strides ---------------------------------------------------------------------------------------------------------


def can_span(robot: Robot, stride: float, over: int | None, heading: float = 0.0) -> bool:
    """Whether Drake finds a posture with one foot on either side of a gap, soles up to its edges.

    Args:
        robot: that stands there.
        stride: from the left foot, behind, to the right foot [m].
        over: 0 or 1 where the CoM must be over that foot's own balance polygon alone, None for anywhere.
        heading: of both feet [rad].
    """
    sole = np.asarray(robot.effectors[0].half_extent)
    reach = float(sole @ np.abs([math.cos(heading), math.sin(heading)]))
    ground = Terrain(
        (level_plate("near", (-2.0, reach), (-1.5, 1.5)), level_plate("far", (stride - reach, 4.0), (-1.5, 1.5)))
    )
    solver = PostureSolver(build_plant(robot, ground))
    c, s = math.cos(heading), math.sin(heading)
    across = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    feet = [np.eye(4), np.eye(4)]
    for foot, (x, side) in enumerate(((0.0, 1.0), (stride, -1.0))):
        feet[foot][:3, :3] = across
        feet[foot][:2, 3] = x, side * SIDE * math.cos(heading)
    region = None
    if over is not None:
        region = balance_region(
            [Contact(EFFECTORS[over], over, feet[over], FRICTION)], robot, FrictionCone.SECOND_ORDER
        )
    for part, drop in ((0.5, 0.05), (0.5, 0.25), (0.3, 0.05), (0.7, 0.05), (0.1, 0.25), (0.9, 0.25)):
        q = nominal_posture(robot).copy()
        q[:4] = math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2)
        q[4:6] += stride * part, 0.0
        q[6] -= drop
        if solver.solve([*feet, None, None], region, q).ok:
            return True
    return False


def widest_stride(robot: Robot, over: int | None, heading: float = 0.0) -> float:
    """The widest stride that `can_span`, by bisection [m].

    Args:
        robot: whose legs.
        over: 0 (left foot, behind) or 1 (right foot, ahead) where the CoM must be over the balance polygon of that
            foot alone; None: anywhere.
        heading: of both feet, away from the direction of the stride [rad].
    """
    low, high = 0.5, 1.5
    while high - low > RESOLUTION:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if can_span(robot, middle, over, heading) else (low, middle)
    return low


def _strides(robot: Robot, options: BenchOptions) -> BenchTable:
    """Widest strides and gaps by heading."""
    rows = []
    sole = np.asarray(robot.effectors[0].half_extent)
    for heading in HEADINGS:
        angle = math.radians(heading)
        rear, front, free = (widest_stride(robot, over, angle) for over in (0, 1, None))
        soles = 2.0 * float(sole @ np.abs([math.cos(angle), math.sin(angle)]))
        rows.append((heading, rear, front, free, min(rear, front) - soles, free - soles))
        options.tell(f"heading {heading:g} deg: {rear:.2f} {front:.2f} {free:.2f} m")
    columns = ("heading deg", "stride, CoM over the foot behind", "over the foot ahead", "CoM anywhere",
               "widest gap at rest m", "widest gap in double support m")  # fmt: skip
    notes = (
        f"[m] by Drake's inverse kinematics with collisions, both feet turned alike, to {RESOLUTION:g} m; a failure is no proof",
        "a robot that is balanced at every moment has its CoM over the rear foot until the front foot has landed, and over the "
        "front foot before the rear foot is lifted; the published 0.5 m (stride 0.72 m) is possible in this way, wider_gap is not",
    )
    return BenchTable(
        "crossings_strides", "How far legs span a gap", columns, tuple(rows), notes, bench="crossings", most_seeds=0
    )


# Speeds ----------------------------------------------------------------------------------------------------------


def longest_time(tilt: float, length: float, friction: float = FRICTION) -> float:
    """Longest time [s] that a CoM can take down a slope on which no standing is possible; infinite on other slopes.

    Coulomb friction leaves at least a = g (sin tilt - mu cos tilt) along the slope while only the slope carries load
    and the height over it stays constant, so that length >= a T^2 / 2 even from rest.

    Args:
        tilt: of the slope [rad].
        length: of the slope [m].
        friction: Coulomb coefficient [-].
    """
    a = GRAVITY * (math.sin(tilt) - friction * math.cos(tilt))
    return math.sqrt(2.0 * length / a) if a > 0 else math.inf


def _speeds(robot: Robot) -> BenchTable:
    """What Coulomb's law asks of the gait."""
    rows = []
    step = 0.5 * robot.max_foot_translation
    for tilt, length in ((30.0, 3.0), (30.0, 0.8), (27.0, 3.0), (27.0, 2.0)):
        angle = math.radians(tilt)
        T = longest_time(angle, length)
        a = GRAVITY * (math.sin(angle) - FRICTION * math.cos(angle))
        rows.append((tilt, length, a, T, math.sqrt(2.0 * a * length), T * step / (length * math.cos(angle))))
    columns = ("tilt deg", "length m", "least acceleration m/s^2", "down within s", "speed at the end m/s",
               "longest transition s")  # fmt: skip
    notes = (
        "closed form, for a CoM that starts at rest where the slope begins; feet that still stand on level ground give some relief",
        f"longest transition: shift and swing with which feet that step {step:g} m ahead in plan are down in that time",
    )
    return BenchTable(
        "crossings_speeds",
        "What Coulomb's law asks of who goes down",
        columns,
        tuple(rows),
        notes,
        bench="crossings",
        most_seeds=0,
    )
