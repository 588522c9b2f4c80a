"""The matrices of a MathematicalProgram that has linear constraints and convex quadratic costs only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from pydrake.solvers import MathematicalProgram, ProgramAttribute

QUADRATIC = {
    ProgramAttribute.kLinearCost,
    ProgramAttribute.kQuadraticCost,
    ProgramAttribute.kLinearConstraint,
    ProgramAttribute.kLinearEqualityConstraint,
}


def is_quadratic(prog: MathematicalProgram) -> bool:
    """Whether every cost and constraint of the program is linear or quadratic as `QuadraticProgram` understands it."""
    return set(prog.required_capabilities()) <= QUADRATIC


@dataclass(frozen=True, eq=False)
class LinearBlock:
    """Rows of one binding: lower <= A x <= upper over all the program's variables.

    Attributes:
        name: description of the binding.
        A: (m, n) sparse matrix.
        lower: (m,) least values, -inf where free.
        upper: (m,) greatest values, inf where free.
    """

    name: str
    A: sp.csr_matrix
    lower: np.ndarray
    upper: np.ndarray

    def excess(self, x: np.ndarray) -> np.ndarray:
        """(m,) by how much each row is violated at x, 0 where it holds."""
        y = self.A @ x
        return np.maximum(np.maximum(self.lower - y, y - self.upper), 0.0)


@dataclass(frozen=True, eq=False)
class QuadraticProgram:
    """min 1/2 x'Px + q'x + c  s.t.  every block's rows and lower <= x <= upper.

    Attributes:
        P: (n, n) sparse symmetric Hessian.
        q: (n,) linear cost.
        constant: c.
        equalities: blocks of linear equality constraints (lower equals upper).
        inequalities: blocks of linear inequality constraints.
        lower: (n,) least value of each variable, -inf where free.
        upper: (n,) greatest value of each variable, inf where free.
    """

    P: sp.csc_matrix
    q: np.ndarray
    constant: float
    equalities: tuple[LinearBlock, ...]
    inequalities: tuple[LinearBlock, ...]
    lower: np.ndarray
    upper: np.ndarray

    def cost(self, x: np.ndarray) -> float:
        """Value of the objective at x."""
        return float(0.5 * x @ (self.P @ x) + self.q @ x + self.constant)

    def worst(self, x: np.ndarray) -> tuple[float, str]:
        """The greatest violation at x and the name of the constraint that has it ("" where there is none)."""
        worst, name = (float(np.max(np.maximum(self.lower - x, x - self.upper), initial=0.0)), "bounds")
        for block in (*self.equalities, *self.inequalities):
            excess = float(np.max(block.excess(x), initial=0.0))
            if excess > worst:
                worst, name = excess, block.name
        return worst, name if worst > 0 else ""

    def non_finite(self) -> str:
        """Name of the first term that holds a NaN, or an infinity where none is allowed; "" where all is well."""
        if not (np.isfinite(self.P.data).all() and np.isfinite(self.q).all() and np.isfinite(self.constant)):
            return "cost"
        if np.isnan(self.lower).any() or np.isnan(self.upper).any():
            return "bounds"
        for block in (*self.equalities, *self.inequalities):
            if not np.isfinite(block.A.data).all() or np.isnan(block.lower).any() or np.isnan(block.upper).any():
                return block.name
        return ""


class ProgramReader:
    """Reads a MathematicalProgram into a `QuadraticProgram`, and again after coefficients or bounds were updated.

    Which variables each binding touches is looked up once: between two reads no cost, constraint or variable may be
    added or removed.
    """

    def __init__(self, prog: MathematicalProgram) -> None:
        if not is_quadratic(prog):
            raise ValueError("the program has terms that are neither linear nor quadratic")
        self._prog = prog
        self._bindings = {
            kind: [(b.evaluator(), np.array(prog.FindDecisionVariableIndices(b.variables()))) for b in bindings]
            for kind, bindings in (
                ("quadratic", prog.quadratic_costs()),
                ("linear", prog.linear_costs()),
                ("equality", prog.linear_equality_constraints()),
                ("inequality", prog.linear_constraints()),
                ("bounds", prog.bounding_box_constraints()),
            )
        }

    def read(self) -> QuadraticProgram:
        """The program's present numbers."""
        n = self._prog.num_vars()
        P, q, constant = self._costs(n)
        lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
        for evaluator, index in self._bindings["bounds"]:
            np.maximum.at(lower, index, evaluator.lower_bound())
            np.minimum.at(upper, index, evaluator.upper_bound())
        equalities = tuple(_block(evaluator, index, n) for evaluator, index in self._bindings["equality"])
        inequalities = tuple(_block(evaluator, index, n) for evaluator, index in self._bindings["inequality"])
        return QuadraticProgram(P, q, constant, equalities, inequalities, lower, upper)

    def _costs(self, n: int) -> tuple[sp.csc_matrix, np.ndarray, float]:
        q, constant = np.zeros(n), 0.0
        rows, cols, values = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
        for evaluator, index in self._bindings["quadratic"]:
            Q = evaluator.Q()
            i, j = np.nonzero(Q)
            rows.append(index[i])
            cols.append(index[j])
            values.append(Q[i, j])
            np.add.at(q, index, evaluator.b())
            constant += evaluator.c()
        for evaluator, index in self._bindings["linear"]:
            np.add.at(q, index, evaluator.a())
            constant += evaluator.b()
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols)))
        return sp.coo_matrix(entries, shape=(n, n)).tocsc(), q, float(constant)


def _block(evaluator, index: np.ndarray, n: int) -> LinearBlock:
    """The rows of one linear constraint, its columns moved to where its variables stand in the program."""
    A = evaluator.get_sparse_A().tocsc()
    cols = np.repeat(index, np.diff(A.indptr))
    spread = sp.csr_matrix((A.data, (A.indices, cols)), shape=(A.shape[0], n))
    return LinearBlock(evaluator.get_description(), spread, evaluator.lower_bound(), evaluator.upper_bound())
