"""Contact planning with dynamics, one transition after the other: states carry the CoM and its velocity (Lin 2020 sec. 6.4).

CoM states over one set of contacts that are nearer than a cell count as one; otherwise no state would be reached twice.

The dynamics of all children are evaluated at once; inverse kinematics is solved when a state is popped, with the CoM
where the dynamics leave it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drakeplan.contact_planning.com_costs import DynamicWeights
from drakeplan.contact_planning.contact_domain import ContactDomain
from drakeplan.contact_planning.contact_pool import Held
from drakeplan.contact_planning.dynamic_domain import DynamicDomain, State
from drakeplan.contact_planning.dynamics_evaluator import DynamicsEvaluator


class ComDomain(DynamicDomain):
    """States whose sixth number is a CoM position and velocity; d_dyn is the evaluator's cost of the transition."""

    def __init__(
        self, contacts: ContactDomain, evaluator: DynamicsEvaluator, weights: DynamicWeights | None = None
    ) -> None:
        """Wraps a contact domain.

        Args:
            contacts: states without the CoM.
            evaluator: judges all transitions of an expansion in one batch.
            weights: of the edge cost (Lin 2020 eq. 6.6).
        """
        super().__init__(contacts, weights)
        self.evaluator: DynamicsEvaluator = evaluator
        self._com: list[np.ndarray] = []
        self._velocity: list[np.ndarray] = []

    def start(self, held: Held, com: np.ndarray) -> State:
        """The state of standing still.

        Args:
            held: contact numbers by end effector.
            com: (3,) CoM [m].
        """
        return (held[0], held[1], held[2], held[3], -1, self._com_state(held, com, np.zeros(3)))

    def com_state(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """(3,) CoM [m] and (3,) its velocity [m/s] in this state."""
        return self._com[state[5]], self._velocity[state[5]]

    def successors(self, state: State) -> tuple[Sequence[State], np.ndarray]:
        """Every next state whose transition is dynamically feasible, as far as the evaluator knows, with its cost."""
        children, _ = self.contacts.successors(state[:5])
        if not children:
            return [], np.zeros(0)
        com, velocity = self.com_state(state)
        estimates = self.evaluator.evaluate(state[:4], [child[:4] for child in children], com, velocity)
        feasible = np.flatnonzero(estimates.feasible)
        self.rejections["dynamics"] += len(children) - len(feasible)
        states: list[State] = []
        for k in feasible.tolist():
            child = children[k]
            states.append((*child, self._com_state(child[:4], estimates.com[k], estimates.velocity[k])))
        if not states:
            return [], np.zeros(0)
        return states, self.costs.step_costs(state, states) + self.costs.weights.dynamics * estimates.cost[feasible]

    def dynamics_reason(self, state: State) -> str:
        """Why the body cannot hold the contacts with the CoM where the dynamics leave it, "" if it can."""
        return self.check.at_com(state[:4], self._com[state[5]])

    def _com_state(self, held: Held, com: np.ndarray, velocity: np.ndarray) -> int:
        number = self._number(held, com, velocity, len(self._com))
        if number == len(self._com):
            self._com.append(np.array(com, float))
            self._velocity.append(np.array(velocity, float))
        return number
