"""The two copies of an updatable program's numbers agree: Drake's program read row by row is the slow twin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from optimization.convex.quadratic_program import ProgramReader
from optimization.convex.solver import ConvexSolver, SolverSettings
from optimization.convex.sparse_rows import SparseRows
from optimization.convex.updatable_program import UpdatableProgram


def rows(rng, index):
    """Three sparse rows over the variables, always at the same places."""
    out = SparseRows()
    out.add(np.arange(3), index[:3], rng.uniform(0.5, 2.0, 3))
    out.add(np.array([0, 2]), index[3:5], rng.normal(size=2))
    return out


def build(seed):
    """Two blocks of rows, two of bounds that overlap, a linear and a diagonal cost, with random numbers."""
    rng = np.random.default_rng(seed)
    host = UpdatableProgram()
    _, x = host.add_variables("x", 1, 4)
    _, y = host.add_variables("y", 2, 1)
    index = np.concatenate([x.ravel(), y.ravel()])
    host.add_rows("equal", rows(rng, index), None, rng.normal(size=3) * 0.1)
    host.add_rows("between", rows(rng, index[::-1]), np.full(3, -5.0), np.full(3, 5.0))
    host.add_bounds("wide", index, np.array(-10.0), np.array(10.0))
    host.add_bounds("narrow", index[2:4], np.array([-1.0, -np.inf]), np.array([1.0, np.inf]))
    host.add_linear_cost(y.ravel(), 3.0)
    host.add_diagonal_costs(np.array([1.0, 2, 0, 3, 1, 1]), rng.normal(size=6), [("a", index[:3]), ("b", index[3:])])
    return host, index, rng


def renew(host, index, rng):
    """New numbers everywhere."""
    host.update_rows("equal", rows(rng, index), None, rng.normal(size=3) * 0.1)
    host.update_rows("between", rows(rng, index[::-1]), np.full(3, -4.0), np.full(3, 6.0))
    host.update_bounds("narrow", np.array([-2.0, -0.5]), np.array([np.inf, 0.5]))
    host.update_diagonal_costs(np.array([2.0, 1, 0, 1, 5, 1]), rng.normal(size=6))


def assert_same(one, other):
    assert np.allclose(one.P.toarray(), other.P.toarray())
    assert np.allclose(one.q, other.q)
    assert one.constant == pytest.approx(other.constant)
    assert np.array_equal(one.lower, other.lower)
    assert np.array_equal(one.upper, other.upper)
    for a, b in ((one.equalities, other.equalities), (one.inequalities, other.inequalities)):
        assert np.allclose(a.A.toarray(), b.A.toarray())
        assert np.array_equal(a.lower, b.lower)
        assert np.array_equal(a.upper, b.upper)
        assert a.names == b.names


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000), watched=st.booleans(), times=st.integers(1, 3))
def test_drakes_program_holds_the_numbers_that_the_solver_reads(seed, watched, times):
    host, index, rng = build(seed)
    prog = host.prog if watched else None  # whoever has Drake's program sees every change at once
    assert_same(host.read(), ProgramReader(host.current()).read())
    for _ in range(times):
        renew(host, index, rng)
        assert_same(host.read(), ProgramReader(prog or host.current()).read())


def test_both_copies_have_the_same_optimum():
    host, index, rng = build(1)
    renew(host, index, rng)
    x, _ = ConvexSolver(host, SolverSettings(solver="clarabel")).solve()
    y, _ = ConvexSolver(host.prog, SolverSettings(solver="clarabel")).solve()
    z, record = ConvexSolver(host).solve()
    assert record.feasible
    assert np.allclose(x, y, atol=1e-6)
    assert np.allclose(x, z, atol=1e-6)


def test_what_is_added_from_outside_is_noticed():
    host, _, _ = build(2)
    assert host.is_own()
    host.prog.AddLinearCost(host.prog.decision_variables()[0])
    assert not host.is_own()


def test_a_nan_that_an_update_brings_is_refused_by_name():
    host, index, rng = build(3)
    solver = ConvexSolver(host)
    host.update_rows("between", rows(rng, index[::-1]), np.full(3, np.nan), np.full(3, 6.0))
    with pytest.raises(ValueError, match="between"):
        solver.solve()
