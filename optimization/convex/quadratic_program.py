"""The matrices of a MathematicalProgram that has linear constraints and convex quadratic costs only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from pydrake.solvers import MathematicalProgram, ProgramAttribute

from optimization.convex.sparse_rows import RowPattern

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
class LinearRows:
    """The rows lower <= A x <= upper of several bindings, stacked.

    Attributes:
        A: (m, n) sparse matrix.
        lower: (m,) least values, -inf where free; equal to `upper` for equalities.
        upper: (m,) greatest values, inf where free.
        names: description of each binding.
        starts: first row of each binding.
    """

    A: sp.csc_matrix
    lower: np.ndarray
    upper: np.ndarray
    names: tuple[str, ...]
    starts: np.ndarray

    def name(self, row: int) -> str:
        """Description of the binding that this row belongs to."""
        return self.names[int(np.searchsorted(self.starts, row, side="right")) - 1]

    def worst(self, x: np.ndarray) -> tuple[float, str]:
        """The greatest violation at x and the binding that has it; (0, "") where there are no rows."""
        if not len(self.lower):
            return 0.0, ""
        y = self.A @ x
        excess = np.maximum(self.lower - y, y - self.upper)
        row = int(np.argmax(excess))
        return float(max(excess[row], 0.0)), self.name(row)

    def non_finite(self) -> str:
        """Description of the first binding that holds a NaN or an infinite coefficient, "" where all is well."""
        bad = np.isnan(self.lower) | np.isnan(self.upper)
        bad[self.A.indices[~np.isfinite(self.A.data)]] = True
        return self.name(int(np.argmax(bad))) or "unnamed" if bad.any() else ""


@dataclass(frozen=True, eq=False)
class QuadraticProgram:
    """min 1/2 x'Px + q'x + c  s.t.  equalities, inequalities and lower <= x <= upper.

    Attributes:
        P: (n, n) upper triangle of the sparse symmetric Hessian.
        q: (n,) linear cost.
        constant: c.
        equalities: stacked linear equality constraints.
        inequalities: stacked linear inequality constraints.
        lower: (n,) least value of each variable, -inf where free.
        upper: (n,) greatest value of each variable, inf where free.
    """

    P: sp.csc_matrix
    q: np.ndarray
    constant: float
    equalities: LinearRows
    inequalities: LinearRows
    lower: np.ndarray
    upper: np.ndarray

    def cost(self, x: np.ndarray) -> float:
        """Value of the objective at x."""
        quadratic = x @ (self.P @ x) - 0.5 * (self.P.diagonal() @ x**2)
        return float(quadratic + self.q @ x + self.constant)

    def worst(self, x: np.ndarray) -> tuple[float, str]:
        """The greatest violation at x and the name of the constraint that has it ("" where there is none)."""
        bound = float(np.max(np.maximum(self.lower - x, x - self.upper), initial=0.0))
        worst, name = max(self.equalities.worst(x), self.inequalities.worst(x), (bound, "bounds"))
        return worst, name if worst > 0 else ""

    def non_finite(self) -> str:
        """Name of the first term that holds a NaN, or an infinity where none is allowed; "" where all is well."""
        if not (np.isfinite(self.P.data).all() and np.isfinite(self.q).all() and np.isfinite(self.constant)):
            return "cost"
        if np.isnan(self.lower).any() or np.isnan(self.upper).any():
            return "bounds"
        return self.equalities.non_finite() or self.inequalities.non_finite()


class ProgramReader:
    """Reads a MathematicalProgram into a `QuadraticProgram`, and again after coefficients or bounds were updated.

    Which variables each binding touches is looked up once: between two reads no cost, constraint or variable may be
    added or removed.
    """

    def __init__(self, prog: MathematicalProgram) -> None:
        if not is_quadratic(prog):
            raise ValueError("the program has terms that are neither linear nor quadratic")
        self._n = prog.num_vars()

        def placed(bindings: list) -> list[tuple[Any, np.ndarray]]:
            """Each binding's evaluator with the places of its variables."""
            return [(b.evaluator(), np.array(prog.FindDecisionVariableIndices(b.variables()), int)) for b in bindings]

        self._quadratic, self._linear = placed(prog.quadratic_costs()), placed(prog.linear_costs())
        self._bounds = placed(prog.bounding_box_constraints())
        self._equalities = _RowReader(placed(prog.linear_equality_constraints()), self._n)
        self._inequalities = _RowReader(placed(prog.linear_constraints()), self._n)
        self._costs: tuple[sp.csc_matrix, np.ndarray, float] | None = None

    def read(self, *, costs: bool = True) -> QuadraticProgram:
        """The program's present numbers; those of the costs from the last read where `costs` is False."""
        if costs or self._costs is None:
            self._costs = self._read_costs()
        lower, upper = np.full(self._n, -np.inf), np.full(self._n, np.inf)
        with np.errstate(invalid="ignore"):  # a NaN passes through, for `non_finite` to find
            for evaluator, index in self._bounds:
                np.maximum.at(lower, index, evaluator.lower_bound())
                np.minimum.at(upper, index, evaluator.upper_bound())
        return QuadraticProgram(*self._costs, self._equalities.read(), self._inequalities.read(), lower, upper)

    def _read_costs(self) -> tuple[sp.csc_matrix, np.ndarray, float]:
        q, constant = np.zeros(self._n), 0.0
        rows, cols, values = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
        for evaluator, index in self._quadratic:
            Q = evaluator.Q()
            i, j = np.nonzero(Q)
            rows.append(index[i])
            cols.append(index[j])
            values.append(Q[i, j])
            np.add.at(q, index, evaluator.b())
            constant += evaluator.c()
        for evaluator, index in self._linear:
            np.add.at(q, index, evaluator.a())
            constant += evaluator.b()
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols)))
        P = sp.csc_matrix(sp.triu(sp.coo_matrix(entries, shape=(self._n, self._n)), format="csc"))
        P.sum_duplicates()
        return P, q, float(constant)


class _RowReader:
    """Stacks the rows of linear constraints; sorts their entries once, as long as their sparsity stays."""

    def __init__(self, bindings: list[tuple[Any, np.ndarray]], num_vars: int) -> None:
        self._bindings, self._num_vars = bindings, num_vars
        self._pattern: RowPattern | None = None
        self._seen: tuple[np.ndarray, np.ndarray] | None = None

    def read(self) -> LinearRows:
        blocks = [evaluator.get_sparse_A() for evaluator, _ in self._bindings]
        counts = np.array([block.shape[0] for block in blocks], int)
        starts = np.concatenate([np.zeros(1, int), np.cumsum(counts)])
        indices = np.concatenate([np.zeros(0, int), *(block.indices for block in blocks)])
        indptr = np.concatenate([np.zeros(0, int), *(block.indptr for block in blocks)])
        if self._pattern is None or self._seen is None or not all(map(np.array_equal, self._seen, (indices, indptr))):
            rows = np.concatenate([np.zeros(0, int), *(b.indices + s for b, s in zip(blocks, starts, strict=False))])
            cols = [np.repeat(i, np.diff(b.indptr)) for b, (_, i) in zip(blocks, self._bindings, strict=True)]
            cols = np.concatenate([np.zeros(0, int), *cols])
            shape = (int(starts[-1]), self._num_vars)
            self._pattern = RowPattern.of(rows, cols, shape, np.arange(self._num_vars))
            self._seen = indices, indptr
        values = np.concatenate([np.zeros(0), *(block.data for block in blocks)])
        lower, upper = (
            np.concatenate([np.zeros(0), *(getattr(evaluator, side)() for evaluator, _ in self._bindings)])
            for side in ("lower_bound", "upper_bound")
        )
        names = tuple(evaluator.get_description() for evaluator, _ in self._bindings)
        return LinearRows(self._pattern.matrix(values), lower, upper, names, starts[:-1])
