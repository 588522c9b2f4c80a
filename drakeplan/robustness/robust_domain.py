"""Contact planning that maximises the probability of arriving under pushes (Lin 2020 sec. 7.7).

States are those of `com_domain`: contacts of the feet, CoM and its velocity. Palms are not walked on; they may catch the robot.

    edge cost  (Lin 2020 eq. 7.3)   d + w_s + w_cap c_cap,    c_cap = -log P_success(transition)   (eq. 7.7)
    heuristic  (Lin 2020 eq. 7.8)   D + w_s D / d_max

P_success of a transition is that no push of its swing fells the robot. "swing" asks at n_t = 4 moments (eq. 7.4), "worst-case" at
the first alone, for the whole swing (eq. 7.5). One push at most happens within each part of the time, delta_i with P(delta_i):

    P_success = prod_t (1 - sum_i P(delta_i) (1 - P_reject_i))
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from drakeplan.contact_planning.com_costs import DynamicWeights
from drakeplan.contact_planning.com_domain import ComDomain
from drakeplan.contact_planning.contact_domain import ContactDomain
from drakeplan.contact_planning.contact_plan import CaptureName
from drakeplan.contact_planning.dynamic_domain import State
from drakeplan.contact_planning.dynamics_evaluator import DynamicsEvaluator
from drakeplan.robustness.capture_odds import CaptureOdds
from scenes.disturbance import Disturbance, pushes_along

WEIGHTS = DynamicWeights(distance=1.0, step=3.0, dynamics=0.0)  # Lin 2020 sec. 7.8
CAPTURE_WEIGHT = 1000.0  # w_cap
MOMENTS = 4  # n_t: 0, 0.1, 0.2, 0.3 s after the foot has lifted
LIFTED = 0.4  # share of r(s') in the CoM at the end of the swing (Lin 2020 sec. 7.7)
LEAST_SUCCESS = 1e-6


class RobustDomain(ComDomain):
    """A `ComDomain` whose edges cost what pushes may do during them.

    Attributes:
        odds: answers whether pushed states are captured.
    """

    def __init__(
        self,
        contacts: ContactDomain,
        evaluator: DynamicsEvaluator,
        odds: CaptureOdds,
        disturbances: Sequence[Disturbance],
        mass: float,
        swing_time: float,
        capture: CaptureName,
    ) -> None:
        """Wraps a contact domain.

        Args:
            contacts: states without the CoM, feet alone.
            evaluator: judges the dynamics of an expansion's transitions.
            odds: answers whether pushed states are captured.
            disturbances: of the scene.
            mass: of the robot [kg].
            swing_time: in which a foot moves [s].
            capture: "swing" or "worst-case".
        """
        super().__init__(contacts, evaluator, WEIGHTS)
        self.odds, self._disturbances, self._mass = odds, tuple(disturbances), mass
        self._swing_time, self._capture = swing_time, capture

    def successors(self, state: State) -> tuple[Sequence[State], np.ndarray]:
        """The next states and what reaching them costs (Lin 2020 eq. 7.3)."""
        states, costs = super().successors(state)
        if not states:
            return states, costs
        return states, costs - CAPTURE_WEIGHT * np.log(self.success(state, states))

    def success(self, state: State, states: Sequence[State]) -> np.ndarray:
        """(n,) P_success of the transitions from one state to each of several (Lin 2020 eq. 7.4, 7.5).

        Args:
            state: before them.
            states: n states after them.
        """
        r, v = self.com_state(state)
        after = [self.com_state(child) for child in states]
        stands = np.array([child[1 - child[4]] for child in states])
        success = np.ones(len(states))
        if self._capture == "worst-case":
            for foot in np.unique(stands).tolist():
                success[stands == foot] = self._calm(foot, r[None], v[None], self._swing_time)[0]
            return success
        share = np.arange(MOMENTS) / (MOMENTS - 1)
        end = np.array([LIFTED * com + (1.0 - LIFTED) * r for com, _ in after])
        final = np.array([velocity for _, velocity in after])
        com = r + share[None, :, None] * (end - r)[:, None]  # (n, n_t, 3)
        velocity = v + share[None, :, None] * (final - v)[:, None]
        for foot in np.unique(stands).tolist():
            mine = np.flatnonzero(stands == foot)
            # the first moment is the same for all
            first = self._calm(foot, r[None], v[None], self._swing_time / MOMENTS)[0]
            later = self._calm(
                foot, com[mine, 1:].reshape(-1, 3), velocity[mine, 1:].reshape(-1, 3), self._swing_time / MOMENTS
            )
            success[mine] = first * later.reshape(len(mine), -1).prod(axis=1)
        return success

    def success_of(self, path: Sequence[State]) -> float:
        """Product of P_success over the transitions of a path (Lin 2020 eq. 7.6), as the search sees it."""
        return float(np.prod([self.success(before, [after])[0] for before, after in pairwise(path)]))

    def _calm(self, foot: int, com: np.ndarray, velocity: np.ndarray, duration: float) -> np.ndarray:
        """(m,) probability that no push within this time fells the robot, from m states over one foot."""
        here = pushes_along(self._disturbances, com)
        rows = np.repeat(np.arange(len(com)), [len(pushes.impulses) for pushes in here])
        if not len(rows):
            return np.ones(len(com))
        impulse = np.concatenate([pushes.impulses for pushes in here])
        probability = np.concatenate([pushes.within(duration) for pushes in here])
        rejected = self.odds.rejection(foot, com[rows], velocity[rows] + impulse / self._mass)
        falls = np.bincount(rows, weights=probability * (1.0 - rejected), minlength=len(com))
        return np.maximum(1.0 - falls, LEAST_SUCCESS)
