"""A dense quadratic program with bounds and hinges, in numba: a step of inverse kinematics that keeps bodies apart.

    min  1/2 x^T H x - g^T x + 1/2 sum_r max(0, m_r - J_r x)^2     s.t.  lower <= x <= upper

Few of the hinges bend. Each round solves the program of those that do (`box_qp`) and sees which they are at its optimum;
where they are the same, that is the optimum of all. Where rounds do not settle, each hinge gets a slack,
J_r x - s_r = m_r in the sense of least squares with s_r >= 0, and the larger program is solved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.convex.box_qp import solve_box_qp

ROUNDS = 8  # enough for nearly all


class HingeProgram(NamedTuple):
    """The program's data.

    Attributes:
        H: (n, n) positive definite, only its upper triangle is read.
        g: (n,).
        J: (R, n) rows of the hinges.
        missing: (R,) m_r.
        lower, upper: (n,), lower <= upper.
    """

    H: np.ndarray
    g: np.ndarray
    J: np.ndarray
    missing: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


@njit(cache=True)
def solve_hinge_qp(o: HingeProgram, side: np.ndarray, x: np.ndarray, budget: int) -> int:
    """Writes the optimum x (n,); returns the factorisations of its last program, or -1 when `budget` did not suffice.

    Args:
        o: the program.
        side: (n,) int64 first guess and answer: -1 at the lower bound, 0 free, 1 at the upper bound.
        x: (n,) answer, always finite and within the bounds.
        budget: factorisations allowed in each program.
    """
    n, num = x.shape[0], o.missing.shape[0]
    A, b, bent = np.empty((n, n)), np.empty(n), o.missing > 0.0  # at x = 0
    for _ in range(ROUNDS):
        A[:], b[:] = o.H, o.g
        for r in range(num):
            if bent[r]:
                _add(A, b, o.J[r], o.missing[r])
        used = solve_box_qp(A, b, o.lower, o.upper, n, side, x, budget)
        if used < 0:
            break
        changed = False
        for r in range(num):
            left = o.missing[r]
            for i in range(n):
                left -= o.J[r, i] * x[i]
            changed = changed or bent[r] != (left > 0.0)
            bent[r] = left > 0.0
        if not changed:
            return used
    return _with_slacks(o, bent, side, x, budget)


@njit(cache=True)
def _add(A: np.ndarray, b: np.ndarray, row: np.ndarray, missing: float) -> None:
    """Adds row^T row to the upper triangle of A and row^T missing to b."""
    for i in range(row.shape[0]):
        if row[i] != 0.0:
            b[i] += row[i] * missing
            for j in range(i, row.shape[0]):
                A[i, j] += row[i] * row[j]


@njit(cache=True)
def _with_slacks(o: HingeProgram, bent: np.ndarray, side: np.ndarray, x: np.ndarray, budget: int) -> int:
    """`solve_hinge_qp` as one program of n + R unknowns; bent (R,) is a guess of which slacks are zero."""
    n, num = x.shape[0], o.missing.shape[0]
    m = n + num
    A, b, row, y = np.zeros((m, m)), np.zeros(m), np.zeros(m), np.empty(m)
    low, high, sides = np.zeros(m), np.full(m, np.inf), np.zeros(m, np.int64)
    A[:n, :n], b[:n], low[:n], high[:n], sides[:n] = o.H, o.g, o.lower, o.upper, side
    for r in range(num):
        row[:] = 0.0
        row[:n], row[n + r] = o.J[r], -1.0
        sides[n + r] = -1 if bent[r] else 0
        _add(A, b, row, o.missing[r])
    used = solve_box_qp(A, b, low, high, m, sides, y, budget + num)
    x[:], side[:] = y[:n], sides[:n]
    return used
