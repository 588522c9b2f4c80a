"""The polygon of admissible centres of mass by proved edges: slower than a walk, and right where bases are nearly singular.

Every vertex is the farthest point in some direction, found by a linear program. Between two neighbours the program asks
for the farthest point along the normal of the line through them: either there is one beyond the line, a new vertex, or
the line is an edge (Bretl & Lall 2008). A nearly singular basis is inverted afresh, and what is solved with it
(weights, multipliers, entering column) is refined once against the columns themselves, so that a condition number of
1e9 still leaves the digits that the answer needs.

Bretl & Lall 2008: "Testing static equilibrium for legged robots", IEEE T-RO 24(4).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.balance.patch_simplex import PIVOT, WRENCH, best_column, num_generators, wrench

OPTIMAL = 1e-9  # reduced cost left at an optimum [m]
BEYOND = 1e-8  # [m] a point that lies less beyond a line is no vertex
TIE = 1e-12  # rows that reach zero while another weight changes by less than this tie
NEGATIVE = -1e-8  # a basis with a weight below this is no basis of forces [M g]
SINGULAR = 1e-14  # pivot of an inversion
SMALL = 1e-4  # pivots below this or above its inverse lose digits: the basis is inverted afresh
MOST_PIVOTS = 100  # of one direction; it takes 1 to 10


class Basis(NamedTuple):
    """m basic columns and what is known of them; the second half is scratch.

    Attributes:
        number: (m,) columns, numbered as in `patch_simplex`.
        A: (m, m) their 4 + n rows, one column each.
        inverse: (m, m) of A.
        move: (2, m) how the weight of each moves the centre of mass.
        b: (m,) right-hand side.
        x: (m,) weights, A x = b.
        y, a, w, left: (m,).
        work: (m, m).
        full: (6 + n,) multipliers of the six rows and the limits.
    """

    number: np.ndarray
    A: np.ndarray
    inverse: np.ndarray
    move: np.ndarray
    b: np.ndarray
    x: np.ndarray
    y: np.ndarray
    a: np.ndarray
    w: np.ndarray
    left: np.ndarray
    work: np.ndarray
    full: np.ndarray


@njit(cache=True)
def _column(contacts: np.ndarray, generators: np.ndarray, j: int, a: np.ndarray) -> tuple[float, float]:
    """Writes the 4 + n rows of column j (generator, slack or artificial) and returns how it moves the CoM."""
    n = contacts.shape[0]
    slack = num_generators(contacts, generators)
    a[:] = 0.0
    if j < slack:
        a[0], a[1], a[2], a[3], x, y, c = wrench(contacts, generators, j)
        a[4 + c] = 1.0
        return x, y
    if j < slack + n:
        a[4 + j - slack] = 1.0
    else:
        a[j - slack - n] = 1.0
    return 0.0, 0.0


@njit(cache=True)
def right_hand_side(contacts: np.ndarray, generators: np.ndarray, T: np.ndarray, basic: np.ndarray) -> np.ndarray:
    """(4 + n,) what the basic columns add up to with their weights.

    Args:
        contacts: (n, 13 + 2 V) from `patch_simplex.pack`.
        generators: (n, G, 3) friction cones in C, rays with fz = 1.
        T: (m + 2, m + 1) tableau.
        basic: (m,) number of the basic column of each row.
    """
    m = basic.shape[0]
    b, a = np.zeros(m), np.empty(m)
    for i in range(m):
        _column(contacts, generators, basic[i], a)
        for k in range(m):
            b[k] += max(T[i, m], 0.0) * a[k]
    return b


@njit(cache=True)
def _invert(basis: Basis) -> bool:
    """Gauss-Jordan with row pivoting; False where a pivot vanishes."""
    work, inverse = basis.work, basis.inverse
    m = work.shape[0]
    for i in range(m):
        for k in range(m):
            work[i, k] = basis.A[i, k]
            inverse[i, k] = 1.0 if i == k else 0.0
    for c in range(m):
        p = c
        for i in range(c + 1, m):
            if abs(work[i, c]) > abs(work[p, c]):
                p = i
        if abs(work[p, c]) < SINGULAR:
            return False
        if p != c:
            for k in range(m):
                work[c, k], work[p, k] = work[p, k], work[c, k]
                inverse[c, k], inverse[p, k] = inverse[p, k], inverse[c, k]
        scale = 1.0 / work[c, c]
        for k in range(m):
            work[c, k] *= scale
            inverse[c, k] *= scale
        for i in range(m):
            f = work[i, c]
            if i != c and f != 0.0:
                for k in range(m):
                    work[i, k] -= f * work[c, k]
                    inverse[i, k] -= f * inverse[c, k]
    return True


@njit(cache=True)
def _solve(basis: Basis, right: np.ndarray, out: np.ndarray) -> None:
    """out = A^-1 right, refined once."""
    A, inverse, left = basis.A, basis.inverse, basis.left
    m = A.shape[0]
    for i in range(m):
        total = 0.0
        for k in range(m):
            total += inverse[i, k] * right[k]
        out[i] = total
    for i in range(m):
        left[i] = right[i]
        for k in range(m):
            left[i] -= A[i, k] * out[k]
    for i in range(m):
        for k in range(m):
            out[i] += inverse[i, k] * left[k]


@njit(cache=True)
def _price(basis: Basis, ux: float, uy: float) -> None:
    """Multipliers y of direction u, y A = -u . move, refined once, into `full`."""
    A, inverse, move, left, y, full = basis.A, basis.inverse, basis.move, basis.left, basis.y, basis.full
    m = A.shape[0]
    y[:] = 0.0
    for i in range(m):
        cost = ux * move[0, i] + uy * move[1, i]
        for k in range(m):
            y[k] -= cost * inverse[i, k]
    for i in range(m):
        left[i] = ux * move[0, i] + uy * move[1, i]
        for k in range(m):
            left[i] += y[k] * A[k, i]
    for i in range(m):
        for k in range(m):
            y[k] -= left[i] * inverse[i, k]
    full[4], full[5] = ux, uy
    for k in range(m):
        full[k if k < 4 else k + WRENCH - 4] = y[k]


@njit(cache=True)
def _load(contacts: np.ndarray, generators: np.ndarray, basis: Basis) -> bool:
    """Fills A, inverse, move and x for the columns of `number`; False where A is singular."""
    m = basis.number.shape[0]
    for i in range(m):
        basis.move[0, i], basis.move[1, i] = _column(contacts, generators, basis.number[i], basis.a)
        for k in range(m):
            basis.A[k, i] = basis.a[k]
    if not _invert(basis):
        return False
    _solve(basis, basis.b, basis.x)
    return True


@njit(cache=True)
def _exchange(contacts: np.ndarray, generators: np.ndarray, basis: Basis, row: int, j: int) -> bool:
    """Puts column j, transformed in `w`, in the place of a row; False (and nothing changed) where A becomes singular."""
    m = basis.number.shape[0]
    inverse, w, old = basis.inverse, basis.w, basis.number[row]
    basis.number[row] = j
    if not SMALL < w[row] < 1.0 / SMALL:
        if _load(contacts, generators, basis):
            return True
        basis.number[row] = old
        _load(contacts, generators, basis)
        return False
    basis.move[0, row], basis.move[1, row] = _column(contacts, generators, j, basis.a)
    for k in range(m):
        basis.A[k, row] = basis.a[k]
        inverse[row, k] /= w[row]
    for i in range(m):
        if i != row:
            for k in range(m):
                inverse[i, k] -= w[i] * inverse[row, k]
    _solve(basis, basis.b, basis.x)
    return True


@njit(cache=True)
def _leaving(x: np.ndarray, w: np.ndarray) -> int:
    """The row that first reaches zero, -1 when none does; among ties the one with the greatest pivot (Harris 1973)."""
    bound = np.inf
    for i in range(x.shape[0]):
        if w[i] > PIVOT:
            bound = min(bound, (max(x[i], 0.0) + TIE) / w[i])
    row = -1
    for i in range(x.shape[0]):
        if w[i] > PIVOT and max(x[i], 0.0) <= bound * w[i] and (row < 0 or w[i] > w[row]):
            row = i
    return row


@njit(cache=True)
def _farthest(contacts: np.ndarray, generators: np.ndarray, basis: Basis, ux: float, uy: float) -> None:
    """Moves a basis to the optimum in direction u, or as near as rounding and the count of pivots let it."""
    for _ in range(MOST_PIVOTS):
        _price(basis, ux, uy)
        j = best_column(contacts, generators, basis.full, OPTIMAL)
        if j < 0:
            return
        _column(contacts, generators, j, basis.a)
        _solve(basis, basis.a, basis.w)
        row = _leaving(basis.x, basis.w)
        if row < 0 or not _exchange(contacts, generators, basis, row, j):
            return


@njit(cache=True)
def complete(
    contacts: np.ndarray,
    generators: np.ndarray,
    b: np.ndarray,
    basic: np.ndarray,
    first: np.ndarray,
    path: np.ndarray,
    count: int,
) -> int:
    """Turns some points of the polygon into all its vertices.

    Args:
        contacts: (n, 13 + 2 V) from `patch_simplex.pack`.
        generators: (n, G, 3) friction cones in C, rays with fz = 1.
        b: (4 + n,) right-hand side.
        basic: (m,) a basis to start from; written.
        first: (m,) another one, for where rounding has spoilt the former.
        path: (V, 2) points [m]; receives the vertices counter-clockwise.
        count: how many there are.

    Returns:
        Number of vertices. Where rounding hides one the polygon comes out smaller, never larger.
    """
    m = basic.shape[0]
    v, M = np.empty((5, m)), np.empty((3, m, m))
    basis = Basis(basic, M[0], M[1], np.empty((2, m)), b, v[0], v[1], v[2], v[3], v[4], M[2], np.empty(WRENCH + m - 4))
    if not _load(contacts, generators, basis) or basis.x.min() < NEGATIVE:
        basic[:] = first
        if not _load(contacts, generators, basis) or basis.x.min() < NEGATIVE:
            return 0
    for ux, uy in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
        if count < path.shape[0]:
            _farthest(contacts, generators, basis, ux, uy)
            count = _add(path, count, count, basis)
    count = _hull(path, count)
    i = 0
    while i < count:
        after = i + 1 if i + 1 < count else 0
        ex, ey = path[after, 0] - path[i, 0], path[after, 1] - path[i, 1]
        length = np.sqrt(ex * ex + ey * ey)
        if length > BEYOND and count < path.shape[0]:
            ux, uy = ey / length, -ex / length
            _farthest(contacts, generators, basis, ux, uy)
            gain = -ux * path[i, 0] - uy * path[i, 1]
            for k in range(m):
                gain += basis.x[k] * (ux * basis.move[0, k] + uy * basis.move[1, k])
            if gain > BEYOND:
                before = count
                count = _add(path, count, i + 1, basis)
                if count > before:
                    continue
        i += 1
    return _hull(path, count)


@njit(cache=True)
def _add(path: np.ndarray, count: int, at: int, basis: Basis) -> int:
    """Inserts the centre of mass of the basis' weights, if they are forces; the new count."""
    x, move = basis.x, basis.move
    if x.min() < NEGATIVE:
        return count
    for i in range(count, at, -1):
        path[i, 0], path[i, 1] = path[i - 1, 0], path[i - 1, 1]
    path[at, 0], path[at, 1] = 0.0, 0.0
    for k in range(x.shape[0]):
        path[at, 0] += x[k] * move[0, k]
        path[at, 1] += x[k] * move[1, k]
    return count + 1


@njit(cache=True)
def _hull(path: np.ndarray, count: int) -> int:
    """Puts the convex hull of some points in their place, counter-clockwise, and returns its size (Andrew 1979)."""
    points = path[:count].copy()
    order = np.argsort(points[:, 0], kind="mergesort")
    for i in range(1, count):  # equal x: by y
        k = i
        while k > 0 and (
            points[order[k], 0] == points[order[k - 1], 0] and points[order[k], 1] < points[order[k - 1], 1]
        ):
            order[k], order[k - 1] = order[k - 1], order[k]
            k -= 1
    size = 0
    for sweep in range(2):
        floor = size if sweep else 1
        for q in range(count):
            p = points[order[q]] if sweep == 0 else points[order[count - 1 - q]]
            if sweep and q == 0:
                continue
            while size > floor and not _left(path[size - 2], path[size - 1], p):
                size -= 1
            if size == 0 or p[0] != path[size - 1, 0] or p[1] != path[size - 1, 1]:
                path[size, 0], path[size, 1] = p[0], p[1]
                size += 1
    if size > 1 and path[size - 1, 0] == path[0, 0] and path[size - 1, 1] == path[0, 1]:
        size -= 1
    return size


@njit(cache=True)
def _left(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0
