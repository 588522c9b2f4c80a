"""Checks a centroidal trajectory against every constraint of its problem, on the numbers that are written out.

Nothing here is shared with the program that made the trajectory: world forces, centres of pressure and torques go in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optimization.balance.contact_wrench import SMALLEST
from optimization.balance.friction import contains
from optimization.centroidal.force_limits import force_limits
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.trajectory import LEAST_LOAD, CentroidalTrajectory
from scenes.effector import EFFECTORS
from scenes.gravity import GRAVITY

RESIDUAL = 1e-8  # [M g, M g m]: Newton and Euler hold by construction, to rounding
FORCE = 1e-6  # [M g] that a force may stick out of its cone or exceed its limit
LENGTH = 1e-4  # [m] of bounds on the CoM and of reach
PATCH = 1e-6  # [m] that a centre of pressure may lie outside its support
MOMENTUM = 1e-5  # [M g s, M g m s] left at rest
RELATIVE = 1e-3  # of the limits on angular momentum and its rate


@dataclass(frozen=True)
class Violation:
    """One constraint block that fails, at its worst place.

    Attributes:
        block: name of the constraint.
        excess: by how much it fails, over its tolerance [-].
        amount: by how much it fails [SI].
        unit: of the amount.
        knot: where; for what holds over an interval, the knot at its start.
        time: of that knot [s].
        effector: whose, "" where it belongs to none.
    """

    block: str
    excess: float
    amount: float
    unit: str
    knot: int
    time: float
    effector: str = ""

    def __str__(self) -> str:
        who = f" of {self.effector}" if self.effector else ""
        return f"{self.block}{who} exceeded by {self.amount:.3g} {self.unit} at knot {self.knot} ({self.time:.2f} s)"


@dataclass(frozen=True, eq=False)
class _Table:
    """Amounts by which a constraint fails: (n,), or (n, E) by end effector; row 0 stands at knot `first`."""

    block: str
    amount: np.ndarray
    tolerance: float
    unit: str
    first: int = 0


def violations(
    problem: CentroidalProblem, options: CentroidalOptions, trajectory: CentroidalTrajectory
) -> list[Violation]:
    """Every violated constraint block with its worst place, the worst first; empty where all hold.

    Args:
        problem: the data, in SI.
        options: limits and cone.
        trajectory: to check.
    """
    weight = problem.mass * GRAVITY
    tables = [
        *_dynamics(problem, trajectory, weight),
        *_contacts(problem, options, trajectory, weight),
        *_bounds(problem, options, trajectory, weight),
    ]
    found = []
    for table in tables:
        filled = np.where(np.isnan(table.amount), np.inf, table.amount)
        place = np.unravel_index(int(np.argmax(filled)), filled.shape)
        worst = float(filled[place])
        if worst > table.tolerance:
            effector = EFFECTORS[place[1]] if filled.ndim == 2 else ""
            knot = table.first + int(place[0])
            when = float(trajectory.t[knot])
            found.append(Violation(table.block, worst / table.tolerance, worst, table.unit, knot, when, effector))
    return sorted(found, key=lambda violation: -violation.excess)


def _poses(problem: CentroidalProblem, trajectory: CentroidalTrajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N, E, 3) points, (N, E, 3, 3) orientations and (N, E) friction of the contacts, anything where there is none."""
    p_WC, R_WC, friction = problem.schedule.poses()
    if not len(p_WC):
        shape = trajectory.contact.shape
        return (np.zeros((*shape, 3)), np.tile(np.eye(3), (*shape, 1, 1)), np.zeros(shape))
    at = np.maximum(trajectory.contact, 0)
    return p_WC[at], R_WC[at], friction[at]


def _dynamics(problem: CentroidalProblem, trajectory: CentroidalTrajectory, weight: float) -> list[_Table]:
    """Residuals of the plan file's three difference equations and of the initial state, each (N-1,) or (1,)."""
    t = trajectory
    p_WC, R_WC, _ = _poses(problem, trajectory)
    dt = np.diff(t.t)[:, None]
    force = t.force_W[:-1]
    gravity = np.array([0.0, 0.0, -weight])
    p_cop = p_WC + np.einsum("neab,neb->nea", R_WC[..., :2], t.cop_C)
    torque = (R_WC[..., 2] * t.torque_n[..., None])[:-1]
    newton = np.diff(t.linear_momentum, axis=0) / dt - force.sum(axis=1) - gravity
    moment = np.cross(p_cop[:-1] - t.com[1:, None], force) + torque
    euler = np.diff(t.angular_momentum, axis=0) / dt - moment.sum(axis=1)
    path = np.diff(t.com, axis=0) - dt * t.linear_momentum[1:] / problem.mass
    start = max(
        np.abs(t.com[0] - problem.initial_com).max(),
        np.abs(t.linear_momentum[0] - problem.initial_linear_momentum).max() / weight,
        np.abs(t.angular_momentum[0] - problem.initial_angular_momentum).max() / weight,
    )
    return [
        _Table("newton", np.abs(newton).max(axis=1), RESIDUAL * weight, "N"),
        _Table("euler", np.abs(euler).max(axis=1), RESIDUAL * weight, "N m"),
        _Table("com integration", np.abs(path).max(axis=1), 1e-9, "m"),
        _Table("initial state", np.array([start]), 1e-9, "m, s"),
    ]


def _contacts(
    problem: CentroidalProblem, options: CentroidalOptions, trajectory: CentroidalTrajectory, weight: float
) -> list[_Table]:
    """Cone, patch, load and reach of each contact, each (N, E)."""
    t = trajectory
    p_WC, R_WC, friction = _poses(problem, trajectory)
    held = t.contact >= 0
    force_C = np.einsum("neba,neb->nea", R_WC, t.force_W)
    inside = contains(options.cone, options.reserve.friction * friction, force_C, FORCE * weight)
    off = _off_support(options.reserve.supports(problem.supports), t)
    outside = np.where(force_C[..., 2] > LEAST_LOAD * weight, off, 0.0)
    free = np.where(held, 0.0, np.abs(t.force_W).max(axis=2) + np.abs(t.torque_n))
    limits = force_limits(problem.schedule, options)
    overload = force_C[..., 2] - weight * np.vstack([limits, limits[-1:]])
    reach = np.asarray(options.com_reach)
    after = np.linalg.norm(t.com[1:, None] - p_WC[:-1], axis=2) - reach  # at the end of each interval
    before = np.linalg.norm(t.com[1:, None] - p_WC[1:], axis=2) - reach  # at the start of the next one
    far = np.maximum(np.where(held[:-1], after, 0.0), np.where(held[1:], before, 0.0))
    return [
        _Table("force without contact", free, FORCE * weight, "N"),
        _Table("friction cone", np.where(held & ~inside, np.inf, 0.0), FORCE * weight, "N"),
        _Table("pressure centre", np.where(held, outside, 0.0), PATCH, "m"),
        _Table("force limit", np.where(held, overload, 0.0), FORCE * weight, "N"),
        _Table("reach", far, LENGTH, "m", first=1),
    ]


def _off_support(supports: np.ndarray, trajectory: CentroidalTrajectory) -> np.ndarray:
    """(N, E) how far centres of pressure lie beyond supports (C, V, 2) [m], negative inside: beyond an edge, or the box around it."""
    if not len(supports):
        return np.full(trajectory.contact.shape, -np.inf)
    edge = np.roll(supports, -1, axis=1) - supports
    length = np.linalg.norm(edge, axis=2)
    normal = np.stack([edge[..., 1], -edge[..., 0]], axis=2) / np.maximum(length, SMALLEST)[..., None]
    level = np.where(length > SMALLEST, (normal * supports).sum(axis=2), np.inf)  # no edge where a corner repeats
    at = np.maximum(trajectory.contact, 0)
    beyond_edge = (np.einsum("neva,nea->nev", normal[at], trajectory.cop_C) - level[at]).max(axis=2)
    low, high = supports.min(axis=1)[at], supports.max(axis=1)[at]  # all that bounds a support of no area
    beyond_box = np.maximum(low - trajectory.cop_C, trajectory.cop_C - high).max(axis=2)
    return np.maximum(beyond_edge, beyond_box)


def _bounds(
    problem: CentroidalProblem, options: CentroidalOptions, trajectory: CentroidalTrajectory, weight: float
) -> list[_Table]:
    """Limits on momentum, height, boxes and rest, each (N-1,) or (1,)."""
    t = trajectory
    rate = np.diff(t.angular_momentum, axis=0) / np.diff(t.t)[:, None]
    k_limit, rate_limit = (np.asarray(options.angular_momentum_limit), np.asarray(options.angular_momentum_rate_limit))
    feet = problem.schedule.feet_mean()
    low, nominal, high = options.com_height
    height = t.com[1:, 2] - feet[:, 2]
    k_excess = (np.abs(t.angular_momentum[1:]) - k_limit).max(axis=1)
    rate_excess = (np.abs(rate) - rate_limit).max(axis=1)
    height_excess = np.nan_to_num(np.maximum(low - height, height - high), nan=0.0)  # nan: no foot is in contact
    tables = [
        _Table("angular momentum limit", k_excess, RELATIVE * k_limit.min(), "N m s", first=1),
        _Table("angular momentum rate limit", rate_excess, RELATIVE * rate_limit.min(), "N m"),
        _Table("com height", height_excess, LENGTH, "m", first=1),
    ]
    if problem.com_box is not None and problem.com_reference is not None:
        off = np.abs(t.com - problem.com_reference)[1:] - problem.com_box[1:]
        tables.append(_Table("com box", off.max(axis=1), LENGTH, "m", first=1))
    known = np.flatnonzero(np.isfinite(feet[:, 0]))
    last = len(t.t) - 1
    if options.final_half_width is not None and len(known):
        centre = feet[known[-1]] + np.array([0.0, 0.0, nominal])
        off = np.abs(t.com[-1] - centre) - np.asarray(options.final_half_width)
        tables.append(_Table("final com box", np.array([off.max()]), LENGTH, "m", first=last))
    if options.rest_at_end:
        for name, momentum, unit in (("linear", t.linear_momentum, "kg m/s"), ("angular", t.angular_momentum, "N m s")):
            left = np.abs(momentum[1:][-2:]).max(axis=1)
            tables.append(_Table(f"rest: {name} momentum", left, MOMENTUM * weight, unit, first=last + 1 - len(left)))
    return tables
