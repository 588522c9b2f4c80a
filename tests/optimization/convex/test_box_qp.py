"""The bounded quadratic program against its optimality conditions, with conditioning as bad as the kinematics makes it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from optimization.convex.box_qp import factor_and_solve, solve_box_qp


def random_problem(seed, n, decades):
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((max(1, 2 * n // 3), n)) * 10.0 ** rng.uniform(-decades / 2, 0, (max(1, 2 * n // 3), 1))
    H = rows.T @ rows + 10.0**-decades * np.eye(n)
    g = H @ rng.standard_normal(n)
    lower, upper = -rng.uniform(0, 1, n), rng.uniform(0, 1, n)
    fixed = rng.random(n) < 0.1
    upper[fixed] = lower[fixed]
    upper[rng.random(n) < 0.2] = np.inf
    return H, g, lower, upper, rng.integers(-1, 1, n)


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 40), decades=st.integers(0, 8))
def test_the_answer_satisfies_the_optimality_conditions(seed, n, decades):
    H, g, lower, upper, side = random_problem(seed, n, decades)
    x = np.empty(n)
    assert solve_box_qp(np.triu(H), g, lower, upper, n, side, x, 2000) > 0
    assert (lower <= x).all() and (x <= upper).all()
    slope, tolerance = H @ x - g, 1e-7 * max(1.0, np.abs(g).max())
    assert np.abs(slope[(x > lower) & (x < upper)]).max(initial=0) < tolerance
    assert slope[(x == lower) & (lower < upper)].min(initial=0) > -tolerance
    assert slope[(x == upper) & (lower < upper)].max(initial=0) < tolerance


def test_without_active_bounds_it_is_a_linear_solve_in_one_factorisation():
    H, g, _, _, _ = random_problem(5, 12, 2)
    x, wide = np.empty(12), np.full(12, 1e9)
    assert solve_box_qp(H, g, -wide, wide, 12, np.zeros(12, np.int64), x, 5) == 1
    np.testing.assert_allclose(x, np.linalg.solve(H, g), rtol=1e-8)


def test_a_warm_start_with_the_right_bounds_needs_one_factorisation():
    H, g, lower, upper, side = random_problem(7, 30, 4)
    x, again = np.empty(30), np.empty(30)
    assert solve_box_qp(H, g, lower, upper, 30, side, x, 200) >= 1
    assert solve_box_qp(H, g, lower, upper, 30, side, again, 1) == 1
    np.testing.assert_allclose(x, again, rtol=1e-12)


@pytest.mark.parametrize("value", [np.nan, -1.0])
def test_a_matrix_that_is_not_positive_definite_is_reported_and_the_answer_stays_inside(value):
    H = np.eye(3)
    H[1, 1] = value
    x = np.empty(3)
    assert not factor_and_solve(H.copy(), np.ones(3), 3)
    assert solve_box_qp(H, np.ones(3), -np.ones(3), np.ones(3), 3, np.zeros(3, np.int64), x, 10) < 0
    assert (np.abs(x) <= 1).all()
