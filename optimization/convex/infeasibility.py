"""Which constraints of a convex program without an answer stand in the way, and by how much."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from pydrake.solvers import Binding, LinearConstraint, LorentzConeConstraint, MathematicalProgram

from optimization.convex.solver import ConvexSolver, SolverSettings


@dataclass(frozen=True, eq=False)
class Relaxable:
    """How a constraint may give way.

    Attributes:
        group: group of each of its rows; rows of a group give way together. Each Lorentz cone is one row.
        price: of one unit.
    """

    group: np.ndarray
    price: float = 1.0


@dataclass(frozen=True)
class Relaxation:
    """One place where a constraint must give way.

    Attributes:
        block: description of the constraint.
        group: which group of its rows, as the caller numbered them.
        amount: by how much, in the constraint's own unit.
    """

    block: str
    group: int
    amount: float


def smallest_relaxation(
    prog: MathematicalProgram, may_give: Mapping[str, Relaxable], *, least: float = 1e-6
) -> list[Relaxation]:
    """The cheapest amounts by which some constraints must give way so that all can hold.

    Args:
        prog: linear and second-order cone constraints; its costs are ignored.
        may_give: the constraints that may give way, by description; all others stay hard.
        least: amounts below this count as none.

    Returns:
        The most expensive first; empty where no relaxation helps or none is needed.
    """
    relaxed = MathematicalProgram()
    relaxed.AddDecisionVariables(prog.decision_variables())
    slack = {name: relaxed.NewContinuousVariables(_count(each.group), name) for name, each in may_give.items()}
    cones_seen = dict.fromkeys(may_give, 0)
    for binding in prog.GetAllConstraints():
        name = binding.evaluator().get_description()
        if name not in slack:
            relaxed.AddConstraint(binding)
        elif isinstance(binding.evaluator(), LorentzConeConstraint):
            _widen_cone(relaxed, binding, slack[name][may_give[name].group[cones_seen[name]]])
            cones_seen[name] += 1
        else:
            _widen_rows(relaxed, binding, slack[name], may_give[name].group)
    everything = np.concatenate([np.zeros(0, object), *slack.values()])
    prices = np.concatenate([np.zeros(0), *(np.full(len(slack[name]), each.price) for name, each in may_give.items())])
    relaxed.AddBoundingBoxConstraint(0.0, np.inf, everything)
    relaxed.AddLinearCost(prices, 0.0, everything)
    x, record = ConvexSolver(relaxed, SolverSettings(solver="clarabel")).solve()
    if x is None or not record.feasible:
        return []
    found = [
        Relaxation(name, group, float(amount))
        for name, variables in slack.items()
        for group, amount in enumerate(x[relaxed.FindDecisionVariableIndices(variables)])
        if amount > least
    ]
    return sorted(found, key=lambda relaxation: -relaxation.amount * may_give[relaxation.block].price)


def _count(group: np.ndarray) -> int:
    return int(group.max(initial=-1)) + 1


def _widen_rows(relaxed: MathematicalProgram, binding: Binding, slack: np.ndarray, group: np.ndarray) -> None:
    """lower <= A x + s and A x - s <= upper, each row with the slack of its group."""
    evaluator = binding.evaluator()
    A = evaluator.get_sparse_A()
    spread = sp.csc_matrix((np.ones(len(group)), (np.arange(len(group)), group)), shape=(len(group), len(slack)))
    variables = np.concatenate([binding.variables(), slack])
    for sign, bound in ((1.0, evaluator.lower_bound()), (-1.0, evaluator.upper_bound())):
        finite = np.flatnonzero(np.isfinite(bound))
        if len(finite):
            rows = sp.hstack([A, sign * spread]).tocsr()[finite].tocsc()
            infinite = np.full(len(finite), np.inf)
            lower, upper = (bound[finite], infinite) if sign > 0 else (-infinite, bound[finite])
            relaxed.AddConstraint(LinearConstraint(rows, lower, upper), variables)


def _widen_cone(relaxed: MathematicalProgram, binding: Binding, slack: object) -> None:
    """|z_1..| <= z_0 + s."""
    A = np.asarray(binding.evaluator().A().todense())
    first = np.zeros((A.shape[0], 1))
    first[0] = 1.0
    cone = LorentzConeConstraint(np.hstack([A, first]), binding.evaluator().b())
    relaxed.AddConstraint(cone, np.append(binding.variables(), slack))
