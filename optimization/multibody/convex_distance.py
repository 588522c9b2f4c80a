"""Distance between two convex hulls of points, with the two nearest points, compiled.

The algorithm is that of Gilbert, Johnson & Keerthi (1988): a simplex of at most four differences a - b of corners closes
in on the point of A - B nearest to the origin. Its distance is an upper bound at every step, and the corner that lies
deepest against it gives a lower one; it ends when the two meet. Hulls that overlap have distance zero and no nearest
points; `way_out` finds a direction in which they part.
"""

from __future__ import annotations

import numpy as np
from numba import njit

AGREE = 1e-9  # [m] upper and lower bound this near to each other are the distance
MEET = 1e-10  # [m] hulls nearer than this overlap
FLAT = 1e-14  # [m^3] a tetrahedron with less than six times this volume has no inside
MAX_STEPS = 100  # ordinary pairs take 3 to 10
SHRINK = (0.97, 0.9, 0.75, 0.5, 0.2)  # hulls that overlap are drawn together about their middles by these factors


@njit(cache=True)
def hull_distance(
    A: np.ndarray, num_a: int, B: np.ndarray, num_b: int, most: float, p_A: np.ndarray, p_B: np.ndarray
) -> float:
    """Distance between the hulls of two sets of points [m]; 0 where they overlap, inf where it is more than `most`.

    Args:
        A: (m, 3) points [m], the first `num_a` of them count.
        num_a: at least 1.
        B: (n, 3) points in the same frame [m], the first `num_b` of them count.
        num_b: at least 1.
        most: greatest distance that is of interest [m].
        p_A: (3,) is written: the point of A nearest to B, unless they overlap or are further apart [m].
        p_B: (3,) is written: the point of B nearest to A [m].
    """
    corner = np.empty((4, 2), np.int64)  # of A and of B, of each point of the simplex
    W, share, v = np.empty((4, 3)), np.empty(4), np.empty(3)
    _towards(A, num_a, B, num_b, v)
    corner[0, 0], corner[0, 1] = _extreme(A, num_a, v, -1.0), _extreme(B, num_b, v, 1.0)
    for r in range(3):
        W[0, r] = A[corner[0, 0], r] - B[corner[0, 1], r]
    if W[0, 0] * v[0] + W[0, 1] * v[1] + W[0, 2] * v[2] > most:
        return np.inf
    for r in range(3):
        v[r] = W[0, r]
    share[0], size = 1.0, 1
    for _ in range(MAX_STEPS):
        length2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
        if length2 < MEET * MEET:
            return 0.0
        i, j = _extreme(A, num_a, v, -1.0), _extreme(B, num_b, v, 1.0)
        bound = 0.0
        for r in range(3):
            bound += v[r] * (A[i, r] - B[j, r])
        length = np.sqrt(length2)
        if bound > most * length:
            return np.inf
        if length2 - bound <= AGREE * length or _known(corner, size, i, j):
            break
        corner[size, 0], corner[size, 1] = i, j
        for r in range(3):
            W[size, r] = A[i, r] - B[j, r]
        size = nearest_of_simplex(W, size + 1, share, corner, v)
        if size == 4:
            return 0.0
        if v[0] * v[0] + v[1] * v[1] + v[2] * v[2] >= length2:  # rounding: no nearer than before
            break
    for r in range(3):
        p_A[r], p_B[r] = 0.0, 0.0
        for k in range(size):
            p_A[r] += share[k] * A[corner[k, 0], r]
            p_B[r] += share[k] * B[corner[k, 1], r]
    distance = np.sqrt((p_A[0] - p_B[0]) ** 2 + (p_A[1] - p_B[1]) ** 2 + (p_A[2] - p_B[2]) ** 2)
    return distance if distance <= most else np.inf


@njit(cache=True)
def _towards(A: np.ndarray, num_a: int, B: np.ndarray, num_b: int, v: np.ndarray) -> None:
    """Writes the unit vector from the middle of B's box to that of A's; zero where they coincide."""
    length2 = 0.0
    for r in range(3):
        low_a = high_a = A[0, r]
        for i in range(1, num_a):
            low_a, high_a = min(low_a, A[i, r]), max(high_a, A[i, r])
        low_b = high_b = B[0, r]
        for j in range(1, num_b):
            low_b, high_b = min(low_b, B[j, r]), max(high_b, B[j, r])
        v[r] = 0.5 * (low_a + high_a) - 0.5 * (low_b + high_b)
        length2 += v[r] * v[r]
    length = np.sqrt(length2)
    for r in range(3):
        v[r] = v[r] / length if length > 0.0 else 0.0


@njit(cache=True)
def _extreme(points: np.ndarray, count: int, v: np.ndarray, sign: float) -> int:
    """Number of the point that lies furthest along sign * v."""
    best, chosen = -np.inf, 0
    for i in range(count):
        d = sign * (points[i, 0] * v[0] + points[i, 1] * v[1] + points[i, 2] * v[2])
        if d > best:
            best, chosen = d, i
    return chosen


@njit(cache=True)
def _known(corner: np.ndarray, size: int, i: int, j: int) -> bool:
    for k in range(size):  # noqa: SIM110 (compiled: no generators)
        if corner[k, 0] == i and corner[k, 1] == j:
            return True
    return False


@njit(cache=True)
def nearest_of_simplex(W: np.ndarray, size: int, share: np.ndarray, corner: np.ndarray, v: np.ndarray) -> int:
    """Reduces a simplex to the face that holds its point nearest to the origin; how many points that face has.

    Args:
        W: (4, 3) points of the simplex [m]; those of the face come first afterwards.
        size: how many points count, 2 to 4.
        share: (4,) is written: the nearest point as a combination of the face's points.
        corner: (4, 2) what belongs to each point; reordered with them.
        v: (3,) is written: the nearest point [m]. Where the origin lies inside a tetrahedron the answer is 4 and v is
            left alone.
    """
    weight = np.zeros(4)
    trial = np.empty(4)
    best = np.inf
    if size == 2:
        _on_triangle(W, 0, 1, 1, weight)
    elif size == 3:
        _on_triangle(W, 0, 1, 2, weight)
    else:
        inside = True
        for apex in range(4):
            a, b, c = (apex + 1) % 4, (apex + 2) % 4, (apex + 3) % 4
            if not _beyond(W, a, b, c, apex):
                continue
            inside = False
            d = _on_triangle(W, a, b, c, trial)
            if d < best:
                best = d
                weight[:] = trial
        if inside:
            return 4
    kept = 0
    v[:] = 0.0
    for k in range(size):
        if weight[k] > 0.0:
            for r in range(3):
                W[kept, r] = W[k, r]
                v[r] += weight[k] * W[k, r]
            corner[kept, 0], corner[kept, 1] = corner[k, 0], corner[k, 1]
            share[kept] = weight[k]
            kept += 1
    return kept


@njit(cache=True)
def _beyond(W: np.ndarray, a: int, b: int, c: int, apex: int) -> bool:
    """Whether the origin lies on the other side of triangle abc than the apex, or the four lie in one plane."""
    ux, uy, uz = W[b, 0] - W[a, 0], W[b, 1] - W[a, 1], W[b, 2] - W[a, 2]
    wx, wy, wz = W[c, 0] - W[a, 0], W[c, 1] - W[a, 1], W[c, 2] - W[a, 2]
    nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    apex_side = nx * (W[apex, 0] - W[a, 0]) + ny * (W[apex, 1] - W[a, 1]) + nz * (W[apex, 2] - W[a, 2])
    origin_side = -(nx * W[a, 0] + ny * W[a, 1] + nz * W[a, 2])
    return abs(apex_side) < FLAT or apex_side * origin_side < 0.0


@njit(cache=True)
def _on_triangle(W: np.ndarray, a: int, b: int, c: int, weight: np.ndarray) -> float:
    """Writes the point of triangle abc nearest to the origin as weights of all four points; its squared distance.

    Ericson (2004), Real-Time Collision Detection, sec. 5.1.5. b = c stands for the segment ab.
    """
    weight[:] = 0.0
    abx, aby, abz = W[b, 0] - W[a, 0], W[b, 1] - W[a, 1], W[b, 2] - W[a, 2]
    acx, acy, acz = W[c, 0] - W[a, 0], W[c, 1] - W[a, 1], W[c, 2] - W[a, 2]
    d1 = -(abx * W[a, 0] + aby * W[a, 1] + abz * W[a, 2])
    d2 = -(acx * W[a, 0] + acy * W[a, 1] + acz * W[a, 2])
    d3 = -(abx * W[b, 0] + aby * W[b, 1] + abz * W[b, 2])
    d4 = -(acx * W[b, 0] + acy * W[b, 1] + acz * W[b, 2])
    d5 = -(abx * W[c, 0] + aby * W[c, 1] + abz * W[c, 2])
    d6 = -(acx * W[c, 0] + acy * W[c, 1] + acz * W[c, 2])
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        weight[a] = 1.0
    elif d3 >= 0.0 and d4 <= d3:
        weight[b] = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        weight[a], weight[b] = 1.0 - t, t
    elif d6 >= 0.0 and d5 <= d6:
        weight[c] = 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        weight[a], weight[c] = 1.0 - t, t
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        weight[b], weight[c] = 1.0 - t, t
    else:
        whole = max(va + vb + vc, 1e-300)
        weight[b], weight[c] = vb / whole, vc / whole
        weight[a] = 1.0 - weight[b] - weight[c]
    total = 0.0
    for r in range(3):
        x = weight[a] * W[a, r] + weight[b] * W[b, r] + (weight[c] * W[c, r] if c != b else 0.0)
        total += x * x
    return total


@njit(cache=True)
def way_out(
    A: np.ndarray, num_a: int, B: np.ndarray, num_b: int, p_A: np.ndarray, p_B: np.ndarray, n: np.ndarray
) -> float:
    """How far A has to move along n for its hull to leave that of B [m]: at least the depth of their overlap.

    The direction is the best of those in which the two, shrunk about their middles, are nearest to each other.

    Args:
        A: (m, 3) points [m], the first `num_a` of them count.
        num_a: at least 1.
        B: (n, 3) points in the same frame [m], the first `num_b` of them count.
        num_b: at least 1.
        p_A: (3,) is written: the point of A deepest along n [m].
        p_B: (3,) is written: where that point should be [m].
        n: (3,) is written: unit vector from B to A.
    """
    a, b, u = np.empty((num_a, 3)), np.empty((num_b, 3)), np.empty(3)
    middle_a, middle_b = _middle(A, num_a), _middle(B, num_b)
    least, deepest = np.inf, 0
    for share in SHRINK:
        for r in range(3):
            for i in range(num_a):
                a[i, r] = middle_a[r] + share * (A[i, r] - middle_a[r])
            for j in range(num_b):
                b[j, r] = middle_b[r] + share * (B[j, r] - middle_b[r])
        length = hull_distance(a, num_a, b, num_b, np.inf, p_A, p_B)
        if length == 0.0 and (share > SHRINK[-1] or least < np.inf):
            continue
        for r in range(3):
            u[r] = (p_A[r] - p_B[r]) / length if length > 0.0 else (1.0 if r == 2 else 0.0)
        i, j = _extreme(A, num_a, u, -1.0), _extreme(B, num_b, u, 1.0)
        way = u[0] * (B[j, 0] - A[i, 0]) + u[1] * (B[j, 1] - A[i, 1]) + u[2] * (B[j, 2] - A[i, 2])
        if way < least:
            least, deepest = way, i
            n[:] = u
    for r in range(3):
        p_A[r] = A[deepest, r]
        p_B[r] = p_A[r] + least * n[r]
    return least


@njit(cache=True)
def _middle(points: np.ndarray, count: int) -> np.ndarray:
    middle = np.zeros(3)
    for i in range(count):
        for r in range(3):
            middle[r] += points[i, r] / count
    return middle
