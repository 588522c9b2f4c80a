"""A whole-body trajectory deformed until its contacts lie in given regions: the contact-consistent elastic strip.

Chung & Khatib 2015: "Contact-consistent elastic strips for multi-contact locomotion planning of humanoid robots", ICRA.
Brock & Khatib 2002: "Elastic strips: a framework for motion generation in human environments", IJRR 21(12).
Lin 2020: "Learning for Humanoid Multi-Contact Navigation Planning", sec. 4.5.3.
"""

# pydrake's stubs read "float64[m, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from pydrake.solvers import Binding, MathematicalProgram

from optimization.balance.balance_regions import BalancePolygons, edge_rows
from optimization.balance.static_equilibrium import polygon_margin
from optimization.convex.solver import ConvexSolver, SolveRecord, SolverSettings
from optimization.elastic_strip.check import (
    Violations,
    find_violations,
    frame_error,
    strip_faults,
)
from optimization.elastic_strip.problem import StripEstimate, StripIteration, StripOptions, StripProblem
from optimization.elastic_strip.rows import linearise, make_strip_rows
from optimization.elastic_strip.state import StripState, course_pose, first_state, moved_state
from optimization.multibody.body_capsules import BodyCapsules
from optimization.multibody.kinematic_tree import difference
from optimization.multibody.kinematics import Kinematics
from scenes.contact import contact_heading
from scenes.effector import is_foot
from scenes.robots.robot import Robot
from scenes.terrain.packed_terrain import PackedTerrain

LEVER = 0.3  # [m] an angle of 1 rad counts as this distance
SIDES = 12  # of the polygon that stands for a circle
TAKE_OFF = 0.25  # share of a swing at either end in which what is in the air may be near the terrain
AIR_WEIGHT = 30.0  # [1/m^2] of the course of an end effector in the air; far below that of contacts
ROUND = 1.0  # [1/m^2] quadratic part of the penalties, which makes the answer unique
LEAST_TRUST = 0.04  # [rad, m]
PROMISING = 0.7  # share to which violations must fall for steps to grow again
STALLED, IDLE = 5, 0.98  # iterations in which violations must fall to this share, or the strip is given up
SETTLED, DONE = 5e-3, 0.06  # [rad, m] a step that ends the iterations, and one that does where every task is done
WELL_HELD = 1e-3  # [m] contact error at which the strip may end early
LOOSE = 1e-2  # violation of a program's constraints up to which its answer is a step; slack makes all of them feasible
ACCURATE = 1e-6  # of each convex program: the next iteration forgives more


class ElasticStrip:
    """Moves the contacts of a trajectory into their regions, and the trajectory with them.

        min   sum_n tension / (t[n+1] - t[n]) |u[n+1] - u[n]|^2                          internal forces
              + memory sum_n |u[n]|^2 + home sum_c |c - c_home|^2
              + contact_weight sum_n sum_e |X_WE[n] - X_WC|^2                            contact
              + air sum_n |X_WE[n] - course between its contacts|^2
              + exact_penalty sum_n (s_balance[n] + s_clearance[n] + ...)
        s.t.  lower <= joints <= upper                                                   limits
              CoM[n] in the balance polygon of what carries, but for s_balance[n]        balance
              distances of limbs, of what is in the air, of the body from itself,
              but for s_clearance[n]                                                     clearance
              each contact's centre in a circle of its regions, its turn bounded         contact regions
              |dq|, |dc| <= trust

    with u = q - q planned. Each iteration linearises the trajectory about where it is and solves this convex program for
    the changes of all configurations and contacts together. One contact is one pose, however many configurations hold it.

    The priorities are the documented ones: limits are never left; contact, balance and clearance are in parallel, each
    with a weight that outdoes whatever is below; internal forces get what remains. The internal forces are those of
    springs between neighbours (Brock & Khatib 2002: a configuration is drawn to where it divides the way between its
    neighbours as before), acting on the displacement, so that a strip that nothing pushes keeps its planned shape.

    Decision variables: dq (N, nv) [rad, m]; dc (C, 3) in each contact's frame: x, y [m] and turn about z [rad];
    slack (2 N + gatherings) [m].
    """

    def __init__(
        self,
        robot: Robot,
        kinematics: Kinematics,
        capsules: BodyCapsules,
        packed: PackedTerrain,
        problem: StripProblem,
        options: StripOptions | None = None,
    ) -> None:
        """Builds the program; nothing is solved yet.

        Args:
            robot: patches and force limits.
            kinematics: of the robot, its first four frames the end effectors.
            capsules: its shape, see `optimization.multibody.body_capsules`.
            packed: the terrain to move to.
            problem: the trajectory and where its contacts may go.
            options: weights, margins, limits.
        """
        self.robot, self.problem, self.options = robot, problem, options or StripOptions()
        self.tree, self._capsules, self._packed = kinematics.tree, capsules, packed
        self._num, self._nv = len(problem.t), len(kinematics.tree.lower) + 6
        own = zip(problem.regions, problem.contacts, strict=True)
        self._regions = tuple(r.where(r.surface == c.surface) for r, c in own)
        self._home = np.array([c.X_WC for c in problem.contacts]).reshape(-1, 4, 4)
        self._circle = np.zeros(len(problem.contacts), np.int64)  # that each contact is in
        self._polygons = BalancePolygons(robot, problem.contacts, self.options.cone)
        link_of = {int(link): e for e, link in enumerate(self.tree.frame_link[:4])}
        self._effector_of = np.array([link_of.get(int(link), -1) for link in capsules.link], np.int64)
        swings = problem.swing.max(axis=2) >= 0
        middle = (problem.share > TAKE_OFF) & (problem.share < 1.0 - TAKE_OFF)
        self._air = (problem.held < 0) & (middle[:, None] | ~swings)
        self._on_course = self._air & swings
        self._rows = make_strip_rows(self._num, 4, self._nv)
        self._planned_pose = np.array([kinematics.effector_poses(q)[:4] for q in problem.q])
        self.prog = MathematicalProgram()
        self._add_variables()
        self._add_internal_forces()
        self._add_tracking()
        self._add_limits()
        self._add_balance_and_clearance()
        self._add_regions()
        self._add_gatherings()
        self._add_penalties()

    # ---- the program

    def _add_variables(self) -> None:
        self.dq = self.prog.NewContinuousVariables(self._num, self._nv, "dq")
        self.dc = self.prog.NewContinuousVariables(len(self._home), 3, "dc")
        self.slack = self.prog.NewContinuousVariables(2 * self._num + len(self.problem.gatherings), "slack")
        # Drake numbers matrices of variables by columns.
        self._dq_index, self._dc_index = (
            np.array(self.prog.FindDecisionVariableIndices(v.ravel())).reshape(v.shape) for v in (self.dq, self.dc)
        )

    def _add_internal_forces(self) -> None:
        self._springs = []
        eye = np.eye(self._nv)
        stiffness = self.options.tension / np.diff(self.problem.t)
        for n, k in enumerate(stiffness):
            Q = 2.0 * k * np.block([[eye, -eye], [-eye, eye]])
            cost = self.prog.AddQuadraticCost(Q, np.zeros(2 * self._nv), np.concatenate([self.dq[n], self.dq[n + 1]]))
            cost.evaluator().set_description(f"internal forces[{n}]")
            self._springs.append((cost, Q))

    def _add_tracking(self) -> None:
        """Contacts, courses in the air and memory: one dense cost for each configuration with what it holds."""
        self._tracking: list[tuple[Binding, np.ndarray]] = []
        for n in range(self._num):
            held = np.unique(self.problem.held[n][self.problem.held[n] >= 0])
            variables = np.concatenate([self.dq[n], self.dc[held].ravel()])
            size = len(variables)
            cost = self.prog.AddQuadraticCost(np.eye(size), np.zeros(size), variables)
            cost.evaluator().set_description(f"contact[{n}]")
            self._tracking.append((cost, held))
        self._homing = []
        for c in range(len(self._home)):
            Q = 2.0 * self.options.home * np.diag([1.0, 1.0, LEVER**2])
            self._homing.append(self.prog.AddQuadraticCost(Q, np.zeros(3), self.dc[c]))

    def _add_limits(self) -> None:
        flat = self.dq.ravel()
        self._bounds = self.prog.AddBoundingBoxConstraint(-np.ones(flat.size), np.ones(flat.size), flat)
        self._bounds.evaluator().set_description("limits")

    def _add_balance_and_clearance(self) -> None:
        self._balance, self._clearance = [], []
        for n in range(self._num):
            for kind, bindings in (("balance", self._balance), ("clearance", self._clearance)):
                variables = np.append(self.dq[n], self.slack[n if kind == "balance" else self._num + n])
                row = np.zeros((1, self._nv + 1))
                row[0, -1] = 1.0
                bindings.append(self.prog.AddLinearConstraint(row, [0.0], [np.inf], variables))
                bindings[-1].evaluator().set_description(f"{kind}[{n}]")

    def _add_regions(self) -> None:
        angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
        self._sides = np.column_stack([np.cos(angles), np.sin(angles)])
        self._circles, self._contact_bounds = [], []
        for c in range(len(self._home)):
            free = np.full(SIDES, np.inf)
            circle = self.prog.AddLinearConstraint(self._sides, -free, free, self.dc[c, :2])
            circle.evaluator().set_description(f"contact region {self.problem.contacts[c].effector}[{c}]")
            self._circles.append(circle)
            bounds = self.prog.AddBoundingBoxConstraint(-np.ones(3), np.ones(3), self.dc[c])
            bounds.evaluator().set_description(f"turn {self.problem.contacts[c].effector}[{c}]")
            self._contact_bounds.append(bounds)

    def _add_gatherings(self) -> None:
        self._gatherings = []
        for g, gathering in enumerate(self.problem.gatherings):
            variables = np.append(self.dc[list(gathering.contacts), :2].ravel(), self.slack[2 * self._num + g])
            binding = self.prog.AddLinearConstraint(
                np.ones((SIDES, len(variables))), np.full(SIDES, -np.inf), np.full(SIDES, np.inf), variables
            )
            binding.evaluator().set_description(gathering.name)
            self._gatherings.append(binding)

    def _add_penalties(self) -> None:
        num = len(self.slack)
        self.prog.AddBoundingBoxConstraint(np.zeros(num), np.full(num, np.inf), self.slack)
        Q = 2.0 * ROUND * np.eye(2)
        for i in range(0, num - 1, 2):  # in pairs: a dense cost over all of them would be large
            self.prog.AddQuadraticCost(Q, np.full(2, self.options.exact_penalty), self.slack[i : i + 2])
        if num % 2:
            self.prog.AddQuadraticCost(Q[:1, :1], [self.options.exact_penalty], self.slack[-1:])

    # ---- iterations

    def solve(self) -> StripEstimate:
        """Iterates until the strip rests, does all its tasks, or time or iterations are spent.

        Where a task cannot be done the best strip so far comes back, marked, with the faults of that one.
        """
        options, began = self.options, time.process_time()
        solver = ConvexSolver(self.prog, SolverSettings(options.solver, ACCURATE, ACCURATE, accept=1e-4))
        state = first_state(self.problem)
        trust, ended_by = options.trust, "iterations"
        done: list[StripIteration] = []
        best, violations = state, self._look(state)
        least, merits = violations, [violations.merit(options.contact_weight, options.exact_penalty)]
        for _ in range(options.max_iterations):
            if time.process_time() - began > options.time_limit:
                ended_by = "time"
                break
            self._update(state, trust)
            x, record = solver.solve()
            if x is None or not record.worst < LOOSE:
                ended_by = "solver"
                break
            dq, dc = x[self._dq_index], x[self._dc_index]
            state = moved_state(state, dq, dc, self.tree, self._regions, self._circle)
            done.append(_iteration(violations, record, float(np.abs(dq).max()), time.process_time() - began))
            violations = self._look(state)
            merits.append(violations.merit(options.contact_weight, options.exact_penalty))
            if violations.total < least.total or violations.score <= 1.0:
                best, least = state, violations
            if merits[-1] > merits[-2]:
                trust = max(0.5 * trust, LEAST_TRUST)
            elif merits[-1] < PROMISING * merits[-2]:
                trust = min(2.0 * trust, options.trust)
            if _rests(violations, done[-1].step, merits):
                ended_by = "converged"
                break
        return self._estimate(best, least, tuple(done), ended_by)

    def _look(self, state: StripState) -> Violations:
        """Linearises about a state and says what is wrong there."""
        options = self.options
        linearise(
            self.tree,
            self._capsules,
            self._packed,
            self._effector_of,
            state.q,
            self._air,
            options.limb_clearance,
            options.air_clearance,
            self._rows,
        )
        self._polygons.move(state.X_WC)
        depth = np.full(self._num, np.inf)
        for n in np.flatnonzero((self.problem.support >= 0).any(axis=1)):
            polygon = self._polygons(self.problem.support[n])
            depth[n] = polygon_margin(polygon, len(polygon), self._rows.com[n, 0], self._rows.com[n, 1])
        return find_violations(self.problem, self.tree, self._rows, state.q, state.X_WC, depth)

    def _update(self, state: StripState, trust: float) -> None:
        """Writes the coefficients of the program about a state, whose rows `_look` has left."""
        planned = self.problem.q
        u = np.empty((self._num, self._nv))
        for n in range(self._num):
            difference(planned[n], state.q[n], u[n])
        for n, (cost, Q) in enumerate(self._springs):
            ends = np.concatenate([u[n], u[n + 1]])
            cost.evaluator().UpdateCoefficients(Q, Q @ ends)
        self._update_tracking(state, u)
        self._update_limits(state, trust)
        self._update_balance()
        self._update_clearance()
        self._update_contacts(state)

    def _update_tracking(self, state: StripState, u: np.ndarray) -> None:
        nv, rows = self._nv, self._rows
        hold = self.options.contact_weight * np.array([LEVER**2] * 3 + [1.0] * 3)
        for n, (cost, held) in enumerate(self._tracking):
            size = nv + 3 * len(held)
            H, g = 2.0 * self.options.memory * np.eye(size), np.zeros(size)
            H[nv:, nv:] = 0.0
            g[:nv] = 2.0 * self.options.memory * u[n]
            for e in range(4):
                c = self.problem.held[n, e]
                if c < 0 and not self._on_course[n, e]:
                    continue
                A = np.zeros((6, size))
                A[:, :nv] = rows.J_E[n, e]
                X_WC = state.X_WC[c] if c >= 0 else course_pose(self.problem, state, n, e, self._planned_pose[n, e])
                weight = hold if c >= 0 else AIR_WEIGHT / self.options.contact_weight * hold
                if c >= 0:
                    column = nv + 3 * int(np.searchsorted(held, c))
                    A[:3, column + 2] = -X_WC[:3, 2]
                    A[3:, column : column + 2] = -X_WC[:3, :2]
                error = frame_error(rows.R_WE[n, e], rows.p_WE[n, e], X_WC)
                H += 2.0 * A.T @ (weight[:, None] * A)
                g -= 2.0 * A.T @ (weight * error)
            cost.evaluator().UpdateCoefficients(H, g, 0.0, True)

    def _update_limits(self, state: StripState, trust: float) -> None:
        """Bounds on all changes; a joint that the plan brings nearer to its limit than the reserve may stay there."""
        lower, upper = np.full((self._num, self._nv), -trust), np.full((self._num, self._nv), trust)
        joints, planned = state.q[:, 7:], self.problem.q[:, 7:]
        reserve = np.minimum(self.options.reserve, 0.1 * (self.tree.upper - self.tree.lower))
        low = np.clip(np.minimum(self.tree.lower + reserve, planned), self.tree.lower, self.tree.upper)
        high = np.clip(np.maximum(self.tree.upper - reserve, planned), self.tree.lower, self.tree.upper)
        lower[:, 6:] = np.minimum(np.maximum(lower[:, 6:], low - joints), trust)
        upper[:, 6:] = np.maximum(np.minimum(upper[:, 6:], high - joints), lower[:, 6:])
        self._bounds.evaluator().UpdateLowerBound(lower.ravel())
        self._bounds.evaluator().UpdateUpperBound(upper.ravel())

    def _update_balance(self) -> None:
        """a . (com + J dq) <= b - margin + slack for the edges of what carries; nothing where that is no polygon."""
        for n, binding in enumerate(self._balance):
            A, bound = edge_rows(self._polygons(self.problem.support[n]), self.options.margin)
            room = bound - A @ self._rows.com[n, :2]
            rows = np.zeros((len(A) + 1, self._nv + 1))
            rows[:-1, :-1], rows[:, -1] = -A @ self._rows.J_com[n], 1.0
            upper = np.full(len(rows), np.inf)
            binding.evaluator().UpdateCoefficients(rows, np.append(-room, 0.0), upper)

    def _update_clearance(self) -> None:
        """gap + J dq + slack >= 0 for the distances that are near or short."""
        for n, binding in enumerate(self._clearance):
            count = int(self._rows.count[n])
            rows = np.zeros((count + 1, self._nv + 1))
            rows[:count, :-1], rows[:, -1] = self._rows.J_gap[n, :count], 1.0
            lower = np.append(-self._rows.gap[n, :count], 0.0)
            binding.evaluator().UpdateCoefficients(rows, lower, np.full(len(rows), np.inf))

    def _update_contacts(self, state: StripState) -> None:
        """Each contact keeps to a circle that holds it and gives it room to go on, to its turn and its trust region."""
        trust, turn = self.options.trust_contact, self.options.turn
        for c, contact in enumerate(self.problem.contacts):
            X_WC = state.X_WC[c]
            index = self._regions[c].furthest_along(X_WC, state.way[c])
            if index < 0:
                index, _ = self._regions[c].nearest(X_WC)
            self._circle[c] = index
            offset = X_WC[:3, :2].T @ (X_WC[:3, 3] - self._regions[c].X_WR[index, :3, 3])
            # An inscribed polygon; a contact on the circle's rim may stay there.
            reach = np.maximum(np.cos(np.pi / SIDES) * self._regions[c].radius[index], self._sides @ offset)
            self._circles[c].evaluator().UpdateUpperBound(reach - self._sides @ offset)
            most = np.array([trust, trust, max(turn - state.turned[c], 0.0) if is_foot(contact.effector) else 0.0])
            least = np.array([-trust, -trust, min(-turn - state.turned[c], 0.0) if is_foot(contact.effector) else 0.0])
            self._contact_bounds[c].evaluator().UpdateLowerBound(least)
            self._contact_bounds[c].evaluator().UpdateUpperBound(most)
            away = np.append(X_WC[:3, :2].T @ (X_WC[:3, 3] - self._home[c, :3, 3]), state.turned[c])
            Q = self._homing[c].evaluator().Q()
            self._homing[c].evaluator().UpdateCoefficients(Q, Q @ away)
        for gathering, binding in zip(self.problem.gatherings, self._gatherings, strict=True):
            index = list(gathering.contacts)
            mean = state.X_WC[index, :2, 3].mean(axis=0) - np.array(gathering.xy)
            A = np.zeros((SIDES, 2 * len(index) + 1))
            for i, c in enumerate(index):
                A[:, 2 * i : 2 * i + 2] = self._sides @ state.X_WC[c, :2, :2] / len(index)
            A[:, -1] = -1.0
            reach = np.cos(np.pi / SIDES) * gathering.radius - self._sides @ mean
            free = np.full(SIDES, -np.inf)
            binding.evaluator().UpdateCoefficients(A, free, reach)

    def _estimate(
        self, state: StripState, violations: Violations, iterations: tuple[StripIteration, ...], ended_by: str
    ) -> StripEstimate:
        contacts = tuple(
            replace(c, X_WC=X_WC, heading=contact_heading(X_WC) if is_foot(c.effector) else c.heading)
            for c, X_WC in zip(self.problem.contacts, state.X_WC, strict=True)
        )
        faults = strip_faults(self.problem, violations)
        more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
        reason = f"the strip breaks: {faults[0]}{more}" if faults else ""
        return StripEstimate(not faults, reason, state.q, contacts, faults, iterations, ended_by)


def _iteration(before: Violations, record: SolveRecord, step: float, elapsed: float) -> StripIteration:
    return StripIteration(
        float(before.contact.max(initial=0.0)),
        float(before.balance.max()),
        float(before.clearance.max()),
        record.cost,
        step,
        record.solver,
        record.time,
        elapsed,
    )


def _rests(violations: Violations, step: float, merits: list[float]) -> bool:
    """Whether another iteration would change nothing that matters: no step, all tasks done well, or no progress."""
    if step < SETTLED:
        return True
    if violations.score <= 1.0:
        return step < DONE and violations.contact.max(initial=0.0) < WELL_HELD
    return len(merits) > STALLED and merits[-1] > IDLE * merits[-1 - STALLED]
