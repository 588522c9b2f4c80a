"""PIQP (Schwan et al. 2023), a sparse interior-point solver for quadratic programs, behind one small door.

It is optional (extra `fast`) and knows nothing of Drake: what it solves is a `QuadraticProgram`.
"""

from __future__ import annotations

import importlib.util

import numpy as np
import scipy.sparse as sp

from optimization.quadratic_program import QuadraticProgram

UNBOUNDED = 1e20  # rows with no bound beyond this are dropped


def available() -> bool:
    """Whether PIQP is installed."""
    return importlib.util.find_spec("piqp") is not None


class PiqpSolver:
    """Solves quadratic programs in turn, and keeps PIQP's symbolic work while their sparsity stays the same."""

    def __init__(self) -> None:
        self._solver = None
        self._pattern: tuple | None = None

    def solve(self, program: QuadraticProgram, *, tolerance: float, max_iterations: int) -> tuple[str, np.ndarray, int]:
        """Status in PIQP's words, the (n,) last iterate and the number of iterations.

        Args:
            program: finite data, see `QuadraticProgram.non_finite`.
            tolerance: absolute and relative accuracy asked for.
            max_iterations: of the interior-point method.
        """
        import piqp  # optional, and only needed from here on

        P = sp.triu(program.P, format="csc")
        A = _stack([block.A for block in program.equalities], program.q.size)
        b = np.concatenate([np.zeros(0), *(block.upper for block in program.equalities)])
        G = _stack([block.A for block in program.inequalities], program.q.size)
        lower = np.concatenate([np.zeros(0), *(block.lower for block in program.inequalities)])
        upper = np.concatenate([np.zeros(0), *(block.upper for block in program.inequalities)])
        data = (P, program.q, A, b, G, lower, upper, program.lower, program.upper)
        bounded = np.concatenate(
            [lower > -UNBOUNDED, upper < UNBOUNDED, program.lower > -UNBOUNDED, program.upper < UNBOUNDED]
        )
        pattern = (*(part for M in (P, A, G) for part in (M.indptr, M.indices)), bounded)
        if self._pattern is not None and _same(pattern, self._pattern):
            self._solver.update(*data)
        else:
            self._solver = piqp.SparseSolver()
            settings = self._solver.settings
            settings.eps_abs = settings.eps_rel = tolerance
            settings.max_iter = max_iterations
            settings.verbose = False
            self._solver.setup(*data)
            self._pattern = pattern
        status = self._solver.solve()
        result = self._solver.result
        return (str(status).rpartition("PIQP_")[2].lower(), np.array(result.x), int(result.info.iter))


def _stack(blocks: list[sp.csr_matrix], n: int) -> sp.csc_matrix:
    stacked = sp.vstack(blocks, format="csc") if blocks else sp.csc_matrix((0, n))
    stacked.sort_indices()
    return stacked


def _same(left: tuple, right: tuple) -> bool:
    return all(a.shape == b.shape and np.array_equal(a, b) for a, b in zip(left, right, strict=True))
