"""The one file that chooses solvers.

Data is checked before a solver sees it (SNOPT and CLP call a NaN cost a success), time limits and one thread are set,
what was run is recorded, and the answer is checked against the program's own constraints: a solver's word is recorded,
never believed.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from pydrake.solvers import Binding, ClarabelSolver, CommonSolverOption, MathematicalProgram, SolverOptions

from optimization.convex import piqp_adapter
from optimization.convex.quadratic_program import ProgramReader, QuadraticProgram, is_quadratic
from optimization.convex.updatable_program import UpdatableProgram
from scenes.input_error import InputError

LEAST_COST = 1e-2  # a relative gap says nothing of costs near zero
SOLVERS = ("auto", "piqp", "clarabel")


@dataclass(frozen=True)
class SolverSettings:
    """How a convex program is to be solved.

    Attributes:
        solver: "auto" (PIQP where it is installed and the program is a quadratic one, else Clarabel), or by name.
        tolerance: accuracy of constraints and stationarity asked of the solver, in the program's own units.
        gap: relative accuracy of the cost asked of the solver; of costs below 0.01 as if they were 0.01.
        time_limit: seconds after which the solver should give up.
        max_iterations: of the interior-point method.
        accept: greatest violation of any constraint at which an answer counts as feasible.
    """

    solver: str = "auto"
    tolerance: float = 1e-8
    gap: float = 1e-8
    time_limit: float = 30.0
    max_iterations: int = 100
    accept: float = 1e-6

    def __post_init__(self) -> None:
        if self.solver not in SOLVERS:
            raise InputError(f"solver {self.solver!r} is none of {', '.join(SOLVERS)}")


@dataclass(frozen=True)
class SolveRecord:
    """What was run and what it gave.

    Attributes:
        solver: name of the solver.
        status: its own word for how it ended.
        feasible: whether the answer satisfies the program's constraints, by our own check.
        worst: greatest violation of a constraint, in the program's units; inf where there is no finite answer.
        worst_constraint: name of the constraint that has it.
        iterations: of the solver, or -1 where it does not say.
        time: seconds in the solver, checks included.
        cost: the program's objective at the answer, NaN where there is none.
    """

    solver: str
    status: str
    feasible: bool
    worst: float
    worst_constraint: str
    iterations: int
    time: float
    cost: float


class ConvexSolver:
    """Solves one convex MathematicalProgram, again and again as its coefficients change.

    Quadratic programs go to PIQP or Clarabel, second-order cone programs to Clarabel. Where PIQP finds no answer that
    holds, Clarabel is asked too: PIQP's "infeasible" has been seen to be wrong. Between two solves no cost,
    constraint or variable may be added to the program.
    """

    def __init__(self, prog: MathematicalProgram | UpdatableProgram, settings: SolverSettings | None = None) -> None:
        self._host = prog
        self.settings = settings or SolverSettings()
        quadratic = is_quadratic(self.prog)
        self.name = self._choose(quadratic)
        self._reader = None
        if quadratic:
            self._reader = prog if isinstance(prog, UpdatableProgram) else ProgramReader(prog)
        self._num_vars = self.prog.num_vars()
        self._piqp = None
        if self.name == "piqp":
            limits = self.settings
            self._piqp = piqp_adapter.PiqpSolver(limits.tolerance, limits.gap, LEAST_COST, limits.max_iterations)

    @property
    def prog(self) -> MathematicalProgram:
        """Drake's program with the present numbers."""
        return self._host.current() if isinstance(self._host, UpdatableProgram) else self._host

    def _choose(self, quadratic: bool) -> str:
        asked = self.settings.solver
        if asked == "auto":
            return "piqp" if quadratic and piqp_adapter.available() else "clarabel"
        if asked == "piqp" and not piqp_adapter.available():
            raise InputError("solver 'piqp' is not installed: install the extra 'fast', or choose 'clarabel'")
        if asked == "piqp" and not quadratic:
            raise InputError("solver 'piqp' takes linear and quadratic terms only: choose 'clarabel' or a linear cone")
        return asked

    def solve(self, *, costs_changed: bool = True, time_limit: float = np.inf) -> tuple[np.ndarray | None, SolveRecord]:
        """The (n,) answer, None where it is not finite, and the record of how it came about.

        Args:
            costs_changed: False where the costs are those of the last solve: saves reading them.
            time_limit: seconds after which to give up, where that is less than the settings'. PIQP knows no limit.

        Raises:
            InputError: the program's data holds a NaN or an infinity.
        """
        started = time.perf_counter()
        program = self._reader.read(costs=costs_changed) if self._reader is not None else None
        bad = program.non_finite() if program is not None else _non_finite(self.prog)
        if bad:
            raise InputError(f"optimisation: the data of {bad!r} is not finite")
        if self._piqp is not None and program is not None:
            answer = self._piqp.solve(program)
            x, record = self._judge("piqp", answer, program, started)
            if record.feasible:
                return x, record
        name = "clarabel" if self._piqp is None else "clarabel after piqp"
        return self._judge(name, self._clarabel(time_limit), program, started)

    def _judge(
        self, name: str, answer: tuple[str, np.ndarray, int], program: QuadraticProgram | None, started: float
    ) -> tuple[np.ndarray | None, SolveRecord]:
        """The answer with its record, after our own check of the constraints."""
        status, x, iterations = answer
        worst, constraint, cost = np.inf, "", np.nan
        finite = x.size == self._num_vars and bool(np.isfinite(x).all())
        if finite:
            worst, constraint = program.worst(x) if program is not None else worst_violation(self.prog, x)
            cost = program.cost(x) if program is not None else _cost(self.prog, x)
        elapsed = time.perf_counter() - started
        feasible = worst <= self.settings.accept
        record = SolveRecord(name, status, feasible, worst, constraint, iterations, elapsed, cost)
        return (x if finite else None), record

    def _clarabel(self, time_limit: float) -> tuple[str, np.ndarray, int]:
        options = SolverOptions()
        options.SetOption(CommonSolverOption.kMaxThreads, 1)
        solver = ClarabelSolver()
        options.SetOption(solver.solver_id(), "tol_feas", self.settings.tolerance)
        options.SetOption(solver.solver_id(), "tol_gap_rel", self.settings.gap)
        options.SetOption(solver.solver_id(), "tol_gap_abs", self.settings.gap * LEAST_COST)
        options.SetOption(solver.solver_id(), "time_limit", min(time_limit, self.settings.time_limit))
        options.SetOption(solver.solver_id(), "max_iter", self.settings.max_iterations)
        result = solver.Solve(self.prog, None, options)
        details = result.get_solver_details()
        return (str(details.status), np.asarray(result.get_x_val()), int(getattr(details, "iterations", -1)))


def worst_violation(prog: MathematicalProgram, x: np.ndarray) -> tuple[float, str]:
    """The greatest violation of any constraint of any program at x, and that constraint's name.

    Cone constraints are measured by the distance that their scalar part lacks.

    Args:
        prog: the program.
        x: (n,) values of its variables.
    """
    worst, name = 0.0, ""
    for binding in prog.GetAllConstraints():
        evaluator = binding.evaluator()
        excess = _excess(prog, binding, x)
        if not excess <= worst:  # so that NaN counts as a violation
            worst, name = ((excess if np.isfinite(excess) else np.inf), evaluator.get_description())
    return worst, name


def _cost(prog: MathematicalProgram, x: np.ndarray) -> float:
    return float(sum(prog.EvalBinding(binding, x).item() for binding in prog.GetAllCosts()))


def _excess(prog: MathematicalProgram, binding: Binding, x: np.ndarray) -> float:
    evaluator = binding.evaluator()
    if type(evaluator).__name__ == "LorentzConeConstraint":
        z = evaluator.A() @ x[prog.FindDecisionVariableIndices(binding.variables())] + evaluator.b()
        return float(max(np.linalg.norm(z[1:]) - z[0], 0.0))
    y = prog.EvalBinding(binding, x)
    return float(np.max(np.maximum(evaluator.lower_bound() - y, y - evaluator.upper_bound()), initial=0.0))


def _non_finite(prog: MathematicalProgram) -> str:
    """Name of the first cost or constraint of a cone program whose data is not finite, "" where all is well."""
    for binding in (*prog.GetAllCosts(), *prog.GetAllConstraints()):
        evaluator = binding.evaluator()
        parts = [getattr(evaluator, part)() for part in ("Q", "a", "b", "c") if hasattr(evaluator, part)]
        if hasattr(evaluator, "get_sparse_A"):
            parts.append(evaluator.get_sparse_A().data)
        elif hasattr(evaluator, "A_dense"):
            parts.append(evaluator.A_dense())
        if any(not np.isfinite(part).all() for part in parts):
            return evaluator.get_description() or type(evaluator).__name__
        if hasattr(evaluator, "lower_bound") and (
            np.isnan(evaluator.lower_bound()).any() or np.isnan(evaluator.upper_bound()).any()
        ):
            return evaluator.get_description() or type(evaluator).__name__
    return ""
