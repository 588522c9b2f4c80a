"""Sequential convex programming with exact re-evaluation: Gauss-Newton, a line search, an L1 penalty.

It knows nothing of what it solves. A model linearises itself about a point, offers the convex program, and says what a
candidate really costs; the true merit alone decides what is accepted.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from optimization.convex.solver import ConvexSolver, SolveRecord

STEPS = (1.0, 0.5, 0.25, 0.1)  # of the line search
SUFFICIENT = 1e-4  # a step must bring this part of the decrease that the convex program foresees
GOOD = 0.1  # a step with this part of it is not searched any further
SHRINK = 0.25  # of the greatest change of the trusted variables after a failed line search
LEAST_RADIUS = 1e-4
STANDSTILL = 0.9  # of a merit that a hopeless violation makes: it need not be known any better


class Point(Protocol):
    """A candidate with its true merit."""

    @property
    def merit(self) -> float:
        """Cost plus penalty."""
        ...

    @property
    def violation(self) -> float:
        """The penalised violation alone, 0 where every penalised constraint holds."""
        ...


PointT = TypeVar("PointT", bound=Point)


class SequentialModel(Protocol[PointT]):
    """What `minimise` asks of a problem."""

    def evaluate(self, x: np.ndarray) -> PointT:
        """The point that the convex program's answer x stands for, recomputed exactly."""
        ...

    def between(self, start: PointT, end: PointT, step: float) -> PointT:
        """The point at this part of the way; it satisfies every convex constraint that both ends satisfy.

        Args:
            start, end: two points.
            step: part of the way from start to end, 0 to 1.
        """
        ...

    def distance(self, start: PointT, end: PointT) -> float:
        """The greatest change of a variable that `trust` bounds.

        Args:
            start, end: two points.
        """
        ...

    def linearise(self, point: PointT) -> None:
        """Updates the convex program about this point."""
        ...

    def trust(self, point: PointT, radius: float) -> None:
        """Bounds the step from this point.

        Args:
            point: to stay near.
            radius: greatest change of each bounded variable, in its unit.
        """
        ...


@dataclass(frozen=True)
class Outcome(Generic[PointT]):
    """How an iteration ended.

    Attributes:
        point: the best point, None where the first convex program had no answer.
        converged: whether the last step changed the merit by less than the tolerance, or did what was foreseen.
        reason: "converged", "first convex program failed", "no step improves", "the penalty stays", "iterations" or
            "time".
        records: one per convex program.
    """

    point: PointT | None
    converged: bool
    reason: str
    records: tuple[SolveRecord, ...]


def minimise(
    model: SequentialModel[PointT],
    solver: ConvexSolver,
    *,
    max_iterations: int,
    tolerance: float,
    time_limit: float,
    radius: float,
    tight: float = 1e-4,
    hopeless: float = np.inf,
) -> Outcome[PointT]:
    """Solves, re-evaluates, searches along the step and linearises again until the merit stands still.

    Args:
        model: linearised about its first guess.
        solver: of the model's convex program.
        max_iterations: most convex programs.
        tolerance: relative decrease of the merit that counts as standing still.
        time_limit: seconds after which no further convex program is started.
        radius: first bound on the step once a line search has failed.
        tight: violation that counts as none; until it is reached, standing still is measured ten times finer.
        hopeless: a violation above this that stands still to a tenth ends the iteration.
    """
    started = time.perf_counter()
    records: list[SolveRecord] = []
    point: PointT | None = None
    bound = np.inf
    for _ in range(max_iterations):
        left = started + time_limit - time.perf_counter()
        if left <= 0:
            return Outcome(point, False, "time", tuple(records))
        x, record = solver.solve(costs_changed=not records, time_limit=left)
        records.append(record)
        candidate = model.evaluate(x) if x is not None and record.feasible else None
        if point is None:
            following, step = candidate, 1.0
        else:
            following, step = _search(model, point, candidate, record.cost)
        if following is None:
            if point is None:
                late = time.perf_counter() - started > time_limit  # then its failure says nothing
                return Outcome(None, False, "time" if late else "first convex program failed", tuple(records))
            if candidate is not None and not np.isfinite(bound) and _close(point, candidate.merit, tolerance, tight):
                return Outcome(point, True, "converged", tuple(records))
            went = model.distance(point, candidate) if candidate is not None else np.inf
            bound = min(bound * SHRINK, went * SHRINK, radius)
            if bound < LEAST_RADIUS:
                return Outcome(point, True, "no step improves", tuple(records))
            model.trust(point, bound)
            continue
        before = point
        point = following
        # where the convex program foresaw the true merit, its optimum is ours
        if _close(point, record.cost, tolerance, tight) and (
            (point is candidate and point.violation <= tight)
            or (before is not None and _close(point, before.merit, tolerance, tight))
        ):
            return Outcome(point, True, "converged", tuple(records))
        if before is not None and _hopeless(before, point, record.cost, hopeless):
            return Outcome(point, True, "the penalty stays", tuple(records))
        model.linearise(point)
        if np.isfinite(bound):
            bound *= 2.0 if step == 1.0 else 1.0
            model.trust(point, bound)
    return Outcome(point, False, "iterations", tuple(records))


def _close(point: Point, merit: float, tolerance: float, tight: float) -> bool:
    """Whether a merit differs from the point's by less than the tolerance, a tenth of it while a penalty is left."""
    return abs(point.merit - merit) <= (tolerance if point.violation <= tight else 0.1 * tolerance) * abs(point.merit)


def _hopeless(before: Point, point: Point, foreseen: float, least: float) -> bool:
    """Whether a violation above `least` hardly fell, and no convex program foresees that it will."""
    slow = min(point.merit, foreseen) >= STANDSTILL * before.merit
    return point.violation > least and slow


def _search(
    model: SequentialModel[PointT], start: PointT, end: PointT | None, foreseen: float
) -> tuple[PointT | None, float]:
    """A point on the way to `end` that brings enough of the merit foreseen there, and how far it lies.

    The first with a good part of it; else, lest the iteration goes to and fro between two points, the best of all.
    None where there is none.
    """
    if end is None:
        return None, 0.0
    best: tuple[PointT | None, float] = None, 0.0
    for step in STEPS:
        candidate = end if step == 1.0 else model.between(start, end, step)
        hoped = step * max(start.merit - foreseen, 0.0)
        if candidate.merit < start.merit - GOOD * hoped:
            return candidate, step
        if candidate.merit < (start.merit - SUFFICIENT * hoped if best[0] is None else best[0].merit):
            best = candidate, step
    return best
