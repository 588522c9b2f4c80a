"""A small simplex method for forces on contact patches, compiled; the machine room of `static_equilibrium`.

The unknowns are the weights of generators: column j is one edge of one corner's friction cone, a force f at a point p.
Its six rows, for a robot of unit weight M g at rest whose centre of mass stands over (x, y), are

    sum f_x = 0,   sum f_y = 0,   sum f_z = 1,   sum (p x f)_z = 0,   -sum (p x f)_y = x,   sum (p x f)_x = y

A query fixes x and y and asks for six rows; a region leaves them free, so that four rows remain and the last two are
its objectives. Every contact adds one row that bounds its normal force, with a slack. Columns are numbered generators
first, then the n slacks, then one artificial column for each of the 4 or 6 rows.

Columns are never stored. A row vector y over the six rows is a force field a + b x p, so that its product with all
columns of a corner is one 3-vector h in the contact frame times the generators; a corner whose circumscribed cone
h_z + mu |h_xy| cannot win is passed over whole.

State of m = rows + n basic columns:

    T       (m + 2, m + 1)  rows: the basic ones, then two objectives as minus their multipliers (phase 1 uses one);
                            columns: the inverse of the basis, the right-hand side
    basic   (m,)            number of the basic column of each row
    w       (m + 2,)        the entering column in terms of the basis, then its reduced costs

A right-hand side full of zeros makes bases degenerate, so the right-hand side is shifted by about 1e-11 before the
start. Every answer is exact for the shifted problem, which stands for the asked one as long as friction or a limit
leaves any play. Reading the unshifted right-hand side off the same bases would be wrong: a basis of nearly level
contacts stretches the shift by the inverse of the tilt.
"""

from __future__ import annotations

import numpy as np
from numba import njit

ENTERS = 1e-10  # a reduced cost above this lets a column enter [m or 1]
PIVOT = 1e-9  # smallest pivot
SHIFT = 1e-13  # of the right-hand side [M g]
FEASIBLE = 1e-9  # force and moment that may be left unbalanced [M g, M g m]
NEAR_TIE = 1e-11  # two columns whose edges turn less than this apart [rad]
MAX_PIVOTS = 500  # a phase takes 5 to 15
WRENCH = 6  # rows of a column

# A packed contact: p (3) from the mean of the contacts, R_WC (9) row by row, square of the widest generator's tangential
# part, x and y of each of V corners in C.
WIDE, CORNERS = 12, 13


@njit(cache=True)
def pack(
    p_WC: np.ndarray, R_WC: np.ndarray, corners: np.ndarray, generators: np.ndarray, force_limit: np.ndarray
) -> tuple[np.ndarray, float, float, bool]:
    """(contacts (n, 13 + 2 V), x and y of their mean, whether there are any and all numbers are finite).

    Args:
        p_WC, R_WC, corners, generators, force_limit: as in `static_equilibrium.ContactArrays`.
    """
    n = p_WC.shape[0]
    contacts = np.empty((n, CORNERS + 2 * corners.shape[1]))
    x, y, z, finite = 0.0, 0.0, 0.0, 0.0
    for c in range(n):
        x, y, z = x + p_WC[c, 0] / n, y + p_WC[c, 1] / n, z + p_WC[c, 2] / n
    for c in range(n):
        contacts[c, 0], contacts[c, 1], contacts[c, 2] = p_WC[c, 0] - x, p_WC[c, 1] - y, p_WC[c, 2] - z
        for k in range(3):
            for q in range(3):
                contacts[c, 3 + 3 * k + q] = R_WC[c, k, q]
        for s in range(corners.shape[1]):
            contacts[c, CORNERS + 2 * s], contacts[c, CORNERS + 2 * s + 1] = corners[c, s, 0], corners[c, s, 1]
        wide = 0.0
        for g in range(generators.shape[1]):
            finite += 0.0 * (generators[c, g, 0] + generators[c, g, 1] + generators[c, g, 2])
            wide = max(wide, generators[c, g, 0] ** 2 + generators[c, g, 1] ** 2)
        contacts[c, WIDE] = wide * (1.0 + 1e-12)
        finite += 0.0 * force_limit[c]
        for k in range(contacts.shape[1]):
            finite += 0.0 * contacts[c, k]
    return contacts, x, y, n > 0 and finite == 0.0


@njit(cache=True)
def num_generators(contacts: np.ndarray, generators: np.ndarray) -> int:
    """How many columns are generators: those of every corner of every contact.

    Args:
        contacts: (n, 13 + 2 V) from `pack`.
        generators: (n, G, 3) friction cones in C, rays with fz = 1.
    """
    return ((contacts.shape[1] - CORNERS) // 2) * contacts.shape[0] * generators.shape[1]


@njit(cache=True)
def wrench(
    contacts: np.ndarray, generators: np.ndarray, j: int
) -> tuple[float, float, float, float, float, float, int]:
    """The six rows of generator j and its contact.

    Args:
        contacts: (n, 13 + 2 V) from `pack`.
        generators: (n, G, 3) friction cones in C, rays with fz = 1.
        j: column of a generator.
    """
    G, V = generators.shape[1], (contacts.shape[1] - CORNERS) // 2
    g, corner = j % G, j // G
    c = corner // V
    s = CORNERS + 2 * (corner - c * V)
    k, e0, e1, e2 = contacts, generators[c, g, 0], generators[c, g, 1], generators[c, g, 2]
    sx, sy = k[c, s], k[c, s + 1]
    fx = k[c, 3] * e0 + k[c, 4] * e1 + k[c, 5] * e2
    fy = k[c, 6] * e0 + k[c, 7] * e1 + k[c, 8] * e2
    fz = k[c, 9] * e0 + k[c, 10] * e1 + k[c, 11] * e2
    px = k[c, 0] + k[c, 3] * sx + k[c, 4] * sy
    py = k[c, 1] + k[c, 6] * sx + k[c, 7] * sy
    pz = k[c, 2] + k[c, 9] * sx + k[c, 10] * sy
    return fx, fy, fz, px * fy - py * fx, px * fz - pz * fx, py * fz - pz * fy, c


@njit(cache=True)
def _field(contacts: np.ndarray, c: int, y: np.ndarray) -> tuple[float, float, float, float, float, float]:
    """Multipliers y of the six rows as the field a + b x p on contact c: (a + b x p_WC, b), both in C."""
    k = contacts
    b0, b1, b2 = y[5], -y[4], y[3]
    a0 = y[0] + b1 * k[c, 2] - b2 * k[c, 1]
    a1 = y[1] + b2 * k[c, 0] - b0 * k[c, 2]
    a2 = y[2] + b0 * k[c, 1] - b1 * k[c, 0]
    return (
        k[c, 3] * a0 + k[c, 6] * a1 + k[c, 9] * a2,
        k[c, 4] * a0 + k[c, 7] * a1 + k[c, 10] * a2,
        k[c, 5] * a0 + k[c, 8] * a1 + k[c, 11] * a2,
        k[c, 3] * b0 + k[c, 6] * b1 + k[c, 9] * b2,
        k[c, 4] * b0 + k[c, 7] * b1 + k[c, 10] * b2,
        k[c, 5] * b0 + k[c, 8] * b1 + k[c, 11] * b2,
    )


@njit(cache=True)
def best_column(contacts: np.ndarray, generators: np.ndarray, y: np.ndarray, least: float) -> int:
    """The generator or slack with the greatest reduced cost, -1 when none is worth entering.

    Args:
        contacts, generators: (n, 13 + 2 V) as packed and (n, G, 3).
        y: (6 + n,) on the six rows and on the contacts' force limits.
        least: reduced cost that a column must exceed [m or 1].
    """
    n, G, V = generators.shape[0], generators.shape[1], (contacts.shape[1] - CORNERS) // 2
    best, best_j = least, -1
    for c in range(n):
        f = _field(contacts, c, y)
        limit = y[WRENCH + c]
        if limit > best:
            best, best_j = limit, V * n * G + c
        for s in range(V):
            sx, sy = contacts[c, CORNERS + 2 * s], contacts[c, CORNERS + 2 * s + 1]
            h0, h1, h2 = f[0] - f[5] * sy, f[1] + f[5] * sx, f[2] + f[3] * sy - f[4] * sx + limit
            short = best - h2
            if short > 0.0 and contacts[c, WIDE] * (h0 * h0 + h1 * h1) < short * short:
                continue
            for g in range(G):
                r = h0 * generators[c, g, 0] + h1 * generators[c, g, 1] + h2
                if r > best:
                    best, best_j = r, (c * V + s) * G + g
    return best_j


@njit(cache=True)
def next_column(contacts: np.ndarray, generators: np.ndarray, y: np.ndarray, z: np.ndarray) -> int:
    """The column whose edge comes first when the direction turns left, -1 when none does within 90 deg.

    At an optimum in direction u every column has reduced costs (alpha, beta) in directions u and u turned left, with
    alpha <= 0; turning by phi makes it enter when tan(phi) = -alpha / beta. A column comes before the leader when
    d = lead_alpha beta + lead_beta alpha > 0, with lead_alpha = -alpha of the leader. Among ties the greatest beta
    leads: it leaves a degenerate corner soonest.

    Args:
        contacts, generators: (n, 13 + 2 V) as packed and (n, G, 3).
        y, z: (6 + n,) multipliers of u and of u turned left.
    """
    n, G, V = generators.shape[0], generators.shape[1], (contacts.shape[1] - CORNERS) // 2
    lead_alpha, lead_beta, lead, tie = 1.0, 0.0, -1, NEAR_TIE
    for c in range(n):
        fa, fb = _field(contacts, c, y), _field(contacts, c, z)
        ya, zb = y[WRENCH + c], z[WRENCH + c]
        if lead_alpha * zb + lead_beta * ya > tie and zb > ENTERS:
            lead_alpha, lead_beta, lead = max(-ya, 0.0), zb, V * n * G + c
            tie = NEAR_TIE * (lead_alpha + lead_beta)
        for s in range(V):
            sx, sy = contacts[c, CORNERS + 2 * s], contacts[c, CORNERS + 2 * s + 1]
            a0, a1, a2 = fa[0] - fa[5] * sy, fa[1] + fa[5] * sx, fa[2] + fa[3] * sy - fa[4] * sx + ya
            b0, b1, b2 = fb[0] - fb[5] * sy, fb[1] + fb[5] * sx, fb[2] + fb[3] * sy - fb[4] * sx + zb
            d0, d1 = lead_alpha * b0 + lead_beta * a0, lead_alpha * b1 + lead_beta * a1
            d2 = lead_alpha * b2 + lead_beta * a2
            short = -tie - d2
            if short > 0.0 and contacts[c, WIDE] * (d0 * d0 + d1 * d1) < short * short:
                continue
            for g in range(G):
                e0, e1 = generators[c, g, 0], generators[c, g, 1]
                d = d0 * e0 + d1 * e1 + d2
                if d > -tie:
                    beta = b0 * e0 + b1 * e1 + b2
                    if beta > ENTERS and (d > tie or beta > lead_beta):
                        lead_alpha, lead_beta = max(-(a0 * e0 + a1 * e1 + a2), 0.0), beta
                        lead, tie = (c * V + s) * G + g, NEAR_TIE * (lead_alpha + lead_beta)
                        d0, d1 = lead_alpha * b0 + lead_beta * a0, lead_alpha * b1 + lead_beta * a1
                        d2 = lead_alpha * b2 + lead_beta * a2
    return lead


@njit(cache=True)
def transform(contacts: np.ndarray, generators: np.ndarray, T: np.ndarray, w: np.ndarray, j: int) -> None:
    """Writes column j in terms of the basis into w; its own costs, as for x and y, are left to `transform_moving`.

    Args:
        contacts: (n, 13 + 2 V) from `pack`.
        generators: (n, G, 3) friction cones in C, rays with fz = 1.
        T: (m + 2, m + 1) tableau.
        w: (m + 2,) receives the column.
        j: number of the column.
    """
    n = contacts.shape[0]
    rows, slack = T.shape[0] - 2 - n, num_generators(contacts, generators)
    if j >= slack:
        for i in range(T.shape[0]):
            w[i] = T[i, rows + j - slack]
        return
    a0, a1, a2, a3, a4, a5, c = wrench(contacts, generators, j)
    for i in range(T.shape[0]):
        w[i] = T[i, rows + c] + T[i, 0] * a0 + T[i, 1] * a1 + T[i, 2] * a2 + T[i, 3] * a3
    if rows == WRENCH:
        for i in range(T.shape[0]):
            w[i] += T[i, 4] * a4 + T[i, 5] * a5


@njit(cache=True)
def transform_moving(contacts: np.ndarray, generators: np.ndarray, T: np.ndarray, w: np.ndarray, j: int) -> None:
    """The same with four rows, for the objectives x and y: w ends with how fast column j moves the centre of mass.

    Args:
        contacts: (n, 13 + 2 V) from `pack`.
        generators: (n, G, 3) friction cones in C, rays with fz = 1.
        T: (m + 2, m + 1) tableau.
        w: (m + 2,) receives the column.
        j: number of the column.
    """
    transform(contacts, generators, T, w, j)
    if j < num_generators(contacts, generators):
        moved = wrench(contacts, generators, j)
        w[T.shape[0] - 2] += moved[4]
        w[T.shape[0] - 1] += moved[5]


@njit(cache=True)
def leaving_row(T: np.ndarray, w: np.ndarray) -> int:
    """The row that first reaches zero when the entering column grows, -1 when none does.

    Args:
        T: (m + 2, m + 1) tableau.
        w: (m + 2,) the entering column in terms of the basis.
    """
    m = T.shape[0] - 2
    best, row = np.inf, -1
    for i in range(m):
        if w[i] > PIVOT:
            ratio = max(T[i, m], 0.0) / w[i]
            if ratio < best:
                best, row = ratio, i
    return row


@njit(cache=True)
def pivot(T: np.ndarray, basic: np.ndarray, w: np.ndarray, row: int, j: int) -> None:
    """Exchanges the basic column of `row` for the transformed column j.

    Args:
        T: (m + 2, m + 1) tableau; written.
        basic: (m,) number of the basic column of each row; written.
        w: (m + 2,) the entering column in terms of the basis.
        row: of the column that leaves.
        j: number of the column that enters.
    """
    scale = 1.0 / w[row]
    for k in range(T.shape[1]):
        T[row, k] *= scale
    for i in range(T.shape[0]):
        if i != row and w[i] != 0.0:
            for k in range(T.shape[1]):
                T[i, k] -= w[i] * T[row, k]
    basic[row] = j


@njit(cache=True)
def find_feasible(
    contacts: np.ndarray,
    generators: np.ndarray,
    force_limit: np.ndarray,
    x: float,
    y: float,
    T: np.ndarray,
    basic: np.ndarray,
    w: np.ndarray,
) -> bool:
    """Phase 1: fills T (zeros before) and `basic` with nonnegative weights that meet the rows.

    There are 4 rows, or 6 with the centre of mass over (x, y), by the size of T. Each starts with an artificial column,
    and the sum of their weights, kept below the basic rows, is driven to zero.

    Args:
        contacts: (n, 13 + 2 V) from `pack`.
        generators: (n, G, 3) friction cones in C, rays with fz = 1.
        force_limit: (n,) greatest normal force of each contact [M g].
        x, y: CoM from the mean of the contacts, in W [m].
        T: (m + 2, m + 1) zeros; written.
        basic: (m,) written.
        w: (m + 2,) scratch.

    Returns:
        False when no such weights exist.
    """
    m, n = T.shape[0] - 2, contacts.shape[0]
    rows, slack = m - n, num_generators(contacts, generators)
    for i in range(m):
        T[i, i] = 1.0
        basic[i] = slack + n + i if i < rows else slack + i - rows
    T[2, m] = 1.0
    if rows == WRENCH:
        T[4, 4], T[4, m] = (1.0 if x >= 0 else -1.0), abs(x)
        T[5, 5], T[5, m] = (1.0 if y >= 0 else -1.0), abs(y)
    for c in range(n):
        T[rows + c, m] = force_limit[c]
    for i in range(m):
        T[i, m] += shift(i)
    for i in range(rows):
        for k in range(m + 1):
            T[m, k] += T[i, k]
    multipliers = np.zeros(WRENCH + n)
    for _ in range(MAX_PIVOTS):
        if T[m, m] < SHIFT:
            break
        for k in range(rows):
            multipliers[k] = T[m, k]
        for k in range(n):
            multipliers[WRENCH + k] = T[m, rows + k]
        j = best_column(contacts, generators, multipliers, ENTERS)
        if j < 0:
            break
        transform(contacts, generators, T, w, j)
        row = leaving_row(T, w)
        if row < 0:
            return False
        pivot(T, basic, w, row, j)
    return bool(T[m, m] <= FEASIBLE)


@njit(cache=True)
def shift(i: int) -> float:
    """What the right-hand side of row i is shifted by: small amounts without a common measure."""
    return SHIFT * (1.0 + (i * 0.6180339887498949) % 1.0)


@njit(cache=True)
def set_objectives(contacts: np.ndarray, generators: np.ndarray, T: np.ndarray, basic: np.ndarray) -> None:
    """Fills the objective rows with minus the multipliers of the CoM's x and y; their right-hand side is (-x, -y).

    Args:
        contacts: (n, 13 + 2 V) from `pack`.
        generators: (n, G, 3) friction cones in C, rays with fz = 1.
        T: (m + 2, m + 1) tableau; its last two rows are written.
        basic: (m,) number of the basic column of each row.
    """
    m = basic.shape[0]
    for k in range(m + 1):
        T[m, k], T[m + 1, k] = 0.0, 0.0
    for i in range(m):
        if basic[i] < num_generators(contacts, generators):
            a = wrench(contacts, generators, basic[i])
            for k in range(m + 1):
                T[m, k] -= a[4] * T[i, k]
                T[m + 1, k] -= a[5] * T[i, k]


@njit(cache=True)
def multipliers(T: np.ndarray, ux: float, uy: float, y: np.ndarray) -> None:
    """Multipliers of the objective ux x + uy y over the six rows and the limits.

    Args:
        T: (m + 2, m + 1) tableau with its objective rows set.
        ux, uy: direction.
        y: (6 + n,) written.
    """
    m = T.shape[0] - 2
    for k in range(4):
        y[k] = ux * T[m, k] + uy * T[m + 1, k]
    y[4], y[5] = ux, uy
    for k in range(4, m):
        y[WRENCH + k - 4] = ux * T[m, k] + uy * T[m + 1, k]
