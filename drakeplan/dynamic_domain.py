"""Contact planning with dynamics as a search problem: states carry the CoM and its velocity (Lin 2020 sec. 6.4).

A state is six integers: those of `drakeplan.contact_domain`, and the number of a CoM state. CoM states of one stance that
are nearer than a cell count as one, or the tree would never meet itself.

    edge cost  (6.6)   w_xy d + w_s + w_dyn d_dyn      d: way of the mean of the feet on the map; d_dyn: the program's cost
    heuristic  (6.7)   w_xy D + w_s D / d_max          D: torso box on the SE(2) grid; d_max: most that mean travels a step

Whether forces can bring a transition about is asked for all children at once; whether the body can be there is asked
of inverse kinematics when a state is popped, with the CoM held where the dynamics leave it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.contact_domain import ContactDomain
from drakeplan.contact_pool import Held
from drakeplan.dynamics_evaluator import DynamicsEvaluator

State = tuple[int, ...]  # six: left foot, right foot, left palm, right palm, last mover, CoM state
COM_CELL = 0.05  # [m] CoM positions of one stance nearer than this count as one,
VELOCITY_CELL = 0.1  # [m/s] given velocities nearer than this


@dataclass(frozen=True)
class DynamicWeights:
    """Weights of the edge cost (6.6), with the documents' values as defaults.

    Attributes:
        distance: w_xy [1/m].
        step: w_s, cost of one transition.
        dynamics: w_dyn, on the objective of the centroidal program.
    """

    distance: float = 1.0
    step: float = 3.0
    dynamics: float = 0.1


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
        self.weights = weights or DynamicWeights()
        self.rejections = contacts.rejections
        self.careful = False
        self._com: list[np.ndarray] = []
        self._velocity: list[np.ndarray] = []
        self._number: dict[tuple[object, ...], int] = {}
        # A foot that translates by d moves the mean of the feet by d / 2.
        per_step = 0.5 * contacts.robot.max_foot_translation
        self._per_metre = self.weights.distance + self.weights.step / per_step

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
        weights = self.weights
        travel = np.linalg.norm(self._feet_mean(states) - self._feet_mean([state]), axis=1)
        return states, weights.distance * travel + weights.step + weights.dynamics * estimates.cost[feasible]

    def effort(self, path: Sequence[State], cost: float) -> float:
        """Sum of d_dyn over a path of this cost: what is left of it without ways and steps (6.6)."""
        mean = self._feet_mean(path)
        way = float(np.linalg.norm(np.diff(mean, axis=0), axis=1).sum())
        rest = cost - self.weights.distance * way - self.weights.step * (len(path) - 1)
        return rest / self.weights.dynamics if self.weights.dynamics > 0 else float("nan")

    def heuristic(self, states: Sequence[State]) -> np.ndarray:
        """(n,) estimated cost to go (6.7); future dynamics are not in it."""
        return self.contacts.distance_to_go([s[:5] for s in states]) * self._per_metre

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

    def _feet_mean(self, states: Sequence[State]) -> np.ndarray:
        p = self.contacts.pool.p
        return 0.5 * (p[[s[0] for s in states], :2] + p[[s[1] for s in states], :2])

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
