"""The common part of search problems whose states include the motion of the CoM (Lin 2020 sec. 6.4).

A state is six integers: the five of `contact_domain`, and a number that stands for what the CoM does.

    edge cost  (Lin 2020 eq. 6.6)   w_xy d + w_s + w_dyn d_dyn     d: way of the mean of the feet on the map
    heuristic  (Lin 2020 eq. 6.7)   w_xy D + w_s D / d_max         D: torso box on the SE(2) grid; d_max: most that mean travels
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Hashable, Sequence
from typing import Protocol, cast

import numpy as np

from drakeplan.contact_planning.com_costs import ComCosts, DynamicWeights
from drakeplan.contact_planning.contact_domain import ContactDomain
from drakeplan.contact_planning.contact_pool import Held
from drakeplan.contact_planning.transition_check import TransitionCheck

State = tuple[int, ...]  # six: left foot, right foot, left palm, right palm, last mover, number of what the CoM does
COM_CELL = 0.05  # [m] CoM positions over the same contacts nearer than this count as one,
VELOCITY_CELL = 0.1  # [m/s] given velocities nearer than this


class Counted(Protocol):
    """An evaluator of dynamics that counts the transitions it was asked about."""

    asked: Counter[str]  # transitions evaluated, by "exact" and "learned"


class DynamicDomain(ABC):
    """Costs, heuristic, goal, forbidden transitions and counts of states that carry the CoM; subclasses add its dynamics.

    Attributes:
        contacts: the same states without the CoM.
        evaluator: answers for the dynamics.
        costs: of edges.
        rejections: edges turned down, by why.
        static_balance: whether a transition must pass its critical configurations at rest too (Lin 2020 sec. 3.3).
            Dynamics ask less, but what they alone allow the legs may be unable to follow. A transition with a partial support
            must in any case: networks take all patches for whole, and on part of a sole a robot goes slowly.
    """

    evaluator: Counted

    def __init__(self, contacts: ContactDomain, weights: DynamicWeights | None) -> None:
        """Wraps a contact domain.

        Args:
            contacts: states without the CoM.
            weights: of the edge cost (Lin 2020 eq. 6.6).
        """
        self.contacts = contacts
        self.costs = ComCosts(contacts, weights or DynamicWeights())
        self.rejections = contacts.rejections
        self.static_balance = False
        self._numbers: dict[tuple[Hashable, tuple[int, ...]], int] = {}

    @property
    def check(self) -> TransitionCheck:
        """The check of the contacts, which knows postures: what has dynamics is a humanoid."""
        return cast("TransitionCheck", self.contacts.check)

    @abstractmethod
    def start(self, held: Held, com: np.ndarray) -> State:
        """The state of standing still.

        Args:
            held: contact numbers by end effector.
            com: (3,) CoM [m].
        """

    @abstractmethod
    def com_state(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """(3,) CoM [m] and (3,) its velocity [m/s] in this state."""

    @abstractmethod
    def successors(self, state: State) -> tuple[Sequence[State], np.ndarray]:
        """The next states and the (n,) costs of reaching them."""

    @abstractmethod
    def dynamics_reason(self, state: State) -> str:
        """Why the dynamics or the body refuse the last transition of a state, "" if they do not."""

    def heuristic(self, states: Sequence[State]) -> np.ndarray:
        """(n,) estimated cost to go (Lin 2020 eq. 6.7); future dynamics are not in it."""
        return self.costs.cost_to_go(states)

    def is_goal(self, state: State) -> bool:
        """Whether the mean of the feet is in the goal region."""
        return self.contacts.is_goal(state[:5])

    def confirm(self, parent: State, state: State) -> bool:
        """Whether the transition is not forbidden, its dynamics hold and the body can follow them.

        Args:
            parent: the state before.
            state: the state after.
        """
        if self.contacts.is_forbidden(parent[:5], state[:5]):
            self.rejections["motion"] += 1
            return False
        reason = self.dynamics_reason(state)
        if not reason and (self.static_balance or self._on_parts(parent, state)):
            reason = self.check.transition(parent[:4], state[:4])
        reason = reason or self.check.swing(parent[:4], state[:4])
        if reason:
            self.rejections[reason] += 1
        return not reason

    def _on_parts(self, parent: State, state: State) -> bool:
        """Whether a contact of a transition rests on part of its patch."""
        supports = self.contacts.pool.supports
        return bool(supports) and any(n in supports for n in (*parent[:4], *state[:4]))

    def _number(self, contacts: Hashable, com: np.ndarray, velocity: np.ndarray, count: int) -> int:
        """The number of what the CoM does over these contacts: that of a near one, or `count` where there is none yet."""
        cell = (
            *np.round(com / COM_CELL).astype(int).tolist(),
            *np.round(velocity / VELOCITY_CELL).astype(int).tolist(),
        )
        return self._numbers.setdefault((contacts, cell), count)
