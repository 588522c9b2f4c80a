"""Centroidal dynamics over given contacts: the least-effort momentum trajectory that contact forces can bring about.

Lin 2020: Y.-C. Lin, "Humanoid Contact Planning in Challenging Environments" (dissertation), sec. 6.3, weights sec. 6.7.
Ponton et al. 2018: B. Ponton et al., "On time optimization of centroidal momentum dynamics", ICRA 2018.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

import numpy as np
from pydrake.solvers import (
    BoundingBoxConstraint,
    LinearConstraint,
    LinearEqualityConstraint,
    LorentzConeConstraint,
    MathematicalProgram,
)

from optimization import piqp_adapter
from optimization.centroidal_check import violations
from optimization.centroidal_cost import cost_terms
from optimization.centroidal_estimate import CentroidalEstimate
from optimization.centroidal_explanation import explain
from optimization.centroidal_guess import guess_com, guess_loads
from optimization.centroidal_model import CentroidalModel
from optimization.centroidal_options import (
    ARM,
    COST_SCALE,
    GRAVITY,
    LEAST_PRESSURE_LOAD,
    PENALTY,
    UP,
    CentroidalOptions,
)
from optimization.centroidal_problem import CentroidalProblem
from optimization.centroidal_trajectory import CentroidalTrajectory, WrenchIntegrator
from optimization.com_bounds import final_box, height_bounds
from optimization.contact_wrench import CornerForces, pressure_residuals, skew
from optimization.friction import cone_index
from optimization.gauss_newton import minimise
from optimization.solvers import ConvexSolver, SolverSettings
from optimization.sparse_rows import RowPattern, SparseRows
from scenes.effector import EFFECTORS

FIRST_RADIUS = 0.1  # [m] bound on the CoM's change once a full step has failed


class CentroidalProgram:
    """Moves the CoM over fixed contacts with little momentum, force and torque (Lin 2020 eq. 6.3 to 6.5).

        min   sum_n (dt/0.2) [ w_l |l|^2 + w_ld |ldot|^2 + w_k |k - k_ref|^2 + w_kd |kdot - kdot_ref|^2
                               + w_com |com - com_ref|^2
                               + sum_e w_f |f|^2 + w_tau tau^2 + w_lat |f_lateral|^2 + w_cop |cop / lengths|^2 ]
        s.t.  v[n+1] = v[n] + dt g a[n]                                    newton
              com[n+1] = com[n] + dt v[n+1]                                com integration
              k[n+1] = k[n] + dt kdot[n]                                   angular momentum integration
              a + e_z = sum R f                                            total force
              (f, m) = sum of four corner forces inside the cone           contact wrench, friction cone
              kdot = sum (p - com) x R f + R m                             angular momentum rate (bilinear in com, f)
              z = (cop / lengths, tau)                                     pressure centre (nonlinear in f, m)
              |k_i|, |kdot_i| <= limit + s                                 k limit, kdot limit
              |com - p| <= reach + ARM s                                   reach
              CoM height over the feet, com box, final com box, rest at the end, force limit

    The bilinear rows, the nonlinear residuals and the reach balls are linearised about the last trajectory; the convex
    program that remains is solved, its forces are integrated exactly, and a line search on the true cost plus PENALTY s
    follows (Gauss-Newton with an exact L1 penalty; the CoM's step is bounded once a step has failed). All other
    constraints are convex, so that a first convex program without an answer proves the problem infeasible.

    Units in the program: m, s, M g; moments M g ARM. Points are relative to `origin`.
    Decision variables, for n = 0..N-2 (state at knot n+1, forces over [t_n, t_n+1)) and J active contacts:
        com, v, k, a, kdot (N-1, 3), s (N-1, 1), s_end (1, 1), wrench (J, 6), z (J, 3), force (J, 12) at the corners.
    A cost added to `prog` from outside steers the convex programs, but the line search does not know of it.
    """

    com: np.ndarray
    v: np.ndarray
    k: np.ndarray
    a: np.ndarray
    kdot: np.ndarray
    s: np.ndarray
    s_end: np.ndarray
    wrench: np.ndarray
    z: np.ndarray
    force: np.ndarray

    def __init__(self, problem: CentroidalProblem, options: CentroidalOptions | None = None) -> None:
        self.problem, self.options = problem, options or CentroidalOptions()
        cone_index(self.options.cone)
        self._read_data()
        self.prog = MathematicalProgram()
        self._add_variables()
        self._add_newton()
        self._add_integration()
        self._add_total_force()
        self._add_contact_wrenches()
        self._add_friction_cones()
        self._add_angular_momentum_rate()
        self._add_pressure_centre()
        self._add_reach()
        self._add_angular_momentum_limits()
        self._add_com_bounds()
        self._add_rest()
        self._add_costs()

    def _read_data(self) -> None:
        """The problem's numbers in the program's units."""
        problem, schedule = self.problem, self.problem.schedule
        self.weight = problem.mass * GRAVITY
        self.origin = np.array(problem.initial_com)
        self.dt = schedule.dt
        self.v0 = problem.initial_linear_momentum / problem.mass
        self.k0 = problem.initial_angular_momentum / (self.weight * ARM)
        self.integrator = WrenchIntegrator(schedule, np.stack([problem.initial_com, self.v0, self.k0 * ARM]))
        self.interval, self.effector = self.integrator.interval, self.integrator.effector
        self.p, self.R = self.integrator.p_WC, self.integrator.R_WC
        self.half = problem.half_extent[self.effector]
        _, _, friction = schedule.poses()
        held = schedule.active[self.interval, self.effector]
        self.corners = CornerForces(self.options.cone, friction[held], self.half, ARM)
        unit = self.weight * ARM
        self.momentum_limits = tuple(
            np.asarray(limit, float) / unit
            for limit in (self.options.angular_momentum_limit, self.options.angular_momentum_rate_limit)
        )
        self.reach = self._reach_data()
        com = guess_com(problem, self.options)
        wrench = np.zeros((len(self.interval), 6))
        wrench[:, 2] = guess_loads(problem, com, self.interval, self.effector)
        self._about = com, np.tile(UP, (len(self.dt), 1)), wrench

    def _reach_data(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(K,) knot less one, (K, 3) contact point and (K,) greatest distance [m]: contacts next to knots 1..N-1."""
        schedule = self.problem.schedule
        held = np.zeros((len(self.dt), len(schedule.contacts)), bool)
        held[self.interval, schedule.active[self.interval, self.effector]] = True
        held[:-1] |= held[1:]  # at the knot where a contact is made it must be within reach already
        knot, contact = np.nonzero(held)
        p_WC, _, _ = schedule.poses()
        reach = [self.options.com_reach[EFFECTORS.index(c.effector)] for c in schedule.contacts]
        return knot, p_WC[contact], np.array(reach, float)[contact]

    def _add_variables(self) -> None:
        N, J = len(self.dt), len(self.interval)
        state = [(name, N, 3) for name in ("com", "v", "k", "a", "kdot")]
        self.index: dict[str, np.ndarray] = {}
        self._patterns: dict[str, RowPattern] = {}
        self.num_vars = 0
        for name, count, width in (
            *state, ("s", N, 1), ("s_end", 1, 1), ("wrench", J, 6), ("z", J, 3), ("force", J, 12)
        ):  # fmt: skip
            size = count * width
            self.index[name] = self.num_vars + np.arange(size).reshape(count, width)
            self.num_vars += size
            setattr(self, name, self.prog.NewContinuousVariables(size, name).reshape(count, width))
        self._x = self.prog.decision_variables()

    def _add_rows(self, name: str, rows: SparseRows, lower: np.ndarray | None, upper: np.ndarray) -> LinearConstraint:
        """Adds lower <= rows x <= upper, an equality where `lower` is None, and returns the constraint."""
        pattern = rows.pattern(len(upper), self.num_vars)
        A = pattern.matrix(rows.values)
        constraint = LinearEqualityConstraint(A, upper) if lower is None else LinearConstraint(A, lower, upper)
        constraint.set_description(name)
        self.prog.AddConstraint(constraint, self._x[pattern.columns])
        self._patterns[name] = pattern
        return constraint

    def _add_bounds(
        self, name: str, variables: np.ndarray, lower: np.ndarray, upper: np.ndarray
    ) -> BoundingBoxConstraint:
        lower, upper = (np.broadcast_to(bound, variables.shape).ravel() for bound in (lower, upper))
        constraint = self.prog.AddBoundingBoxConstraint(lower, upper, variables.ravel()).evaluator()
        constraint.set_description(name)
        return constraint

    def _add_newton(self) -> None:
        """v[n+1] - v[n] - dt g a[n] = 0."""
        self._add_difference("newton", "v", "a", GRAVITY * self.dt, self.v0)

    def _add_integration(self) -> None:
        """com[n+1] - com[n] - dt v[n+1] = 0 and k[n+1] - k[n] - dt kdot[n] = 0."""
        self._add_difference("com integration", "com", "v", self.dt, np.zeros(3))
        self._add_difference("angular momentum integration", "k", "kdot", self.dt, self.k0)

    def _add_difference(self, name: str, of: str, rate: str, step: np.ndarray, initial: np.ndarray) -> None:
        index = self.index[of]
        rows, right = SparseRows(), np.zeros(index.shape)
        row = np.arange(index.size).reshape(index.shape)
        rows.add(row, index, 1.0)
        rows.add(row[1:], index[:-1], -1.0)
        rows.add(row, self.index[rate], -step[:, None])
        right[0] = initial
        self._add_rows(name, rows, None, right.ravel())

    def _add_total_force(self) -> None:
        """a - sum R f = -e_z."""
        rows = SparseRows()
        row = np.arange(3 * len(self.dt)).reshape(-1, 3)
        rows.add(row, self.index["a"], 1.0)
        rows.add_blocks(row[self.interval], self.index["wrench"][:, :3], -self.R)
        self._add_rows("total force", rows, None, np.tile(-UP, len(self.dt)))

    def _add_contact_wrenches(self) -> None:
        """(f, m) - map force = 0, and f_z within the end effector's limit."""
        if not len(self.interval):
            return
        rows = SparseRows()
        row = np.arange(self.index["wrench"].size).reshape(-1, 6)
        rows.add(row, self.index["wrench"], 1.0)
        rows.add_blocks(row, self.index["force"], -self.corners.map)
        self._add_rows("contact wrench", rows, None, np.zeros(row.size))
        limit = np.asarray(self.options.force_limit, float)[self.effector]
        self._add_bounds("force limit", self.wrench[:, 2], np.array(-np.inf), limit)

    def _add_friction_cones(self) -> None:
        """Faces of the cone for each corner force; Lorentz cones for `second_order` where the solver takes them."""
        if not len(self.interval):
            return
        if self.options.cone == "second_order" and not self._linear_only():
            b = np.zeros(3)
            for j, forces in enumerate(self.force):
                A = np.array([[0, 0, self.corners.friction[j]], [1, 0, 0], [0, 1, 0]], float)
                for force in forces.reshape(4, 3):
                    cone = LorentzConeConstraint(A, b)
                    cone.set_description("friction cone")
                    self.prog.AddConstraint(cone, force)
            return
        faces = self.corners.rows
        count = 4 * len(faces) * faces.shape[1]
        rows = SparseRows()
        row = np.arange(count).reshape(len(faces), 4, -1)
        rows.add_blocks(row, self.index["force"].reshape(-1, 4, 3), faces[:, None])
        self._add_rows("friction cone", rows, np.full(count, -np.inf), np.zeros(count))

    def _linear_only(self) -> bool:
        solver = self.options.solver
        return solver == "piqp" or (solver == "auto" and piqp_adapter.available())

    def _add_angular_momentum_rate(self) -> None:
        self._rate = self._add_rows("angular momentum rate", *self._rate_rows())

    def _rate_rows(self) -> tuple[SparseRows, None, np.ndarray]:
        """kdot - sum ((p - com0) x R f / ARM + R m) - u0 x (com - com0) / ARM = 0, about com0 and u0 = a0 + e_z."""
        com, total_force, _ = self._about
        rows = SparseRows()
        row = np.arange(3 * len(self.dt)).reshape(-1, 3)
        rows.add(row, self.index["kdot"], 1.0)
        rows.add_blocks(row, self.index["com"], -skew(total_force) / ARM)
        lever = skew(self.p - com[self.interval]) @ self.R / ARM
        rows.add_blocks(row[self.interval], self.index["wrench"], -np.concatenate([lever, self.R], axis=2))
        return rows, None, -np.cross(total_force, com - self.origin).ravel() / ARM

    def _add_pressure_centre(self) -> None:
        self._pressure = self._add_rows("pressure centre", *self._pressure_rows()) if len(self.interval) else None

    def _pressure_rows(self) -> tuple[SparseRows, None, np.ndarray]:
        """z - J wrench = z0 - J wrench0, with J the Jacobian of z about wrench0."""
        _, _, wrench = self._about
        z, jacobian = pressure_residuals(wrench, self.half, ARM, LEAST_PRESSURE_LOAD)
        rows = SparseRows()
        row = np.arange(z.size).reshape(z.shape)
        rows.add(row, self.index["z"], 1.0)
        rows.add_blocks(row, self.index["wrench"], -jacobian)
        return rows, None, (z - np.einsum("jab,jb->ja", jacobian, wrench)).ravel()

    def _add_reach(self) -> None:
        self._reach = self._add_rows("reach", *self._reach_rows()) if len(self.reach[0]) else None

    def _reach_rows(self) -> tuple[SparseRows, np.ndarray, np.ndarray]:
        """e . (com - p) - ARM s <= reach, e pointing from the contact to com0: the ball's supporting half space."""
        knot, points, limit = self.reach
        away = self._about[0][knot] - points
        away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        rows = SparseRows()
        row = np.arange(len(knot))
        rows.add(row[:, None], self.index["com"][knot], away)
        rows.add(row, self.index["s"][knot, 0], -ARM)
        return rows, np.full(len(knot), -np.inf), limit + np.einsum("ka,ka->k", away, points - self.origin)

    def linearise(self, com: np.ndarray, total_force: np.ndarray, wrench: np.ndarray) -> None:
        """Linearises about another trajectory.

        Args:
            com: (N-1, 3) at knots 1..N-1 [m].
            total_force: (N-1, 3) sum of the contact forces [M g].
            wrench: (J, 6) contact wrenches in their frames [M g, M g ARM].
        """
        self._about = com, total_force, wrench
        for constraint, built in (
            (self._rate, self._rate_rows),
            (self._pressure, self._pressure_rows),
            (self._reach, self._reach_rows),
        ):
            if constraint is None:
                continue
            rows, lower, upper = built()
            A = self._patterns[constraint.get_description()].matrix(rows.values)
            constraint.UpdateCoefficients(A, upper) if lower is None else constraint.UpdateCoefficients(A, lower, upper)

    def bound_step(self, com: np.ndarray, radius: float) -> None:
        """Keeps the CoM within `radius` per axis of this path (N-1, 3) [m]."""
        self._step.set_bounds((com - self.origin - radius).ravel(), (com - self.origin + radius).ravel())

    def _add_angular_momentum_limits(self) -> None:
        """|k_i| <= limit + s and |kdot_i| <= limit + s; the slacks cost PENALTY each."""
        slacks = np.concatenate([self.s.ravel(), self.s_end.ravel()])
        self._add_bounds("slack", slacks, np.array(0.0), np.array(np.inf))
        self.prog.AddLinearCost(np.full(slacks.size, PENALTY), 0.0, slacks)
        for name, limit in zip(("k", "kdot"), self.momentum_limits, strict=True):
            self._add_soft_limit(f"{name} limit", self.index[name], self.index["s"], limit)

    def _add_soft_limit(self, name: str, index: np.ndarray, slack: np.ndarray, limit: np.ndarray) -> None:
        """|x_i| - slack <= limit for the finite entries of `limit` (3,)."""
        axes = np.flatnonzero(np.isfinite(limit))
        if not len(axes):
            return
        rows = SparseRows()
        row = np.arange(index[:, axes].size).reshape(len(index), -1)
        for offset, sign in ((0, 1.0), (row.size, -1.0)):
            rows.add(row + offset, index[:, axes], sign)
            rows.add(row + offset, slack, -1.0)
        upper = np.tile(limit[axes], 2 * len(index))
        self._add_rows(name, rows, np.full(upper.size, -np.inf), upper)

    def _add_com_bounds(self) -> None:
        """Height over the feet in contact, box around the reference, final box, and room for `bound_step`."""
        problem, infinite = self.problem, np.array(np.inf)
        low, high = (bound - self.origin[2] for bound in height_bounds(problem, self.options))
        self._add_bounds("com height", self.com[:, 2], low, high)
        if problem.com_box is not None and problem.com_reference is not None:
            centre, half = problem.com_reference[1:] - self.origin, problem.com_box[1:]
            self._add_bounds("com box", self.com, centre - half, centre + half)
        final = final_box(problem, self.options)
        if final is not None:
            self._add_bounds("final com box", self.com[-1], final[0] - self.origin, final[1] - self.origin)
        self._step = self._add_bounds("com step", self.com, -infinite, infinite)

    def _add_rest(self) -> None:
        """v = 0 and |k_i| <= s_end at the last two knots: the forces between and after them hold it at rest."""
        if self.options.rest_at_end:
            self._add_bounds("rest: linear momentum", self.v[-2:], np.array(0.0), np.array(0.0))
            self._add_soft_limit("rest: angular momentum", self.index["k"][-2:], self.index["s_end"], np.zeros(3))

    def _add_costs(self) -> None:
        """One diagonal quadratic cost for each interval, over its state, its contacts and their residuals."""
        diagonal, target = cost_terms(self.problem, self.options.weights, self.index, self.interval, self.num_vars)
        self.cost_diagonal, self.cost_target = diagonal, target
        first = np.searchsorted(self.interval, np.arange(len(self.dt) + 1))
        state = np.concatenate([self.index[name] for name in ("com", "v", "k", "a", "kdot")], axis=1)
        contact = np.concatenate([self.index["wrench"], self.index["z"]], axis=1)
        for n in range(len(self.dt)):
            index = np.concatenate([state[n], contact[first[n] : first[n + 1]].ravel()])
            index = index[diagonal[index] > 0]
            w, goal = 2 * diagonal[index], target[index]
            cost = self.prog.AddQuadraticCost(np.diag(w), -w * goal, 0.5 * float(w @ goal**2), self._x[index], True)
            cost.evaluator().set_description(f"effort[{n}]")

    def start_from(self, trajectory: CentroidalTrajectory) -> None:
        """Linearises about an earlier answer for the same schedule, so that `solve` starts there."""
        force, moment = self.integrator.wrenches(trajectory, self.problem.mass)
        state = self.integrator.integrate(force, moment)
        self.linearise(state.com, state.total_force, np.concatenate([force, moment / ARM], axis=1))

    def solve(self) -> CentroidalEstimate:
        """Solves from the first guess, or `start_from`, and checks the numbers that would be written to a plan."""
        options = self.options
        self.bound_step(self._about[0], np.inf)
        gap = 1e-2 * options.tolerance
        settings = SolverSettings(solver=options.solver, gap=gap, time_limit=options.time_limit)
        outcome = minimise(
            CentroidalModel(self),
            ConvexSolver(self.prog, settings),
            max_iterations=options.max_iterations,
            tolerance=options.tolerance,
            time_limit=options.time_limit,
            radius=FIRST_RADIUS,
        )
        point = outcome.point
        if point is None:
            return CentroidalEstimate(False, np.inf, explain(self), outcome.records, None)
        force, moment = point.wrench[:, :3], ARM * point.wrench[:, 3:]
        trajectory = self.integrator.trajectory(self.problem.schedule, force, moment, self.problem.mass)
        found = violations(self.problem, options, trajectory)
        reason = str(found[0]) if found else ""
        if found and not outcome.converged:
            reason += f" (stopped by the limit on {outcome.reason})"
        return CentroidalEstimate(not found, point.effort / COST_SCALE, reason, outcome.records, trajectory)
