"""Recomputes centroidal trajectories exactly from their forces, for `optimization.convex.sequential_convex`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from optimization.balance.contact_wrench import pressure_residuals
from optimization.centroidal.options import ARM, LEAST_PRESSURE_LOAD, PENALTY, UP
from optimization.centroidal.trajectory import CentroidalState

if TYPE_CHECKING:
    from optimization.centroidal.program import CentroidalProgram


@dataclass(frozen=True, eq=False)
class CentroidalPoint:
    """A trajectory given by its forces, with its true merit (see `gauss_newton.Point`).

    Attributes:
        forces: (J, 4, 3) admissible corner forces [M g] in the contact frames.
        wrench: (J, 6) contact wrenches in their frames [M g, M g ARM].
        state: the trajectory that they bring about.
        effort: scaled cost without the pull towards a CoM reference.
        violation: sum of the slacks that the penalised constraints need.
        merit: cost, pull included, plus penalty.
    """

    forces: np.ndarray
    wrench: np.ndarray
    state: CentroidalState
    effort: float
    violation: float
    merit: float


class CentroidalModel:
    """A centroidal program as `gauss_newton.minimise` sees it."""

    def __init__(self, program: CentroidalProgram) -> None:
        self.program = program

    def evaluate(self, x: np.ndarray) -> CentroidalPoint:
        """The exact trajectory of the corner forces in x, cut back to their cones: every wrench is admissible."""
        program = self.program
        forces = x[program.index["force"]].reshape(-1, 4, 3)
        return self._point(program.corners.project(forces))

    def between(self, start: CentroidalPoint, end: CentroidalPoint, step: float) -> CentroidalPoint:
        """The trajectory of the forces at this part of the way."""
        return self._point(start.forces + step * (end.forces - start.forces))

    def distance(self, start: CentroidalPoint, end: CentroidalPoint) -> float:
        """The greatest change of the CoM along any axis [m]."""
        return float(np.abs(end.state.com - start.state.com).max())

    def linearise(self, point: CentroidalPoint) -> None:
        """Updates the convex program about this point."""
        self.program.linearise(point.state.com, point.state.total_force, point.wrench)

    def trust(self, point: CentroidalPoint, radius: float) -> None:
        """Keeps every CoM within `radius` [m] per axis of this point's."""
        self.program.bound_step(point.state.com, radius)

    def _point(self, forces: np.ndarray) -> CentroidalPoint:
        program = self.program
        wrench = program.corners.wrench(forces)
        state = program.integrator.integrate(wrench[:, :3], ARM * wrench[:, 3:])
        x = program_values(program, wrench, state)
        costs = program.cost_diagonal * (x - program.cost_target) ** 2
        cost, pull = float(costs.sum()), float(costs[program.index["com"]].sum())
        violation = self._violation(state)
        return CentroidalPoint(forces, wrench, state, cost - pull, violation, cost + PENALTY * violation)

    def _violation(self, state: CentroidalState) -> float:
        """Sum over the knots of the slack s that the trajectory needs, and s_end."""
        program = self.program
        slack = np.zeros(len(program.dt))
        for value, limit in zip((state.k, state.k_rate), program.momentum_limits, strict=True):
            slack = np.maximum(slack, (np.abs(value) / ARM - limit).max(axis=1))
        knot, points, limit = program.reach
        np.maximum.at(slack, knot, (np.linalg.norm(state.com[knot] - points, axis=1) - limit) / ARM)
        at_end = np.abs(state.k[-2:]).max() / ARM if program.options.rest_at_end else 0.0
        return float(slack.sum() + at_end)


def program_values(program: CentroidalProgram, wrench: np.ndarray, state: CentroidalState) -> np.ndarray:
    """(n,) values of a program's variables under contact wrenches (J, 6) and the motion that they bring about.

    Corner forces and slacks are left 0: they cost nothing.
    """
    z, _ = pressure_residuals(wrench, program.half, ARM, LEAST_PRESSURE_LOAD)
    x = np.zeros(program.num_vars)
    for name, value in (
        ("com", state.com - program.origin),
        ("v", state.velocity),
        ("k", state.k / ARM),
        ("a", state.total_force - UP),
        ("kdot", state.k_rate / ARM),
        ("wrench", wrench),
        ("z", z),
    ):
        x[program.index[name]] = value
    return x
