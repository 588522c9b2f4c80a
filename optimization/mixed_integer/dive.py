"""A first answer to a mixed-integer program by diving: solve the convex relaxation, fix a binary, solve again.

Big-M relaxations say little, but a conic interior point solves them in a fraction of a second, and contacts chosen one
after the other in the light of those already fixed are usually feasible. SCIP starts from the answer: on programs with
momentum dynamics its own linear relaxations take a minute before the first one. Where the program has an easier one
(the contacts without their dynamics), the binaries of that one's dive are tried first.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from optimization.mixed_integer.data import INTEGRAL, MixedIntegerData, build_program

MAX_BACKTRACKS = 30
DIVE_SHARE = 0.5  # of the time limit that solvers give to a dive
NEARLY = 0.99  # a binary this near to 1 is fixed without being asked


def dive(data: MixedIntegerData, time_limit: float, accept: float = 1e-6) -> np.ndarray | None:
    """(n,) an answer whose binaries are whole and which violates nothing by more than `accept`, None where none is found.

    Args:
        data: the program.
        time_limit: seconds after which it gives up.
        accept: greatest violation of a row or cone, in its unit.
    """
    from pydrake.solvers import ClarabelSolver, CommonSolverOption, SolverOptions

    began = time.perf_counter()
    if data.easier is not None:
        guess = dive(data.easier, 0.5 * time_limit, accept)
        if guess is not None:
            padded = np.concatenate([guess, np.zeros(data.size - data.easier.size)])
            answer = _exact(data, padded, accept)
            if answer is not None:
                return answer
    prog, x = build_program(replace(data, binary=np.zeros(data.size, bool)))
    bounds = prog.bounding_box_constraints()[0].evaluator()
    solver, options = ClarabelSolver(), SolverOptions()
    options.SetOption(CommonSolverOption.kMaxThreads, 1)
    lower, upper = data.lower.copy(), data.upper.copy()
    trail: list[tuple[np.ndarray, np.ndarray, int]] = []  # bounds before a binary was fixed, and which one
    backtracks = 0
    while (left := time_limit - (time.perf_counter() - began)) > 0:
        options.SetOption(solver.solver_id(), "time_limit", left)
        bounds.set_bounds(lower, upper)
        result = solver.Solve(prog, None, options)
        if not result.is_success():
            backtracks += 1
            if not trail or backtracks > MAX_BACKTRACKS:
                return None
            lower, upper, last = trail.pop()
            upper[last] = 0.0  # what was fixed before it stays: something else is tried from there
            continue
        answer = np.asarray(result.GetSolution(x), float)
        whole = np.where(data.binary, np.round(answer), answer)
        loose = data.binary & (lower < upper)
        if not loose.any() or np.abs(answer - whole)[data.binary].max() < INTEGRAL:
            return whole if data.worst(whole)[0] <= accept else _exact(data, whole, accept)
        rest = np.flatnonzero(loose & (answer <= NEARLY))
        chosen = int(rest[np.argmax(answer[rest])]) if len(rest) else int(np.flatnonzero(loose)[0])
        trail.append((lower.copy(), upper.copy(), chosen))
        lower[loose & (answer > NEARLY)] = 1.0
        lower[chosen] = 1.0
    return None


def _exact(data: MixedIntegerData, x: np.ndarray, accept: float) -> np.ndarray | None:
    """The continuous part solved again with these binaries; None where that does not hold either."""
    from pydrake.solvers import ClarabelSolver

    prog, variables = build_program(data.with_binaries(x))
    answer = np.asarray(ClarabelSolver().Solve(prog).GetSolution(variables), float)
    answer = np.where(data.binary, np.round(x), answer)
    return answer if data.worst(answer)[0] <= accept else None
