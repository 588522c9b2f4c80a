"""The program with hinges against its conditions of optimality, and against the same program with a slack for each hinge."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from optimization.convex.box_qp import solve_box_qp
from optimization.convex.hinge_qp import HingeProgram, solve_hinge_qp


def random_problem(seed: int, n: int, num: int):
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((n, n)) * 10.0 ** rng.uniform(-3, 0, (n, 1))
    H = rows.T @ rows + 1e-4 * np.eye(n)
    J = rng.standard_normal((num, n)) * 10.0 ** rng.uniform(-1, 2, (num, 1))
    J[:, rng.random(n) < 0.3] = 0.0
    missing = rng.standard_normal(num) * 10.0 ** rng.uniform(-2, 1, num)
    return H, H @ rng.standard_normal(n), J, missing, -rng.uniform(0, 1, n), rng.uniform(0, 1, n)


def solved(H, g, J, missing, lower, upper):
    x = np.zeros(len(g))
    program = HingeProgram(np.triu(H), g, J, missing, lower, upper)
    ok = solve_hinge_qp(program, np.zeros(len(g), np.int64), x, 500) > 0
    assert (lower <= x).all() and (x <= upper).all()
    return ok, x


def cost(H, g, J, missing, x):
    return 0.5 * x @ H @ x - g @ x + 0.5 * (np.maximum(0.0, missing - J @ x) ** 2).sum()


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 30), num=st.integers(0, 40))
def test_the_answer_satisfies_the_optimality_conditions(seed, n, num):
    H, g, J, missing, lower, upper = random_problem(seed, n, num)
    ok, x = solved(H, g, J, missing, lower, upper)
    assert ok
    slope = H @ x - g - J.T @ np.maximum(0.0, missing - J @ x)
    scale = 1e-7 * max(1.0, np.abs(g).max(), (np.abs(J).T @ np.abs(missing)).max(initial=0.0))
    assert np.abs(slope[(x > lower) & (x < upper)]).max(initial=0) < scale
    assert slope[x == lower].min(initial=0) > -scale
    assert slope[x == upper].max(initial=0) < scale


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 20), num=st.integers(1, 20))
def test_it_is_the_program_with_a_slack_for_each_hinge(seed, n, num):
    H, g, J, missing, lower, upper = random_problem(seed, n, num)
    _, x = solved(H, g, J, missing, lower, upper)
    rows = np.hstack([J, -np.eye(num)])  # J x - slack = missing, slack >= 0
    whole = rows.T @ rows
    whole[:n, :n] += H
    y = np.empty(n + num)
    low, high = np.concatenate([lower, np.zeros(num)]), np.concatenate([upper, np.full(num, np.inf)])
    right = np.concatenate([g, np.zeros(num)]) + rows.T @ missing
    assert solve_box_qp(np.triu(whole), right, low, high, n + num, np.zeros(n + num, np.int64), y, 2000) > 0
    best = cost(H, g, J, missing, y[:n])
    assert abs(cost(H, g, J, missing, x) - best) <= 1e-8 * max(1.0, abs(best))


def test_without_hinges_it_is_the_program_with_bounds():
    H, g, _, _, lower, upper = random_problem(3, 12, 0)
    ok, x = solved(H, g, np.empty((0, 12)), np.empty(0), lower, upper)
    y = np.empty(12)
    assert solve_box_qp(np.triu(H), g, lower, upper, 12, np.zeros(12, np.int64), y, 50) > 0
    assert ok
    np.testing.assert_array_equal(x, y)
