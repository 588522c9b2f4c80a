"""The centroidal program: labels per second, agreement with an interior point, whole sequences, and outside solvers.

Lin et al. 2019 give 10 labels/s, 1.23 s for 10 contacts (wide gap) and 6.32 s for 31 (steep slope), without bounds on
angular momentum.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from drakeplan.bench.peers import differential_dynamic, interior_point
from drakeplan.bench.peers.interior_point import InteriorPoint
from drakeplan.bench.random_transitions import CATEGORIES, RandomTransition, random_transition
from drakeplan.bench.table import BenchOptions, BenchTable
from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.estimate import CentroidalEstimate
from optimization.centroidal.options import UP, CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem, structure
from optimization.centroidal.program import CentroidalProgram
from optimization.centroidal.transition_dynamics import TransitionDynamics, transition_options
from optimization.convex import piqp_adapter
from scenes.contact import Contact, contact_pose
from scenes.footholds.start_stance import standing_com
from scenes.robots.robot import Robot, load_robot
from scenes.stance import Stance

PER_SEED = 4  # transitions of each category: 200 for 50 seeds
STARTS = 2  # of the interior point, where it finds nothing
TURNS = 3  # of each whole sequence; the least time counts
CONES = (FrictionCone.INNER, FrictionCone.SQUARE)
AIMS = {"feet": (40, 0.95), "one palm": (25, 0.92), "both palms": (25, 0.92)}  # labels/s, agreement
SLOPE = np.deg2rad(17.0)  # [rad]; the published 30 deg are impossible at friction 0.5 under any true cone
SEQUENCE_AIMS = {"10 contacts": (150, 300), "31 contacts": (600, 1500)}  # ms with PIQP and with Clarabel
WALK = "walk, 6 contacts"
COLUMNS = ("what", "cone", "solver", "asked", "feasible", "labels/s", "aim", "CPU ms", "median ms", "p95 ms", "agrees",
           "aim", "cost / peer's, p5", "p95", "worst violation")  # fmt: skip
NONE = float("nan")


@dataclass(frozen=True, eq=False)
class Labels:
    """The estimates of the transitions of one category, with their times.

    Attributes:
        estimates: one each.
        wall, cpu: seconds for each.
    """

    estimates: list[CentroidalEstimate]
    wall: np.ndarray
    cpu: np.ndarray


def run(options: BenchOptions) -> BenchTable:
    """Rates and agreement for random transitions, sequences of 10 and 31 contacts, and one walk for every peer."""
    robot = load_robot(options.robot)
    solvers = ("piqp", "clarabel") if piqp_adapter.available() else ("clarabel",)
    rows, notes = [], []
    for category in CATEGORIES:
        drawn = draw(robot, category, PER_SEED * options.seeds)
        for cone in CONES:
            for solver in solvers:
                found = label(robot, drawn, replace(transition_options(robot, cone), solver=solver))
                agrees: tuple[object, ...] = (NONE, NONE, NONE, NONE)
                if cone == FrictionCone.INNER and solver == solvers[0] and interior_point.available():
                    agrees, listed = agreement(robot, category, drawn, found, options)
                    notes += listed
                rows.append(_label_row(category, cone, solver, found, agrees))
                options.tell(f"{category}, {cone}, {solver}: {rows[-1][5]:.1f} labels/s")
    for name, stances in (("10 contacts", gap_walk()), ("31 contacts", slope_walk(31))):
        for cone in CONES:
            for solver in solvers:
                rows.append(_sequence_row(robot, name, stances, cone, solver))
                options.tell(f"{name}, {cone}, {solver}: {rows[-1][8]:.0f} ms")
    walk, listed = peers_on_a_walk(robot)
    rows += walk
    notes += [
        *listed,
        f"labels/s: by processor time, programs built within it; median and p95 by the clock. Sequences: {TURNS} turns, the"
        " program built anew in each; CPU ms is the least.",
        "agrees: same verdict as IPOPT with exact Hessians (CasADi) from up to "
        f"{STARTS} starts of its own; where only ours is feasible, from ours as well.",
        *([] if interior_point.available() else [interior_point.INSTALL]),
    ]
    return BenchTable(
        "centroidal",
        "Centroidal programs: labels, sequences and peers",
        COLUMNS,
        tuple(rows),
        tuple(notes),
        most_seeds=None,
    )


def draw(robot: Robot, category: str, count: int) -> list[RandomTransition]:
    """The first transitions of the category's own random sequence.

    Args:
        robot: for which they are drawn.
        category: one of `CATEGORIES`.
        count: how many.
    """
    rng = np.random.default_rng([list(CATEGORIES).index(category), 2019])
    return [random_transition(rng, robot, category) for _ in range(count)]


def label(robot: Robot, drawn: list[RandomTransition], options: CentroidalOptions) -> Labels:
    """Labels transitions one by one, as a campaign does.

    Args:
        robot: its limits and mass.
        drawn: the transitions.
        options: of the centroidal program.
    """
    TransitionDynamics(robot, options).estimate(*_question(drawn[0]))  # libraries load outside the measurement
    dynamics = TransitionDynamics(robot, options)
    estimates, wall, cpu = [], [], []
    for transition in drawn:
        began, began_cpu = time.perf_counter(), time.process_time()
        estimates.append(dynamics.estimate(*_question(transition)))
        wall.append(time.perf_counter() - began)
        cpu.append(time.process_time() - began_cpu)
    return Labels(estimates, np.array(wall), np.array(cpu))


def _question(t: RandomTransition) -> tuple[Stance, Stance, np.ndarray, np.ndarray]:
    return t.before, t.after, t.com, t.linear_momentum


def _label_row(
    category: str, cone: FrictionCone, solver: str, found: Labels, agrees: tuple[object, ...]
) -> tuple[object, ...]:
    rate, share = AIMS[category]
    yes = sum(e.feasible for e in found.estimates)
    percent = [1e3 * float(np.percentile(found.wall, q)) for q in (50, 95)]
    aim = rate if solver == "piqp" else NONE
    return (category, cone, solver, len(found.wall), yes, len(found.cpu) / float(found.cpu.sum()), aim,
            1e3 * float(found.cpu.mean()), *percent, agrees[0], share if agrees[0] == agrees[0] else NONE,
            *agrees[1:])  # fmt: skip


def agreement(
    robot: Robot, category: str, drawn: list[RandomTransition], found: Labels, options: BenchOptions
) -> tuple[tuple[object, ...], list[str]]:
    """Compares feasibility and cost of drakeplan's program with those of the interior-point peer.

    Args:
        robot: its limits and mass.
        category: of the transitions, for the list.
        drawn: the transitions.
        found: drakeplan's estimates of them.
        options: progress.

    Returns:
        (share of equal verdicts, 5th and 95th percentile of drakeplan's cost over the peer's, worst violation of a
        trajectory of drakeplan that the peer could not reduce to zero), and a line for every disagreement.
    """
    dynamics = TransitionDynamics(robot)
    peers: dict[object, InteriorPoint] = {}
    ratios, listed, seconds, unmended = [], [], [], 0.0
    for i, (transition, ours) in enumerate(zip(drawn, found.estimates, strict=True)):
        problem = dynamics.problem(*_question(transition))
        key = structure(problem)
        if key not in peers:
            peers[key] = InteriorPoint(problem, dynamics.options)
        peer = peers[key]
        answer = peer.solve(problem, peer.guess(problem))
        seconds.append(answer.time)
        for start in range(1, STARTS):
            if not answer.feasible:
                again = peer.solve(problem, peer.guess(problem, np.random.default_rng(start)))
                answer = again if again.violation < answer.violation else answer
        alone = ours.feasible and not answer.feasible
        if alone and ours.trajectory is not None:
            answer = peer.solve(problem, peer.from_trajectory(problem, ours.trajectory))
            unmended = max(unmended, 0.0 if answer.feasible else answer.violation)
            if answer.feasible:
                listed.append(f"{category} {i}: feasible; the peer finds it from our trajectory only")
        if ours.feasible and answer.feasible:
            ratios.append(ours.cost / answer.cost)
        if ours.feasible != answer.feasible:
            verdict = "FALSE FEASIBLE" if ours.feasible else f"only the peer finds it (we: {ours.reason})"
            listed.append(f"{category} {i}: {verdict}; its cost {answer.cost:.4g}, violation {answer.violation:.1e}")
            options.tell(listed[-1])
    differ = sum("peer finds it (" in line or "FALSE" in line for line in listed)
    listed.append(f"{category}: {differ} of {len(drawn)} verdicts differ; IPOPT's first start takes "
                  f"{1e3 * float(np.median(seconds)):.0f} ms (median).")  # fmt: skip
    options.tell(listed[-1])
    p5, p95 = np.percentile(ratios, [5, 95]) if ratios else (NONE, NONE)
    return (1.0 - differ / len(drawn), float(p5), float(p95), unmended), listed


# Whole sequences -----------------------------------------------------------------------------------------------------


def _foot(effector: int, point: np.ndarray, normal: np.ndarray) -> Contact:
    name = ("left_foot", "right_foot")[effector]
    return Contact(name, 0, contact_pose(name, point, normal, 0.0), 0.5)


def gap_walk() -> list[Stance]:
    """10 foot contacts on level ground with one stride of 0.72 m, as over the wide gap (Lin 2020 sec. 6.7.1)."""
    stances = [Stance((_foot(0, np.array([0, 0.1, 0]), UP), _foot(1, np.array([0, -0.1, 0]), UP), None, None))]
    for i, x in enumerate((0.2, 0.3, 0.3, 0.35, 1.02, 1.02, 1.3, 1.3)):
        foot = i % 2
        stances.append(stances[-1].replace(foot, _foot(foot, np.array([x, 0.1 - 0.2 * foot, 0.0]), UP)))
    return stances


def slope_walk(contacts: int, length: float = 3.0) -> list[Stance]:
    """A walk down a slope by equal short strides (Lin 2020 sec. 6.7.2).

    Args:
        contacts: number of foot contacts.
        length: of the walk along the slope [m].
    """
    normal = np.array([np.sin(SLOPE), 0.0, np.cos(SLOPE)])

    def foot(index: int) -> Contact:
        along = max(0, index - 1) * length / (contacts - 2)
        side = 0.1 if index % 2 == 0 else -0.1
        return _foot(index % 2, np.array([along * np.cos(SLOPE), side, -along * np.sin(SLOPE)]), normal)

    stances = [Stance((foot(0), foot(1), None, None))]
    for index in range(2, contacts):
        stances.append(stances[-1].replace(index % 2, foot(index)))
    return stances


def sequence_problem(robot: Robot, stances: list[Stance], options: CentroidalOptions) -> CentroidalProblem:
    """The centroidal problem of a sequence, from rest over the first feet.

    Args:
        robot: its mass and contact patches.
        stances: the sequence.
        options: their durations are used, by default those of Lin 2020 sec. 6.7.
    """
    schedule = ContactSchedule.from_stances(
        stances, dt=options.dt, shift_time=options.shift_time, swing_time=options.swing_time
    )
    start = standing_com(robot, stances[0])
    return CentroidalProblem(schedule, robot.mass, robot.half_extents, start)


def sequence_options(robot: Robot, cone: FrictionCone, solver: str) -> CentroidalOptions:
    """Options with a robot's limits, at rest at the end.

    Args:
        robot: its limits.
        cone: friction cone of every contact.
        solver: its name.
    """
    return replace(transition_options(robot, cone), rest_at_end=True, explain=True, solver=solver)


def _sequence_row(
    robot: Robot, name: str, stances: list[Stance], cone: FrictionCone, solver: str
) -> tuple[object, ...]:
    chosen = sequence_options(robot, cone, solver)
    problem = sequence_problem(robot, stances, chosen)
    wall, cpu = [], []
    estimate = CentroidalProgram(problem, chosen).solve()  # libraries load outside the measurement
    for _ in range(TURNS):
        began, began_cpu = time.perf_counter(), time.process_time()
        estimate = CentroidalProgram(problem, chosen).solve()
        wall.append(time.perf_counter() - began)
        cpu.append(time.process_time() - began_cpu)
    aims = SEQUENCE_AIMS.get(name)
    shown = name if aims is None else f"{name} (aim {aims[0] if solver == 'piqp' else aims[1]} ms)"
    median, most = 1e3 * float(np.median(wall)), 1e3 * max(wall)
    return (shown, cone, solver, TURNS, TURNS * int(estimate.feasible), NONE, NONE, 1e3 * min(cpu), median, most,
            *([NONE] * 5))  # fmt: skip


def peers_on_a_walk(robot: Robot) -> tuple[list[tuple[object, ...]], list[str]]:
    """One walk of six contacts for our program, IPOPT and crocoddyl: cost, violation by IPOPT's functions, time."""
    chosen = sequence_options(robot, DEFAULT_CONE, "auto")
    problem = sequence_problem(robot, slope_walk(6, length=0.8), chosen)
    rows, notes = [_sequence_row(robot, WALK, slope_walk(6, length=0.8), DEFAULT_CONE, "auto")], []
    ours = CentroidalProgram(problem, chosen).solve()
    if not interior_point.available():
        return rows, [*notes, interior_point.INSTALL]
    peer = InteriorPoint(problem, chosen)
    answer = peer.solve(problem, peer.guess(problem))
    rows.append(_peer_row("IPOPT, exact Hessian", answer.feasible, answer.time, answer.cost, ours, answer.violation))
    if not differential_dynamic.available():
        return rows, [*notes, differential_dynamic.INSTALL]
    found = differential_dynamic.solve(problem, chosen)
    _, violation = peer.judge(problem, found.x)
    rows.append(_peer_row("crocoddyl, FDDP", found.converged, found.time, found.cost, ours, violation))
    notes.append(differential_dynamic.NOTE)
    return rows, notes


def _peer_row(
    name: str, feasible: bool, seconds: float, cost: float, ours: CentroidalEstimate, violation: float
) -> tuple[object, ...]:
    ratio = ours.cost / cost
    return (WALK, DEFAULT_CONE, name, 1, int(feasible), NONE, NONE, NONE, 1e3 * seconds, NONE, NONE, NONE,
            ratio, ratio, violation)  # fmt: skip
