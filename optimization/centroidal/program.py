"""Centroidal dynamics over given contacts: the least-effort momentum trajectory that contact forces can bring about.

Lin 2020: Y.-C. Lin, "Learning for Humanoid Multi-Contact Navigation Planning" (dissertation), sec. 6.3, weights sec. 6.7.
Ponton et al. 2018: B. Ponton et al., "On time optimization of centroidal momentum dynamics", ICRA 2018.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pydrake.solvers import MathematicalProgram

from optimization.balance.contact_wrench import cross
from optimization.centroidal.check import violations
from optimization.centroidal.com_bounds import final_box, height_bounds
from optimization.centroidal.data import CentroidalData
from optimization.centroidal.estimate import CentroidalEstimate
from optimization.centroidal.explanation import explain
from optimization.centroidal.flight import impossible_flight
from optimization.centroidal.guess import guess_com, guess_forces, guess_total_force
from optimization.centroidal.model import CentroidalModel
from optimization.centroidal.options import ARM, COST_SCALE, PENALTY, CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem, structure
from optimization.centroidal.rows import (
    contact_wrench_rows,
    difference_rows,
    friction_rows,
    momentum_rate_rows,
    pressure_rows,
    reach_rows,
    soft_limit_rows,
    total_force_rows,
)
from optimization.centroidal.trajectory import CentroidalTrajectory
from optimization.convex import piqp_adapter
from optimization.convex.sequential_convex import minimise
from optimization.convex.solver import ConvexSolver, SolverSettings
from optimization.convex.updatable_program import Rows, UpdatableProgram
from scenes.gravity import GRAVITY

FIRST_RADIUS = 0.1  # [m] bound on the CoM's change once a full step has failed
ACCURACY, SHORT = 1e-7, 60  # of the convex programs of up to so many intervals; see `_accuracy`
FINEST = 1e-11  # what double precision leaves
HOPELESS = 0.1  # [M g ARM, M g ARM s] slack in all whose standing still ends the iteration


class CentroidalProgram:
    """Moves the CoM over fixed contacts with little momentum, force and torque (Lin 2020 eq. 6.3 to 6.5).

        min   sum_n (dt/0.2) [ w_l |l|^2 + w_ld |ldot|^2 + w_k |k - k_ref|^2 + w_kd |kdot - kdot_ref|^2
                               + w_com |com - com_ref|^2
                               + sum_e w_f |f|^2 + w_tau tau^2 + w_lat |f_lateral|^2 + w_cop |cop / lengths|^2 ]
        s.t.  v[n+1] = v[n] + dt g a[n]                                    newton
              com[n+1] = com[n] + dt v[n+1]                                com integration
              k[n+1] = k[n] + dt kdot[n]                                   angular momentum integration
              a + e_z = sum R f                                            total force
              (f, m) = sum of corner forces inside the cone                contact wrench, friction cone
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
        com, v, k, a, kdot (N-1, 3), s (N-1, 1), s_end (1, 1), wrench (J, 6), z (J, 3), force (J, 3 V) at the
        V corners of the supports.
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
        self.options = options or CentroidalOptions()
        self._read(problem)
        self._host = UpdatableProgram()
        self._rows: dict[str, Callable[[], Rows]] = {}
        self._bounds: dict[str, Callable[[], tuple[np.ndarray, np.ndarray]]] = {}
        self._solver: ConvexSolver | None = None
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

    @property
    def prog(self) -> MathematicalProgram:
        """The convex program about the last trajectory, with the present numbers."""
        return self._host.prog

    @property
    def problem(self) -> CentroidalProblem:
        """The present data, in SI."""
        return self.data.problem

    def update(self, problem: CentroidalProblem) -> None:
        """Takes other data of the same structure (see `structure`): nothing is rebuilt.

        Raises:
            ValueError: the structure differs.
        """
        if structure(problem) != structure(self.problem):
            raise ValueError("the new problem's contacts are not active at the same times, or it tracks other things")
        self._read(problem)
        for name, rows in self._rows.items():
            self._host.update_rows(name, *rows())
        for name, bounds in self._bounds.items():
            self._host.update_bounds(name, *bounds())
        if self._host.num_cones:
            self._host.update_cones("friction cone", self._cone_matrices())
        self._host.update_diagonal_costs(self.data.cost_diagonal, self.data.cost_target)

    def _read(self, problem: CentroidalProblem) -> None:
        """The problem's numbers, and the first trajectory to linearise about."""
        self.data = data = CentroidalData.of(problem, self.options)
        com = guess_com(problem, self.options)
        wrench = np.zeros((len(data.interval), 6))
        wrench[:, :3] = guess_forces(problem, com, data.interval, data.effector)
        middle = np.concatenate([data.middle, np.zeros((len(wrench), 1))], axis=1)
        wrench[:, 3:] = cross(middle, wrench[:, :3]) / ARM
        self._about = com, guess_total_force(problem, com), wrench

    def _add_variables(self) -> None:
        for name, index in self.data.index.items():
            variables, _ = self._host.add_variables(name, *index.shape)
            setattr(self, name, variables)

    def _add_rows(self, name: str, rows: Callable[[], Rows | None]) -> None:
        """Adds rows and remembers how to make them from new numbers."""
        built = rows()
        if built is not None and len(built[2]):
            self._host.add_rows(name, *built)
            self._rows[name] = rows  # type: ignore[assignment]

    def add_rows(self, name: str, rows: Callable[[], Rows | None]) -> None:
        """Adds rows on variables by their places (`index`); `rows` is called again whenever numbers are updated.

        Args:
            name: of the block of constraints.
            rows: gives coefficients, lower (None for equality) and upper bounds; None for no rows.
        """
        self._add_rows(name, rows)

    def _add_bounds(self, name: str, index: np.ndarray, bounds: Callable[[], tuple[np.ndarray, np.ndarray]]) -> None:
        if index.size:
            self._host.add_bounds(name, index, *bounds())
            self._bounds[name] = bounds

    def _add_newton(self) -> None:
        """v[n+1] - v[n] - dt g a[n] = 0."""
        v, a = self.data.index["v"], self.data.index["a"]
        self._add_rows("newton", lambda: difference_rows(v, a, GRAVITY * self.data.dt, self.data.v0))

    def _add_integration(self) -> None:
        """com[n+1] - com[n] - dt v[n+1] = 0 and k[n+1] - k[n] - dt kdot[n] = 0."""
        com, v, k, kdot = (self.data.index[name] for name in ("com", "v", "k", "kdot"))
        self._add_rows("com integration", lambda: difference_rows(com, v, self.data.dt, np.zeros(3)))
        self._add_rows("angular momentum integration", lambda: difference_rows(k, kdot, self.data.dt, self.data.k0))

    def _add_total_force(self) -> None:
        """a - sum R f = -e_z."""
        a, wrench = self.data.index["a"], self.data.index["wrench"]
        self._add_rows("total force", lambda: total_force_rows(a, wrench, self.data.interval, self.data.R_WC))

    def _add_contact_wrenches(self) -> None:
        """(f, m) - map force = 0, and f_z within the end effector's limit."""
        wrench, force = self.data.index["wrench"], self.data.index["force"]
        self._add_rows("contact wrench", lambda: contact_wrench_rows(wrench, force, self.data.corners.map))
        free = np.full(len(wrench), -np.inf)
        self._add_bounds("force limit", wrench[:, 2], lambda: (free, self.data.force_limit))

    def _add_friction_cones(self) -> None:
        """Faces of the cone for each corner force; Lorentz cones for `second_order` where the solver takes them."""
        force = self.data.index["force"]
        if self.options.cone == "second_order" and not self._linear_only():
            self._host.add_cones("friction cone", self._cone_matrices(), force.reshape(-1, 3))
        else:
            self._add_rows("friction cone", lambda: friction_rows(force, self.data.corners.rows))

    def _cone_matrices(self) -> np.ndarray:
        """(V J, 3, 3) matrices whose product with a corner force is (mu f_z, f_x, f_y)."""
        corners = self.data.corners.count
        matrices = np.zeros((corners * len(self.data.interval), 3, 3))
        matrices[:, 0, 2] = np.repeat(self.data.corners.friction, corners)
        matrices[:, 1, 0] = matrices[:, 2, 1] = 1.0
        return matrices

    def _linear_only(self) -> bool:
        solver = self.options.solver
        return solver == "piqp" or (solver == "auto" and piqp_adapter.available())

    def _add_angular_momentum_rate(self) -> None:
        """kdot - sum ((p - com0) x R f / ARM + R m) - u0 x (com - com0) / ARM = 0, about com0 and u0 = a0 + e_z."""
        kdot, com, wrench = (self.data.index[name] for name in ("kdot", "com", "wrench"))

        def rows() -> Rows:
            pose, about = (self.data.p_WC, self.data.R_WC), self._about[:2]
            return momentum_rate_rows(kdot, com, wrench, self.data.interval, pose, about, self.data.origin)

        self._add_rows("angular momentum rate", rows)

    def _add_pressure_centre(self) -> None:
        """z - J wrench = z0 - J wrench0, with J the Jacobian of z about wrench0."""
        z, wrench = self.data.index["z"], self.data.index["wrench"]
        self._add_rows("pressure centre", lambda: pressure_rows(z, wrench, self._about[2], self.data.half))

    def _add_reach(self) -> None:
        """e . (com - p) - ARM s <= reach, e pointing from the contact to com0: the ball's supporting half space."""
        com, slack = self.data.index["com"], self.data.index["s"]
        self._add_rows("reach", lambda: reach_rows(com, slack, self.data.reach, self._about[0], self.data.origin))

    def linearise(self, com: np.ndarray, total_force: np.ndarray, wrench: np.ndarray) -> None:
        """Linearises about another trajectory.

        Args:
            com: (N-1, 3) at knots 1..N-1 [m].
            total_force: (N-1, 3) sum of the contact forces [M g].
            wrench: (J, 6) contact wrenches in their frames [M g, M g ARM].
        """
        self._about = com, total_force, wrench
        for name in ("angular momentum rate", "pressure centre", "reach"):
            if name in self._rows:
                self._host.update_rows(name, *self._rows[name]())

    def bound_step(self, com: np.ndarray, radius: float) -> None:
        """Keeps the CoM within `radius` per axis of this path (N-1, 3) [m].

        Args:
            com: (N-1, 3) CoM at knots 1..N-1 [m].
            radius: greatest distance from it per axis [m].
        """
        self._host.update_bounds("com step", com - self.data.origin - radius, com - self.data.origin + radius)

    def _add_angular_momentum_limits(self) -> None:
        """|k_i| <= limit + s and |kdot_i| <= limit + s; the slacks cost PENALTY each."""
        slacks = np.concatenate([self.data.index["s"].ravel(), self.data.index["s_end"].ravel()])
        self._add_bounds("slack", slacks, lambda: (np.zeros(len(slacks)), np.full(len(slacks), np.inf)))
        self._host.add_linear_cost(slacks, PENALTY)
        self._add_rows("k limit", lambda: self._soft_limit("k", 0))
        self._add_rows("kdot limit", lambda: self._soft_limit("kdot", 1))

    def _soft_limit(self, name: str, which: int) -> Rows | None:
        return soft_limit_rows(self.data.index[name], self.data.index["s"], self.data.momentum_limits[which])

    def _add_com_bounds(self) -> None:
        """Height over the feet in contact, box around the reference, final box, and room for `bound_step`."""
        com = self.data.index["com"]

        def height() -> tuple[np.ndarray, np.ndarray]:
            low, high = height_bounds(self.problem, self.options)
            return low - self.data.origin[2], high - self.data.origin[2]

        def box() -> tuple[np.ndarray, np.ndarray]:
            reference, half = self.problem.com_reference, self.problem.com_box
            assert reference is not None  # the problem saw to it
            assert half is not None
            centre = reference[1:] - self.data.origin
            return centre - half[1:], centre + half[1:]

        def final() -> tuple[np.ndarray, np.ndarray]:
            corners = final_box(self.problem, self.options)
            assert corners is not None  # by the same structure
            return corners[0] - self.data.origin, corners[1] - self.data.origin

        self._add_bounds("com height", com[:, 2], height)
        if self.problem.com_box is not None:
            self._add_bounds("com box", com, box)
        if final_box(self.problem, self.options) is not None:
            self._add_bounds("final com box", com[-1], final)
        self._add_bounds("com step", com, lambda: (np.full(com.shape, -np.inf), np.full(com.shape, np.inf)))

    def _add_rest(self) -> None:
        """v = 0 and |k_i| <= s_end at the last two knots: the forces between and after them hold it at rest."""
        if self.options.rest_at_end:
            v, k, slack = self.data.index["v"][-2:], self.data.index["k"][-2:], self.data.index["s_end"]
            self._add_bounds("rest: linear momentum", v, lambda: (np.zeros(v.shape), np.zeros(v.shape)))
            self._add_rows("rest: angular momentum", lambda: soft_limit_rows(k, slack, np.zeros(3)))

    def _add_costs(self) -> None:
        """One diagonal quadratic cost for each interval, over its state, its contacts and their residuals."""
        first = np.searchsorted(self.data.interval, np.arange(len(self.data.dt) + 1))
        state = np.concatenate([self.data.index[name] for name in ("com", "v", "k", "a", "kdot")], axis=1)
        contact = np.concatenate([self.data.index["wrench"], self.data.index["z"]], axis=1)
        groups = [
            (f"effort[{n}]", np.concatenate([state[n], contact[first[n] : first[n + 1]].ravel()]))
            for n in range(len(self.data.dt))
        ]
        self._host.add_diagonal_costs(self.data.cost_diagonal, self.data.cost_target, groups)

    def start_from(self, trajectory: CentroidalTrajectory) -> None:
        """Linearises about an earlier answer for the same schedule, so that `solve` starts there."""
        force, moment = self.data.integrator.wrenches(trajectory, self.problem.mass)
        state = self.data.integrator.integrate(force, moment)
        self.linearise(state.com, state.total_force, np.concatenate([force, moment / ARM], axis=1))

    def _convex_solver(self) -> ConvexSolver:
        """The solver of the last `solve`, with its symbolic work, unless something was added to `prog` since."""
        own = self._host.is_own()
        if self._solver is None or not own or not self._own:
            options, gap = self.options, 1e-2 * self.options.tolerance
            limit = options.time_limit
            settings = SolverSettings(solver=options.solver, tolerance=self._accuracy(), gap=gap, time_limit=limit)
            self._solver = ConvexSolver(self._host if own else self.prog, settings)
        self._own = own
        return self._solver

    def _accuracy(self) -> float:
        """Of the convex program: forces are integrated exactly afterwards, where errors add up and an error at the start grows with
        the square of the time: after 300 s at 1e-7 it was 0.4 N m s of angular momentum.
        """
        return max(ACCURACY * min(1.0, SHORT / len(self.data.dt)) ** 3, FINEST)

    def solve(self, time_limit: float = np.inf) -> CentroidalEstimate:
        """Solves from the first guess, or `start_from`, and checks the numbers that would be written to a plan.

        Args:
            time_limit: seconds after which no further convex program is started, if sooner than the options say.
        """
        options = self.options
        self.bound_step(self._about[0], np.inf)
        outcome = minimise(
            CentroidalModel(self.data, self.linearise, self.bound_step),
            self._convex_solver(),
            max_iterations=options.max_iterations,
            tolerance=options.tolerance,
            time_limit=min(options.time_limit, time_limit),
            radius=FIRST_RADIUS,
            hopeless=HOPELESS,
        )
        point = outcome.point
        stopped = "" if outcome.converged or outcome.reason not in ("time", "iterations") else outcome.reason
        if point is None:
            return CentroidalEstimate(False, np.inf, self._why_not(stopped), outcome.records, None, stopped)
        force, moment = point.wrench[:, :3], ARM * point.wrench[:, 3:]
        trajectory = self.data.integrator.trajectory(self.problem.schedule, force, moment, self.problem.mass)
        found = violations(self.problem, options, trajectory)
        reason = str(found[0]) if found else ""
        if found and stopped:
            reason += f" (stopped by the limit on {stopped})"
        return CentroidalEstimate(not found, point.effort / COST_SCALE, reason, outcome.records, trajectory, stopped)

    def _why_not(self, stopped: str) -> str:
        """Why there is no trajectory at all."""
        if stopped:
            return f"stopped by the limit on {stopped} before the first answer"
        flight = impossible_flight(self.problem, self.options)
        if flight:
            return flight
        return explain(self.prog, self.data) if self.options.explain else "the convex program has no answer"
