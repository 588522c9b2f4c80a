"""The effect of a contact transition on the centre of mass: by the exact program, or by networks that learned it.

Lin et al. 2019 sec. VI: a transition is judged on its own, from the CoM state in which the one before it ended.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drakeplan.contact_planning.contact_pool import ContactPool, Held
from learning.surrogate import FRICTION_TOLERANCE, DynamicsSurrogate
from learning.transition_batch import TransitionBatch
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.transition_dynamics import TransitionDynamics
from scenes.robots.robot import Robot
from scenes.stance import Stance

MOST_ASKED = 8  # transitions from one state, far from what was learned, that the exact program is asked about


@dataclass(frozen=True, eq=False)
class TransitionEstimates:
    """Estimates of n transitions from one state.

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
    """Estimates the dynamics of all transitions of one expansion in a batch."""

    asked: Counter[str]  # transitions evaluated, by "exact" and "learned"

    def evaluate(
        self, before: Held, after: Sequence[Held], com: np.ndarray, velocity: np.ndarray
    ) -> TransitionEstimates:
        """Estimates the transitions from one stance to each of several.

        Args:
            before: contact numbers by end effector, -1 where free.
            after: n sets of contact numbers, each differing from `before` in one end effector.
            com: (3,) CoM in W before the transition [m].
            velocity: (3,) its velocity in W [m/s].
        """
        ...


class ExactDynamics:
    """The centroidal program for each transition."""

    def __init__(self, pool: ContactPool, robot: Robot, options: CentroidalOptions | None = None) -> None:
        """Prepares the programs.

        Args:
            pool: contacts by number.
            robot: its mass, force limits and contact patches.
            options: of the centroidal program; None: those of the robot.
        """
        self.pool, self.robot = pool, robot
        self.dynamics = TransitionDynamics(robot, options)
        self.asked: Counter[str] = Counter()

    def evaluate(
        self, before: Held, after: Sequence[Held], com: np.ndarray, velocity: np.ndarray
    ) -> TransitionEstimates:
        """Solves one program for each transition; solutions are checked by evaluating the constraints again.

        Args:
            before: contact numbers by end effector, -1 where free.
            after: n sets of contact numbers, each differing from `before` in one end effector.
            com: (3,) CoM in W before the transition [m].
            velocity: (3,) its velocity in W [m/s].
        """
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
    """The surrogate for all transitions at once; the exact program for those outside the surrogate's training range."""

    def __init__(self, pool: ContactPool, surrogate: DynamicsSurrogate, exact: ExactDynamics | None) -> None:
        """Prepares the estimates.

        Args:
            pool: contacts by number.
            surrogate: trained for this robot.
            exact: estimates the transitions that the surrogate flags as far from its training data; None: the
                surrogate's own estimates are used for these as well.
        """
        self.pool, self.surrogate, self.exact = pool, surrogate, exact
        self.asked: Counter[str] = Counter()

    def evaluate(
        self, before: Held, after: Sequence[Held], com: np.ndarray, velocity: np.ndarray
    ) -> TransitionEstimates:
        """Evaluates the networks once for all transitions, and the exact program for some of those far from the training data.

        The others of those are not feasible, as far as is known.

        Args:
            before: contact numbers by end effector, -1 where free.
            after: n sets of contact numbers, each differing from `before` in one end effector.
            com: (3,) CoM in W before the transition [m].
            velocity: (3,) its velocity in W [m/s].
        """
        pool = self.pool
        batch = TransitionBatch.of_children(
            pool.p, pool.R, np.array(before), np.array(after), com, velocity, pool.frictions
        )
        says = self.surrogate.predict(batch)
        feasible, cost = says.feasible.copy(), np.where(says.feasible, np.maximum(says.cost, 0.0), np.inf)
        final_com, final_velocity = says.com.copy(), says.velocity.copy()
        far = np.flatnonzero(says.far) if self.exact is not None else np.zeros(0, int)
        if self.exact is not None and len(far):
            feasible[far], cost[far] = False, np.inf
            far = self._asked_about(batch, far)
            truth = self.exact.evaluate(before, [after[k] for k in far.tolist()], com, velocity)
            feasible[far], cost[far] = truth.feasible, truth.cost
            final_com[far], final_velocity[far] = truth.com, truth.velocity
        self.asked["learned"] += len(after) - int(says.far.sum()) if self.exact is not None else len(after)
        self.asked["exact"] += len(far)
        return TransitionEstimates(feasible, cost, final_com, final_velocity)

    def _asked_about(self, batch: TransitionBatch, far: np.ndarray) -> np.ndarray:
        """Of the transitions that are far (n,), all on slippery ground and at most `MOST_ASKED` others, spread evenly.

        An exact program takes 0.1 s, and a state with two palms held in an odd way has 60 such transitions: asked about all
        of them, the search would stand still for seconds, with no look at its deadline.
        """
        slippery = np.zeros(len(far), bool)
        if batch.friction is not None:
            slippery = batch.friction[far] < self.surrogate.friction[0] - FRICTION_TOLERANCE
        others = np.flatnonzero(~slippery)
        if len(others) > MOST_ASKED:
            others = others[np.linspace(0, len(others) - 1, MOST_ASKED).astype(int)]
        return far[np.sort(np.concatenate([np.flatnonzero(slippery), others]))]


def stance_of(pool: ContactPool, held: Held) -> Stance:
    """The stance of these contact numbers.

    Args:
        pool: contacts by number.
        held: contact numbers by end effector, -1 where free.
    """
    return Stance(tuple(None if n < 0 else pool.contact(n) for n in held))
