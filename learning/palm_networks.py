"""One network for each number of palms that are held before the transition.

What feet alone can do, what they can with one palm and with two are three problems, and a network that learns one of
them can be smaller than one that learns all. Every child of an expansion belongs to the same problem, so that a planner asks one
network of the three: three times the weights at the same time of a query.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from learning.network import NetworkAnswer, SharedNetwork
from learning.relative_features import RELATIVE_FRAME
from learning.transition_features import CanonicalTransitions, Frame

PALMS = np.array([0, 0, 1, 1, 1, 1, 1, 2, 2, 2])  # held before, in each category
NUM_PALMS = 3


@dataclass(frozen=True, eq=False)
class PalmNetworks:
    """Networks by how many palms are held; each knows the categories that begin so.

    Attributes:
        networks: for none, one and both.
    """

    networks: tuple[SharedNetwork, SharedNetwork, SharedNetwork]
    frame: Frame = RELATIVE_FRAME

    def answer(self, c: CanonicalTransitions, relative: np.ndarray) -> NetworkAnswer:
        """See `learning.network.TransitionNetwork`.

        Args:
            c: n representatives, in the frame of these networks.
            relative: (n, d) their features of `relative_features.py`.
        """
        palms = PALMS[c.category]  # rows of unknown category may go anywhere
        if len(palms) and (palms == palms[0]).all():
            return self.networks[palms[0]].answer(c, relative)
        n = len(palms)
        whole = NetworkAnswer(np.zeros(n), np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3)))
        for k, network in enumerate(self.networks):
            rows = np.flatnonzero(palms == k)
            if len(rows):
                part = network.answer(c.take(rows), relative[rows])
                whole.logit[rows], whole.cost[rows] = part.logit, part.cost
                whole.com[rows], whole.velocity[rows] = part.com, part.velocity
        return whole
