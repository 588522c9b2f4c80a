"""Where a motion needs more weight on what it did not keep: contacts, CoM, momenta, distances between bodies, calm joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drakeplan.motion.check import Problem

NEAR = 0.25  # [s] before and after a problem that take part in its repair
FIRMER = 2.5  # times that a weight grows for each repair
WEIGHT_OF = {
    "held": "hold",
    "com": "com",
    "speed": "calm",
    "jerk": "calm",
    "acceleration": "calm",
    "self collision": "apart",
    "terrain collision": "apart",
    "sole collision": "apart",
    "angular momentum": "follow",
    "linear momentum": "follow",
}


class Emphasis:
    """Factors on the weights of each frame, all 1 at first.

    Attributes:
        hold: (T,) of end effectors' places.
        com: (T,) of the CoM.
        calm: (T,) of accelerations.
        apart: (T,) of distances between bodies.
        follow: (T,) of momenta.
    """

    def __init__(self, t: np.ndarray) -> None:
        """Begins without emphasis.

        Args:
            t: (T,) times of the frames [s].
        """
        self._t = t
        self.hold, self.com, self.calm, self.apart, self.follow = (np.ones(len(t)) for _ in range(5))

    def stress(self, problems: Sequence[Problem]) -> np.ndarray:
        """Raises the weights near each problem, once for each kind; (T,) the frames that are concerned.

        Args:
            problems: what is wrong.
        """
        concerned = {name: np.zeros(len(self._t), dtype=bool) for name in WEIGHT_OF.values()}
        for problem in problems:
            first, last = problem.span
            concerned[WEIGHT_OF[problem.kind]] |= (self._t > first - NEAR) & (self._t < last + NEAR)
        for name, near in concerned.items():
            getattr(self, name)[near] *= FIRMER
        return np.any(list(concerned.values()), axis=0)
