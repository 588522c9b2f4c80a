"""What is wrong with a strip, judged on its configurations and contacts, not on what a solver says of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optimization.elastic_strip.problem import (
    BALANCE,
    CLEARANCE,
    CONTACT,
    LIMITS,
    PLACE,
    StripFault,
    StripProblem,
)
from optimization.elastic_strip.rows import StripRows
from optimization.multibody.kinematic_tree import KinematicTree, rotation_error

LEVER = 0.3  # [m] an angle of 1 rad counts as this distance
GOOD_CONTACT = 4e-3  # [m] an end effector this near its contact holds it: the motion stage makes it exact
GOOD_BALANCE = 5e-3  # [m] a CoM this far outside what balances
GOOD_CLEARANCE = 0.02  # [m] short of the distance wanted, which capsules understate by as much
GOOD_LIMIT, GOOD_PLACE = 1e-9, 1e-3  # [rad, m]
NOWHERE = 1.0  # [m] that a CoM counts as outside where contacts balance nowhere


@dataclass(frozen=True, eq=False)
class Violations:
    """By how much each task fails.

    Attributes:
        contact: (N, E) distance of what is held from its contact, an angle counting `LEVER` [m].
        balance: (N,) distance of the CoM outside what balances [m].
        clearance: (N,) what the shortest distance lacks [m].
        limits: (N,) joints beyond their limits [rad].
        place: (G,) distance of each gathering from its circle [m].
    """

    contact: np.ndarray
    balance: np.ndarray
    clearance: np.ndarray
    limits: np.ndarray
    place: np.ndarray

    @property
    def score(self) -> float:
        """The greatest violation in multiples of what is accepted: at most 1 where every task is done."""
        return max(self._shares)

    @property
    def total(self) -> float:
        """The greatest violations of all tasks added: falls where one task gets on and another cannot be done."""
        return sum(self._shares)

    def merit(self, contact_weight: float, exact_penalty: float) -> float:
        """What the violations cost in the program's own terms: falls along a step that the linearisation is right about.

        Args:
            contact_weight: of squared distances from the contacts [1/m^2].
            exact_penalty: of distances outside balance and clearance [1/m].
        """
        short = self.balance.sum() + self.clearance.sum() + self.place.sum()
        return float(contact_weight * (self.contact**2).sum() + exact_penalty * short)

    @property
    def _shares(self) -> tuple[float, ...]:
        return (
            float(self.contact.max(initial=0.0)) / GOOD_CONTACT,
            float(self.balance.max(initial=0.0)) / GOOD_BALANCE,
            float(self.clearance.max(initial=0.0)) / GOOD_CLEARANCE,
            float(self.place.max(initial=0.0)) / GOOD_PLACE,
            float(self.limits.max(initial=0.0)) / GOOD_LIMIT,
        )


def find_violations(
    problem: StripProblem, tree: KinematicTree, rows: StripRows, q: np.ndarray, X_WC: np.ndarray, depth: np.ndarray
) -> Violations:
    """How far a strip is from doing its tasks.

    Args:
        problem: the strip's tasks.
        tree: of the robot.
        rows: of these configurations.
        q: (N, nq).
        X_WC: (C, 4, 4) the contacts now.
        depth: (N,) how far the CoM is inside what balances [m].
    """
    contact = np.zeros(problem.held.shape)
    for n, e in zip(*np.nonzero(problem.held >= 0), strict=True):
        error = frame_error(rows.R_WE[n, e], rows.p_WE[n, e], X_WC[problem.held[n, e]])
        contact[n, e] = np.hypot(LEVER * np.linalg.norm(error[:3]), np.linalg.norm(error[3:]))
    looked_at = np.arange(rows.gap.shape[1]) < rows.count[:, None]
    clearance = np.where(looked_at, np.maximum(-rows.gap, 0.0), 0.0).max(axis=1)
    beyond = np.maximum(tree.lower - q[:, 7:], q[:, 7:] - tree.upper).max(axis=1)
    place = [
        np.linalg.norm(X_WC[list(g.contacts), :2, 3].mean(axis=0) - np.array(g.xy)) - g.radius
        for g in problem.gatherings
    ]
    return Violations(
        contact,
        np.minimum(np.maximum(-depth, 0.0), NOWHERE),
        clearance,
        np.maximum(beyond, 0.0),
        np.maximum(np.array(place), 0.0),
    )


def strip_faults(problem: StripProblem, violations: Violations) -> tuple[StripFault, ...]:
    """The worst fault of each task in each phase, in multiples of what is accepted the greatest first.

    Args:
        problem: the strip's.
        violations: of its last motion.
    """
    found: list[StripFault] = []
    effectors = ("left_foot", "right_foot", "left_palm", "right_palm")
    for phase in np.unique(problem.phase):
        own = np.flatnonzero(problem.phase == phase)
        for e, effector in enumerate(effectors):
            n = own[np.argmax(violations.contact[own, e])]
            contact = int(problem.held[n, e])
            found.append(
                StripFault(
                    CONTACT, int(n), int(phase), contact, effector, float(violations.contact[n, e]), GOOD_CONTACT
                )
            )
        for task, values, limit, about in (
            (BALANCE, violations.balance, GOOD_BALANCE, "centre of mass"),
            (CLEARANCE, violations.clearance, GOOD_CLEARANCE, "body"),
            (LIMITS, violations.limits, GOOD_LIMIT, "joints"),
        ):
            n = own[np.argmax(values[own])]
            found.append(StripFault(task, int(n), int(phase), -1, about, float(values[n]), limit))
    for gathering, value in zip(problem.gatherings, violations.place, strict=True):
        found.append(StripFault(PLACE, -1, -1, -1, gathering.name, float(value), GOOD_PLACE))
    faults = [f for f in found if f.value > f.limit]
    return tuple(sorted(faults, key=lambda f: -f.value / f.limit))


def frame_error(R_WA: np.ndarray, p_WA: np.ndarray, X_WB: np.ndarray) -> np.ndarray:
    """(6,) rotation vector [rad] and translation [m] in W that take a frame at (R_WA, p_WA) to X_WB.

    Args:
        R_WA: (3, 3) orientation.
        p_WA: (3,) origin in W [m].
        X_WB: (4, 4) pose in W [m].
    """
    error = np.empty(6)
    rotation_error(np.ascontiguousarray(R_WA), np.ascontiguousarray(X_WB[:3, :3]), error[:3])
    error[3:] = X_WB[:3, 3] - p_WA
    return error


def rotation_about(w: np.ndarray) -> np.ndarray:
    """(3, 3) exp([w]x) of a rotation vector [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(w))
    W = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    a = np.sin(angle) / angle if angle > 1e-9 else 1.0
    b = (1.0 - np.cos(angle)) / angle**2 if angle > 1e-6 else 0.5
    return np.eye(3) + a * W + b * W @ W
