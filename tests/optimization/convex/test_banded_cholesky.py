"""Band systems against a dense solver."""

from __future__ import annotations

import numpy as np
import pytest

from optimization.convex.banded_cholesky import solve_band


def packed(A: np.ndarray, width: int) -> np.ndarray:
    """Row j: A[j, j], A[j + 1, j], ..., zeros beyond the end."""
    band = np.zeros((len(A), width))
    for j in range(len(A)):
        column = A[j : j + width, j]
        band[j, : len(column)] = column
    return band


@pytest.mark.parametrize(("n", "width"), [(1, 1), (1, 5), (7, 3), (40, 9), (40, 40), (5, 9)])
def test_the_solution_is_that_of_a_dense_solver(n: int, width: int):
    rng = np.random.default_rng(n + width)
    L = np.tril(np.triu(rng.normal(size=(n, n)), 1 - width).T, 0) if width < n else np.tril(rng.normal(size=(n, n)))
    L = np.tril(np.where(np.abs(np.subtract.outer(range(n), range(n))) < width, L + rng.normal(size=(n, n)), 0.0))
    A, b = L @ L.T + np.eye(n), rng.normal(size=n)
    x = b.copy()
    assert solve_band(packed(A, width), x)
    assert np.allclose(x, np.linalg.solve(A, b), atol=1e-9)


@pytest.mark.parametrize("spoiled", [-1.0, np.nan])
def test_a_matrix_that_is_not_positive_definite_is_refused(spoiled: float):
    A = np.diag([4.0, 4.0, 4.0]) + np.diag([1.0, 1.0], 1) + np.diag([1.0, 1.0], -1)
    A[1, 1] = spoiled
    assert not solve_band(packed(A, 2), np.ones(3))
