"""What a contact transition does to the centre of mass: asked of the exact program, or of what has learned it.

Lin et al. 2019 sec. VI: a transition is judged on its own, from the CoM state in which the one before it ended.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drakeplan.contact_planning.contact_pool import ContactPool, Held
from learning.surrogate import DynamicsSurrogate
from learning.transition_batch import TransitionBatch
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.transition_dynamics import TransitionDynamics
from scenes.robots.robot import Robot
from scenes.stance import Stance


@dataclass(frozen=True, eq=False)
class TransitionEstimates:
    """What is said of n transitions from one state.

    Attributes:
        feasible: (n,) whether contact forces can bring it about.
        cost: (n,) least objective (Lin 2020 sec. 6.3), inf where not feasible.
        com: (n, 3) CoM after it [m].
        velocity: (n, 3) its velocity [m/s].
    """

    feasible: np.ndarray
    cost: np.ndarray
    com: np.ndarray
    velocity: np.ndarray


class DynamicsEvaluator(Protocol):
    """Judges every transition of one expansion in a batch."""

    asked: Counter[str]  # transitions by who answered: "exact", "learned"

    def evaluate(
        self, before: Held, after: Sequence[Held], com: np.ndarray, velocity: np.ndarray
    ) -> TransitionEstimates:
        """Estimates for moves from one stance with CoM (3,) [m] and its velocity (3,) [m/s] to each of several."""
        ...


class ExactDynamics:
    """The centroidal program for each transition."""

    def __init__(self, pool: ContactPool, robot: Robot, options: CentroidalOptions | None = None) -> None:
        self.pool, self.robot = pool, robot
        self.dynamics = TransitionDynamics(robot, options)
        self.asked: Counter[str] = Counter()

    def evaluate(
        self, before: Held, after: Sequence[Held], com: np.ndarray, velocity: np.ndarray
    ) -> TransitionEstimates:
        """One program per transition; the answers have been checked on recomputed numbers."""
        n = len(after)
        feasible, cost = np.zeros(n, bool), np.full(n, np.inf)
        final_com, final_velocity = np.tile(com, (n, 1)), np.tile(velocity, (n, 1))
        first = stance_of(self.pool, before)
        momentum = self.robot.mass * np.asarray(velocity)
        for k, held in enumerate(after):
            estimate = self.dynamics.estimate(first, stance_of(self.pool, held), com, momentum)
            if estimate.feasible:
                feasible[k], cost[k] = True, estimate.cost
                final_com[k], final_velocity[k] = self.dynamics.final_state(estimate)
        self.asked["exact"] += n
        return TransitionEstimates(feasible, cost, final_com, final_velocity)


class LearnedDynamics:
    """The surrogate for all transitions at once; the exact program for those that it was not trained for.

    Args:
        surrogate: trained for this robot.
        exact: answers where the surrogate's flag for what is far from its training data fires; None: nobody does, the
            surrogate's guess stands.
    """

    def __init__(self, pool: ContactPool, surrogate: DynamicsSurrogate, exact: ExactDynamics | None) -> None:
        self.pool, self.surrogate, self.exact = pool, surrogate, exact
        self.asked: Counter[str] = Counter()

    def evaluate(
        self, before: Held, after: Sequence[Held], com: np.ndarray, velocity: np.ndarray
    ) -> TransitionEstimates:
        """One pass through the networks, and a program for each transition that is far from what they have seen."""
        pool = self.pool
        batch = TransitionBatch.of_children(
            pool.p, pool.R, np.array(before), np.array(after), com, velocity, pool.frictions
        )
        says = self.surrogate.predict(batch)
        feasible, cost = says.feasible.copy(), np.where(says.feasible, np.maximum(says.cost, 0.0), np.inf)
        final_com, final_velocity = says.com.copy(), says.velocity.copy()
        far = np.flatnonzero(says.far) if self.exact is not None else np.zeros(0, int)
        if self.exact is not None and len(far):
            truth = self.exact.evaluate(before, [after[k] for k in far.tolist()], com, velocity)
            feasible[far], cost[far] = truth.feasible, truth.cost
            final_com[far], final_velocity[far] = truth.com, truth.velocity
        self.asked["learned"] += len(after) - len(far)
        self.asked["exact"] += len(far)
        return TransitionEstimates(feasible, cost, final_com, final_velocity)


def stance_of(pool: ContactPool, held: Held) -> Stance:
    """The stance of these contact numbers, -1 where an end effector is free."""
    return Stance(tuple(None if n < 0 else pool.contact(n) for n in held))
