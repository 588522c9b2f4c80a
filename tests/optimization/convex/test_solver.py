"""Solvers are chosen, checked and recorded; their word is not believed."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from pydrake.solvers import LinearEqualityConstraint, MathematicalProgram

from optimization.convex import solver as solvers
from optimization.convex.infeasibility import Relaxable, smallest_relaxation
from optimization.convex.quadratic_program import ProgramReader, is_quadratic
from optimization.convex.solver import ConvexSolver, SolverSettings, worst_violation
from scenes.input_error import InputError

NEAR = 1e-6  # the solvers are asked for 1e-8


def projection(point, *, radius=None):
    """The nearest point to `point` on the simplex sum x = 1, x >= 0, and inside a ball where `radius` is given."""
    prog = MathematicalProgram()
    x = prog.NewContinuousVariables(len(point), "x")
    prog.AddQuadraticErrorCost(np.eye(len(point)), np.asarray(point, float), x)
    prog.AddLinearEqualityConstraint(np.ones((1, len(point))), [1.0], x).evaluator().set_description("sum")
    prog.AddBoundingBoxConstraint(0.0, np.inf, x).evaluator().set_description("sign")
    if radius is not None:
        A = np.vstack([np.zeros(len(point)), np.eye(len(point))])
        prog.AddLorentzConeConstraint(A, np.concatenate([[radius], np.zeros(len(point))]), x)
    return prog, x


def simplex_projection(point):
    """Held, Wolfe and Crowder 1974: shift by the one amount that makes the positive parts add up to one."""
    ordered = np.sort(point)[::-1]
    shifts = (np.cumsum(ordered) - 1) / np.arange(1, len(point) + 1)
    return np.maximum(point - shifts[np.flatnonzero(ordered > shifts)[-1]], 0)


@given(st.lists(st.floats(-3, 3), min_size=2, max_size=6))
def test_both_solvers_find_the_projection_on_the_simplex(point):
    expected = simplex_projection(np.array(point))
    for name in ("piqp", "clarabel"):
        prog, _ = projection(point)
        x, record = ConvexSolver(prog, SolverSettings(solver=name)).solve()
        assert np.allclose(x, expected, atol=1e-4)
        assert record.solver == name
        assert record.feasible
        assert record.worst < NEAR
        assert record.iterations > 0
        assert record.time > 0


def test_the_matrices_that_are_read_give_the_programs_own_costs_and_constraints():
    rng = np.random.default_rng(0)
    prog = MathematicalProgram()
    x, y = prog.NewContinuousVariables(3, "x"), prog.NewContinuousVariables(2, "y")
    root = rng.normal(size=(4, 4))
    prog.AddQuadraticCost(root @ root.T, rng.normal(size=4), 0.7, np.append(x, y[0]))
    prog.AddQuadraticCost(np.eye(2), np.ones(2), y)
    prog.AddLinearCost(rng.normal(size=2), 0.3, y[::-1])
    prog.AddLinearEqualityConstraint(rng.normal(size=(2, 3)), rng.normal(size=2), x[[2, 0, 1]])
    prog.AddLinearConstraint(rng.normal(size=(3, 2)), -np.ones(3), np.full(3, np.inf), np.array([y[1], x[1]]))
    prog.AddBoundingBoxConstraint(-1, 2, x)
    program = ProgramReader(prog).read()
    for _ in range(20):
        point = rng.normal(size=5) * 2
        costs = [prog.EvalBinding(binding, point).item() for binding in prog.GetAllCosts()]
        assert program.cost(point) == pytest.approx(sum(costs))
        worst, _ = worst_violation(prog, point)
        assert program.worst(point)[0] == pytest.approx(worst)


def test_a_program_is_solved_again_after_its_coefficients_changed():
    for name in ("piqp", "clarabel"):
        prog, x = projection([0.2, 0.1, 0.0])
        row = LinearEqualityConstraint(sp.csc_matrix([[1.0, -1.0]]), np.zeros(1))
        prog.AddConstraint(row, x[:2])
        solver = ConvexSolver(prog, SolverSettings(solver=name))
        first, _ = solver.solve()
        assert first[0] == pytest.approx(first[1], abs=NEAR)
        row.UpdateCoefficients(sp.csc_matrix([[1.0, -3.0]]), np.zeros(1))
        second, _ = solver.solve(costs_changed=False)
        assert second[0] == pytest.approx(3 * second[1], abs=NEAR)
        row.UpdateCoefficients(sp.csc_matrix([[0.0, 1.0]]), np.zeros(1))  # a new pattern of zeros
        third, _ = solver.solve()
        assert third[1] == pytest.approx(0, abs=NEAR)


def test_second_order_cones_go_to_clarabel_and_never_to_piqp():
    prog, _ = projection([1.0, 0.0], radius=0.75)
    assert not is_quadratic(prog)
    x, record = ConvexSolver(prog).solve()
    assert record.solver == "clarabel"
    assert record.feasible
    # on the line x + y = 1 at distance 0.75 from the origin
    assert x.sum() == pytest.approx(1, abs=NEAR)
    assert np.hypot(*x) == pytest.approx(0.75, abs=1e-5)
    with pytest.raises(InputError, match="piqp"):
        ConvexSolver(prog, SolverSettings(solver="piqp"))


def test_an_infeasible_program_is_not_called_feasible_by_any_solver():
    for name in ("auto", "piqp", "clarabel"):
        prog, x = projection([0.2, 0.1])
        prog.AddBoundingBoxConstraint(2.0, 3.0, x[:1]).evaluator().set_description("too much")
        _, record = ConvexSolver(prog, SolverSettings(solver=name)).solve()
        assert not record.feasible
        assert record.worst > 0.1


def test_clarabel_is_asked_where_piqp_says_infeasible(monkeypatch):
    prog, _ = projection([0.2, 0.1, 0.9])
    solver = ConvexSolver(prog, SolverSettings(solver="piqp"))
    monkeypatch.setattr(solver._piqp, "solve", lambda *_, **__: ("primal_infeasible", np.zeros(3), 7))
    x, record = solver.solve()
    assert record.feasible
    assert record.solver == "clarabel after piqp"
    assert np.allclose(x, simplex_projection(np.array([0.2, 0.1, 0.9])), atol=1e-4)


@pytest.mark.parametrize("lie", [np.full(3, np.nan), np.array([5.0, 5.0, 5.0]), np.zeros(0)])
def test_an_answer_that_a_solver_calls_solved_is_checked(monkeypatch, lie):
    prog, _ = projection([0.2, 0.1, 0.9])
    solver = ConvexSolver(prog, SolverSettings(solver="clarabel"))
    monkeypatch.setattr(solver, "_clarabel", lambda limit: ("Solved", lie, 3))
    x, record = solver.solve()
    assert not record.feasible
    assert (x is None) == (not np.isfinite(lie).all() or lie.size == 0)


@pytest.mark.parametrize("solver", ["piqp", "clarabel"])
@pytest.mark.parametrize("where", ["cost", "bounds", "rows"])
def test_nan_is_refused_before_a_solver_sees_it(solver, where):
    prog, x = projection([0.2, 0.1])
    if where == "cost":
        prog.AddLinearCost(np.array([1.0, np.nan]), 0.0, x)
    elif where == "bounds":
        prog.AddBoundingBoxConstraint(0.0, 1.0, x).evaluator().set_bounds([np.nan, 0], [1, 1])
    else:
        binding = prog.AddLinearConstraint(np.eye(2), np.zeros(2), np.ones(2), x)
        binding.evaluator().set_description("rows")
        binding.evaluator().set_bounds([0, 0], [np.nan, 1])
    with pytest.raises(InputError, match=where):
        ConvexSolver(prog, SolverSettings(solver=solver)).solve()


def test_nan_in_a_cone_program_is_refused_too():
    prog, _ = projection([0.2, np.nan], radius=1.0)
    with pytest.raises(InputError, match="finite"):
        ConvexSolver(prog).solve()


def test_without_piqp_everything_goes_to_clarabel(monkeypatch):
    monkeypatch.setattr(solvers.piqp_adapter, "available", lambda: False)
    prog, _ = projection([0.2, 0.1])
    _, record = ConvexSolver(prog).solve()
    assert record.solver == "clarabel"
    with pytest.raises(InputError, match="fast"):
        ConvexSolver(prog, SolverSettings(solver="piqp"))


def test_an_unknown_solver_is_refused_by_name():
    with pytest.raises(InputError, match="gurobi"):
        SolverSettings(solver="gurobi")


def test_the_smallest_relaxation_is_the_gap_between_two_demands():
    prog, x = projection([0.2, 0.1])
    prog.AddBoundingBoxConstraint(1.3, 3.0, x[:1]).evaluator().set_description("much")
    found = smallest_relaxation(prog, {"much": Relaxable(np.zeros(1, int)), "sign": Relaxable(np.arange(2), 100.0)})
    assert [(r.block, r.group) for r in found] == [("much", 0)]
    assert found[0].amount == pytest.approx(0.3, abs=1e-5)
    dear = smallest_relaxation(prog, {"much": Relaxable(np.zeros(1, int), 100.0), "sign": Relaxable(np.arange(2))})
    assert [(r.block, r.group) for r in dear] == [("sign", 1)]
    assert smallest_relaxation(prog, {}) == []
