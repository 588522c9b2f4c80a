"""Centroidal dynamics over given contacts: the least-effort momentum trajectory that contact forces can bring about.

Lin 2020: Y.-C. Lin, "Humanoid Contact Planning in Challenging Environments" (dissertation), sec. 6.3, weights sec. 6.7.
Ponton et al. 2018: B. Ponton et al., "On time optimization of centroidal momentum dynamics", ICRA 2018.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from pydrake.solvers import LinearConstraint, LinearEqualityConstraint, MathematicalProgram

from optimization.centroidal_check import violations
from optimization.centroidal_options import GRAVITY, REFERENCE_STEP, CentroidalOptions
from optimization.centroidal_problem import CentroidalProblem
from optimization.centroidal_trajectory import CentroidalState, CentroidalTrajectory, WrenchIntegrator
from optimization.friction import cone_generators, cone_index, corner_points
from optimization.gauss_newton import minimise
from optimization.solvers import ConvexSolver, SolveRecord, SolverOptionsRecord
from optimization.sparse_rows import SparseRows
from scenes.effector import EFFECTORS

ARM = 0.05  # [m]: moments are written in M g ARM and angular momenta in M g ARM s, so that columns are of one size
COST_SCALE = 1e-3  # the documents' cost of a transition is 100 to 1000
LEAST_PRESSURE_LOAD = 0.01  # [M g]: the cost of the centre of pressure is that of a contact loaded with at least this
PENALTY = 300.0  # L1 weight [scaled cost per scaled unit] of breaking a bound on angular momentum or reach
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class CentroidalEstimate:
    """What the centroidal program says of a contact sequence or transition.

    Attributes:
        feasible: whether the trajectory satisfies every constraint, checked on the recomputed numbers.
        cost: value of the documents' objective, inf where there is no trajectory.
        reason: "" where feasible, else the constraint block that fails, with knot and end effector where known.
        records: one per convex program that was solved.
        trajectory: the best one found, also where it is not feasible; None where there is none.
    """

    feasible: bool
    cost: float
    reason: str
    records: tuple[SolveRecord, ...]
    trajectory: CentroidalTrajectory | None

    @property
    def solve_record(self) -> SolveRecord | None:
        """The last convex program that was solved."""
        return self.records[-1] if self.records else None


@dataclass(frozen=True, eq=False)
class CentroidalPoint:
    """A trajectory given by its ray weights, with its true merit (see `gauss_newton.Point`).

    Attributes:
        rays: (J, 4 G) ray weights [M g].
        wrench: (J, 6) contact wrenches in their frames [M g, M g ARM].
        state: the trajectory that they bring about.
        cost: scaled cost.
        violation: sum of the slacks that the penalised constraints need.
        merit: cost plus penalty.
    """

    rays: np.ndarray
    wrench: np.ndarray
    state: CentroidalState
    cost: float
    violation: float
    merit: float


def skew(a: np.ndarray) -> np.ndarray:
    """(..., 3, 3) matrix of the cross product with a (..., 3)."""
    out = np.zeros((*a.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = a[..., 2], -a[..., 1], a[..., 0]
    return out


class CentroidalProgram:
    """Moves the CoM over fixed contacts with little momentum, force and torque (Lin 2020 eq. 6.3 to 6.5).

        min   sum_n (dt/0.2) [ w_l |l|^2 + w_ld |ldot|^2 + w_k |k - k_ref|^2 + w_kd |kdot - kdot_ref|^2
                               + sum_e w_f |f|^2 + w_tau tau^2 + w_lat |f_lateral|^2 + w_cop |cop / lengths|^2
                               + w_com |com - com_ref|^2 ]
        s.t.  v[n+1] = v[n] + dt g (u[n] - e_z)                            newton
              com[n+1] = com[n] + dt v[n+1]                                com integration
              k[n+1] = k[n] + dt kdot[n]                                   angular momentum integration
              u = sum R f                                                  total force
              (f, m) = sum over corners and rays of the friction cone      contact wrench
              kdot = sum (p - com) x R f + R m                             angular momentum rate (bilinear in com, f)
              z = (cop / lengths, tau)                                     pressure centre (nonlinear in f, m)
              |k_i|, |kdot_i| <= limits + s                                angular momentum bounds
              |com - p| <= reach + ARM s                                   reach
              com over the feet, in its box, in the final box; rest at the end; normal forces below their limits

    The bilinear rows, the nonlinear residuals and the reach balls are linearised about the last trajectory; the convex
    program that remains is solved, its forces are integrated exactly, and a line search on the true cost plus PENALTY s
    follows (Gauss-Newton with an exact L1 penalty; the CoM's step is bounded where a step fails). All other
    constraints are linear, so that a first convex program without a solution proves the problem infeasible.

    Units in the program: m, s, M g; moments M g ARM. Points are relative to `origin`.
    Decision variables, for n = 0..N-2 (state at knot n+1, forces over [t_n, t_n+1)) and J active contacts:
        com, v, k, u, kdot (N-1, 3), s (N-1,), s_end (1,), wrench (J, 6), z (J, 3), ray (J, 4 G) weights >= 0.
    """

    def __init__(self, problem: CentroidalProblem, options: CentroidalOptions | None = None) -> None:
        self.problem, self.options = problem, options or CentroidalOptions()
        cone_index(self.options.cone)
        schedule = problem.schedule
        self.weight = problem.mass * GRAVITY
        self.origin = np.array(problem.initial_com)
        self.dt = schedule.dt
        initial = np.stack(
            [
                problem.initial_com,
                problem.initial_linear_momentum / problem.mass,
                problem.initial_angular_momentum / self.weight,
            ]
        )
        self.integrator = WrenchIntegrator(schedule, initial)
        self.interval, self.effector = (self.integrator.interval, self.integrator.effector)
        self.held = schedule.active[self.interval, self.effector]
        self.p = self.integrator.p_WC - self.origin
        self.R = self.integrator.R_WC
        self.half = problem.half_extent[self.effector]
        self.prog = MathematicalProgram()
        self._add_variables()
        self._add_newton()
        self._add_integration()
        self._add_total_force()
        self._add_contact_wrenches()
        self._add_linearised()
        self._add_angular_momentum_bounds()
        self._add_com_bounds()
        self._add_costs()

    # ---- variables

    def _add_variables(self) -> None:
        N, J = len(self.dt), len(self.interval)
        rays = cone_generators(self.options.cone, 1.0).shape[0]
        self.num_vars = 0
        self._index: dict[str, np.ndarray] = {}
        for name, shape in (
            ("com", (N, 3)), ("v", (N, 3)), ("k", (N, 3)), ("u", (N, 3)), ("kdot", (N, 3)), ("s", (N, 1)), ("s_end", (1, 1)),
            ("wrench", (J, 6)), ("z", (J, 3)), ("ray", (J, 4 * rays)),
        ):  # fmt: skip
            size = shape[0] * shape[1]
            self._index[name] = np.arange(self.num_vars, self.num_vars + size).reshape(shape)
            setattr(self, name, self.prog.NewContinuousVariables(size, name).reshape(shape))
            self.num_vars += size
        self.x = self.prog.decision_variables()

    def _add_equalities(self, name: str, rows: SparseRows, right: np.ndarray):
        constraint = LinearEqualityConstraint(rows.matrix(len(right), self.num_vars), right)
        constraint.set_description(name)
        return self.prog.AddConstraint(constraint, self.x).evaluator()

    def _add_bounds(self, name: str, index: str, lower: np.ndarray, upper: np.ndarray):
        shape = self._index[index].shape
        lower, upper = (np.broadcast_to(bound, shape).ravel() for bound in (lower, upper))
        binding = self.prog.AddBoundingBoxConstraint(lower, upper, getattr(self, index).ravel())
        binding.evaluator().set_description(name)
        return binding.evaluator()

    # ---- dynamics

    def _add_newton(self) -> None:
        """v[n+1] - v[n] - dt g u[n] = -dt g e_z."""
        rows, right = self._difference("v", self.problem.initial_linear_momentum / self.problem.mass)
        index = np.arange(right.size).reshape(right.shape)
        rows.add(index, self._index["u"], -GRAVITY * self.dt[:, None])
        self._add_equalities("newton", rows, (right - GRAVITY * self.dt[:, None] * UP).ravel())

    def _add_integration(self) -> None:
        """com[n+1] - com[n] - dt v[n+1] = 0 and k[n+1] - k[n] - dt kdot[n] = 0."""
        start = self.problem.initial_angular_momentum / (self.weight * ARM)
        for name, rate, initial, text in (
            ("com", "v", self.problem.initial_com - self.origin, "com integration"),
            ("k", "kdot", start, "angular momentum integration"),
        ):
            rows, right = self._difference(name, initial)
            rows.add(np.arange(right.size).reshape(right.shape), self._index[rate], -self.dt[:, None])
            self._add_equalities(text, rows, right.ravel())

    def _difference(self, name: str, initial: np.ndarray) -> tuple[SparseRows, np.ndarray]:
        index = self._index[name]
        rows, right = SparseRows(), np.zeros(index.shape)
        row = np.arange(index.size).reshape(index.shape)
        rows.add(row, index, 1.0)
        rows.add(row[1:], index[:-1], -1.0)
        right[0] = initial
        return rows, right

    def _add_total_force(self) -> None:
        """u - sum R f = 0."""
        rows = SparseRows()
        row = np.arange(3 * len(self.dt)).reshape(-1, 3)
        rows.add(row, self._index["u"], 1.0)
        rows.add_blocks(row[self.interval], self._index["wrench"][:, :3], -self.R)
        self._add_equalities("total force", rows, np.zeros(row.size))

    def _add_contact_wrenches(self) -> None:
        """(f, m) = sum of four corner forces, each a nonnegative combination of the rays of its cone; f_z limited."""
        count = len(self.interval)
        if not count:
            return
        rays = self._ray_wrenches()
        rows = SparseRows()
        row = np.arange(6 * count).reshape(-1, 6)
        rows.add(row, self._index["wrench"], 1.0)
        rows.add_blocks(row, self._index["ray"], -rays)
        self._add_equalities("contact wrench", rows, np.zeros(row.size))
        self._add_bounds("friction cone", "ray", np.array(0.0), np.array(np.inf))
        upper = np.full((count, 6), np.inf)
        upper[:, 2] = np.asarray(self.options.force_limit)[self.effector]
        self._add_bounds("force limit", "wrench", np.array(-np.inf), upper)

    def _ray_wrenches(self) -> np.ndarray:
        """(J, 6, 4 G) wrench of each ray of each corner, moments in M g ARM."""
        self.rays = np.zeros((len(self.interval), 6, self._index["ray"].shape[1]))
        known: dict[tuple, np.ndarray] = {}
        for j, (held, effector) in enumerate(zip(self.held, self.effector, strict=True)):
            key = (self.problem.schedule.contacts[held].friction, effector)
            if key not in known:
                rays = cone_generators(self.options.cone, key[0])
                corners = corner_points(self.problem.half_extent[effector])
                moments = np.cross(corners[:, None], rays[None]) / ARM
                forces = np.broadcast_to(rays, moments.shape)
                known[key] = np.concatenate([forces, moments], axis=2).reshape(-1, 6).T
            self.rays[j] = known[key]
        return self.rays

    # ---- what is linearised

    def _add_linearised(self) -> None:
        com, total_force, wrench = self._guess()
        state_rows, state_right = self._angular_rows(com, total_force)
        self._rate = self._add_equalities("angular momentum rate", state_rows, state_right)
        self._pressure = None
        if len(self.interval):
            self._pressure = self._add_equalities("pressure centre", *self._pressure_rows(wrench))
        self._reach_pairs = self._knot_contacts()
        self._reach = None
        if len(self._reach_pairs[0]):
            rows, upper = self._reach_rows(com)
            constraint = LinearConstraint(rows.matrix(len(upper), self.num_vars), np.full(len(upper), -np.inf), upper)
            constraint.set_description("reach")
            self._reach = self.prog.AddConstraint(constraint, self.x).evaluator()
        self._trust = self._add_bounds("com step", "com", np.array(-np.inf), np.array(np.inf))

    def _linearise(self, com: np.ndarray, total_force: np.ndarray, wrench: np.ndarray) -> None:
        """Linearises about a CoM (N-1, 3) relative to the origin, forces (N-1, 3) and wrenches (J, 6)."""
        rows, right = self._angular_rows(com, total_force)
        self._rate.UpdateCoefficients(rows.matrix(len(right), self.num_vars), right)
        if self._pressure is not None:
            rows, right = self._pressure_rows(wrench)
            self._pressure.UpdateCoefficients(rows.matrix(len(right), self.num_vars), right)
        if self._reach is not None:
            rows, upper = self._reach_rows(com)
            matrix = rows.matrix(len(upper), self.num_vars)
            self._reach.UpdateCoefficients(matrix, np.full(len(upper), -np.inf), upper)

    def _angular_rows(self, com: np.ndarray, total_force: np.ndarray) -> tuple[SparseRows, np.ndarray]:
        """kdot - sum ((p - com0) x R f / ARM + R m) - u0 x com / ARM = -u0 x com0 / ARM."""
        rows = SparseRows()
        row = np.arange(3 * len(self.dt)).reshape(-1, 3)
        rows.add(row, self._index["kdot"], 1.0)
        rows.add_blocks(row, self._index["com"], -skew(total_force) / ARM)
        if len(self.interval):
            lever = skew(self.p - com[self.interval]) @ self.R / ARM
            rows.add_blocks(row[self.interval], self._index["wrench"], -np.concatenate([lever, self.R], axis=2))
        return rows, -np.cross(total_force, com).ravel() / ARM

    def _pressure_rows(self, wrench: np.ndarray) -> tuple[SparseRows, np.ndarray]:
        """z - J (wrench - wrench0) = z0, with J the Jacobian of `residuals`."""
        z, jacobian = self._residuals(wrench)
        rows = SparseRows()
        row = np.arange(z.size).reshape(z.shape)
        rows.add(row, self._index["z"], 1.0)
        rows.add_blocks(row, self._index["wrench"], -jacobian)
        return rows, (z - np.einsum("jab,jb->ja", jacobian, wrench)).ravel()

    def _residuals(self, wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(J, 3) centre of pressure over the patch's lengths and normal torque there, and (J, 3, 6) its Jacobian."""
        fx, fy, fz, mx, my, mz = wrench.T
        load = np.maximum(fz, LEAST_PRESSURE_LOAD)
        slope = np.where(fz > LEAST_PRESSURE_LOAD, 1.0, 0.0)
        a, b = (ARM / (2 * np.maximum(half, 1e-6)) for half in self.half.T)
        z = np.stack([-a * my / load, b * mx / load, mz + (mx * fx + my * fy) / load], axis=1)
        jacobian = np.zeros((len(wrench), 3, 6))
        jacobian[:, 0, 4] = -a / load
        jacobian[:, 1, 3] = b / load
        jacobian[:, 2, 0], jacobian[:, 2, 1], jacobian[:, 2, 5] = (mx / load, my / load, 1.0)
        jacobian[:, 2, 3], jacobian[:, 2, 4] = fx / load, fy / load
        jacobian[:, 0, 2] = -slope * z[:, 0] / load
        jacobian[:, 1, 2] = -slope * z[:, 1] / load
        jacobian[:, 2, 2] = -slope * (mx * fx + my * fy) / load**2
        return z, jacobian

    def _knot_contacts(self) -> tuple[np.ndarray, np.ndarray]:
        """Interval index of the knot at its end, and contact: those held before or after each knot 1..N-1."""
        active = self.problem.schedule.active
        pairs = {
            (n, c)
            for n in range(len(active))
            for row in active[n : n + 2]
            for c in row[row >= 0].tolist()
        }  # fmt: skip
        order = sorted(pairs)
        return np.array([n for n, _ in order], int), np.array([c for _, c in order], int)

    def _reach_data(self) -> tuple[np.ndarray, np.ndarray]:
        """(K, 3) points relative to the origin and (K,) greatest distances of `_reach_pairs`."""
        contacts = self.problem.schedule.contacts
        limit = np.array([self.options.com_reach[EFFECTORS.index(contact.effector)] for contact in contacts])
        points = np.stack([contact.p_WC for contact in contacts]) - self.origin
        return points[self._reach_pairs[1]], limit[self._reach_pairs[1]]

    def _reach_rows(self, com: np.ndarray) -> tuple[SparseRows, np.ndarray]:
        """e . (com - p) - ARM s <= reach, with e the direction from the contact to the last CoM: a supporting plane."""
        points, limit = self._reach_data()
        knot = self._reach_pairs[0]
        away = com[knot] - points
        away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        rows = SparseRows()
        row = np.arange(len(knot))
        rows.add(row[:, None], self._index["com"][knot], away)
        rows.add(row, self._index["s"][knot, 0], -ARM)
        return rows, limit + np.einsum("ka,ka->k", away, points)

    # ---- bounds

    def _momentum_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """(3,) limits of k and kdot in the program's units."""
        unit = self.weight * ARM
        options = self.options
        return (
            np.asarray(options.angular_momentum_limit, float) / unit,
            np.asarray(options.angular_momentum_rate_limit, float) / unit,
        )

    def _add_angular_momentum_bounds(self) -> None:
        """|k_i| <= limit + s, |kdot_i| <= limit + s, and |k_i| <= s_end at the last knot where it must rest."""
        self._add_bounds("slack", "s", np.array(0.0), np.array(np.inf))
        self._add_bounds("slack at the end", "s_end", np.array(0.0), np.array(np.inf))
        index = self._index
        for name, limit in zip(("k", "kdot"), self._momentum_limits(), strict=True):
            self._add_soft_limit(f"{name} limit", index[name], index["s"], limit)
        if self.options.rest_at_end:
            self._add_soft_limit("rest: angular momentum", index["k"][-1:], index["s_end"], np.zeros(3))
        cost = np.concatenate([np.full(len(self.dt), PENALTY), [PENALTY]])
        self.prog.AddLinearCost(cost, 0.0, np.concatenate([self.s.ravel(), self.s_end.ravel()]))

    def _add_soft_limit(self, name: str, index: np.ndarray, slack: np.ndarray, limit: np.ndarray) -> None:
        rows = SparseRows()
        row = np.arange(index.size).reshape(index.shape)
        for offset, sign in ((0, 1.0), (index.size, -1.0)):
            rows.add(row + offset, index, sign)
            rows.add(row + offset, slack, -1.0)
        upper = np.tile(np.broadcast_to(limit, index.shape).ravel(), 2)
        finite = np.isfinite(upper)
        if not finite.any():
            return
        matrix = rows.matrix(2 * index.size, self.num_vars)[finite]
        constraint = LinearConstraint(sp.csc_matrix(matrix), np.full(finite.sum(), -np.inf), upper[finite])
        constraint.set_description(name)
        self.prog.AddConstraint(constraint, self.x)

    def _add_com_bounds(self) -> None:
        """Height over the feet in contact, box around the reference, final box, and rest at the end."""
        lower, upper = self.height_bounds()
        free = np.full((len(self.dt), 3), np.inf)
        low, high = -free.copy(), free.copy()
        low[:, 2], high[:, 2] = lower - self.origin[2], upper - self.origin[2]
        self._add_bounds("com height", "com", low, high)
        problem = self.problem
        if problem.com_box is not None and problem.com_reference is not None:
            centre = problem.com_reference[1:] - self.origin
            self._add_bounds("com box", "com", centre - problem.com_box[1:], centre + problem.com_box[1:])
        final = self.final_box()
        if final is not None:
            low, high = -free.copy(), free.copy()
            low[-1], high[-1] = final[0] - self.origin, final[1] - self.origin
            self._add_bounds("final com box", "com", low, high)
        if self.options.rest_at_end:
            rest = free.copy()
            rest[-1] = 0.0
            self._add_bounds("rest: linear momentum", "v", -rest, rest)

    def height_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(N-1,) least and greatest CoM height at knots 1..N-1 [m]; infinite while no foot is in contact."""
        ground = self.problem.schedule.feet_mean()[:, 2]
        low, _, high = self.options.com_height
        known = np.isfinite(ground)
        return np.where(known, ground + low, -np.inf), np.where(known, ground + high, np.inf)

    def final_box(self) -> tuple[np.ndarray, np.ndarray] | None:
        """(3,) lower and upper corner of the box in which the CoM must end [m], or None."""
        half = self.options.final_half_width
        feet = self.problem.schedule.feet_mean()
        known = np.flatnonzero(np.isfinite(feet[:, 0]))
        if half is None or not len(known):
            return None
        centre = feet[known[-1]] + self.options.com_height[1] * UP
        return centre - np.asarray(half), centre + np.asarray(half)

    # ---- costs

    def _add_costs(self) -> None:
        """One diagonal quadratic cost for each interval, over its state, its contacts and their residuals."""
        diagonal, target = self._cost_terms()
        self.cost_diagonal, self.cost_target = diagonal, target
        names = ("com", "v", "k", "u", "kdot")
        contacts = [np.flatnonzero(self.interval == n) for n in range(len(self.dt))]
        for n, held in enumerate(contacts):
            index = np.concatenate(
                [self._index[name][n] for name in names] + [self._index[name][held].ravel() for name in ("wrench", "z")]
            )
            index = index[diagonal[index] > 0]
            w, goal = 2 * diagonal[index], target[index]
            binding = self.prog.AddQuadraticCost(
                np.diag(w), -w * goal, 0.5 * float(w @ goal**2), self.x[index], is_convex=True
            )
            binding.evaluator().set_description(f"effort[{n}]")

    def _cost_terms(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) weight and target of each variable: the scaled cost is sum weight (x - target)^2."""
        w, problem, index = self.options.weights, self.problem, self._index
        diagonal, target = np.zeros(self.num_vars), np.zeros(self.num_vars)
        step = (COST_SCALE * self.dt / REFERENCE_STEP)[:, None]
        moment = (self.weight * ARM) ** 2
        diagonal[index["v"]] = step * w.linear_momentum * problem.mass**2
        diagonal[index["u"]] = step * w.linear_momentum_rate * self.weight**2
        target[index["u"]] = UP
        diagonal[index["k"]] = step * w.angular_momentum * moment
        diagonal[index["kdot"]] = step * w.angular_momentum_rate * moment
        if problem.angular_momentum_reference is not None:
            reference = problem.angular_momentum_reference / (self.weight * ARM)
            target[index["k"]] = reference[1:]
            target[index["kdot"]] = np.diff(reference, axis=0) / self.dt[:, None]
        if problem.com_reference is not None:
            diagonal[index["com"]] = step * w.com_tracking
            target[index["com"]] = problem.com_reference[1:] - self.origin
        if len(self.interval):
            each = step[self.interval]
            lateral = w.force + w.lateral_force
            diagonal[index["wrench"]] = each * np.array([lateral, lateral, w.force, 0, 0, 0])
            diagonal[index["z"]] = each * np.array([w.pressure_centre, w.pressure_centre, w.torque * moment])
        return diagonal, target

    # ---- solving

    def _guess(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """CoM (N-1, 3) relative to the origin, total force (N-1, 3) and wrenches (J, 6) to linearise about first."""
        N = len(self.dt)
        wrench = np.zeros((len(self.interval), 6))
        feet = self.effector < 2
        carriers = np.where(self._has_foot()[self.interval], feet, True)
        wrench[:, 2] = carriers / np.maximum(np.bincount(self.interval, carriers, N), 1.0)[self.interval]
        wrench[:, 2] = np.maximum(wrench[:, 2], 0.1)
        if self.problem.com_reference is not None:
            com = self.problem.com_reference[1:] - self.origin
        else:
            com = self._smooth_path() - self.origin
        return com, np.tile(UP, (N, 1)), wrench

    def _has_foot(self) -> np.ndarray:
        return (self.problem.schedule.active[:, :2] >= 0).any(axis=1)

    def _smooth_path(self) -> np.ndarray:
        """(N-1, 3) the mean of the feet, averaged over two seconds, at the nominal height; the start blended in."""
        feet = self.problem.schedule.feet_mean()
        times = np.cumsum(self.dt)
        known = np.isfinite(feet[:, 0])
        if not known.any():
            return np.tile(self.problem.initial_com, (len(self.dt), 1))
        feet = np.stack([np.interp(times, times[known], feet[known, i]) for i in range(3)], axis=1)
        near = np.abs(times[:, None] - times[None]) <= 1.0
        path = (near @ feet) / near.sum(axis=1, keepdims=True) + self.options.com_height[1] * UP
        fade = np.exp(-times)[:, None]
        return (1 - fade) * path + fade * self.problem.initial_com

    def evaluate(self, x: np.ndarray) -> CentroidalPoint:
        """The exact trajectory of the ray weights in x, negative ones cut off: every wrench is admissible."""
        return self._point(np.maximum(x[self._index["ray"]], 0.0))

    def between(self, start: CentroidalPoint, end: CentroidalPoint, step: float) -> CentroidalPoint:
        """The trajectory of the forces at this part of the way."""
        return self._point(start.rays + step * (end.rays - start.rays))

    def linearise(self, point: CentroidalPoint) -> None:
        """Updates the convex program about this point."""
        self._linearise(point.state.com - self.origin, point.state.total_force, point.wrench)

    def trust(self, point: CentroidalPoint | None, radius: float) -> None:
        """Keeps every CoM within `radius` [m] per axis of this point's."""
        size = self._index["com"].size
        centre = np.zeros(size) if point is None else (point.state.com - self.origin).ravel()
        self._trust.set_bounds(centre - radius, centre + radius)

    def _point(self, rays: np.ndarray) -> CentroidalPoint:
        wrench = np.einsum("jar,jr->ja", self.rays, rays) if len(rays) else np.zeros((0, 6))
        state = self.integrator.integrate(wrench[:, :3], ARM * wrench[:, 3:])
        x = np.zeros(self.num_vars)
        k, k_rate = state.k / ARM, state.k_rate / ARM
        com = state.com - self.origin
        values = (com, state.velocity, k, state.total_force, k_rate)
        for name, value in zip(("com", "v", "k", "u", "kdot"), values, strict=True):
            x[self._index[name]] = value
        if len(rays):
            x[self._index["wrench"]] = wrench
            x[self._index["z"]] = self._residuals(wrench)[0]
        cost = float(self.cost_diagonal @ (x - self.cost_target) ** 2)
        slack = np.zeros(len(self.dt))
        for value, limit in zip((k, k_rate), self._momentum_limits(), strict=True):
            slack = np.maximum(slack, (np.abs(value) - limit).max(axis=1))
        if self._reach is not None:
            points, limit = self._reach_data()
            knot = self._reach_pairs[0]
            np.maximum.at(slack, knot, (np.linalg.norm(com[knot] - points, axis=1) - limit) / ARM)
        violation = float(slack.sum())
        if self.options.rest_at_end:
            violation += float(np.abs(k[-1]).max())
        return CentroidalPoint(rays, wrench, state, cost, violation, cost + PENALTY * violation)

    def solve(self) -> CentroidalEstimate:
        """Solves from the first guess and checks the answer on the numbers that would be written to a plan."""
        options = self.options
        started = time.perf_counter()
        solver = ConvexSolver(self.prog, SolverOptionsRecord(solver=options.solver, time_limit=options.time_limit))
        outcome = minimise(
            self,
            solver,
            max_iterations=options.max_iterations,
            tolerance=options.tolerance,
            time_limit=options.time_limit - (time.perf_counter() - started),
            radius=0.1,
        )
        if outcome.point is None:
            return CentroidalEstimate(False, np.inf, "no forces move the CoM as required", outcome.records, None)
        point = outcome.point
        wrench = point.wrench
        trajectory = self.integrator.trajectory(
            self.problem.schedule, wrench[:, :3], ARM * wrench[:, 3:], self.problem.mass
        )
        found = violations(self.problem, options, trajectory)
        reason = "" if not found else str(found[0])
        return CentroidalEstimate(not found, point.cost / COST_SCALE, reason, outcome.records, trajectory)
