"""How different two plans are: the Hausdorff distance of their contact poses (Lin 2020 eq. 4.2 and 4.3).

    eta(c_i, c_j) = |X_i - X_j| + w_r (1 - |Q_i . Q_j|) for contacts of one end effector, infinite for others
    d(pi_1, pi_2) = max( max_i min_j eta(c_i, c_j), max_j min_i eta(c_i, c_j) )

Both plans are in their own frames (`stored_plan`), which aligns their starts and the ways to their goals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from drakeplan.experience.stored_plan import Outline

TURN_WEIGHT = 0.5  # [m] w_r (Lin 2020 sec. 4.6)


@dataclass(frozen=True, eq=False)
class PlanBatch:
    """The contacts of M plans, one after the other.

    Attributes:
        start: (M + 1,) where the contacts of each plan begin.
        position: (K, 3) contact points, each in its plan's frame [m].
        quaternion: (K, 4) orientations (w, x, y, z).
        effector: (K,) index into `EFFECTORS`.
        first: (K,) stance in which each contact appears first.
    """

    start: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray
    effector: np.ndarray
    first: np.ndarray

    def __len__(self) -> int:
        return len(self.start) - 1

    @staticmethod
    def of(outlines: Sequence[Outline]) -> PlanBatch:
        """The contacts of these plans."""
        counts = [len(outline.effector) for outline in outlines]
        return PlanBatch(
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            np.concatenate([np.zeros((0, 3)), *(o.position for o in outlines)]),
            np.concatenate([np.zeros((0, 4)), *(o.quaternion for o in outlines)]),
            np.concatenate([np.zeros(0, np.int64), *(o.effector for o in outlines)]),
            np.concatenate([np.zeros(0, np.int64), *(o.first for o in outlines)]),
        )


def distances(one: Outline, others: PlanBatch) -> np.ndarray:
    """(M,) Hausdorff distance of a plan from each of others [m]; infinite where they use other end effectors.

    Args:
        one: in its own frame.
        others: each in its own.
    """
    return _distances(
        np.ascontiguousarray(one.position, dtype=np.float64),
        np.ascontiguousarray(one.quaternion, dtype=np.float64),
        np.ascontiguousarray(one.effector, dtype=np.int64),
        others.start,
        np.ascontiguousarray(others.position),
        np.ascontiguousarray(others.quaternion),
        others.effector,
    )


@njit(cache=True)
def _distances(
    p: np.ndarray,
    Q: np.ndarray,
    e: np.ndarray,
    start: np.ndarray,
    others_p: np.ndarray,
    others_Q: np.ndarray,
    others_e: np.ndarray,
) -> np.ndarray:
    found = np.empty(len(start) - 1)
    for m in range(len(found)):
        a, b = start[m], start[m + 1]
        there = _one_sided(p, Q, e, others_p[a:b], others_Q[a:b], others_e[a:b])
        back = _one_sided(others_p[a:b], others_Q[a:b], others_e[a:b], p, Q, e)
        found[m] = max(there, back)
    return found


@njit(cache=True)
def _one_sided(
    p: np.ndarray, Q: np.ndarray, e: np.ndarray, to_p: np.ndarray, to_Q: np.ndarray, to_e: np.ndarray
) -> float:
    """The greatest distance of a contact of the first plan from the nearest one of the second."""
    worst = 0.0
    for i in range(len(e)):
        nearest = np.inf
        for j in range(len(to_e)):
            if to_e[j] != e[i]:
                continue
            x, y, z = p[i, 0] - to_p[j, 0], p[i, 1] - to_p[j, 1], p[i, 2] - to_p[j, 2]
            away = np.sqrt(x * x + y * y + z * z)
            if away >= nearest:
                continue
            turn = abs(Q[i, 0] * to_Q[j, 0] + Q[i, 1] * to_Q[j, 1] + Q[i, 2] * to_Q[j, 2] + Q[i, 3] * to_Q[j, 3])
            nearest = min(nearest, away + TURN_WEIGHT * (1.0 - turn))
            if nearest <= worst:  # it cannot be the farthest any more
                break
        if nearest > worst:
            worst = nearest
    return worst
