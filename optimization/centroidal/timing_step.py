"""One convex step of timing: a centroidal program about a trajectory, with the lengths of its intervals free as well."""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from pydrake.solvers import (
    ClarabelSolver,
    CommonSolverOption,
    LinearEqualityConstraint,
    MathematicalProgram,
    SolverOptions,
)

from optimization.centroidal.cost import cost_terms
from optimization.centroidal.data import CentroidalData
from optimization.centroidal.model import program_values
from optimization.centroidal.options import ARM, COST_SCALE
from optimization.centroidal.program import CentroidalProgram
from optimization.centroidal.trajectory import CentroidalTrajectory
from optimization.convex.solver import ConvexSolver, SolveRecord, SolverSettings, worst_violation
from scenes.gravity import GRAVITY

# integrated variables, their rate and its factor
INTEGRATIONS = {
    "newton": ("v", "a", GRAVITY),
    "com integration": ("com", "v", 1.0),
    "angular momentum integration": ("k", "kdot", 1.0),
}
ACCURACIES = (1e-10, 1e-8, 1e-6)  # asked of the multipliers, the next where the last is not reached
ACCEPT = 1e-6  # violation at which their program counts as solved
RELATIVE_STEP = 1e-6  # of the difference quotients of weights and targets, which are linear or reciprocal in dt


class TimingStep:
    """A centroidal program linearised in the durations of groups of intervals too.

        min   sum_n | r_n(x) + (dr_n/d dt_n) delta_n |^2 + change_weight (dt_n + delta_n - given_n)^2 + penalties
        s.t.  x[n+1] - x[n] - dt_n rate[n] - rate0[n] delta_n = x0     for v, com and k
              delta_n = share_n D_group(n),   least <= D <= most,   sum D <= room
              and everything else that the program asks, about the trajectory

    r_n are the weighted residuals of the program's cost: Gauss-Newton in x and durations together, so that the step
    knows how the trajectory would follow a change of time. The fixed-time program is then solved at the new durations.

    Args:
        program: its `problem` is that of the trajectory; it is linearised about the trajectory here.
        trajectory: to start from.
        group: (N-1,) number of the duration that each interval belongs to, 0..G-1.
        given: (N-1,) intervals that `change_weight` is counted from [s].
        change_weight: on the squared change of each interval [1/s^2].
    """

    def __init__(
        self,
        program: CentroidalProgram,
        trajectory: CentroidalTrajectory,
        group: np.ndarray,
        given: np.ndarray,
        change_weight: float = 0.0,
    ) -> None:
        self.program, self.group, self.given = program, group, given
        self.change_weight = COST_SCALE * change_weight
        self.dt = program.problem.schedule.dt
        self.durations = np.bincount(group, self.dt)
        self.share = self.dt / self.durations[group]
        program.start_from(trajectory)
        program.bound_step(trajectory.com[1:], np.inf)
        self.x = trajectory_values(program.data, trajectory)
        self.prog = MathematicalProgram()
        self.prog.AddDecisionVariables(program.prog.decision_variables())
        self.change = self.prog.NewContinuousVariables(len(self.durations), "D")
        self._add_constraints()
        self._add_costs()

    def _add_constraints(self) -> None:
        """The program's own, with durations in its integrations."""
        for binding in self.program.prog.GetAllConstraints():
            name = binding.evaluator().get_description()
            if name not in INTEGRATIONS:
                self.prog.AddConstraint(binding)
        for name in INTEGRATIONS:
            self._add_integration(name)

    def _add_integration(self, name: str) -> None:
        """x[n+1] - x[n] - dt rate[n] - rate0[n] delta_n = 0, or x0 in the first row."""
        of, rate, factor = INTEGRATIONS[name]
        index, rates = self.program.data.index[of], self.program.data.index[rate]
        right = np.zeros(index.shape)
        right[0] = {"v": self.program.data.v0, "com": np.zeros(3), "k": self.program.data.k0}[of]
        row = np.arange(index.size).reshape(index.shape)
        duration = self.program.prog.num_vars() + np.broadcast_to(self.group[:, None], index.shape)
        slope = factor * self.x[rates] * self.share[:, None]
        entries = (
            (row, index, np.ones(index.shape)),
            (row[1:], index[:-1], -np.ones(index[1:].shape)),
            (row, rates, np.broadcast_to(-factor * self.dt[:, None], index.shape)),
            (row, duration, -slope),
        )
        i, j, values = (np.concatenate([entry[part].ravel() for entry in entries]) for part in range(3))
        columns, place = np.unique(j, return_inverse=True)
        A = sp.csc_matrix((values, (i, place)), shape=(index.size, len(columns)))
        constraint = LinearEqualityConstraint(A, right.ravel())
        constraint.set_description(name)
        self.prog.AddConstraint(constraint, self.prog.decision_variables()[columns])

    def _add_costs(self) -> None:
        """The program's costs; those of the intervals with their derivative by the interval's length."""
        for binding in self.program.prog.GetAllCosts():
            if not binding.evaluator().get_description().startswith("effort["):
                self.prog.AddCost(binding)
        root, offset, slope = self.residuals()
        interval_of = interval_of_variables(self.program.data)
        variables = self.prog.decision_variables()
        for n, g in enumerate(self.group):
            index = np.flatnonzero((interval_of == n) & (root > 0))
            # r = root x - offset + slope share D: the quadratic form of the stacked rows
            J = np.hstack([np.diag(root[index]), (slope[index] * self.share[n])[:, None]])
            self._add_squares(J, offset[index], [*variables[index], self.change[g]], f"effort[{n}]")
        if self.change_weight:
            for n, g in enumerate(self.group):
                root_weight = np.sqrt(self.change_weight)
                J = np.array([[root_weight * self.share[n]]])
                off = np.array([root_weight * (self.given[n] - self.dt[n])])
                self._add_squares(J, off, [self.change[g]], f"change of interval[{n}]")

    def _add_squares(self, J: np.ndarray, offset: np.ndarray, variables: list, name: str) -> None:
        """|J y - offset|^2."""
        cost = self.prog.AddQuadraticCost(
            2 * J.T @ J, -2 * J.T @ offset, float(offset @ offset), np.array(variables), is_convex=True
        )
        cost.evaluator().set_description(name)

    def residuals(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n,) roots of the weights, (n,) root x target, (n,) derivative of each residual by its interval's length.

        r = sqrt(w) (x - t), so dr/d dt = w' / (2 sqrt(w)) (x - t) - sqrt(w) t'.
        """
        data = self.program.data
        weight, target = data.cost_diagonal, data.cost_target
        schedule = data.problem.schedule
        longer = replace(data.problem, schedule=replace(schedule, dt=self.dt * (1 + RELATIVE_STEP)))
        args = data.options.weights, data.index, data.interval, data.num_vars
        later_weight, later_target = cost_terms(longer, *args)
        dt = self.dt[interval_of_variables(data)]
        weight_slope, target_slope = (
            (later - now) / (RELATIVE_STEP * dt) for later, now in ((later_weight, weight), (later_target, target))
        )
        root = np.sqrt(weight)
        safe = np.where(root > 0, root, 1.0)
        slope = weight_slope / (2 * safe) * (self.x - target) - root * target_slope
        return root, root * target, slope

    def solve(
        self, least: np.ndarray, most: np.ndarray, room: float, time_limit: float
    ) -> tuple[np.ndarray | None, SolveRecord]:
        """(G,) change of each duration [s] within (least, most) and at most `room` in sum, and how it was found.

        Args:
            least, most: (G,) bounds on the change of each duration [s].
            room: greatest sum of the changes [s], inf for free.
            time_limit: of the solver [s].
        """
        prog = self.prog.Clone()
        prog.AddBoundingBoxConstraint(least, most, self.change).evaluator().set_description("duration bounds")
        if np.isfinite(room):
            total = prog.AddLinearConstraint(np.ones((1, len(self.change))), [-np.inf], [room], self.change)
            total.evaluator().set_description("total duration")
        settings = SolverSettings(solver=self.program.options.solver, time_limit=time_limit)
        x, record = ConvexSolver(prog, settings).solve()
        if x is None or not record.feasible:
            return None, record
        return np.clip(x[prog.FindDecisionVariableIndices(self.change)], least, most), record

    def gradient(self) -> np.ndarray:
        """(G,) derivative of the optimal cost by each duration [cost/s]: multipliers of D = 0; NaN where none are found.

        Exact where the trajectory is the optimum of the fixed-time program, whose linearisation is exact there.
        """
        prog = self.prog.Clone()
        held = prog.AddLinearEqualityConstraint(np.eye(len(self.change)), np.zeros(len(self.change)), self.change)
        for accuracy in ACCURACIES:
            options = SolverOptions()
            options.SetOption(CommonSolverOption.kMaxThreads, 1)
            for name in ("tol_feas", "tol_gap_rel", "tol_gap_abs"):
                options.SetOption(ClarabelSolver.id(), name, accuracy)
            result = ClarabelSolver().Solve(prog, None, options)  # PIQP's adapter and `solvers` give no multipliers
            if result.is_success() and worst_violation(prog, result.get_x_val())[0] < ACCEPT:
                return np.asarray(result.GetDualSolution(held)) / COST_SCALE
        return np.full(len(self.change), np.nan)


def interval_of_variables(data: CentroidalData) -> np.ndarray:
    """(n,) interval whose length weighs each variable in the cost; 0 for those that cost nothing."""
    out = np.zeros(data.num_vars, int)
    for name in ("com", "v", "k", "a", "kdot"):
        out[data.index[name]] = np.arange(len(data.dt))[:, None]
    for name in ("wrench", "z"):
        out[data.index[name]] = data.interval[:, None]
    return out


def trajectory_values(data: CentroidalData, trajectory: CentroidalTrajectory) -> np.ndarray:
    """(n,) values of a program's variables along a trajectory; corner forces and slacks are left 0.

    Args:
        data: of the program.
        trajectory: one of its problem.
    """
    force, moment = data.integrator.wrenches(trajectory, data.problem.mass)
    state = data.integrator.integrate(force, moment)
    wrench = np.concatenate([force, moment / ARM], axis=1)
    return program_values(data, wrench, state)


def whole_cost(data: CentroidalData, trajectory: CentroidalTrajectory) -> float:
    """Objective of a trajectory (Lin 2020 sec. 6.3 and 6.7), the pull towards a CoM reference included.

    Args:
        data: of the program.
        trajectory: one of its problem.
    """
    x = trajectory_values(data, trajectory)
    return float(np.sum(data.cost_diagonal * (x - data.cost_target) ** 2)) / COST_SCALE
