"""Edge cost and heuristic of a planner that considers dynamics, without the cost of the dynamics themselves (Lin 2020 eq. 6.6, 6.7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drakeplan.contact_planning.contact_domain import ContactDomain

State = tuple[int, ...]  # left foot, right foot, left palm, right palm, last mover, and whatever else a domain adds


@dataclass(frozen=True)
class DynamicWeights:
    """Weights of the edge cost (Lin 2020 eq. 6.6), with the values of Lin 2020 as defaults.

    Attributes:
        distance: w_xy [1/m].
        step: w_s, cost of one transition.
        dynamics: w_dyn, on the objective of the centroidal program.
    """

    distance: float = 1.0
    step: float = 3.0
    dynamics: float = 0.1


class ComCosts:
    """Costs of states that begin with those of the contact domain.

    Attributes:
        weights: of the edge cost.
    """

    def __init__(self, contacts: ContactDomain, weights: DynamicWeights) -> None:
        """Prepares the costs.

        Args:
            contacts: domain whose robot, contacts and distance to the goal the costs use.
            weights: of the edge cost (Lin 2020 eq. 6.6).
        """
        self.weights = weights
        self._contacts = contacts
        # A foot that translates by d moves the mean of the feet by d / 2.
        per_step = 0.5 * contacts.max_travel
        self._per_metre = weights.distance + weights.step / per_step

    def step_costs(self, state: State, states: Sequence[State]) -> np.ndarray:
        """(n,) w_xy d + w_s of the transitions from one state to each of several (Lin 2020 eq. 6.6 without d_dyn).

        Args:
            state: the state before the transition; its first four numbers are contact numbers.
            states: n states after it.
        """
        travel = np.linalg.norm(self._feet_mean(states) - self._feet_mean([state]), axis=1)
        return self.weights.distance * travel + self.weights.step

    def cost_to_go(self, states: Sequence[State]) -> np.ndarray:
        """(n,) w_xy D + w_s D / d_max, the heuristic (Lin 2020 eq. 6.7)."""
        return self._contacts.distance_to_go([s[:5] for s in states]) * self._per_metre

    def effort(self, path: Sequence[State], cost: float) -> float:
        """Sum of d_dyn over a path: its cost less the terms for distance and steps (Lin 2020 eq. 6.6).

        Args:
            path: consecutive states from the start.
            cost: sum of the path's edge costs.
        """
        way = float(np.linalg.norm(np.diff(self._feet_mean(path), axis=0), axis=1).sum())
        rest = cost - self.weights.distance * way - self.weights.step * (len(path) - 1)
        return rest / self.weights.dynamics if self.weights.dynamics > 0 else float("nan")

    def _feet_mean(self, states: Sequence[State]) -> np.ndarray:
        p = self._contacts.pool.p
        return 0.5 * (p[[s[0] for s in states], :2] + p[[s[1] for s in states], :2])
