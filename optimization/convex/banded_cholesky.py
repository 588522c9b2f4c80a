"""Symmetric positive definite band matrices in numba: factored and solved in place, on one thread, always the same.

LAPACK takes a third of the time, and a hundred times as long where its threads wait for busy cores.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, fastmath={"contract", "reassoc"})
def solve_band(band: np.ndarray, x: np.ndarray) -> bool:
    """Solves A x = b by Cholesky; False, with x useless, where A is not positive definite or holds NaN.

    Args:
        band: (n, u + 1), row j holds A[j, j], A[j + 1, j], ..., A[j + u, j], zeros beyond the end. Destroyed.
        x: (n,) b, and then x.
    """
    n, width = band.shape
    first = 0
    while first < n:
        num = min(4, n - first)
        for j in range(first, first + num):  # the columns of this block, and what they take from each other
            column = band[j]
            if not column[0] > 1e-300:
                return False
            scale = 1.0 / np.sqrt(column[0])
            last = min(width, n - j)
            for k in range(last):
                column[k] *= scale
            for k in range(1, min(first + num - j, last)):
                _take(band[j + k], column, k, column[k], last - k)
            x[j] *= scale
            for k in range(1, last):
                x[j + k] -= column[k] * x[j]
        if num == 4:
            _take_four(band, first, min(width, n - first))
            # Further down only the later columns of the block reach.
            for j in range(first + 1, first + 4):
                last = min(width, n - j)
                for k in range(max(width - (j - first), first + 4 - j), last):
                    _take(band[j + k], band[j], k, band[j, k], last - k)
        first += num
    for j in range(n - 1, -1, -1):
        column = band[j]
        s = x[j]
        for k in range(1, min(width, n - j)):
            s -= column[k] * x[j + k]
        x[j] = s / column[0]
    return True


@njit(cache=True, fastmath={"contract", "reassoc"})
def _take(target: np.ndarray, column: np.ndarray, k: int, a: float, count: int) -> None:
    """Subtracts a times the column from its entry k on."""
    for i in range(count):
        target[i] -= a * column[k + i]


@njit(cache=True, fastmath={"contract", "reassoc"})
def _take_four(band: np.ndarray, first: int, reach: int) -> None:
    """What four columns take together from those below that all four reach: one pass over memory instead of four.

    Args:
        band: of which columns first to first + 3 are done.
        first: the first of the four.
        reach: rows from `first` on that its column has.
    """
    width = band.shape[1]
    c0, c1, c2, c3 = band[first], band[first + 1], band[first + 2], band[first + 3]
    for k in range(4, reach):
        a0, a1, a2, a3 = c0[k], c1[k - 1], c2[k - 2], c3[k - 3]
        if a0 == 0.0 and a1 == 0.0 and a2 == 0.0 and a3 == 0.0:
            continue
        target, together = band[first + k], reach - k
        b1, b2, b3 = c1[k - 1 :], c2[k - 2 :], c3[k - 3 :]
        b0 = c0[k:]
        for i in range(together):
            target[i] -= a0 * b0[i] + a1 * b1[i] + a2 * b2[i] + a3 * b3[i]
        # The other three columns each reach one row further than the one before, as far as there are rows.
        for i in range(together, min(together + 3, width)):
            if k - 1 + i < width:
                target[i] -= a1 * c1[k - 1 + i]
            if k - 2 + i < width:
                target[i] -= a2 * c2[k - 2 + i]
            if k - 3 + i < width:
                target[i] -= a3 * c3[k - 3 + i]
