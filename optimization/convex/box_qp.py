"""A dense convex quadratic program with bounds, in numba: the inner problem of every inverse kinematics step.

    min  1/2 x^T H x - g^T x     s.t.  lower <= x <= upper,     H symmetric positive definite, up to about 80 unknowns

Block principal pivoting (Judice & Pires, Computers & Operations Research 21, 1994): guess which bounds hold with
equality, solve for the free unknowns, move every unknown that is on the wrong side at once. Where that stops helping, a
primal active set (Nocedal & Wright, Numerical Optimization, 2006, algorithm 16.3) walks on from the last point inside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

_PATIENCE = 4  # exchanges allowed without fewer misplaced unknowns
_TOLERANCE = 1e-10  # relative to the size of the unknowns and of g


class _Problem(NamedTuple):
    """The program as in `solve_box_qp`, its point x, and room for a solve: A (n, n), b (n,), free (n,), wrong (n,)."""

    H: np.ndarray
    g: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    side: np.ndarray
    x: np.ndarray
    A: np.ndarray
    b: np.ndarray
    free: np.ndarray
    wrong: np.ndarray


@njit(cache=True)
def factor_and_solve(A: np.ndarray, b: np.ndarray, n: int) -> bool:
    """Solves A x = b in place by Cholesky; reads the upper triangle of A[:n, :n], which it destroys; b[:n] becomes x.

    Returns False, with b useless, when A is not positive definite to working precision or holds NaN.

    Args:
        A: (n or more, n or more) symmetric matrix.
        b: (n or more,) right-hand side.
        n: number of unknowns.
    """
    for k in range(0, n, 4):
        width = min(4, n - k)
        for c in range(k, k + width):
            row = A[c]
            for d in range(k, c):
                above, a = A[d], A[d, c]
                for j in range(c, n):
                    row[j] -= a * above[j]
            if not row[c] > 1e-300:
                return False
            scale = 1.0 / np.sqrt(row[c])
            for j in range(c, n):
                row[j] *= scale
        if width == 4:
            # Four rows at once, so the trailing triangle passes through memory a quarter as often.
            r0, r1, r2, r3 = A[k], A[k + 1], A[k + 2], A[k + 3]
            for i in range(k + 4, n):
                a0, a1, a2, a3 = r0[i], r1[i], r2[i], r3[i]
                row = A[i]
                for j in range(i, n):
                    row[j] -= a0 * r0[j] + a1 * r1[j] + a2 * r2[j] + a3 * r3[j]
    for i in range(n):
        row = A[i]
        b[i] /= row[i]
        s = b[i]
        for j in range(i + 1, n):
            b[j] -= row[j] * s
    for i in range(n - 1, -1, -1):
        row = A[i]
        s = b[i]
        for j in range(i + 1, n):
            s -= row[j] * b[j]
        b[i] = s / row[i]
    return True


@njit(cache=True)
def _solve_free(o: _Problem, n: int, x: np.ndarray) -> bool:
    """Sets x at the bounds that `side` names and to the optimum of the rest; False when that is singular."""
    num_free = 0
    for i in range(n):
        if o.side[i] == 0:
            o.free[num_free] = i
            num_free += 1
        else:
            x[i] = o.lower[i] if o.side[i] < 0 else o.upper[i]
    for a in range(num_free):
        i = o.free[a]
        s = o.g[i]
        for j in range(n):
            if o.side[j] != 0 and x[j] != 0.0:
                s -= (o.H[i, j] if i < j else o.H[j, i]) * x[j]
        o.b[a] = s
        for c in range(a, num_free):
            o.A[a, c] = o.H[i, o.free[c]]
    if not factor_and_solve(o.A, o.b, num_free):
        return False
    for a in range(num_free):
        x[o.free[a]] = o.b[a]
    return True


@njit(cache=True)
def _slope(o: _Problem, n: int, i: int) -> float:
    """Derivative of the cost along unknown i, at x."""
    slope = -o.g[i]
    for j in range(n):
        slope += (o.H[i, j] if i < j else o.H[j, i]) * o.x[j]
    return slope


@njit(cache=True)
def _misplaced(o: _Problem, n: int) -> int:
    """Marks in `wrong` the side that each misplaced unknown should be on, 2 where it is; returns how many there are."""
    scale_x, scale_g = 1e-3, 1e-12
    for i in range(n):
        if o.side[i] == 0:
            scale_x = max(scale_x, abs(o.x[i]))
        scale_g = max(scale_g, abs(o.g[i]))
    count = 0
    for i in range(n):
        o.wrong[i] = 2
        if o.side[i] == 0:
            if o.x[i] < o.lower[i] - _TOLERANCE * scale_x:
                o.wrong[i] = -1
            elif o.x[i] > o.upper[i] + _TOLERANCE * scale_x:
                o.wrong[i] = 1
        elif o.lower[i] < o.upper[i] and _slope(o, n, i) * o.side[i] > _TOLERANCE * scale_g:
            o.wrong[i] = 0
        if o.wrong[i] != 2:
            count += 1
    return count


@njit(cache=True)
def _exchange_blocks(o: _Problem, n: int, budget: int) -> int:
    """Block principal pivoting; returns the factorisations used, negative when it stopped helping."""
    fewest, patience = n + 1, _PATIENCE
    for k in range(budget):
        if not _solve_free(o, n, o.x):
            return -k - 1
        count = _misplaced(o, n)
        if count == 0:
            return k + 1
        if count < fewest:
            fewest, patience = count, _PATIENCE
        else:
            patience -= 1
            if patience == 0:
                return -k - 1
        for i in range(n):
            if o.wrong[i] != 2:
                o.side[i] = o.wrong[i]
    return -budget


@njit(cache=True)
def _walk_along_faces(o: _Problem, n: int, budget: int) -> int:
    """Primal active set from an x inside the bounds: the cost never rises; returns the factorisations, or -budget."""
    y = np.empty(n)
    for i in range(n):
        o.side[i] = -1 if o.x[i] <= o.lower[i] else (1 if o.x[i] >= o.upper[i] else 0)
    for k in range(budget):
        if not _solve_free(o, n, y):
            return -budget
        step, blocking = 1.0, -1
        for i in range(n):
            if o.side[i] == 0 and (y[i] < o.lower[i] or y[i] > o.upper[i]):
                bound = o.lower[i] if y[i] < o.lower[i] else o.upper[i]
                fraction = (bound - o.x[i]) / (y[i] - o.x[i])
                if fraction < step:
                    step, blocking = fraction, i
        for i in range(n):
            o.x[i] += step * (y[i] - o.x[i])
        if blocking >= 0:
            o.side[blocking] = -1 if y[blocking] < o.lower[blocking] else 1
            o.x[blocking] = o.lower[blocking] if o.side[blocking] < 0 else o.upper[blocking]
            continue
        if _misplaced(o, n) == 0:
            return k + 1
        worst, released = 0.0, -1
        for i in range(n):
            if o.wrong[i] == 0 and abs(_slope(o, n, i)) > worst:
                worst, released = abs(_slope(o, n, i)), i
        if released < 0:
            return k + 1
        o.side[released] = 0
    return -budget


@njit(cache=True)
def solve_box_qp(
    H: np.ndarray,
    g: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    n: int,
    side: np.ndarray,
    x: np.ndarray,
    budget: int,
) -> int:
    """Writes the optimum x (n,); returns the number of factorisations, or -1 when `budget` did not suffice.

    Args:
        H: (>= n, >= n), only its upper triangle is read.
        g: (>= n,).
        lower, upper: (>= n,), lower <= upper; infinities allowed.
        n: number of unknowns.
        side: (>= n,) int64 first guess and answer: -1 at the lower bound, 0 free, 1 at the upper bound.
        x: (>= n,) answer, always finite and within the bounds, also when the return value is -1.
        budget: factorisations allowed.
    """
    free, wrong = np.empty(n, np.int64), np.empty(n, np.int64)
    problem = _Problem(H, g, lower, upper, side, x, np.empty((n, n)), np.empty(n), free, wrong)
    used = _exchange_blocks(problem, n, budget)
    _clip(x, lower, upper, n)
    if used < 0 and -used < budget:
        walked = _walk_along_faces(problem, n, budget + used)
        _clip(x, lower, upper, n)
        used = walked - used if walked > 0 else -1
    return used if used > 0 else -1


@njit(cache=True)
def _clip(x: np.ndarray, lower: np.ndarray, upper: np.ndarray, n: int) -> None:
    for i in range(n):
        if not np.isfinite(x[i]):
            x[i] = 0.0
        x[i] = min(max(x[i], lower[i]), upper[i])
