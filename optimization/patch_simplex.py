"""A small simplex method for forces on contact patches, compiled; the machine room of `static_equilibrium`.

The unknowns are the weights of generators: column j is one edge of one corner's friction cone, a force f at a point p.
Its six rows, for a robot of unit weight M g at rest whose centre of mass stands over (x, y), are

    sum f_x = 0,   sum f_y = 0,   sum f_z = 1,   sum (p x f)_z = 0,   -sum (p x f)_y = x,   sum (p x f)_x = y

A query fixes x and y and asks for six rows; a region leaves them free, so that four rows remain and the last two are
its objectives. Every contact adds one row that bounds its normal force, with a slack.

Columns are never stored. A row vector y over the six rows is a force field a + b x p, so that its product with all
columns of a corner is one 3-vector in the contact frame times the generators: a few operations a column, and the
basis inverse (4 or 6 rows and one per contact) is all that a pivot changes.

Right-hand sides full of zeros make bases degenerate. The ratio test therefore reads a second right-hand side, shifted
by about 1e-10, which cannot cycle; answers are read from the exact one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

ENTERS = 1e-10  # a reduced cost above this lets a column enter [m or 1]
PIVOT = 1e-9  # smallest pivot
SHIFT = 1e-10  # of the right-hand side [M g]
FEASIBLE = 1e-9  # weight or moment that may be left over [M g, M g m]
NEAR_TIE = 1e-11  # two columns whose edges turn less than this apart [rad]
MAX_PIVOTS = 500  # a phase takes 5 to 15
WRENCH = 6  # rows of a column

CORNER_X = np.array([1.0, -1.0, -1.0, 1.0])
CORNER_Y = np.array([1.0, 1.0, -1.0, -1.0])


class Patches(NamedTuple):
    """Contact patches as arrays, n contacts.

    Attributes:
        p: (n, 3) centres [m], from a point near all of them.
        R_WC: (n, 3, 3) orientations.
        half: (n, 2) half extents [m].
        generators: (n, G, 3) edges of each friction cone in C, with fz = 1.
        limit: (n,) greatest normal force [M g].
    """

    p: np.ndarray
    R_WC: np.ndarray
    half: np.ndarray
    generators: np.ndarray
    limit: np.ndarray


class Basis(NamedTuple):
    """State of the simplex method with m = rows + n basic columns.

    Attributes:
        T: (m + 2, m + 2). Rows: m basic ones, then two objectives as minus their multipliers. Columns: the inverse, the
            right-hand side, the shifted right-hand side.
        column: (m,) basic column of each row: below 4 n G generators, then n slacks, then artificial ones.
        entering: (m + 2,) the entering column in terms of the basis.
        wrench: (6,) its rows.
    """

    T: np.ndarray
    column: np.ndarray
    entering: np.ndarray
    wrench: np.ndarray


@njit(cache=True)
def new_basis(rows: int, n: int) -> Basis:
    """Memory for a problem with this many equality rows and contacts."""
    m = rows + n
    return Basis(np.zeros((m + 2, m + 2)), np.empty(m, np.int64), np.empty(m + 2), np.zeros(WRENCH))


@njit(cache=True)
def num_generators(patches: Patches) -> int:
    """Number of columns that are forces; slacks follow them, then artificial columns."""
    return 4 * patches.generators.shape[0] * patches.generators.shape[1]


@njit(cache=True)
def set_wrench(patches: Patches, j: int, a: np.ndarray) -> int:
    """Writes the six rows of generator j into `a` and returns its contact."""
    G = patches.generators.shape[1]
    g, s, c = j % G, (j // G) % 4, j // (4 * G)
    R, p, e = patches.R_WC[c], patches.p[c], patches.generators[c, g]
    sx, sy = patches.half[c, 0] * CORNER_X[s], patches.half[c, 1] * CORNER_Y[s]
    fx = R[0, 0] * e[0] + R[0, 1] * e[1] + R[0, 2] * e[2]
    fy = R[1, 0] * e[0] + R[1, 1] * e[1] + R[1, 2] * e[2]
    fz = R[2, 0] * e[0] + R[2, 1] * e[1] + R[2, 2] * e[2]
    px = p[0] + R[0, 0] * sx + R[0, 1] * sy
    py = p[1] + R[1, 0] * sx + R[1, 1] * sy
    pz = p[2] + R[2, 0] * sx + R[2, 1] * sy
    a[0], a[1], a[2] = fx, fy, fz
    a[3] = px * fy - py * fx
    a[4] = px * fz - pz * fx
    a[5] = py * fz - pz * fy
    return c


@njit(cache=True)
def _field(patches: Patches, c: int, y: np.ndarray) -> tuple[float, float, float, float, float, float]:
    """y over the six rows as the field a + b x p on contact c: (a + b x p_C, b), both in C."""
    R, p = patches.R_WC[c], patches.p[c]
    b0, b1, b2 = y[5], -y[4], y[3]
    a0 = y[0] + b1 * p[2] - b2 * p[1]
    a1 = y[1] + b2 * p[0] - b0 * p[2]
    a2 = y[2] + b0 * p[1] - b1 * p[0]
    return (
        R[0, 0] * a0 + R[1, 0] * a1 + R[2, 0] * a2,
        R[0, 1] * a0 + R[1, 1] * a1 + R[2, 1] * a2,
        R[0, 2] * a0 + R[1, 2] * a1 + R[2, 2] * a2,
        R[0, 0] * b0 + R[1, 0] * b1 + R[2, 0] * b2,
        R[0, 1] * b0 + R[1, 1] * b1 + R[2, 1] * b2,
        R[0, 2] * b0 + R[1, 2] * b1 + R[2, 2] * b2,
    )


@njit(cache=True)
def best_column(patches: Patches, y: np.ndarray) -> int:
    """The column with the greatest reduced cost, -1 when none is worth entering.

    Args:
        y: (6 + n,) on the six rows and on the contacts' force limits.
    """
    n, G = patches.generators.shape[0], patches.generators.shape[1]
    best, best_j = ENTERS, -1
    for c in range(n):
        f = _field(patches, c, y)
        limit = y[WRENCH + c]
        if limit > best:
            best, best_j = limit, 4 * n * G + c
        for s in range(4):
            sx, sy = patches.half[c, 0] * CORNER_X[s], patches.half[c, 1] * CORNER_Y[s]
            h0, h1, h2 = f[0] - f[5] * sy, f[1] + f[5] * sx, f[2] + f[3] * sy - f[4] * sx + limit
            for g in range(G):
                r = h0 * patches.generators[c, g, 0] + h1 * patches.generators[c, g, 1] + h2
                if r > best:
                    best, best_j = r, (c * 4 + s) * G + g
    return best_j


@njit(cache=True)
def next_column(patches: Patches, y: np.ndarray, z: np.ndarray) -> int:
    """The column whose edge comes first when the direction turns left, -1 when none does within 90 deg.

    At an optimum in direction u every column has reduced costs (alpha, beta) in directions u and u turned left, with
    alpha <= 0; turning by phi makes it enter when tan(phi) = -alpha / beta. With the leader's (-alpha, beta) scaled
    to (sin, cos) = (na, nb), a column comes before it when na beta + nb alpha > 0. Among ties the greatest beta
    leads: in a degenerate corner it leaves soonest.

    Args:
        y: (6 + n,) multipliers of direction u.
        z: (6 + n,) multipliers of u turned left.
    """
    n, G = patches.generators.shape[0], patches.generators.shape[1]
    na, nb, lead, lead_j = 1.0, 0.0, ENTERS, -1
    for c in range(n):
        fa, fb = _field(patches, c, y), _field(patches, c, z)
        ya, zb = y[WRENCH + c], z[WRENCH + c]
        if na * zb + nb * ya > NEAR_TIE and zb > ENTERS:
            na, nb = _unit(max(-ya, 0.0), zb)
            lead, lead_j = zb, 4 * n * G + c
        for s in range(4):
            sx, sy = patches.half[c, 0] * CORNER_X[s], patches.half[c, 1] * CORNER_Y[s]
            a0, a1, a2 = fa[0] - fa[5] * sy, fa[1] + fa[5] * sx, fa[2] + fa[3] * sy - fa[4] * sx + ya
            b0, b1, b2 = fb[0] - fb[5] * sy, fb[1] + fb[5] * sx, fb[2] + fb[3] * sy - fb[4] * sx + zb
            d0, d1, d2 = na * b0 + nb * a0, na * b1 + nb * a1, na * b2 + nb * a2
            for g in range(G):
                e0, e1 = patches.generators[c, g, 0], patches.generators[c, g, 1]
                ahead = d0 * e0 + d1 * e1 + d2
                if ahead > -NEAR_TIE:
                    beta = b0 * e0 + b1 * e1 + b2
                    if beta > lead or (ahead > NEAR_TIE and beta > ENTERS):
                        lead, lead_j = beta, (c * 4 + s) * G + g
                        na, nb = _unit(max(-(a0 * e0 + a1 * e1 + a2), 0.0), beta)
                        d0, d1, d2 = na * b0 + nb * a0, na * b1 + nb * a1, na * b2 + nb * a2
    return lead_j


@njit(cache=True)
def _unit(a: float, b: float) -> tuple[float, float]:
    scale = 1.0 / np.sqrt(a * a + b * b)
    return a * scale, b * scale


@njit(cache=True)
def transform(patches: Patches, basis: Basis, rows: int, j: int) -> None:
    """Writes column j in terms of the basis: what it costs is added by `transform_moving` alone."""
    T, w, a = basis.T, basis.entering, basis.wrench
    first_slack = num_generators(patches)
    if j >= first_slack:
        for i in range(T.shape[0]):
            w[i] = T[i, rows + j - first_slack]
        return
    c = set_wrench(patches, j, a)
    for i in range(T.shape[0]):
        w[i] = T[i, rows + c]
        for k in range(rows):
            w[i] += T[i, k] * a[k]


@njit(cache=True)
def transform_moving(patches: Patches, basis: Basis, j: int) -> None:
    """The same for four rows and the objectives x and y; the last two entries are the column's reduced costs."""
    transform(patches, basis, 4, j)
    if j < num_generators(patches):
        basis.entering[-2] += basis.wrench[4]
        basis.entering[-1] += basis.wrench[5]


@njit(cache=True)
def leaving_row(basis: Basis) -> int:
    """The row that first reaches zero when the entering column grows, -1 when none does."""
    m = basis.column.shape[0]
    best, row = np.inf, -1
    for i in range(m):
        if basis.entering[i] > PIVOT:
            ratio = basis.T[i, m + 1] / basis.entering[i]
            if ratio < best:
                best, row = ratio, i
    return row


@njit(cache=True)
def pivot(basis: Basis, row: int, j: int) -> None:
    """Exchanges the basic column of `row` for the transformed column j."""
    T, w = basis.T, basis.entering
    scale = 1.0 / w[row]
    for k in range(T.shape[1]):
        T[row, k] *= scale
    for i in range(T.shape[0]):
        if i != row and w[i] != 0.0:
            for k in range(T.shape[1]):
                T[i, k] -= w[i] * T[row, k]
    basis.column[row] = j


@njit(cache=True)
def find_feasible(patches: Patches, basis: Basis, rows: int, x: float, y: float) -> bool:
    """Phase 1: a basis with nonnegative weights that meets the equality rows (4, or 6 with the CoM over (x, y)).

    Each row starts with an artificial column; their sum is driven to zero. Its multipliers stand in the row below the
    basic ones. False means that no such weights exist.
    """
    T, m, n = basis.T, basis.column.shape[0], patches.limit.shape[0]
    slack = num_generators(patches)
    for i in range(m):
        T[i, i] = 1.0
        basis.column[i] = slack + n + i if i < rows else slack + i - rows
    T[2, m] = 1.0
    if rows == WRENCH:
        T[4, 4], T[4, m] = (1.0 if x >= 0 else -1.0), abs(x)
        T[5, 5], T[5, m] = (1.0 if y >= 0 else -1.0), abs(y)
    for c in range(n):
        T[rows + c, m] = patches.limit[c]
    shift_right_hand_side(basis)
    for i in range(rows):
        for k in range(m + 2):
            T[m, k] += T[i, k]
    multipliers = np.zeros(WRENCH + n)
    for _ in range(MAX_PIVOTS):
        if T[m, m + 1] < SHIFT:
            break
        multipliers[:rows] = T[m, :rows]
        multipliers[WRENCH:] = T[m, rows:m]
        j = best_column(patches, multipliers)
        if j < 0:
            break
        transform(patches, basis, rows, j)
        row = leaving_row(basis)
        if row < 0:
            return False
        pivot(basis, row, j)
    return leftover(basis, slack + n) <= FEASIBLE


@njit(cache=True)
def shift_right_hand_side(basis: Basis) -> None:
    """Makes every basic weight positive in the shifted right-hand side, by amounts without a common measure."""
    m = basis.column.shape[0]
    for i in range(m):
        basis.T[i, m + 1] = max(basis.T[i, m], 0.0) + SHIFT * (1.0 + (i * 0.6180339887498949) % 1.0)


@njit(cache=True)
def leftover(basis: Basis, first_artificial: int) -> float:
    """How far the basic solution is from solving the rows with nonnegative weights; NaN if any weight is."""
    m = basis.column.shape[0]
    missing = 0.0
    for i in range(m):
        weight = basis.T[i, m]
        missing += abs(weight) if basis.column[i] >= first_artificial else max(-weight, 0.0) + 0.0 * weight
    return missing
