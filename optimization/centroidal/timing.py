"""Timing of a contact sequence: phase durations that make its centroidal trajectory cheaper.

Ponton et al. 2018: B. Ponton et al., "On time optimization of centroidal momentum dynamics", ICRA 2018.
Lin 2020: Y.-C. Lin, "Learning for Humanoid Multi-Contact Navigation Planning" (dissertation), leaves it as future work.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from optimization.centroidal.check import violations
from optimization.centroidal.estimate import CentroidalEstimate
from optimization.centroidal.options import COST_SCALE, CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from optimization.centroidal.timing_step import TimingStep, whole_cost
from optimization.centroidal.trajectory import CentroidalTrajectory
from scenes.input_error import InputError

Build = Callable[[CentroidalProblem, CentroidalOptions], CentroidalProgram]
RESCUES = (0.8, 1.25, 0.64, 1.5625, 0.5, 2.0)  # factors tried on all durations where the given ones have no answer
GOOD, POOR = 0.5, 0.1  # parts of the foreseen decrease that widen the trust region, and that are too few to keep it
LEAST_RADIUS = 5e-3  # [-] of the durations


@dataclass(frozen=True)
class TimingOptions:
    """Which durations are free, and how far.

    Attributes:
        each: "phase" (the longest runs of the same active contacts keep their intervals' shares) or "interval".
        shortest, longest: bounds on each duration, as factors of the given one; one for all, or (G,) of them.
        interval: bounds on every interval [s].
        total: greatest sum of all durations [s]; the given sum where None, inf where free.
        change_weight: on the squared change of each interval [1/s^2], as in Ponton et al. 2018.
        radius: first trust region, as a factor of each duration.
        max_iterations: fixed-time programs solved at most, after the first.
        tolerance: relative decrease that is not worth another step.
        time_limit: seconds after which no further step is started.
    """

    each: str = "phase"
    shortest: float | tuple[float, ...] = 0.5
    longest: float | tuple[float, ...] = 2.0
    interval: tuple[float, float] = (0.02, 0.5)
    total: float | None = None
    change_weight: float = 0.0
    radius: float = 0.3
    max_iterations: int = 30
    tolerance: float = 1e-3
    time_limit: float = 60.0

    def __post_init__(self) -> None:
        if self.each not in ("phase", "interval"):
            raise InputError(f"timing options: each must be 'phase' or 'interval', got {self.each!r}")
        low, high = (np.atleast_1d(np.asarray(factor, float)) for factor in (self.shortest, self.longest))
        if not ((low > 0).all() and (low <= 1).all() and (high >= 1).all() and np.isfinite(high).all()):
            raise InputError(
                f"timing options: expected 0 < shortest <= 1 <= longest, got {self.shortest}, {self.longest}"
            )
        if not 0 < self.interval[0] <= self.interval[1]:
            raise InputError(f"timing options: interval must ascend from above 0 s, got {self.interval}")
        if self.total is not None and not self.total > 0:
            raise InputError(f"timing options: total must be > 0 s, got {self.total}")
        for name in ("radius", "tolerance", "time_limit"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise InputError(f"timing options: {name} must be a finite number > 0, got {getattr(self, name)}")
        if not (math.isfinite(self.change_weight) and self.change_weight >= 0):
            raise InputError(f"timing options: change_weight must be a finite number >= 0, got {self.change_weight}")
        if self.max_iterations < 1:
            raise InputError(f"timing options: max_iterations must be at least 1, got {self.max_iterations}")


@dataclass(frozen=True)
class TimingRecord:
    """One step that was tried.

    Attributes:
        radius: trust region, as a factor of each duration.
        foreseen: objective that the convex step promised.
        objective: what the fixed-time program then had; inf where it was not feasible.
        accepted: whether the step was kept.
    """

    radius: float
    foreseen: float
    objective: float
    accepted: bool


@dataclass(frozen=True, eq=False)
class TimedEstimate:
    """A centroidal trajectory with durations of its own, never worse than that with the durations it started from.

    Attributes:
        problem: with the schedule that was found.
        estimate: of that problem: solved at fixed time and checked like any other.
        objective: its cost with the pull towards a CoM reference and the price of changed intervals.
        durations: (G,) [s].
        given: (G,) that it started from [s].
        group: (N-1,) which duration each interval belongs to.
        gradient: (G,) derivative of the objective by each duration at the end [1/s], NaN where there is no trajectory.
        fixed: the estimate at the durations it started from.
        fixed_objective: its objective.
        records: the steps.
        reason: "converged", "no step improves", "iterations", "time" or "no trajectory".
    """

    problem: CentroidalProblem
    estimate: CentroidalEstimate
    objective: float
    durations: np.ndarray
    given: np.ndarray
    group: np.ndarray
    gradient: np.ndarray
    fixed: CentroidalEstimate
    fixed_objective: float
    records: tuple[TimingRecord, ...]
    reason: str


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A fixed-time answer; `rank` orders feasible before infeasible, then by violation, then by objective."""

    problem: CentroidalProblem
    program: CentroidalProgram
    estimate: CentroidalEstimate
    objective: float
    rank: tuple[bool, float, float]


def optimise_timing(
    problem: CentroidalProblem,
    options: CentroidalOptions | None = None,
    timing: TimingOptions | None = None,
    *,
    build: Build = CentroidalProgram,
) -> TimedEstimate:
    """Shortens and lengthens phases until the objective stands still.

    A trust region on the durations around fixed-time programs: a convex step (`TimingStep`) proposes durations, the
    fixed-time program is solved there from the last trajectory, and only an answer that passes every check and costs
    less is kept. Where the given durations allow no trajectory, all are scaled until one is found.

    Args:
        problem: its schedule gives the durations to start from; scaled to `timing.total` where they are longer.
            References by knot stay with their knots.
        options: as for `CentroidalProgram`.
        timing: bounds and limits.
        build: makes the program, where it needs more than its own constraints.

    Raises:
        InputError: the given intervals are outside the bounds, or the total is too short for them.
    """
    search = _TimingSearch(problem, options or CentroidalOptions(), timing or TimingOptions(), build)
    return search.run()


class _TimingSearch:
    """The trust region's state: bounds, the best answer and what was tried."""

    def __init__(
        self, problem: CentroidalProblem, options: CentroidalOptions, timing: TimingOptions, build: Build
    ) -> None:
        self.problem, self.options, self.timing, self.build = problem, options, timing, build
        schedule = problem.schedule
        self.group = schedule.phases if timing.each == "phase" else np.arange(len(schedule.dt))
        self.given = np.bincount(self.group, schedule.dt)
        self.share = schedule.dt / self.given[self.group]
        self.least, self.most = self._bounds()
        self.total = float(self.given.sum()) if timing.total is None else timing.total
        if self.least.sum() > self.total * (1 + 1e-9):
            raise InputError(
                f"timing: total {self.total:.3g} s is less than the shortest durations take, {self.least.sum():.3g} s"
            )
        self.deadline = time.perf_counter() + timing.time_limit

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(G,) least and greatest durations [s]."""
        timing, count = self.timing, len(self.given)
        widest, narrowest = np.zeros(count), np.full(count, np.inf)
        np.maximum.at(widest, self.group, self.share)
        np.minimum.at(narrowest, self.group, self.share)
        for name in ("shortest", "longest"):
            factor = getattr(timing, name)
            if isinstance(factor, tuple) and len(factor) != count:
                raise InputError(f"timing: {name} has {len(factor)} factors for {count} durations")
        least = np.maximum(np.asarray(timing.shortest) * self.given, timing.interval[0] / narrowest)
        most = np.minimum(np.asarray(timing.longest) * self.given, timing.interval[1] / widest)
        outside = np.flatnonzero((self.given < least * (1 - 1e-9)) | (self.given > most * (1 + 1e-9)))
        if len(outside):
            raise InputError(
                f"timing: intervals of {timing.each} {outside[0]} are outside the bounds of"
                f" {timing.interval[0]:g} to {timing.interval[1]:g} s"
            )
        return least, most

    def run(self) -> TimedEstimate:
        start = self._fit(self.given)
        best = fixed = self._solve(start, None)
        durations = start
        if best.estimate.trajectory is None:
            durations, best = self._rescue(start, best)
        if best.estimate.trajectory is None:
            return self._answer(best, fixed, durations, start, [], "no trajectory")
        records: list[TimingRecord] = []
        radius, reason = self.timing.radius, "iterations"
        step = self._step(best)
        for _ in range(self.timing.max_iterations):
            if time.perf_counter() > self.deadline:
                reason = "time"
                break
            change, foreseen = self._propose(step, durations, radius)
            gain = best.objective - foreseen
            if change is not None and best.estimate.feasible and gain <= self.timing.tolerance * best.objective:
                reason = "converged"
                break
            tried = None if change is None else self._solve(durations + change, best.estimate.trajectory)
            better = tried is not None and tried.rank < best.rank
            feasible = tried is not None and tried.estimate.feasible
            records.append(TimingRecord(radius, foreseen, tried.objective if tried and feasible else np.inf, better))
            part = (best.objective - tried.objective) / gain if tried and feasible and gain > 0 else 0.0
            if better and tried is not None and change is not None:
                durations, best = durations + change, tried
                step = self._step(best)
            radius = (
                min(2 * radius, 1.0) if better and part >= GOOD else radius if better and part > POOR else 0.3 * radius
            )
            if radius < LEAST_RADIUS:
                reason = "no step improves"
                break
        return self._answer(best, fixed, durations, start, records, reason)

    def _fit(self, durations: np.ndarray) -> np.ndarray:
        """The durations within their bounds, shortened alike where their sum exceeds the total."""
        durations = np.clip(durations, self.least, self.most)
        excess = durations.sum() - self.total
        room = durations - self.least
        return durations - room * (max(excess, 0.0) / room.sum()) if excess > 1e-9 * self.total else durations

    def _solve(self, durations: np.ndarray, start: CentroidalTrajectory | None) -> _Candidate:
        """The fixed-time program at these durations, from an earlier trajectory's forces."""
        schedule = replace(self.problem.schedule, dt=self.share * durations[self.group])
        problem = replace(self.problem, schedule=schedule)
        program = self.build(problem, self.options)
        if start is not None:
            program.start_from(start)
        estimate = program.solve()
        trajectory = estimate.trajectory
        if trajectory is None:
            return _Candidate(problem, program, estimate, np.inf, (True, np.inf, np.inf))
        moved = np.sum((schedule.dt - self.problem.schedule.dt) ** 2)
        objective = whole_cost(program.data, trajectory) + self.timing.change_weight * float(moved)
        excess = sum(violation.excess for violation in violations(problem, self.options, trajectory))
        return _Candidate(problem, program, estimate, objective, (not estimate.feasible, excess, objective))

    def _rescue(self, start: np.ndarray, failed: _Candidate) -> tuple[np.ndarray, _Candidate]:
        """The best of all durations scaled alike; `failed` where none has a trajectory."""
        best, found = start, failed
        for factor in RESCUES:
            durations = self._fit(factor * start)
            if time.perf_counter() > self.deadline:
                break
            tried = self._solve(durations, None)
            if tried.rank < found.rank:
                best, found = durations, tried
            if found.estimate.feasible:
                break
        return best, found

    def _step(self, candidate: _Candidate) -> TimingStep:
        trajectory = candidate.estimate.trajectory
        assert trajectory is not None  # callers see to it
        program, weight = candidate.program, self.timing.change_weight
        return TimingStep(program, trajectory, self.group, self.problem.schedule.dt, weight)

    def _propose(self, step: TimingStep, durations: np.ndarray, radius: float) -> tuple[np.ndarray | None, float]:
        """(G,) change within the trust region, and the objective that the convex step foresees."""
        least = np.maximum(self.least - durations, -radius * durations)
        most = np.minimum(self.most - durations, radius * durations)
        limit = max(self.deadline - time.perf_counter(), 0.1)
        change, record = step.solve(np.minimum(least, 0.0), np.maximum(most, 0.0), self._room(durations), limit)
        return change, record.cost / COST_SCALE

    def _room(self, durations: np.ndarray) -> float:
        return max(self.total - float(durations.sum()), 0.0) if math.isfinite(self.total) else math.inf

    def _answer(
        self,
        best: _Candidate,
        fixed: _Candidate,
        durations: np.ndarray,
        start: np.ndarray,
        records: list[TimingRecord],
        reason: str,
    ) -> TimedEstimate:
        gradient = np.full(len(durations), np.nan)
        if best.estimate.trajectory is not None:
            gradient = self._step(best).gradient()
        return TimedEstimate(
            best.problem,
            best.estimate,
            best.objective,
            durations,
            start,
            self.group,
            gradient,
            fixed.estimate,
            fixed.objective,
            tuple(records),
            reason,
        )
