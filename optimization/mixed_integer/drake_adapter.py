"""Drake's own ways to solve a mixed-integer program: Gurobi and Mosek where licensed, else its branch and bound.

Each is called like `scip_adapter.solve`, in the worker process: Drake's branch and bound knows no time limit, and a
licence can fail after `enabled()` said it was there.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

import time
from typing import Any

import numpy as np

from optimization.mixed_integer.data import MixedIntegerData, build_program
from optimization.mixed_integer.dive import DIVE_SHARE, dive
from optimization.mixed_integer.scip_adapter import Tell

FIRST_NODES = 32  # explored by the first round of branch and bound; every further round explores four times as many
GROWTH = 4


def gurobi(data: MixedIntegerData, time_limit: float, gap: float, first_only: bool, tell: Tell) -> str:
    """Gurobi through Drake; incumbents come from its callback.

    Args:
        data: the program.
        time_limit: [s].
        gap: relative gap at which to stop [-].
        first_only: whether the first incumbent ends it.
        tell: called with cost, bound and values (None where unknown) of incumbents.
    """
    from pydrake.solvers import GurobiSolver, SolverOptions

    solver, options = GurobiSolver(), SolverOptions()
    for key, value in (("TimeLimit", float(time_limit)), ("MIPGap", float(gap))):
        options.SetOption(solver.solver_id(), key, value)
    options.SetOption(solver.solver_id(), "Threads", 1)
    if first_only:
        options.SetOption(solver.solver_id(), "SolutionLimit", 1)
    prog, x = build_program(data)

    def on_solution(program: Any, status: Any) -> None:
        tell(float(status.current_objective), float(status.best_bound), None)

    solver.AddMipSolCallback(callback=on_solution)
    return _answer(solver.Solve(prog, None, options), x, data, tell)


def mosek(data: MixedIntegerData, time_limit: float, gap: float, first_only: bool, tell: Tell) -> str:
    """Mosek through Drake, which has no callbacks: the incumbent comes at the end.

    Args:
        data: the program.
        time_limit: [s].
        gap: relative gap at which to stop [-].
        first_only: whether the first incumbent ends it.
        tell: called with cost, bound and values (None where unknown) of incumbents.
    """
    from pydrake.solvers import MosekSolver, SolverOptions

    solver, options = MosekSolver(), SolverOptions()
    for key, value in (("MSK_DPAR_MIO_MAX_TIME", float(time_limit)), ("MSK_DPAR_MIO_TOL_REL_GAP", float(gap))):
        options.SetOption(solver.solver_id(), key, value)
    options.SetOption(solver.solver_id(), "MSK_IPAR_NUM_THREADS", 1)
    if first_only:
        options.SetOption(solver.solver_id(), "MSK_IPAR_MIO_MAX_NUM_SOLUTIONS", 1)
    prog, x = build_program(data)
    return _answer(solver.Solve(prog, None, options), x, data, tell)


def branch_and_bound(data: MixedIntegerData, time_limit: float, gap: float, first_only: bool, tell: Tell) -> str:
    """Drake's MixedIntegerBranchAndBound over Clarabel (its gap is fixed at 1 %).

    It can stop after a number of nodes, not after a time, and tells of nothing on the way. So it starts again with
    four times the nodes until it is done: at most a third more work, and every round's incumbent is known.

    Args:
        data: the program.
        time_limit: [s].
        gap: not used: the solver has its own.
        first_only: whether the first incumbent ends it.
        tell: called with cost, bound and values (None where unknown) of incumbents.
    """
    from pydrake.solvers import ClarabelSolver, MixedIntegerBranchAndBound, SolutionResult

    began, nodes = time.perf_counter(), FIRST_NODES
    start = dive(data, DIVE_SHARE * time_limit)
    best = np.inf
    if start is not None:
        best = data.cost(start)
        tell(best, -np.inf, start)
        if first_only:
            return "first"
    prog, x = build_program(data)
    while True:
        options = MixedIntegerBranchAndBound.Options()
        options.max_explored_nodes = nodes
        search = MixedIntegerBranchAndBound(prog, ClarabelSolver().solver_id(), options)
        result = search.Solve()
        found = _best(search, x)
        done = result in (SolutionResult.kSolutionFound, SolutionResult.kInfeasibleConstraints)
        if result == SolutionResult.kInfeasibleConstraints:
            return "infeasible"
        if found is not None and (found[0] < best or done):
            best = found[0]
            tell(best, best if done else -np.inf, found[1])
        if done and found is not None:
            return "optimal"
        if first_only and found is not None:
            return "first"
        if time.perf_counter() - began > time_limit:
            return "time limit"
        nodes *= GROWTH


def _best(search: Any, x: np.ndarray) -> tuple[float, np.ndarray] | None:
    try:
        return float(search.GetOptimalCost()), np.asarray(search.GetSolution(x), float)
    except (RuntimeError, ValueError):
        return None  # no integral solution so far


def _answer(result: Any, x: np.ndarray, data: MixedIntegerData, tell: Tell) -> str:
    answer = np.asarray(result.GetSolution(x), float)
    if np.isfinite(answer).all():
        details = result.get_solver_details()
        bound = float(getattr(details, "objective_bound", np.nan))
        cost = data.cost(answer)
        tell(cost, bound if np.isfinite(bound) else (cost if result.is_success() else -np.inf), answer)
    return "optimal" if result.is_success() else str(result.get_solution_result()).rpartition(".")[2]
