"""PIQP (Schwan et al. 2023), a sparse interior-point solver for quadratic programs, behind one small door.

It is optional (extra `fast`) and knows nothing of Drake: what it solves is a `QuadraticProgram`.
"""

from __future__ import annotations

import importlib.util

import numpy as np

from optimization.convex.quadratic_program import QuadraticProgram

INFINITE = 1e20  # PIQP's own notion of no bound
# The defaults (1e-10, 1e-4) stall on forces that no cost tells apart, and then call feasible problems infeasible.
REGULARISATION = 1e-7
INFEASIBILITY = 1e-9
PRECONDITIONING = 3  # rounds of scaling rows and columns; the default of 10 takes longer than it saves


def available() -> bool:
    """Whether PIQP is installed."""
    return importlib.util.find_spec("piqp") is not None


class PiqpSolver:
    """Solves quadratic programs in turn, and keeps PIQP's symbolic work while their sparsity stays the same."""

    def __init__(self, tolerance: float, gap: float, least_cost: float, max_iterations: int) -> None:
        """Args: absolute and relative accuracy of the residuals, accuracy of the cost relative to it or to a least one,
        and the limit on interior-point iterations.
        """
        self._settings = {
            "eps_abs": tolerance,
            "eps_rel": tolerance,
            "eps_duality_gap_abs": gap * least_cost,
            "eps_duality_gap_rel": gap,
            "reg_lower_limit": REGULARISATION,
            "eps_primal_inf": INFEASIBILITY,
            "eps_dual_inf": INFEASIBILITY,
            "preconditioner_iter": PRECONDITIONING,
            "max_iter": max_iterations,
            "verbose": False,
        }
        self._solver = None
        self._pattern: tuple[np.ndarray, ...] | None = None

    def solve(self, program: QuadraticProgram) -> tuple[str, np.ndarray, int]:
        """Status in PIQP's words, the (n,) last iterate and the number of iterations.

        Args:
            program: finite data, see `QuadraticProgram.non_finite`.
        """
        import piqp  # optional: nobody but the one who asks for it needs it

        equalities, inequalities = program.equalities, program.inequalities
        data = (program.P, program.q, equalities.A, equalities.upper, inequalities.A, inequalities.lower)
        data = (*data, inequalities.upper, program.lower, program.upper)
        pattern = _pattern(program)
        if self._solver is not None and self._pattern is not None and _same(pattern, self._pattern):
            self._solver.update(*data)
        else:
            self._solver, self._pattern = piqp.SparseSolver(), pattern
            # inequality rows folded into the Hessian: the smallest factorisation of the program's small cones
            self._solver.settings.kkt_solver = piqp.KKTSolver.sparse_ldlt_ineq_cond
            for name, value in self._settings.items():
                setattr(self._solver.settings, name, value)
            self._solver.setup(*data)
        status = self._solver.solve()
        result = self._solver.result
        return str(status).rpartition("PIQP_")[2].lower(), np.array(result.x), int(result.info.iter)


def _pattern(program: QuadraticProgram) -> tuple[np.ndarray, ...]:
    """What must not change for PIQP to keep its symbolic work: places of entries, and which bounds exist."""
    places = [part for M in (program.P, program.equalities.A, program.inequalities.A) for part in (M.indptr, M.indices)]
    bounds = (program.inequalities.lower, program.inequalities.upper, program.lower, program.upper)
    return (*places, *(np.abs(bound) < INFINITE for bound in bounds))


def _same(left: tuple[np.ndarray, ...], right: tuple[np.ndarray, ...]) -> bool:
    return all(a is b or np.array_equal(a, b) for a, b in zip(left, right, strict=True))
