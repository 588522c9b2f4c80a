"""The centroidal problem as a nonlinear program with exact derivatives, solved by IPOPT through CasADi: a peer.

Written from Lin 2020 eq. 6.3 to 6.5 and the plan file's difference equations alone: it shares no code with the program
that it is compared with, and knows neither linearisation nor slack. CasADi is optional (extra `peers`).

Variables for each interval: CoM, velocity l / M and angular momentum k / (M g ARM) at its end, and four corner forces
[M g] for each contact, in its frame.
"""

from __future__ import annotations

import importlib.util
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.trajectory import CentroidalTrajectory
from scenes.effector import EFFECTORS

INSTALL = "casadi is not installed: pip install casadi, or the extra 'peers'"
GRAVITY = 9.81  # [m/s^2]
ARM = 0.05  # [m] moments are counted in M g ARM
SCALE = 1e-3  # of the cost
LEAST_LOAD = 0.01  # [M g] a pressure centre in the cost is that of at least this load
HOLDS = 1e-5  # [scaled units] violation up to which an answer counts
CORNERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))
FACES = {"inner": (8, 0.0, 1.0), "square": (4, np.pi / 4, 1.0), "diamond": (4, 0.0, np.sqrt(2.0))}
SETTINGS = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.max_iter": 300, "ipopt.tol": 1e-7,
            "ipopt.constr_viol_tol": 1e-7, "ipopt.bound_relax_factor": 0.0,
            "ipopt.expect_infeasible_problem": "yes"}  # fmt: skip


def available() -> bool:
    """Whether CasADi is installed."""
    return importlib.util.find_spec("casadi") is not None


@dataclass(frozen=True, eq=False)
class PeerAnswer:
    """The result of the interior-point solver.

    Attributes:
        feasible: whether its last iterate satisfies every constraint to `HOLDS`.
        cost: the objective of Lin 2020 sec. 6.3 there.
        violation: greatest violation [scaled units].
        time: seconds in IPOPT.
        x: the last iterate.
    """

    feasible: bool
    cost: float
    violation: float
    time: float
    x: np.ndarray


@dataclass(frozen=True, eq=False)
class _Data:
    """A problem's numbers; as arrays of numbers, or of CasADi's symbols in the same places.

    Attributes:
        body: mass [kg] and M g ARM.
        initial: com [m], v [m/s] and k / (M g ARM) at knot 0, then the centre of the final box [m].
        dt: (N,) lengths of the intervals [s].
        height: (2 N,) least and greatest heights of the CoM [m].
        contacts: (17 C,) point, orientation by rows, friction, half extents, reach and force limit of each contact.
    """

    body: Any
    initial: Any
    dt: Any
    height: Any
    contacts: Any


def _numbers(problem: CentroidalProblem, options: CentroidalOptions) -> _Data:
    schedule, mass = problem.schedule, problem.mass
    unit = mass * GRAVITY * ARM
    ground = []
    for row in schedule.active:
        feet = [schedule.contacts[c].p_WC for c in row[:2] if c >= 0]
        ground.append(np.mean(feet, axis=0) if feet else np.full(3, np.nan))
    known = [g for g in ground if np.isfinite(g[0])]
    low, nominal, high = options.com_height
    heights = [(g[2] + low, g[2] + high) if np.isfinite(g[2]) else (-1e3, 1e3) for g in ground]
    final = known[-1] + [0, 0, nominal] if known else np.zeros(3)
    contacts = []
    for c in schedule.contacts:
        e = EFFECTORS.index(c.effector)
        own = [c.friction, *problem.half_extent[e], options.com_reach[e], options.force_limit[e]]
        contacts.append(np.concatenate([c.p_WC, c.R_WC.ravel(), own]))
    velocity = problem.initial_linear_momentum / mass
    initial = np.concatenate([problem.initial_com, velocity, problem.initial_angular_momentum / unit, final])
    return _Data(np.array([mass, unit]), initial, schedule.dt, np.array(heights).ravel(), np.concatenate(contacts))


def _vector(data: _Data) -> np.ndarray:
    return np.concatenate([data.body, data.initial, data.dt, data.height, data.contacts])


class InteriorPoint:
    """The nonlinear program of one contact structure; poses, friction, mass and states are parameters."""

    def __init__(self, problem: CentroidalProblem, options: CentroidalOptions, *, with_cost: bool = True) -> None:
        """Builds the program.

        Args:
            problem: any problem of that structure, without references for CoM or angular momentum.
            options: limits, weights and a polyhedral cone.
            with_cost: False for the question of feasibility alone.
        """
        import casadi as ca  # optional: nobody but the one who asks for it needs it

        self._ca, self.options = ca, options
        self.active = problem.schedule.active
        numbers = _numbers(problem, options)
        parts = {name: ca.SX.sym(name, len(getattr(numbers, name))) for name in numbers.__dataclass_fields__}
        self._data = _Data(**parts)
        self._states: list[Any] = []
        self._forces: list[Any] = []
        self._rows: list[Any] = []
        self._bounds: list[tuple[float, float]] = []
        cost = self._dynamics()
        self._at_the_end()
        x = ca.vertcat(*(part for n in range(len(self.active)) for part in (self._states[n], self._forces[n])))
        p, g = ca.vertcat(*parts.values()), ca.vertcat(*self._rows)
        self._functions = ca.Function("functions", [x, p], [cost / SCALE, g])
        nlp = {"x": x, "p": p, "f": cost if with_cost else 0, "g": g}
        self._solver = ca.nlpsol("peer", "ipopt", nlp, SETTINGS)
        self.lower, self.upper = np.array(self._bounds).T

    def _add(self, expression: Any, low: float, high: float) -> None:
        parts = self._ca.vertsplit(expression)
        self._rows += parts
        self._bounds += [(low, high)] * len(parts)

    def _dynamics(self) -> Any:
        """Everything that holds in each interval; returns the scaled cost."""
        ca, data = self._ca, self._data
        mass, unit = data.body[0], data.body[1]
        com, v, k = data.initial[0:3], data.initial[3:6], data.initial[6:9]
        limits = (self.options.angular_momentum_limit, self.options.angular_momentum_rate_limit)
        w, cost = self.options.weights, 0.0
        for n, row in enumerate(self.active):
            dt, state = data.dt[n], ca.SX.sym(f"state{n}", 9)
            self._states.append(state)
            com1, v1, k1 = state[0:3], state[3:6], state[6:9]
            total, rate, effort = self._contacts(n, [int(c) for c in row if c >= 0], com1)
            l_rate = total - ca.DM([0, 0, 1])  # over M g
            self._add(v1 - v - dt * GRAVITY * l_rate, 0, 0)
            self._add(com1 - com - dt * v1, 0, 0)
            self._add(k1 - k - dt * rate, 0, 0)
            for value, limit in zip((k1, rate), limits, strict=True):
                for i in np.flatnonzero(np.isfinite(limit)):
                    self._add(value[int(i)] - limit[i] / unit, -np.inf, 0)
                    self._add(-value[int(i)] - limit[i] / unit, -np.inf, 0)
            self._add(data.height[2 * n] - com1[2], -np.inf, 0)
            self._add(com1[2] - data.height[2 * n + 1], -np.inf, 0)
            effort += w.linear_momentum * ca.sumsqr(mass * v1)
            effort += w.linear_momentum_rate * ca.sumsqr(mass * GRAVITY * l_rate)
            effort += w.angular_momentum * ca.sumsqr(unit * k1) + w.angular_momentum_rate * ca.sumsqr(unit * rate)
            cost += SCALE * dt / 0.2 * effort
            com, v, k = com1, v1, k1
        return cost

    def _contacts(self, n: int, held: list[int], com: Any) -> tuple[Any, Any, Any]:
        """Total force [M g] and moment about the CoM [M g ARM] of an interval's contacts, and what they cost."""
        ca, w = self._ca, self.options.weights
        total, rate, effort = ca.SX.zeros(3), ca.SX.zeros(3), 0.0
        following = {int(c) for c in self.active[min(n + 1, len(self.active) - 1)] if c >= 0}
        for c in {*held, *following}:
            own = self._data.contacts[17 * c : 17 * (c + 1)]
            self._add(ca.sumsqr(com - own[0:3]) - own[15] ** 2, -np.inf, 0)
        forces = ca.SX.sym(f"forces{n}", 12 * len(held))
        self._forces.append(forces)
        for j, c in enumerate(held):
            own = self._data.contacts[17 * c : 17 * (c + 1)]
            p, R, mu, half = own[0:3], ca.reshape(own[3:12], 3, 3).T, own[12], own[13:15]
            f, m = ca.SX.zeros(3), ca.SX.zeros(3)
            for i, (sx, sy) in enumerate(CORNERS):
                corner = forces[12 * j + 3 * i : 12 * j + 3 * i + 3]
                count, first, radius = FACES[self.options.cone]
                for a in first + 2 * np.pi * (np.arange(count) + 0.5) / count:
                    apothem = radius * np.cos(np.pi / count) * mu
                    self._add(np.cos(a) * corner[0] + np.sin(a) * corner[1] - apothem * corner[2], -np.inf, 0)
                self._add(-corner[2], -np.inf, 0)
                f += corner
                m += ca.cross(ca.vertcat(sx * half[0], sy * half[1], 0), corner) / ARM
            self._add(f[2] - own[16], -np.inf, 0)
            total += R @ f
            rate += ca.cross(p - com, R @ f) / ARM + R @ m
            load = ca.fmax(f[2], LEAST_LOAD)
            torque = self._data.body[1] * (m[2] + (m[0] * f[0] + m[1] * f[1]) / load)
            cop = ARM * ca.vertcat(-m[1] / half[0], m[0] / half[1]) / (2 * load)
            effort += w.force * ca.sumsqr(f) + w.lateral_force * ca.sumsqr(f[0:2])
            effort += w.torque * torque**2 + w.pressure_centre * ca.sumsqr(cop)
        return total, rate, effort

    def _at_the_end(self) -> None:
        last = self._states[-1]
        for i, half in enumerate(self.options.final_half_width or ()):
            self._add(last[i] - self._data.initial[9 + i], -half, half)
        if self.options.rest_at_end:
            for state in self._states[-2:]:
                self._add(state[3:9], 0, 0)

    def guess(self, problem: CentroidalProblem, rng: np.random.Generator | None = None) -> np.ndarray:
        """A straight CoM course to the last feet with the weight shared evenly.

        Args:
            problem: of this program's structure.
            rng: perturbs the guess at random; None: no perturbation.
        """
        data = _numbers(problem, self.options)
        start, end = data.initial[:3], data.initial[9:12]
        parts = []
        for n, row in enumerate(self.active):
            held = [int(c) for c in row if c >= 0]
            part = (n + 1) / len(self.active)
            com = start + part * (end - start)
            scatter = rng.normal(0, 1, 9 + 12 * len(held)) if rng is not None else np.zeros(9 + 12 * len(held))
            up = [problem.schedule.contacts[c].R_WC[2] / (4 * len(held)) for c in held]
            forces = np.concatenate([np.zeros(0), *(np.tile(f, 4) for f in up)])
            spread = np.concatenate([np.full(3, 0.08), np.full(3, 0.2), np.full(3, 0.3), np.full(len(forces), 0.03)])
            parts += [com, np.zeros(6), forces]
            parts[-3:] = [np.concatenate(parts[-3:]) + spread * scatter]
        return np.concatenate(parts)

    def solve(self, problem: CentroidalProblem, x0: np.ndarray) -> PeerAnswer:
        """Solves the program from a first guess.

        Args:
            problem: of this program's structure.
            x0: the guess [scaled units].
        """
        data = _vector(_numbers(problem, self.options))
        started = time.perf_counter()
        answer = self._solver(x0=x0, p=data, lbg=self.lower, ubg=self.upper)
        elapsed = time.perf_counter() - started
        x = np.asarray(answer["x"]).ravel()
        cost, violation = self.judge(problem, x)
        return PeerAnswer(violation <= HOLDS, cost, violation, elapsed, x)

    def judge(self, problem: CentroidalProblem, x: np.ndarray) -> tuple[float, float]:
        """Cost and greatest violation [scaled units] of given variables.

        Args:
            problem: of this program's structure.
            x: the variables [scaled units].
        """
        cost, _ = self._functions(x, _vector(_numbers(problem, self.options)))
        g = self.rows(problem, x)
        excess = np.max(np.maximum(self.lower - g, g - self.upper), initial=0.0)
        return float(cost), float(excess) if np.isfinite(g).all() else np.inf

    def rows(self, problem: CentroidalProblem, x: np.ndarray) -> np.ndarray:
        """(m,) values of the constraints [scaled units], to lie between `lower` and `upper`.

        Args:
            problem: of this program's structure.
            x: the variables [scaled units].
        """
        _, g = self._functions(x, _vector(_numbers(problem, self.options)))
        return np.asarray(g).ravel()

    def from_trajectory(self, problem: CentroidalProblem, trajectory: CentroidalTrajectory) -> np.ndarray:
        """The variables of a trajectory, as a first guess; each wrench is spread over its corners by least squares.

        Args:
            problem: of this program's structure.
            trajectory: over the same knots.
        """
        weight, parts = problem.mass * GRAVITY, []
        for n, row in enumerate(self.active):
            state = (trajectory.com[n + 1], trajectory.linear_momentum[n + 1] / problem.mass)
            parts += [*state, trajectory.angular_momentum[n + 1] / (weight * ARM)]
            for e in np.flatnonzero(row >= 0):
                f = problem.schedule.contacts[row[e]].R_WC.T @ trajectory.force_W[n, e] / weight
                moment = np.cross([*trajectory.cop_C[n, e], 0.0], f)
                moment[2] += trajectory.torque_n[n, e] / weight
                hx, hy = problem.half_extent[e]
                corners = [(sx * hx, sy * hy, 0.0) for sx, sy in CORNERS]
                lever = [np.cross(np.tile(c, (3, 1)), np.eye(3)).T for c in corners]
                sums = np.vstack([np.tile(np.eye(3), 4), np.hstack(lever)])
                parts.append(np.linalg.lstsq(sums, np.concatenate([f, moment]), rcond=None)[0])
        return np.concatenate(parts)
