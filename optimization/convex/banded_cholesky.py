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
    for j in range(n):
        column = band[j]
        if not column[0] > 1e-300:
            return False
        scale = 1.0 / np.sqrt(column[0])
        last = min(width, n - j)
        for k in range(last):
            column[k] *= scale
        for k in range(1, last):
            a = column[k]
            if a != 0.0:
                target = band[j + k]
                for i in range(last - k):
                    target[i] -= a * column[k + i]
        x[j] *= scale
        for k in range(1, last):
            x[j + k] -= column[k] * x[j]
    for j in range(n - 1, -1, -1):
        column = band[j]
        s = x[j]
        for k in range(1, min(width, n - j)):
            s -= column[k] * x[j + k]
        x[j] = s / column[0]
    return True
