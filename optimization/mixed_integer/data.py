"""The numbers of a mixed-binary convex MathematicalProgram, free of Drake: what other solvers and processes can take.

min   c'x + c0 + sum_k (1/2 x_k' Q_k x_k + b_k' x_k + d_k)
s.t.  lower <= x <= upper,  row_lower <= A x <= row_upper,  A_j x_j + b_j in a second-order cone,  x_i in {0, 1}
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

INTEGRAL = 1e-5  # a binary variable this far from 0 and 1 is neither


@dataclass(frozen=True, eq=False)
class QuadraticTerm:
    """1/2 x[index]' Q x[index] + b' x[index] + c, with Q positive semidefinite."""

    index: np.ndarray
    Q: np.ndarray
    b: np.ndarray
    c: float


@dataclass(frozen=True, eq=False)
class ConeTerm:
    """z = A x[index] + b with z0 >= |z1...| (or, rotated, z0 z1 >= |z2...|^2 and z0, z1 >= 0)."""

    index: np.ndarray
    A: np.ndarray
    b: np.ndarray
    rotated: bool
    name: str

    def lack(self, x: np.ndarray) -> float:
        """What the scalar part lacks; not positive where the cone holds."""
        z = self.A @ x[self.index] + self.b
        if not self.rotated:
            return float(np.linalg.norm(z[1:]) - z[0])
        # z0 z1 >= |w|^2 is |(2 w, z0 - z1)| <= z0 + z1
        return float(np.linalg.norm(np.append(2 * z[2:], z[0] - z[1])) - z[0] - z[1])


@dataclass(frozen=True, eq=False)
class MixedIntegerData:
    """A program as plain arrays.

    Attributes:
        lower, upper: (n,) bounds of the variables.
        binary: (n,) bool.
        A: (m, n) sparse rows, with row_lower and row_upper (m,), and row_name (m,) for messages.
        linear: (n,) cost, with the constant.
        quadratics: convex quadratic costs.
        cones: second-order cones.
        easier: a program on the first of these variables with all of the binaries, whose answer is tried first.
    """

    lower: np.ndarray
    upper: np.ndarray
    binary: np.ndarray
    A: sp.csr_matrix
    row_lower: np.ndarray
    row_upper: np.ndarray
    row_name: tuple[str, ...]
    linear: np.ndarray
    constant: float
    quadratics: tuple[QuadraticTerm, ...]
    cones: tuple[ConeTerm, ...]
    easier: MixedIntegerData | None = None

    @property
    def size(self) -> int:
        """Number of variables."""
        return len(self.lower)

    def cost(self, x: np.ndarray) -> float:
        """Value of the objective at x (n,)."""
        total = float(self.linear @ x) + self.constant
        for q in self.quadratics:
            y = x[q.index]
            total += float(0.5 * y @ q.Q @ y + q.b @ y) + q.c
        return total

    def worst(self, x: np.ndarray) -> tuple[float, str]:
        """The greatest violation at x (n,) and the name of what it violates; binaries count by their distance to 0 or 1."""
        if x.shape != (self.size,) or not np.isfinite(x).all():
            return np.inf, "the answer is not finite"
        worst, name = float(np.max(np.maximum(self.lower - x, x - self.upper), initial=0.0)), "bounds"
        y = self.A @ x
        excess = np.maximum(self.row_lower - y, y - self.row_upper)
        if len(excess) and excess.max() > worst:
            worst, name = float(excess.max()), self.row_name[int(excess.argmax())]
        for cone in self.cones:
            lack = cone.lack(x)
            if lack > worst:
                worst, name = lack, cone.name
        whole = float(np.max(np.abs(x - np.round(x))[self.binary], initial=0.0))
        return (whole, "binary variables") if whole > worst else (worst, name)

    def non_finite(self) -> str:
        """Name of the first term that holds a NaN, or an infinity where none is allowed; "" where all is well."""
        if np.isnan(self.lower).any() or np.isnan(self.upper).any():
            return "bounds"
        bad = np.isnan(self.row_lower) | np.isnan(self.row_upper)
        bad |= ~np.isfinite(np.asarray(abs(self.A).sum(axis=1)).ravel())
        if bad.any():
            return self.row_name[int(np.argmax(bad))] or "a linear constraint"
        for cone in self.cones:
            if not (np.isfinite(cone.A).all() and np.isfinite(cone.b).all()):
                return cone.name or "a second-order cone"
        costs = [self.linear, *(part for q in self.quadratics for part in (q.Q, q.b, np.array([q.c])))]
        return "cost" if not all(np.isfinite(c).all() for c in costs) or not np.isfinite(self.constant) else ""

    def with_binaries(self, x: np.ndarray) -> MixedIntegerData:
        """The continuous convex program that is left when every binary is fixed at its value in x, rounded."""
        whole = np.round(x)
        lower, upper = np.where(self.binary, whole, self.lower), np.where(self.binary, whole, self.upper)
        none = np.zeros(self.size, bool)
        return MixedIntegerData(
            lower,
            upper,
            none,
            self.A,
            self.row_lower,
            self.row_upper,
            self.row_name,
            self.linear,
            self.constant,
            self.quadratics,
            self.cones,
        )


def read_program(prog: object) -> MixedIntegerData:
    """The numbers of a MathematicalProgram with binaries, linear rows, convex quadratic costs and second-order cones.

    Args:
        prog: a `pydrake.solvers.MathematicalProgram`.

    Raises:
        ValueError: the program holds anything else.
    """
    from pydrake.symbolic import Variable

    known = (
        "LinearCost",
        "QuadraticCost",
        "LinearConstraint",
        "LinearEqualityConstraint",
        "LorentzConeConstraint",
        "BoundingBoxConstraint",
        "RotatedLorentzConeConstraint",
    )
    for binding in (*prog.GetAllCosts(), *prog.GetAllConstraints()):
        kind = type(binding.evaluator()).__name__
        if kind not in known:
            raise ValueError(f"a mixed-integer program may not hold a {kind}: {binding.evaluator().get_description()}")
    n, at = prog.num_vars(), prog.FindDecisionVariableIndices
    binary = np.array([v.get_type() == Variable.Type.BINARY for v in prog.decision_variables()], bool)
    lower, upper = np.where(binary, 0.0, -np.inf), np.where(binary, 1.0, np.inf)
    for binding in prog.bounding_box_constraints():
        index = np.asarray(at(binding.variables()))
        np.maximum.at(lower, index, binding.evaluator().lower_bound())
        np.minimum.at(upper, index, binding.evaluator().upper_bound())
    linear, constant = np.zeros(n), 0.0
    for binding in prog.linear_costs():
        np.add.at(linear, np.asarray(at(binding.variables())), binding.evaluator().a())
        constant += binding.evaluator().b()
    quadratics = []
    for binding in prog.quadratic_costs():
        e = binding.evaluator()
        quadratics.append(QuadraticTerm(np.asarray(at(binding.variables())), np.array(e.Q()), np.array(e.b()), e.c()))
    cones = [_cone(b, at, False) for b in prog.lorentz_cone_constraints()]
    cones += [_cone(b, at, True) for b in prog.rotated_lorentz_cone_constraints()]
    return MixedIntegerData(
        lower, upper, binary, *_rows(prog, n), linear, float(constant), tuple(quadratics), tuple(cones)
    )


def build_program(data: MixedIntegerData) -> tuple[Any, np.ndarray]:
    """A MathematicalProgram with these numbers, and its (n,) variables in the same order."""
    from pydrake.solvers import MathematicalProgram

    prog = MathematicalProgram()
    x = np.array(
        [prog.NewBinaryVariables(1)[0] if b else prog.NewContinuousVariables(1, "x")[0] for b in data.binary], object
    )
    prog.AddBoundingBoxConstraint(data.lower, data.upper, x)
    for k in range(len(data.row_lower)):
        row = slice(data.A.indptr[k], data.A.indptr[k + 1])
        prog.AddLinearConstraint(
            data.A.data[row][None], data.row_lower[k : k + 1], data.row_upper[k : k + 1], x[data.A.indices[row]]
        ).evaluator().set_description(data.row_name[k])
    prog.AddLinearCost(data.linear, data.constant, x)
    for q in data.quadratics:
        prog.AddQuadraticCost(q.Q, q.b, q.c, x[q.index], True)
    for cone in data.cones:
        add = prog.AddRotatedLorentzConeConstraint if cone.rotated else prog.AddLorentzConeConstraint
        add(cone.A, cone.b, x[cone.index]).evaluator().set_description(cone.name)
    return prog, x


def _rows(prog: Any, n: int) -> tuple[sp.csr_matrix, np.ndarray, np.ndarray, tuple[str, ...]]:
    entries: list[np.ndarray] = []
    columns: list[np.ndarray] = []
    counts, low, high, names = [0], [], [], []
    for binding in (*prog.linear_constraints(), *prog.linear_equality_constraints()):
        e, index = binding.evaluator(), np.asarray(prog.FindDecisionVariableIndices(binding.variables()))
        A = sp.csr_matrix(e.get_sparse_A())
        for k in range(len(e.lower_bound())):
            row = slice(A.indptr[k], A.indptr[k + 1])
            entries.append(A.data[row])
            columns.append(index[A.indices[row]])
            counts.append(counts[-1] + len(A.data[row]))
            low.append(e.lower_bound()[k])
            high.append(e.upper_bound()[k])
            names.append(e.get_description())
    data = np.concatenate(entries) if entries else np.zeros(0)
    indices = np.concatenate(columns) if columns else np.zeros(0, int)
    matrix = sp.csr_matrix((data, indices, counts), (len(low), n))
    matrix.sum_duplicates()
    return matrix, np.array(low), np.array(high), tuple(names)


def _cone(binding: Any, at: Any, rotated: bool) -> ConeTerm:
    e = binding.evaluator()
    A = e.A()
    dense = np.asarray(A.toarray() if sp.issparse(A) else A, float)
    return ConeTerm(np.asarray(at(binding.variables())), dense, np.asarray(e.b(), float), rotated, e.get_description())
