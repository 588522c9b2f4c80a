"""A MathematicalProgram of linear rows, bounds and diagonal costs whose numbers change and whose places do not.

Quadratic programs are solved again and again here with new numbers. Writing them through Drake and reading them back
costs as much as solving them, so the numbers are kept twice: in stacked sparse arrays that a solver takes as they are,
and in Drake's program, which is brought up to date when somebody asks for it.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from pydrake.solvers import (
    BoundingBoxConstraint,
    LinearConstraint,
    LinearEqualityConstraint,
    LorentzConeConstraint,
    MathematicalProgram,
    QuadraticCost,
)

from optimization.convex.quadratic_program import LinearRows, QuadraticProgram
from optimization.convex.sparse_rows import RowPattern, SparseRows

Rows = tuple[SparseRows, np.ndarray | None, np.ndarray]  # rows, lower (None: equality) and upper


@dataclass(eq=False)
class _RowBlock:
    """Linear rows lower <= A x <= upper, an equality where `lower` is None."""

    name: str
    constraint: LinearConstraint
    pattern: RowPattern
    rows: SparseRows
    lower: np.ndarray | None
    upper: np.ndarray
    stale: bool = False  # Drake's constraint holds older numbers


@dataclass(eq=False)
class _BoundBlock:
    constraint: BoundingBoxConstraint
    index: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    stale: bool = False


class _Stack:
    """The rows of several blocks in one compressed matrix, its places sorted once."""

    def __init__(self, blocks: list[_RowBlock], num_vars: int) -> None:
        self.blocks = blocks
        counts = [len(block.upper) for block in blocks]
        self.starts = np.concatenate([np.zeros(1, int), np.cumsum(counts, dtype=int)])
        parts = [block.rows.places for block in blocks]
        rows = np.concatenate([np.zeros(0, int), *(p[0] + s for p, s in zip(parts, self.starts, strict=False))])
        cols = np.concatenate([np.zeros(0, int), *(p[1] for p in parts)])
        shape = (int(self.starts[-1]), num_vars)
        self.pattern = RowPattern.of(rows, cols, shape, np.arange(num_vars))
        self.matrix = self.pattern.matrix(np.zeros(len(rows)))
        self.names = tuple(block.name for block in blocks)

    def read(self) -> LinearRows:
        values = np.concatenate([np.zeros(0), *(block.rows.values for block in self.blocks)])
        upper = np.concatenate([np.zeros(0), *(block.upper for block in self.blocks)])
        low = (block.upper if block.lower is None else block.lower for block in self.blocks)
        lower = np.concatenate([np.zeros(0), *low])
        self.matrix.data = values[self.pattern.order]  # a new matrix would have its places checked again
        return LinearRows(self.matrix, lower, upper, self.names, self.starts[:-1])


class UpdatableProgram:
    """Holds the program; rows and bounds are added by name and given new numbers by the same name.

    Lorentz cones may be added too (`add_cones`); the program is then no quadratic one and `read` has no meaning.

    Attributes:
        num_vars: number of decision variables.
    """

    def __init__(self) -> None:
        self._prog = MathematicalProgram()
        self._rows: dict[str, _RowBlock] = {}
        self._bounds: dict[str, _BoundBlock] = {}
        self._cones: dict[str, list[LorentzConeConstraint]] = {}
        self._costs: list[tuple[QuadraticCost, np.ndarray]] = []
        self._linear = np.zeros(0)
        self._stacks: tuple[_Stack, _Stack] | None = None
        self._cost_read: tuple[sp.csc_matrix, np.ndarray, float] | None = None
        self._costs_stale = False
        self._diagonal = self._target = np.zeros(0)
        self._watched = False
        self._known = np.zeros(0, object)
        self.num_vars = 0

    @property
    def prog(self) -> MathematicalProgram:
        """Drake's program; from now on new numbers reach it at once. Anybody may add costs and constraints to it."""
        self._watched = True
        return self.current()

    def current(self) -> MathematicalProgram:
        """Drake's program with the present numbers, for a look: later ones reach it with the next look."""
        for block in self._rows.values():
            if block.stale:
                A = block.pattern.matrix(block.rows.values)
                bounds = (block.upper,) if block.lower is None else (block.lower, block.upper)
                block.constraint.UpdateCoefficients(A, *bounds)
                block.stale = False
        for bound in self._bounds.values():
            if bound.stale:
                bound.constraint.set_bounds(bound.lower, bound.upper)
                bound.stale = False
        if self._costs_stale:
            for cost, index in self._costs:
                cost.UpdateCoefficients(*self._dense_cost(index))
            self._costs_stale = False
        return self._prog

    @property
    def num_cones(self) -> int:
        """Lorentz cones that were added here."""
        return sum(map(len, self._cones.values()))

    def is_own(self) -> bool:
        """Whether nothing was added to `prog` from outside, so that `read` tells the whole program."""
        prog = self._prog
        own = len(self._rows) + len(self._bounds) + self.num_cones
        costs = len(self._costs) + int(bool(self._linear.any()))
        return len(prog.GetAllConstraints()) == own and len(prog.GetAllCosts()) == costs

    def _variables(self) -> np.ndarray:
        """Drake's variables; asking for them takes as long as solving a small program."""
        if len(self._known) != self.num_vars:
            self._known = np.asarray(self._prog.decision_variables())
        return self._known

    def add_variables(self, name: str, count: int, width: int) -> tuple[np.ndarray, np.ndarray]:
        """(count, width) new variables and their places.

        Args:
            name: of the variables.
            count, width: number of rows and columns.
        """
        size = count * width
        index = self.num_vars + np.arange(size).reshape(count, width)
        self.num_vars += size
        return self._prog.NewContinuousVariables(size, name).reshape(count, width), index

    def add_rows(self, name: str, rows: SparseRows, lower: np.ndarray | None, upper: np.ndarray) -> None:
        """Adds lower <= rows x <= upper, an equality where `lower` is None.

        Args:
            name: of the block.
            rows: coefficients of R rows.
            lower: (R,) bounds.
            upper: (R,) bounds.
        """
        pattern = rows.pattern(len(upper), self.num_vars)
        A = pattern.matrix(rows.values)
        constraint = LinearEqualityConstraint(A, upper) if lower is None else LinearConstraint(A, lower, upper)
        constraint.set_description(name)
        self._prog.AddConstraint(constraint, self._variables()[pattern.columns])
        self._rows[name] = _RowBlock(name, constraint, pattern, rows, lower, upper)

    def update_rows(self, name: str, rows: SparseRows, lower: np.ndarray | None, upper: np.ndarray) -> None:
        """Gives a block of rows new numbers at the places that it has.

        Args:
            name: of the block.
            rows: coefficients of R rows.
            lower: (R,) bounds, None for equality.
            upper: (R,) bounds.
        """
        block = self._rows[name]
        block.rows, block.lower, block.upper, block.stale = rows, lower, upper, True
        self._pass_on()

    def add_bounds(self, name: str, index: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
        """Adds lower <= x[index] <= upper; all of one shape, or bounds that broadcast.

        Args:
            name: of the block.
            index: places of the variables.
            lower, upper: bounds.
        """
        lower, upper = (np.broadcast_to(bound, index.shape).ravel() for bound in (lower, upper))
        variables = self._variables()[index.ravel()]
        constraint = self._prog.AddBoundingBoxConstraint(lower, upper, variables).evaluator()
        constraint.set_description(name)
        self._bounds[name] = _BoundBlock(constraint, index.ravel(), lower, upper)

    def update_bounds(self, name: str, lower: np.ndarray, upper: np.ndarray) -> None:
        """Gives a block of bounds new numbers.

        Args:
            name: of the block.
            lower, upper: bounds, as many as the block has variables.
        """
        block = self._bounds[name]
        block.lower, block.upper = (np.broadcast_to(bound.ravel(), block.index.shape) for bound in (lower, upper))
        block.stale = True
        self._pass_on()

    def add_cones(self, name: str, A: np.ndarray, index: np.ndarray) -> None:
        """Adds A[j] x[index[j]] in the second-order cone: (J, m, n) and (J, n).

        Args:
            name: of the block.
            A: (J, m, n) matrices; the first row is the cone's scalar part.
            index: (J, n) places of the variables.
        """
        self._cones[name] = []
        for matrix, places in zip(A, index, strict=True):
            cone = LorentzConeConstraint(matrix, np.zeros(len(matrix)))
            cone.set_description(name)
            self._prog.AddConstraint(cone, self._variables()[places])
            self._cones[name].append(cone)

    def update_cones(self, name: str, A: np.ndarray) -> None:
        """Gives cones new (J, m, n) matrices.

        Args:
            name: of the block.
            A: (J, m, n) matrices.
        """
        for cone, matrix in zip(self._cones[name], A, strict=True):
            cone.UpdateCoefficients(matrix, np.zeros(len(matrix)))

    def add_linear_cost(self, index: np.ndarray, price: float) -> None:
        """Adds price times the sum of x[index].

        Args:
            index: (k,) places of the variables.
            price: of each, per unit.
        """
        self._linear = np.zeros(self.num_vars)
        self._linear[index] = price
        variables = self._variables()[index]
        cost = self._prog.AddLinearCost(np.full(len(index), price), 0.0, variables)
        cost.evaluator().set_description("slack price")

    def add_diagonal_costs(
        self, diagonal: np.ndarray, target: np.ndarray, groups: list[tuple[str, np.ndarray]]
    ) -> None:
        """Adds sum diagonal (x - target)^2, one cost of Drake for each named group of places.

        Args:
            diagonal, target: (num_vars,) weights and targets.
            groups: name and places (k,) of each group.
        """
        self._diagonal, self._target = diagonal, target
        for name, index in groups:
            used = index[diagonal[index] > 0]
            variables = self._variables()[used]
            cost = self._prog.AddQuadraticCost(*self._dense_cost(used), variables, True).evaluator()
            cost.set_description(name)
            self._costs.append((cost, used))

    def update_diagonal_costs(self, diagonal: np.ndarray, target: np.ndarray) -> None:
        """New weights and targets; a weight that was zero stays zero.

        Args:
            diagonal, target: (num_vars,) weights and targets.
        """
        self._diagonal, self._target = diagonal, target
        self._costs_stale, self._cost_read = True, None
        self._pass_on()

    def _pass_on(self) -> None:
        if self._watched:
            self.current()

    def _dense_cost(self, index: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        w, goal = 2 * self._diagonal[index], self._target[index]
        return np.diag(w), -w * goal, 0.5 * float(w @ goal**2)

    def read(self, *, costs: bool = True) -> QuadraticProgram:
        """The present numbers as a solver takes them, until the next `read`: the matrices are the same objects.

        `costs` is there for `quadratic_program.ProgramReader`'s sake.
        """
        if self._stacks is None:
            blocks = self._rows.values()
            equal = [block for block in blocks if block.lower is None]
            unequal = [block for block in blocks if block.lower is not None]
            self._stacks = _Stack(equal, self.num_vars), _Stack(unequal, self.num_vars)
        if self._cost_read is None:
            self._cost_read = self._read_costs()
        lower, upper = np.full(self.num_vars, -np.inf), np.full(self.num_vars, np.inf)
        with np.errstate(invalid="ignore"):  # a NaN passes through, for `non_finite` to find
            for block in self._bounds.values():
                lower[block.index] = np.maximum(lower[block.index], block.lower)
                upper[block.index] = np.minimum(upper[block.index], block.upper)
        return QuadraticProgram(*self._cost_read, self._stacks[0].read(), self._stacks[1].read(), lower, upper)

    def _read_costs(self) -> tuple[sp.csc_matrix, np.ndarray, float]:
        used = np.concatenate([np.zeros(0, int), *(index for _, index in self._costs)])
        used.sort()
        w = 2 * self._diagonal[used]
        indptr = np.searchsorted(used, np.arange(self.num_vars + 1))
        P = sp.csc_matrix((w, used, indptr), shape=(self.num_vars, self.num_vars))
        q = np.zeros(self.num_vars)
        q[: len(self._linear)] = self._linear
        q[used] -= w * self._target[used]
        return P, q, 0.5 * float(w @ self._target[used] ** 2)
