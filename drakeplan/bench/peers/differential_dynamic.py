"""The centroidal problem for crocoddyl: differential dynamic programming over the plan file's difference equations.

A peer: cost and dynamics are written out once more, with derivatives by CasADi, one action model for each interval.
Controls are corner forces. Of inequalities crocoddyl has bounds on controls alone, so cones, limits on momentum, height,
reach and the end cost a quadratic penalty that grows steeper. Both packages are optional (extra `peers`).
"""

from __future__ import annotations

import importlib.util
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from scenes.effector import EFFECTORS

INSTALL = "crocoddyl or casadi is not installed: pip install crocoddyl casadi, or the extra 'peers'"
NOTE = ("crocoddyl: limits are penalties, so its violation is not zero; its models are callbacks in Python, so its time is"
        " no measure of its C++.")  # fmt: skip
GRAVITY = 9.81  # [m/s^2]
UP = np.array([0.0, 0.0, 1.0])
ARM = 0.05  # [m] moments are counted in M g ARM
SCALE = 1e-3  # of the cost
PENALTIES = (1.0, 30.0, 1e3, 3e4)  # on squared violations [scaled cost], one after another
LEAST_LOAD = 0.01  # [M g] a pressure centre in the cost is that of at least this load
REDUNDANT = 1e-6  # [scaled cost] on controls: four corner forces make one wrench in many ways
ITERATIONS = 100  # for each penalty


def available() -> bool:
    """Whether crocoddyl and CasADi are installed and their shared libraries load."""
    if importlib.util.find_spec("crocoddyl") is None or importlib.util.find_spec("casadi") is None:
        return False
    try:
        import crocoddyl  # noqa: F401  # pyright: ignore[reportMissingImports]
    except (ImportError, OSError):  # pragma: no cover - a broken wheel
        return False
    return True


@dataclass(frozen=True, eq=False)
class DynamicAnswer:
    """What differential dynamic programming found.

    Attributes:
        converged: as crocoddyl reports.
        cost: the objective of Lin 2020 sec. 6.3, without penalties.
        time: seconds in its solver.
        x: states and corner forces, as `interior_point.InteriorPoint.judge` reads them.
    """

    converged: bool
    cost: float
    time: float
    x: np.ndarray


class _Interval:
    """Next state and residuals of one interval as CasADi functions, with their Jacobians."""

    def __init__(self, problem: CentroidalProblem, options: CentroidalOptions, n: int) -> None:
        import casadi as ca  # optional: nobody but the one who asks for it needs it

        schedule, mass = problem.schedule, problem.mass
        self.held = [schedule.contacts[c] for c in schedule.active[n] if c >= 0]
        following = schedule.active[min(n + 1, len(schedule.active) - 1)]
        near = {*self.held, *(schedule.contacts[c] for c in following if c >= 0)}
        dt, unit, w = float(schedule.dt[n]), mass * GRAVITY * ARM, options.weights
        x, u = ca.SX.sym("x", 9), ca.SX.sym("u", max(12 * len(self.held), 1))
        steep = ca.SX.sym("steep")
        wrenches = [self._wrench(ca, problem, j, u) for j in range(len(self.held))]
        total = sum((c.R_WC @ f for c, (f, _) in zip(self.held, wrenches, strict=True)), ca.SX.zeros(3))
        l_rate = total - ca.DM([0, 0, 1])
        v = x[3:6] + dt * GRAVITY * l_rate
        com = x[0:3] + dt * v
        rate = ca.SX.zeros(3)
        for c, (f, m) in zip(self.held, wrenches, strict=True):
            rate += ca.cross(c.p_WC - com, c.R_WC @ f) / ARM + c.R_WC @ m
        k = x[6:9] + dt * rate
        roots = [np.sqrt(weight) for weight in (w.linear_momentum, w.linear_momentum_rate, w.angular_momentum,
                                                w.angular_momentum_rate)]  # fmt: skip
        effort = [roots[0] * mass * v, roots[1] * mass * GRAVITY * l_rate, roots[2] * unit * k, roots[3] * unit * rate]
        limits = self._cones(u)
        for c, (f, m) in zip(self.held, wrenches, strict=True):
            e = EFFECTORS.index(c.effector)
            hx, hy = problem.half_extent[e]
            load = ca.fmax(f[2], LEAST_LOAD)
            effort += [w.force**0.5 * f, w.lateral_force**0.5 * f[0:2]]
            effort += [w.torque**0.5 * unit * (m[2] + (m[0] * f[0] + m[1] * f[1]) / load)]
            effort += [w.pressure_centre**0.5 * ARM / 2 * ca.vertcat(-m[1] / hx, m[0] / hy) / load]
            limits.append(f[2] - options.force_limit[e])
        for c in near:
            limits.append(ca.norm_2(com - c.p_WC) - options.com_reach[EFFECTORS.index(c.effector)])
        for value, limit in ((k, options.angular_momentum_limit), (rate, options.angular_momentum_rate_limit)):
            limits += [ca.fabs(value) - np.array(limit) / unit]
        limits += self._places(ca, problem, options, n, com)
        ends = ca.vertcat(v, k) if options.rest_at_end and n >= len(schedule.dt) - 2 else ca.SX.zeros(0)
        scale = np.sqrt(SCALE * dt / 0.2)
        penalised = steep * ca.vertcat(*(ca.fmax(limit, 0) for limit in limits), ends)
        self.effort = ca.Function("effort", [x, u], [ca.sumsqr(ca.vertcat(*effort)) * dt / 0.2])
        following_x, residual = ca.vertcat(com, v, k), ca.vertcat(scale * ca.vertcat(*effort), penalised)
        self.calc = ca.Function("calc", [x, u, steep], [following_x, residual])
        jacobians = [ca.densify(ca.jacobian(a, b)) for a in (following_x, residual) for b in (x, u)]
        self.jacobian = ca.Function("jacobian", [x, u, steep], jacobians)

    def _wrench(self, ca: Any, problem: CentroidalProblem, j: int, u: Any) -> tuple[Any, Any]:
        """Force [M g] and moment [M g ARM] of the j-th contact in its frame."""
        hx, hy = problem.half_extent[EFFECTORS.index(self.held[j].effector)]
        f, m = ca.SX.zeros(3), ca.SX.zeros(3)
        for i, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
            corner = u[12 * j + 3 * i : 12 * j + 3 * i + 3]
            f += corner
            m += ca.cross(ca.DM([sx * hx / ARM, sy * hy / ARM, 0]), corner)
        return f, m

    def _places(self, ca: Any, problem: CentroidalProblem, options: CentroidalOptions, n: int, com: Any) -> list[Any]:
        """By how much the CoM leaves its heights, and at the end its box."""
        feet = [c.p_WC for c in self.held if c.effector.endswith("foot")]
        low, nominal, high = options.com_height
        out = []
        if feet:
            ground = np.mean(feet, axis=0)
            out += [ground[2] + low - com[2], com[2] - ground[2] - high]
            if n == len(problem.schedule.dt) - 1 and options.final_half_width is not None:
                out += [ca.fabs(com - (ground + nominal * UP)) - np.array(options.final_half_width)]
        return out

    def _cones(self, u: Any) -> list[Any]:
        """By how much each corner force leaves each face of the octagon in its friction cone."""
        out = []
        for j, contact in enumerate(self.held):
            for i in range(4):
                corner = u[12 * j + 3 * i : 12 * j + 3 * i + 3]
                for angle in (np.arange(8) + 0.5) * np.pi / 4:
                    face = np.array([np.cos(angle), np.sin(angle), -contact.friction * np.cos(np.pi / 8)])
                    out.append(face[0] * corner[0] + face[1] * corner[1] + face[2] * corner[2])
        return out

    def standing(self) -> np.ndarray:
        """(12 J,) corner forces that share the weight evenly."""
        parts = [np.tile(contact.R_WC[2] / (4 * len(self.held)), 4) for contact in self.held]
        return np.concatenate([np.zeros(0), *parts])


def solve(problem: CentroidalProblem, options: CentroidalOptions) -> DynamicAnswer:
    """Solves with FDDP from rest over the feet, the penalties growing.

    Args:
        problem: without references for CoM or angular momentum.
        options: cone `inner`; every interval has a foot in contact.
    """
    import crocoddyl  # pyright: ignore[reportMissingImports]

    state = crocoddyl.StateVector(9)

    class Action(crocoddyl.ActionModelAbstract):
        """One interval."""

        def __init__(self, interval: _Interval) -> None:
            super().__init__(state, 12 * len(interval.held), 0)
            self.interval, self.steep = interval, 1.0

        def calc(self, data: Any, x: np.ndarray, u: np.ndarray | None = None) -> None:
            if u is None:  # the last node: nothing is asked of it
                data.xnext, data.cost = x, 0.0
                return
            following, residual = self.interval.calc(x, u, self.steep)
            data.xnext = np.asarray(following).ravel()
            data.cost = float(np.sum(np.asarray(residual) ** 2))

        def calcDiff(self, data: Any, x: np.ndarray, u: np.ndarray | None = None) -> None:
            if u is None:
                return
            residual = np.asarray(self.interval.calc(x, u, self.steep)[1]).ravel()
            data.Fx, data.Fu, rx, ru = (np.asarray(part) for part in self.interval.jacobian(x, u, self.steep))
            data.Lx, data.Lu = 2 * rx.T @ residual, 2 * ru.T @ residual
            data.Lxx, data.Luu, data.Lxu = 2 * rx.T @ rx, 2 * ru.T @ ru + REDUNDANT * np.eye(self.nu), 2 * rx.T @ ru

    unit = problem.mass * GRAVITY * ARM
    initial = np.concatenate([problem.initial_com, problem.initial_linear_momentum / problem.mass,
                              problem.initial_angular_momentum / unit])  # fmt: skip
    intervals = [_Interval(problem, options, n) for n in range(len(problem.schedule.dt))]
    models = [Action(interval) for interval in intervals]
    shooting = crocoddyl.ShootingProblem(initial, models, models[-1])
    solver = crocoddyl.SolverFDDP(shooting)
    xs, controls = [initial], [interval.standing() for interval in intervals]
    for interval in intervals:  # at rest over the feet that carry
        ground = np.mean([c.p_WC for c in interval.held if c.effector.endswith("foot")], axis=0)
        xs.append(np.concatenate([ground + options.com_height[1] * UP, np.zeros(6)]))
    began = time.perf_counter()
    converged = False
    for penalty in PENALTIES:
        for model in models:
            model.steep = np.sqrt(penalty)
        converged = solver.solve(xs, controls, ITERATIONS, False)
        xs, controls = solver.xs.tolist(), solver.us.tolist()
    elapsed = time.perf_counter() - began
    parts, cost = [], 0.0
    for interval, x0, x1, u in zip(intervals, solver.xs[:-1], solver.xs[1:], solver.us, strict=False):
        x1 = np.asarray(x1)
        parts += [x1, np.asarray(u)]
        cost += float(interval.effort(x0, u))
    return DynamicAnswer(bool(converged), cost, elapsed, np.concatenate(parts))
