"""Rows of the optimisers' table for formulations with questions of their own: whole body, deformation, mixed integers."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from drakeplan.bench.deform import moved_scene
from drakeplan.bench.table import BenchOptions
from drakeplan.bench.trial import newton_euler, peak_memory
from drakeplan.contact_planning.program_planner import ProgramPlanner
from drakeplan.context import QueryContext
from drakeplan.experience.deformation import DeformOptions, deform
from drakeplan.motion.free_timing import effort, planned_schedule
from drakeplan.query.options import PlanOptions
from drakeplan.query.planning import plan_scene
from drakeplan.timing.step_timing import Timing
from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.centroidal.check import violations
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.contact_programs.contact_momentum_program import ContactDynamicsProgram
from optimization.contact_programs.convex_set_graph import ConvexSetGraph
from optimization.contact_programs.footstep_program import (
    ContactEstimate,
    ContactQuery,
    FootstepOptions,
    FootstepProgram,
)
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from optimization.kinodynamic.program import KinodynamicOptions, KinodynamicProblem, KinodynamicProgram
from optimization.mixed_integer.solver import BACKENDS, MixedIntegerSettings
from scenes.contact import Contact, contact_pose
from scenes.files.scene_source import load_scene
from scenes.robots.plant import nominal_posture
from scenes.robots.robot import Robot
from scenes.stance import Stance

NAN = float("nan")
EXPANSIONS = 200  # of the search of whole plans: both timings get the same contacts
SCENE = "rubble_field"
CONTACTS = 16  # foot contacts over the 3.4 m of the rubble field
GAP, TIME_LIMIT = 0.05, 60.0  # of the mixed-integer solvers [-], [s]
NOTES = (
    "kino-dynamic: two steps on level ground; confirmed when its momentum trajectory passes the centroidal check, residual"
    " by the sums made here. elastic strip: the plan of the rubble field deformed to surfaces moved by up to 10 cm and 15"
    " deg; confirmed by the verifier of the whole plan that comes of it; solve is regions and strips.",
    "whole plan: contacts, momenta and motion, confirmed by the verifier; cost is the documents' objective of its momenta and"
    " forces; solve is everything. Free timing keeps the total and never shortens a swing.",
    f"mixed integers: {CONTACTS} contacts over the rubble field to a gap of {GAP:g} within {TIME_LIMIT:g} s of wall time"
    " (with dynamics: the first answer); violation is that of the constraints recomputed at the answer, over its"
    " tolerance; cost / best is cost over the solver's bound; CPU time and memory are those of its process, what it shares"
    " with its parent included.",
)

Row = tuple[object, ...]


class _Program(Protocol):
    """A formulation of where to step."""

    def solve(self, settings: MixedIntegerSettings | None = None) -> ContactEstimate: ...


def whole_body_rows(robot: Robot, options: BenchOptions) -> tuple[list[Row], tuple[str, ...]]:
    """One row for each formulation, and notes.

    Args:
        robot: for which they are solved.
        options: progress.
    """
    rows = [kinodynamic_row(robot)]
    options.tell(f"kino-dynamic: {rows[-1][5]} of 1")
    rows.append(strip_row(robot))
    options.tell(f"elastic strip: {rows[-1][5]} of 1")
    for row in (*plan_rows(robot), *mixed_integer_rows(robot)):
        rows.append(row)
        options.tell(f"{row[0]}, {row[1]}: {row[5]} of 1")
    return rows, NOTES


def kinodynamic_row(robot: Robot) -> Row:
    """Two steps on level ground."""
    began = time.process_time()
    dt = 0.1
    program = KinodynamicProgram(robot, KinodynamicOptions(centroidal=CentroidalOptions(dt=dt)))
    q = np.array(nominal_posture(robot))
    built = time.process_time()
    standing = Stance((_foot("left_foot", 0.0), _foot("right_foot", 0.0), None, None))
    stances = [standing, standing.replace(0, _foot("left_foot", 0.25))]
    stances.append(stances[-1].replace(1, _foot("right_foot", 0.25)))
    schedule = ContactSchedule.from_stances(stances, dt=dt)
    com = program.kinematics.com(q)
    problem = CentroidalProblem(schedule, robot.mass, robot.half_extents, com)
    with peak_memory() as memory:
        estimate = program.solve(KinodynamicProblem(problem, q))
    elapsed = time.process_time() - built
    trajectory = None if estimate.centroidal is None else estimate.centroidal.trajectory
    if estimate.centroidal is None or trajectory is None:
        return _row(
            "kino-dynamic",
            "auto",
            DEFAULT_CONE,
            "2 steps",
            estimate.feasible,
            False,
            build=built - began,
            solve=elapsed,
            memory=memory.rise,
        )
    found = violations(problem, program.options.centroidal, trajectory)
    return _row(
        "kino-dynamic",
        "auto",
        DEFAULT_CONE,
        "2 steps",
        estimate.feasible,
        not found,
        cost=estimate.centroidal.cost,
        violation=found[0].excess if found else 0.0,
        residual=newton_euler(problem, trajectory),
        build=built - began,
        solve=elapsed,
        memory=memory.rise,
    )


def strip_row(robot: Robot) -> Row:
    """The rubble field's plan, deformed to its moved surfaces."""
    scene, moved = moved_scene(SCENE, 0)
    plan = plan_scene(scene, robot, PlanOptions(seed=0, dynamics="quasi-static")).plan
    if plan is None or plan.motion is None:
        return _row("elastic strip", "no plan to deform", DEFAULT_CONE, SCENE, False, False)
    with peak_memory() as memory:
        result = deform(plan, moved, DeformOptions(), robot=robot)
    holds = result.verification is not None and result.verification.holds
    iterations = f"{SCENE}, {result.report.get('configurations', NAN):.0f} configurations"
    return _row(
        "elastic strip",
        "auto",
        DEFAULT_CONE,
        iterations,
        result.status == "complete",
        holds,
        solve=result.report["deform_s"],
        memory=memory.rise,
    )


def plan_rows(robot: Robot) -> Iterator[Row]:
    """The rubble field planned, with momenta and motion, at given and at free timing."""
    for free in (False, True):
        options = PlanOptions(seed=0, dynamics="quasi-static", expansions=EXPANSIONS, timing=Timing(free=free))
        with peak_memory() as memory:
            began = time.process_time()
            found = plan_scene(load_scene(SCENE, seed=0), robot, options)
            elapsed = time.process_time() - began
        plan = found.plan
        whole = plan is not None and plan.centroidal is not None
        cost = NAN
        if plan is not None and plan.centroidal is not None:
            cost = effort(robot, planned_schedule(plan), options.cone, plan.centroidal)  # type: ignore[arg-type]
        formulation = f"whole plan, {'free' if free else 'given'} timing"
        yield _row(
            formulation,
            "auto",
            DEFAULT_CONE,
            SCENE,
            whole,
            found.status == "complete",
            cost=cost,
            solve=elapsed,
            memory=memory.rise,
        )


def mixed_integer_rows(robot: Robot) -> Iterator[Row]:
    """Footsteps by every solver that can be used here, contacts with dynamics, and the graph of convex sets."""
    planner = ProgramPlanner(QueryContext(load_scene(SCENE, seed=0), robot, WholeBodyIK(robot)), "footsteps")
    solvers = [backend.name for backend in BACKENDS if not backend.missing()]
    asked: list[tuple[str, str, Callable[[ContactQuery, FootstepOptions], _Program]]] = [
        *(("footsteps, mixed integer", solver, FootstepProgram) for solver in solvers),
        ("contacts with dynamics, mixed integer", solvers[0], ContactDynamicsProgram),
        ("footsteps, graph of convex sets", "auto", ConvexSetGraph),
    ]
    for formulation, solver, build in asked:
        began = time.process_time()
        program = build(planner.query, FootstepOptions(num_contacts=CONTACTS))
        built = time.process_time()
        with peak_memory() as memory:
            first = build is ContactDynamicsProgram
            settings = MixedIntegerSettings(solver=solver, time_limit=TIME_LIMIT, gap=GAP, first_only=first)
            estimate = program.solve(settings)
        elapsed = time.process_time() - built
        yield _contact_row(formulation, solver, estimate, settings, built - began, elapsed, memory.rise)


def _contact_row(
    formulation: str,
    solver: str,
    estimate: ContactEstimate,
    settings: MixedIntegerSettings,
    build: float,
    solve: float,
    memory: float,
) -> Row:
    record = estimate.record
    size = f"{CONTACTS} contacts, {SCENE}"
    if record is not None and np.isfinite(record.cpu_time):  # solved in a process of its own
        solve, memory = record.cpu_time, record.peak_rss_mb
    if record is None or not estimate.feasible:
        return _row(
            formulation, solver, DEFAULT_CONE, size, estimate.feasible, False, build=build, solve=solve, memory=memory
        )
    return _row(
        formulation,
        record.solver,
        DEFAULT_CONE,
        size,
        True,
        record.worst <= settings.accept,
        cost=estimate.cost,
        ratio=estimate.cost / record.bound if record.bound > 0 else NAN,
        violation=record.worst / settings.accept,
        build=build,
        solve=solve,
        memory=memory,
    )


def _row(
    formulation: str,
    solver: str,
    cone: FrictionCone,
    size: str,
    claimed: bool,
    holds: bool,
    *,
    cost: float = NAN,
    ratio: float = NAN,
    violation: float = NAN,
    residual: float = NAN,
    build: float = NAN,
    solve: float = NAN,
    memory: float = NAN,
) -> Row:
    """A row of the optimisers' table for one question."""
    return (
        formulation,
        solver,
        cone,
        size,
        1,
        int(claimed and holds),
        int(claimed and not holds),
        cost,
        ratio,
        violation,
        residual,
        1e3 * build,
        1e3 * solve,
        1e3 * solve,
        memory,
    )


def _foot(name: str, x: float) -> Contact:
    y = 0.1 if name == "left_foot" else -0.1
    return Contact(name, 0, contact_pose(name, np.array([x, y, 0.0]), np.array([0.0, 0.0, 1.0]), 0.0), 0.6)
