"""One solution of one optimiser to one problem, with time and memory, checked by recomputing its constraints."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from drakeplan.bench.peers import interior_point
from optimization.balance.contact_wrench import CornerForces
from optimization.balance.friction import FrictionCone
from optimization.centroidal.check import violations
from optimization.centroidal.options import ARM, CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem, structure
from optimization.centroidal.program import CentroidalProgram
from optimization.centroidal.timing import TimingOptions, optimise_timing
from optimization.centroidal.trajectory import CentroidalTrajectory, WrenchIntegrator
from scenes.gravity import GRAVITY

CLEAR, STATUS = Path("/proc/self/clear_refs"), Path("/proc/self/status")
ENOUGH = 3.0  # [s] of turns
Answer = tuple[bool, CentroidalProblem, CentroidalTrajectory | None, float, float, float]


@dataclass(frozen=True)
class Method:
    """A formulation and a solver.

    Attributes:
        formulation: in words.
        solver: in words.
        cone: friction cone.
        answer: claim, problem with the timing of the answer, trajectory or None, cost, seconds to build and to solve.
        longest: intervals of the longest question that it is asked; it is asked once where it has such a limit.
    """

    formulation: str
    solver: str
    cone: FrictionCone
    answer: Callable[[CentroidalProblem, CentroidalOptions], Answer]
    longest: int | None = None


@dataclass(frozen=True)
class Trial:
    """The result of one method on one question.

    Attributes:
        claimed: whether the optimiser calls its answer feasible.
        holds: whether it is, by the check on its world forces alone.
        cost: the objective of Lin 2020 sec. 6.3; inf where there is no answer.
        residual: of Newton's and Euler's equations, by this module's own sums [M g, M g m]; NaN without an answer.
        violated: worst constraint over its tolerance, 0 where all hold, inf without an answer.
        block: its name.
        build, solve: greatest and least seconds of the turns: what is built may be kept for the next.
        memory: growth of the process's peak memory [MB], NaN where the system does not say.
    """

    claimed: bool
    holds: bool
    cost: float
    residual: float
    violated: float
    block: str
    build: float
    solve: float
    memory: float


@dataclass
class PeakMemory:
    """How far the process's memory rose above where it stood [MB]; NaN where the system does not say."""

    rise: float = field(default=float("nan"))


@contextmanager
def peak_memory() -> Iterator[PeakMemory]:
    """Measures within a `with`; on Linux only. What other processes take is not counted."""
    found = PeakMemory()
    try:
        CLEAR.write_text("5", encoding="ascii")  # the peak becomes what is resident now
        before = _resident("VmHWM")
    except OSError:
        yield found
        return
    yield found
    found.rise = _resident("VmHWM") - before


def _resident(key: str) -> float:
    line = next(line for line in STATUS.read_text(encoding="ascii").splitlines() if line.startswith(key))
    return int(line.split()[1]) / 1024.0


def ours(solver: str) -> Callable[[CentroidalProblem, CentroidalOptions], Answer]:
    """`CentroidalProgram` with a solver by name."""

    def answer(problem: CentroidalProblem, options: CentroidalOptions) -> Answer:
        began = time.process_time()
        program = CentroidalProgram(problem, replace(options, solver=solver))
        built = time.process_time()
        estimate = program.solve()
        return (estimate.feasible, problem, estimate.trajectory, estimate.cost, built - began,
                time.process_time() - built)  # fmt: skip

    return answer


def free_timing(solver: str) -> Callable[[CentroidalProblem, CentroidalOptions], Answer]:
    """The same with durations of its own, no longer in all."""

    def answer(problem: CentroidalProblem, options: CentroidalOptions) -> Answer:
        began = time.process_time()
        timed = optimise_timing(problem, replace(options, solver=solver), TimingOptions())
        estimate = timed.estimate
        return (estimate.feasible, timed.problem, estimate.trajectory, estimate.cost, 0.0,
                time.process_time() - began)  # fmt: skip

    return answer


def exact_hessian() -> Callable[[CentroidalProblem, CentroidalOptions], Answer]:
    """IPOPT with exact second derivatives through CasADi, from a straight course; built once for each structure."""
    known: dict[Hashable, interior_point.InteriorPoint] = {}

    def answer(problem: CentroidalProblem, options: CentroidalOptions) -> Answer:
        began = time.process_time()
        key = structure(problem), options.cone
        if key not in known:
            known[key] = interior_point.InteriorPoint(problem, options)
        peer, built = known[key], time.process_time()
        found = peer.solve(problem, peer.guess(problem))
        elapsed = time.process_time() - built
        trajectory = trajectory_of_corners(problem, options, corner_forces(problem, found.x))
        return found.feasible, problem, trajectory, found.cost, built - began, elapsed

    return answer


def corner_forces(problem: CentroidalProblem, x: np.ndarray) -> np.ndarray:
    """(J, 4, 3) corner forces [M g] in the contact frames, out of the interior point's variables.

    For each interval the variables are nine of the state, then twelve for each contact.

    Args:
        problem: of the variables.
        x: the variables [scaled units].
    """
    parts, place = [np.zeros((0, 4, 3))], 0
    for row in problem.schedule.active:
        held = int((row >= 0).sum())
        parts.append(x[place + 9 : place + 9 + 12 * held].reshape(held, 4, 3))
        place += 9 + 12 * held
    return np.concatenate(parts)


def trajectory_of_corners(
    problem: CentroidalProblem, options: CentroidalOptions, forces: np.ndarray
) -> CentroidalTrajectory | None:
    """The trajectory that these forces cause, by integration; None where they are not finite.

    Args:
        problem: contacts, mass and initial state.
        options: its friction cone.
        forces: (J, V, 3) corner forces in the contact frames [M g].
    """
    if not np.isfinite(forces).all():
        return None
    weight, mass = problem.mass * GRAVITY, problem.mass
    initial = (problem.initial_com, problem.initial_linear_momentum / mass, problem.initial_angular_momentum / weight)
    integrator = WrenchIntegrator(problem.schedule, np.stack(initial))
    _, _, friction = problem.schedule.poses()
    held = problem.schedule.active[integrator.interval, integrator.effector]
    corners = CornerForces(options.cone, friction[held], problem.supports[held], ARM)
    wrench = corners.wrench(forces)
    return integrator.trajectory(problem.schedule, wrench[:, :3], ARM * wrench[:, 3:], mass)


def run_trial(method: Method, problem: CentroidalProblem, options: CentroidalOptions, turns: int = 1) -> Trial:
    """Solves repeatedly, keeps the least times, and checks the last solution.

    Args:
        method: formulation, solver and cone.
        problem: the question.
        options: of the centroidal program; the method's cone replaces theirs.
        turns: most repetitions; fewer once `ENOUGH` seconds have passed.
    """
    options = replace(options, cone=method.cone)
    builds, solves = [], []
    with peak_memory() as memory:
        for _ in range(turns):
            claimed, solved, trajectory, cost, build, solve = method.answer(problem, options)
            builds.append(build)
            solves.append(solve)
            if sum(builds) + sum(solves) > ENOUGH:
                break
    if trajectory is None:
        nothing = float("nan")
        return Trial(claimed, False, np.inf, nothing, np.inf, "no answer", max(builds), min(solves), memory.rise)
    found = violations(solved, options, trajectory)
    worst, block = (found[0].excess, found[0].block) if found else (0.0, "")
    residual = newton_euler(solved, trajectory)
    return Trial(claimed, not found, cost, residual, worst, block, max(builds), min(solves), memory.rise)


def newton_euler(problem: CentroidalProblem, t: CentroidalTrajectory) -> float:
    """Greatest residual of l, com and k between knots, from world forces, pressure centres and torques [M g, M g m].

    Args:
        problem: contacts and mass.
        t: the trajectory.
    """
    weight = problem.mass * GRAVITY
    dt = np.diff(t.t)[:, None]
    force, moment = np.tile([0.0, 0.0, -weight], (len(dt), 1)), np.zeros((len(dt), 3))
    for n, e in np.argwhere(t.contact[:-1] >= 0):
        contact = problem.schedule.contacts[t.contact[n, e]]
        p_cop = contact.p_WC + contact.R_WC[:, :2] @ t.cop_C[n, e]
        force[n] += t.force_W[n, e]
        moment[n] += np.cross(p_cop - t.com[n + 1], t.force_W[n, e]) + contact.R_WC[:, 2] * t.torque_n[n, e]
    gaps = (
        (np.diff(t.linear_momentum, axis=0) / dt - force) / weight,
        np.diff(t.com, axis=0) / dt - t.linear_momentum[1:] / problem.mass,
        (np.diff(t.angular_momentum, axis=0) / dt - moment) / weight,
    )
    return max(float(np.abs(gap).max()) for gap in gaps)
