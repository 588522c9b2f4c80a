"""Recomputes centroidal trajectories exactly from their forces, for `optimization.convex.sequential_convex`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from optimization.balance.contact_wrench import pressure_residuals
from optimization.centroidal.data import CentroidalData
from optimization.centroidal.options import ARM, LEAST_PRESSURE_LOAD, PENALTY, UP
from optimization.centroidal.trajectory import CentroidalState


@dataclass(frozen=True, eq=False)
class CentroidalPoint:
    """A trajectory given by its forces, with its true merit (see `sequential_convex.Point`).

    Attributes:
        forces: (J, V, 3) admissible corner forces [M g] in the contact frames.
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
    """A centroidal program as `sequential_convex.minimise` sees it.

    Args:
        data: the program's numbers.
        linearise: linearises the convex program about CoM (N-1, 3) [m], total force (N-1, 3) [M g] and contact wrenches
            (J, 6) [M g, M g ARM].
        bound_step: keeps the CoM within a distance [m] per axis of a path (N-1, 3) [m].
    """

    def __init__(
        self,
        data: CentroidalData,
        linearise: Callable[[np.ndarray, np.ndarray, np.ndarray], None],
        bound_step: Callable[[np.ndarray, float], None],
    ) -> None:
        self._data, self._linearise, self._bound_step = data, linearise, bound_step

    def evaluate(self, x: np.ndarray) -> CentroidalPoint:
        """The exact trajectory of the corner forces in x, cut back to their cones: every wrench is admissible."""
        forces = x[self._data.index["force"]].reshape(-1, self._data.corners.count, 3)
        return self._point(self._data.corners.project(forces))

    def between(self, start: CentroidalPoint, end: CentroidalPoint, step: float) -> CentroidalPoint:
        """The trajectory of the forces at this part of the way.

        Args:
            start, end: two trajectories.
            step: part of the way from start to end, 0 to 1.
        """
        return self._point(start.forces + step * (end.forces - start.forces))

    def distance(self, start: CentroidalPoint, end: CentroidalPoint) -> float:
        """The greatest change of the CoM along any axis [m].

        Args:
            start, end: two trajectories.
        """
        return float(np.abs(end.state.com - start.state.com).max())

    def linearise(self, point: CentroidalPoint) -> None:
        """Updates the convex program about this point."""
        self._linearise(point.state.com, point.state.total_force, point.wrench)

    def trust(self, point: CentroidalPoint, radius: float) -> None:
        """Keeps every CoM within `radius` [m] per axis of this point's.

        Args:
            point: the trajectory to stay near.
            radius: per axis [m].
        """
        self._bound_step(point.state.com, radius)

    def _point(self, forces: np.ndarray) -> CentroidalPoint:
        data = self._data
        wrench = data.corners.wrench(forces)
        state = data.integrator.integrate(wrench[:, :3], ARM * wrench[:, 3:])
        x = program_values(data, wrench, state)
        costs = data.cost_diagonal * (x - data.cost_target) ** 2
        cost, pull = float(costs.sum()), float(costs[data.index["com"]].sum())
        violation = self._violation(state)
        return CentroidalPoint(forces, wrench, state, cost - pull, violation, cost + PENALTY * violation)

    def _violation(self, state: CentroidalState) -> float:
        """Sum over the knots of the slack s that the trajectory needs, and s_end."""
        data = self._data
        slack = np.zeros(len(data.dt))
        for value, limit in zip((state.k, state.k_rate), data.momentum_limits, strict=True):
            slack = np.maximum(slack, (np.abs(value) / ARM - limit).max(axis=1))
        knot, points, limit = data.reach
        np.maximum.at(slack, knot, (np.linalg.norm(state.com[knot] - points, axis=1) - limit) / ARM)
        at_end = np.abs(state.k[-2:]).max() / ARM if data.options.rest_at_end else 0.0
        return float(slack.sum() + at_end)


def program_values(data: CentroidalData, wrench: np.ndarray, state: CentroidalState) -> np.ndarray:
    """(n,) values of a program's variables under contact wrenches (J, 6) and the motion that they bring about.

    Corner forces and slacks are left 0: they cost nothing.

    Args:
        data: of the program.
        wrench: (J, 6) force and moment in the contact frames [M g, M g ARM].
        state: the motion under them [m, s, M g].
    """
    z, _ = pressure_residuals(wrench, data.half, ARM, LEAST_PRESSURE_LOAD)
    x = np.zeros(data.num_vars)
    for name, value in (
        ("com", state.com - data.origin),
        ("v", state.velocity),
        ("k", state.k / ARM),
        ("a", state.total_force - UP),
        ("kdot", state.k_rate / ARM),
        ("wrench", wrench),
        ("z", z),
    ):
        x[data.index[name]] = value
    return x
