"""Mixed-integer second-order cone programs for SCIP, through pyscipopt (extra `mip`).

A convex quadratic cost 1/2 x'Qx becomes a bound t >= sum_k lambda_k y_k^2 / 2 over the eigenvectors y = V'x of Q, a
cone a sum of squares of new variables: the forms that SCIP recognises as convex and cuts well. SCIP starts from the
answer of a dive through the convex relaxation, where there is one.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from optimization.mixed_integer.data import ConeTerm, MixedIntegerData, QuadraticTerm
from optimization.mixed_integer.dive import DIVE_SHARE, dive

MISSING = "pyscipopt is not installed: install the extra 'mip' (pip install drakeplan[mip])"
SCIP_INFINITY = 1e20
Tell = Callable[[float, float, "np.ndarray | None"], None]  # cost of the incumbent, bound, (n,) answer where it is new


def available() -> bool:
    """Whether pyscipopt can be imported."""
    from importlib.util import find_spec

    return find_spec("pyscipopt") is not None


def solve(data: MixedIntegerData, time_limit: float, gap: float, first_only: bool, tell: Tell) -> str:
    """Runs SCIP on one thread; `tell` hears of every incumbent and of the bound as it rises.

    Args:
        data: the program.
        time_limit: seconds.
        gap: relative gap at which to stop.
        first_only: stop at the first feasible answer.
        tell: called with cost, bound and the new answer (None where only the bound is new).

    Returns:
        SCIP's own word for how it ended: "optimal", "gaplimit", "infeasible", "timelimit", "sollimit", ...

    Raises:
        ImportError: pyscipopt is missing.
    """
    try:
        import pyscipopt
    except ImportError as error:
        raise ImportError(MISSING) from error
    began = time.perf_counter()
    start = dive(data, DIVE_SHARE * time_limit)
    if start is not None:
        tell(data.cost(start), -np.inf, start)
        if first_only:
            return "first"
    model = pyscipopt.Model()
    model.hideOutput()
    build = _Build(model, pyscipopt.quicksum, _variables(model, data))
    _add_rows(model, build.x, data)
    x, quicksum = build.x, pyscipopt.quicksum
    objective = quicksum(float(data.linear[i]) * x[i] for i in np.flatnonzero(data.linear)) + data.constant
    for term in data.quadratics:
        objective += build.quadratic(term)
    for cone in data.cones:
        build.add_cone(cone)
    model.setObjective(objective)
    model.setParam("limits/time", max(float(time_limit) - (time.perf_counter() - began), 0.01))
    model.setParam("limits/gap", float(gap))
    model.setParam("parallel/maxnthreads", 1)
    if first_only:
        model.setParam("limits/solutions", 1)
    if start is not None:
        model.addSol(build.solution(start))
    model.includeEventhdlr(_watcher(pyscipopt, x, tell), "watcher", "tells of incumbents and bounds")
    model.optimize()
    if model.getNSols():
        best = np.array([model.getVal(v) for v in x])
        tell(_finite(model.getPrimalbound()), _finite(model.getDualbound()), best)
    return str(model.getStatus())


def _variables(model: Any, data: MixedIntegerData) -> list[Any]:
    def bound(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    return [
        model.addVar(lb=bound(low), ub=bound(high), vtype="B" if binary else "C")
        for low, high, binary in zip(data.lower, data.upper, data.binary, strict=True)
    ]


def _add_rows(model: Any, x: list[Any], data: MixedIntegerData) -> None:
    A = data.A
    for k, (low, high) in enumerate(zip(data.row_lower, data.row_upper, strict=True)):
        row = range(A.indptr[k], A.indptr[k + 1])
        if not len(row):
            if low > 1e-9 or high < -1e-9:  # 0 outside its bounds: no answer at all
                model.addCons(x[0] >= (x[0].getUbOriginal() or 0.0) + 1.0)
            continue
        expression = sum(float(A.data[j]) * x[A.indices[j]] for j in row)
        if low == high:
            model.addCons(expression == float(low))
            continue
        if np.isfinite(low):
            model.addCons(expression >= float(low))
        if np.isfinite(high):
            model.addCons(expression <= float(high))


class _Build:
    """Terms that need variables of their own, with what those variables are worth at a given answer."""

    def __init__(self, model: Any, quicksum: Any, x: list[Any]) -> None:
        self.model, self.quicksum, self.x = model, quicksum, x
        self._own: list[tuple[Any, Callable[[np.ndarray], float]]] = []

    def solution(self, answer: np.ndarray) -> Any:
        """SCIP's form of an answer (n,)."""
        solution = self.model.createSol()
        for variable, value in zip(self.x, answer, strict=True):
            self.model.setSolVal(solution, variable, float(value))
        for variable, value_of in self._own:
            self.model.setSolVal(solution, variable, value_of(answer))
        return solution

    def quadratic(self, term: QuadraticTerm) -> Any:
        """The cost of one quadratic term, with the variables and constraints that it needs."""
        model, quicksum = self.model, self.quicksum
        values, vectors = np.linalg.eigh(0.5 * (term.Q + term.Q.T))
        squares = []
        for value, vector in zip(values, vectors.T, strict=True):
            if value > 1e-9:
                y = model.addVar(lb=None, ub=None)
                parts = [(k, v) for k, v in enumerate(vector) if abs(v) > 1e-12]
                model.addCons(quicksum(float(v) * self.x[term.index[k]] for k, v in parts) == y)
                self._own.append((y, lambda a, v=vector: float(v @ a[term.index])))
                squares.append(0.5 * float(value) * y * y)
        cost = quicksum(float(b) * self.x[i] for i, b in zip(term.index, term.b, strict=True) if b) + float(term.c)
        if squares:
            t = model.addVar(lb=0, ub=None)
            model.addCons(quicksum(squares) <= t)
            self._own.append((t, lambda a: 0.5 * float(a[term.index] @ term.Q @ a[term.index])))
            cost += t
        return cost

    def add_cone(self, cone: ConeTerm) -> None:
        """z = A x + b, row by row, and the sum of squares."""
        z: list[Any] = []
        for k, (row, constant) in enumerate(zip(cone.A, cone.b, strict=True)):
            parts = np.flatnonzero(row)
            if not len(parts):
                z.append(float(constant))
                continue
            y = self.model.addVar(lb=0 if k == 0 or (cone.rotated and k == 1) else None, ub=None)
            linear = self.quicksum(float(row[j]) * self.x[cone.index[j]] for j in parts)
            self.model.addCons(linear + float(constant) == y)
            self._own.append((y, lambda a, r=row, c=constant: float(r @ a[cone.index] + c)))
            z.append(y)
        head = 2 if cone.rotated else 1
        squares = self.quicksum(y * y for y in z[head:])
        self.model.addCons(squares <= (z[0] * z[1] if cone.rotated else z[0] * z[0]))


def _finite(value: float) -> float:
    """SCIP writes infinity as 1e20."""
    return value if abs(value) < SCIP_INFINITY else float(np.copysign(np.inf, value))


def _watcher(pyscipopt: Any, x: list[Any], tell: Tell) -> Any:
    """SCIP's event handler; its class can only be made once pyscipopt is there."""

    class Watcher(pyscipopt.Eventhdlr):
        last = -np.inf
        told_at = 0.0

        def eventinit(self) -> None:
            for event in (pyscipopt.SCIP_EVENTTYPE.BESTSOLFOUND, pyscipopt.SCIP_EVENTTYPE.NODESOLVED):
                self.model.catchEvent(event, self)

        def eventexec(self, event: Any) -> None:
            bound, cost = _finite(self.model.getDualbound()), _finite(self.model.getPrimalbound())
            if event.getType() == pyscipopt.SCIP_EVENTTYPE.BESTSOLFOUND:
                best = self.model.getBestSol()
                tell(cost, bound, np.array([self.model.getSolVal(best, v) for v in x]))
            elif bound > self.last + 1e-4 * max(abs(bound), 1.0) and time.perf_counter() > self.told_at + 0.1:
                self.last, self.told_at = bound, time.perf_counter()
                tell(cost, bound, None)

    return Watcher()
