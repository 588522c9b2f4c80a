"""Contact planning with dynamics as a search problem: states carry the CoM and its velocity (Lin 2020 sec. 6.4).

A state is six integers: those of `contact_domain`, and the number of a CoM state. CoM states of one stance that
are nearer than a cell count as one, or the tree would never meet itself.

    edge cost  (6.6)   w_xy d + w_s + w_dyn d_dyn      d: way of the mean of the feet on the map; d_dyn: the program's cost
    heuristic  (6.7)   w_xy D + w_s D / d_max          D: torso box on the SE(2) grid; d_max: most that mean travels a step

Whether forces can bring a transition about is asked for all children at once; whether the body can be there is asked
of inverse kinematics when a state is popped, with the CoM held where the dynamics leave it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drakeplan.contact_planning.com_costs import DynamicCosts, DynamicWeights
from drakeplan.contact_planning.contact_domain import ContactDomain
from drakeplan.contact_planning.contact_pool import Held
from drakeplan.contact_planning.dynamics_evaluator import DynamicsEvaluator

State = tuple[int, ...]  # six: left foot, right foot, left palm, right palm, last mover, CoM state
COM_CELL = 0.05  # [m] CoM positions of one stance nearer than this count as one,
VELOCITY_CELL = 0.1  # [m/s] given velocities nearer than this


class DynamicDomain:
    """Successors, heuristic, goal and lazy confirmation of states that carry the CoM.

    Attributes:
        careful: whether a transition must pass its critical configurations at rest too (Lin 2020 sec. 3.3). Dynamics
            ask less, but what they alone allow the legs may be unable to follow.
    """

    def __init__(
        self, contacts: ContactDomain, evaluator: DynamicsEvaluator, weights: DynamicWeights | None = None
    ) -> None:
        self.contacts, self.evaluator = contacts, evaluator
        self.costs = DynamicCosts(contacts, weights or DynamicWeights())
        self.rejections = contacts.rejections
        self.careful = False
        self._com: list[np.ndarray] = []
        self._velocity: list[np.ndarray] = []
        self._number: dict[tuple[object, ...], int] = {}

    def start(self, held: Held, com: np.ndarray) -> State:
        """The state of standing still on these contacts with the CoM (3,) here [m]."""
        return (held[0], held[1], held[2], held[3], -1, self._com_state(held, com, np.zeros(3)))

    def com_state(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """(3,) CoM [m] and (3,) its velocity [m/s] in this state."""
        return self._com[state[5]], self._velocity[state[5]]

    def successors(self, state: State) -> tuple[Sequence[State], np.ndarray]:
        """Every next state whose transition is dynamically feasible, as far as the evaluator knows, at cost (6.6)."""
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
        return states, self.costs.of_steps(state, states) + self.costs.weights.dynamics * estimates.cost[feasible]

    def heuristic(self, states: Sequence[State]) -> np.ndarray:
        """(n,) estimated cost to go (6.7); future dynamics are not in it."""
        return self.costs.to_go(states)

    def is_goal(self, state: State) -> bool:
        """Whether the mean of the feet is in the goal region."""
        return self.contacts.is_goal(state[:5])

    def confirm(self, parent: State, state: State) -> bool:
        """Whether the body can hold the new contacts with the CoM where the dynamics leave it."""
        if self.contacts.is_forbidden(parent[:5], state[:5]):
            self.rejections["motion"] += 1
            return False
        reason = self.contacts.check.at_com(state[:4], self._com[state[5]])
        if self.careful:
            reason = reason or self.contacts.check.transition(parent[:4], state[:4])
        if reason:
            self.rejections[reason] += 1
        return not reason

    def _com_state(self, held: Held, com: np.ndarray, velocity: np.ndarray) -> int:
        cell = (
            *np.round(com / COM_CELL).astype(int).tolist(),
            *np.round(velocity / VELOCITY_CELL).astype(int).tolist(),
        )
        number = self._number.setdefault((held, cell), len(self._com))
        if number == len(self._com):
            self._com.append(np.array(com, float))
            self._velocity.append(np.array(velocity, float))
        return number
