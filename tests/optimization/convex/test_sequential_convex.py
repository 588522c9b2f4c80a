"""Gauss-Newton on problems of one variable whose answers are known."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from pydrake.solvers import LinearEqualityConstraint, MathematicalProgram

from optimization.convex.sequential_convex import minimise
from optimization.convex.solver import ConvexSolver

SETTINGS = {"max_iterations": 50, "tolerance": 1e-9, "time_limit": 10.0, "radius": 0.5}


@dataclass(frozen=True)
class Candidate:
    x: float
    merit: float
    violation: float = 0.0


class Residual:
    """min residual(x)^2: the convex program has variables x, r with r - slope x = offset, and the cost r^2."""

    def __init__(self, residual, slope, start, bounds=(-100.0, 100.0)):
        self.residual, self.slope = residual, slope
        self.prog = MathematicalProgram()
        self.x, self.r = self.prog.NewContinuousVariables(2, "xr")
        self.row = LinearEqualityConstraint(np.array([[-1.0, 1.0]]), np.zeros(1))
        self.prog.AddConstraint(self.row, [self.x, self.r])
        self.box = self.prog.AddBoundingBoxConstraint(*bounds, self.x).evaluator()
        self.bounds = bounds
        self.prog.AddQuadraticCost(np.array([[2.0]]), np.zeros(1), [self.r], is_convex=True)
        self.merits = []
        self.linearise(self.at(start))

    def at(self, x):
        return Candidate(x, self.residual(x) ** 2)

    def evaluate(self, x):
        return self.at(float(x[0]))

    def between(self, start, end, step):
        return self.at(start.x + step * (end.x - start.x))

    def distance(self, start, end):
        return abs(end.x - start.x)

    def linearise(self, point):
        self.merits.append(point.merit)
        slope = self.slope(point.x)
        right = np.array([self.residual(point.x) - slope * point.x])
        self.row.UpdateCoefficients(np.array([[-slope, 1.0]]), right)

    def trust(self, point, radius):
        low, high = self.bounds
        self.box.set_bounds([max(low, point.x - radius)], [min(high, point.x + radius)])


def run(model, **changes):
    return minimise(model, ConvexSolver(model.prog), **(SETTINGS | changes))


def test_a_linear_residual_takes_one_program():
    outcome = run(Residual(lambda x: 2 * x - 3, lambda x: 2.0, start=10.0, bounds=(2.5, 100.0)))
    assert outcome.converged
    assert outcome.point.x == pytest.approx(2.5, abs=1e-6)
    assert outcome.point.merit == pytest.approx(4.0, abs=1e-5)
    assert len(outcome.records) == 1


def test_where_full_steps_diverge_the_line_search_still_finds_the_root():
    # Newton's method on arctan leaves for infinity from |x| > 1.39; the first program goes to a bound unsearched
    model = Residual(np.arctan, lambda x: 1 / (1 + x * x), start=0.5, bounds=(2.0, 100.0))
    first = run(model, max_iterations=1)
    assert first.point.x == pytest.approx(2.0, abs=1e-5)
    model = Residual(np.arctan, lambda x: 1 / (1 + x * x), start=2.0, bounds=(-1000.0, 1000.0))
    assert abs(2.0 - np.arctan(2.0) * 5.0) > 2.0  # what a full step would do
    outcome = run(model)
    assert outcome.converged
    assert outcome.point.x == pytest.approx(0.0, abs=1e-4)


def test_where_full_steps_go_to_and_fro_the_way_between_is_searched():
    # Newton's method on arctan changes sides for ever from |x| = 1.3917: just inside it gains almost nothing a step
    outcome = run(Residual(np.arctan, lambda x: 1 / (1 + x * x), start=1.3917))
    assert outcome.converged
    assert outcome.point.x == pytest.approx(0.0, abs=1e-4)
    assert len(outcome.records) <= 6


def test_the_merit_never_rises():
    model = Residual(lambda x: np.arctan(x) + 0.2 * np.sin(5 * x), lambda x: 1 / (1 + x * x) + np.cos(5 * x), start=3.0)
    run(model)
    accepted = model.merits[1:]
    assert all(after <= before for before, after in pairwise(accepted))
    assert len(accepted) > 1


def test_a_first_program_without_an_answer_ends_it():
    model = Residual(lambda x: x, lambda x: 1.0, start=0.0)
    model.prog.AddBoundingBoxConstraint(200.0, 300.0, model.x)
    outcome = run(model)
    assert outcome.point is None
    assert not outcome.converged
    assert outcome.reason == "first convex program failed"


def test_limits_on_programs_and_on_time_are_reported_and_the_best_point_comes_back():
    def model():
        return Residual(lambda x: np.exp(x), lambda x: np.exp(x), start=3.0)

    few = run(model(), max_iterations=3)
    assert (few.reason, few.converged, len(few.records)) == ("iterations", False, 3)
    assert few.point is not None
    none = run(model(), time_limit=0.0)
    assert (none.reason, none.point) == ("time", None)
