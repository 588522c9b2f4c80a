"""How likely a pushed robot on one foot comes to rest, with what the place offers (Lin 2020 sec. 7.7.1).

Lin 2020 counts the capture poses that networks accept, n_c, and takes P_reject = 1 - exp(-gamma n_c). Poses that are near each
other fail together, which the document names as its main error (sec. 7.9). Here every capture motion counts once, with its
best pose, less the disagreement of the networks there:

    P_reject = 1 - prod_m (1 - max_j (p_mj - s_mj))          m: stay, foot, either palm; j: poses

Networks of different motions were trained on different questions, so that their errors have little in common.
"""

from __future__ import annotations

from collections import Counter
from typing import Literal

import numpy as np
from numba import njit

from drakeplan.robustness.capture_poses import CapturePoses
from learning.capture_features import NUM_FEATURES, NUM_STATE, write_contact, write_state
from learning.capture_networks import FRICTION_TOLERANCE, CaptureNetworks
from learning.capture_view import NUM_MOTIONS, STAY, CaptureViews, FootFrame
from learning.weights import WeightsError

CaptureModel = Literal["motions", "poses"]
GAMMA = 0.1  # Lin 2020 sec. 7.8
MOST_ROWS = 1 << 10  # questions in one batch: features and layers of so many stay in the cache


class CaptureOdds:
    """Asks the networks about all capture poses of a place at once.

    Attributes:
        asked: questions asked, by "all" and "far": outside the training data, which counts as not captured.
    """

    def __init__(self, networks: CaptureNetworks, poses: CapturePoses, model: CaptureModel = "motions") -> None:
        """Prepares the questions.

        Args:
            networks: that answer.
            poses: of the terrain.
            model: whether every motion counts once, or every pose (Lin 2020 sec. 7.7.1).
        """
        self.networks, self.poses, self.model = networks, poses, model
        self.asked: Counter[str] = Counter()

    def rejection(self, foot: int, com: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """(m,) P_reject of states right after a push.

        Args:
            foot: number of the standing foot's contact in the pool.
            com: (m, 3) in W [m].
            velocity: (m, 3) of it, in W [m/s].
        """
        frame, R, offered = self._place(foot)
        com_F, velocity_F = frame.points(com), frame.vectors(velocity)
        fails, captured = np.ones(len(com)), np.zeros(len(com))
        for motion in range(NUM_MOTIONS):
            p_new, R_new = offered[motion]
            if not len(p_new):
                continue
            best, count = self._ask(motion, com_F, velocity_F, R, p_new, R_new)
            fails *= 1.0 - best
            captured += count
        return 1.0 - fails if self.model == "motions" else 1.0 - np.exp(-GAMMA * captured)

    def likeliest(self, foot: int, com: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contacts that may catch one pushed state, the likeliest first, and how likely each is; -1 stands for none made.

        Args:
            foot: number of the standing foot's contact in the pool.
            com: (3,) in W [m].
            velocity: (3,) of it, in W [m/s].
        """
        frame, R, _ = self._place(foot)
        around = self.poses.about(foot)
        n = len(around.numbers)
        motion = np.concatenate([[STAY], around.motion])
        pool = self.poses.pool
        views = CaptureViews(
            motion,
            np.broadcast_to(R, (n + 1, 3, 3)),
            np.concatenate([np.zeros((1, 3)), frame.points(pool.p[around.numbers])]),
            np.concatenate([np.eye(3)[None], frame.rotations(pool.R[around.numbers])]),
            np.broadcast_to(frame.points(com), (n + 1, 3)),
            np.broadcast_to(frame.vectors(velocity), (n + 1, 3)),
            np.zeros((n + 1, 3)),
        )
        says = self.networks.predict(views)
        order = np.argsort(-says.probability, kind="stable")
        return np.concatenate([[-1], around.numbers])[order], says.probability[order]

    def require_friction(self, friction: np.ndarray) -> None:
        """Refuses ground that is more slippery than what was learned from.

        Args:
            friction: (n,) coefficients of the surfaces.

        Raises:
            WeightsError: one is lower.
        """
        if len(friction) and friction.min() < self.networks.friction - FRICTION_TOLERANCE:
            raise WeightsError(
                f"learned capture exists only for friction {self.networks.friction:g} and above, a surface has "
                f"{friction.min():g}: collect labels with `drakeplan collect capture --friction {friction.min():g}`"
            )

    def _place(self, foot: int) -> tuple[FootFrame, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
        """The frame of a standing foot, its contact frame there, and (n, 3) points and (n, 3, 3) frames by motion."""
        pool, around = self.poses.pool, self.poses.about(foot)
        frame = FootFrame.of(pool.p[foot], pool.R[foot], int(pool.effector[foot]))
        offered = [(np.zeros((1, 3)), np.eye(3)[None])]
        for motion in range(1, NUM_MOTIONS):
            numbers = around.numbers[around.motion == motion]
            offered.append((frame.points(pool.p[numbers]), frame.rotations(pool.R[numbers])))
        return frame, frame.rotations(pool.R[foot]), offered

    def _ask(
        self,
        motion: int,
        com: np.ndarray,
        velocity: np.ndarray,
        R: np.ndarray,
        p_new: np.ndarray,
        R_new: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """(m,) greatest probability less spread over the poses, and (m,) number of poses that capture."""
        m, n = len(com), len(p_new)
        best, count = np.zeros(m), np.zeros(m)
        step = max(MOST_ROWS // n, 1)
        documented = self.networks.kind == "documented"
        for first in range(0, m, step):
            some = slice(first, min(first + step, m))
            x = np.empty(((some.stop - some.start) * n, NUM_FEATURES), np.float32)
            _pairs(com[some], velocity[some], R, p_new, R_new, motion != STAY, x)
            inputs = _documented(motion, com[some], velocity[some], R, p_new, R_new) if documented else None
            says = self.networks.answer(motion, x, inputs)
            self.asked["all"] += len(x)
            self.asked["far"] += int(says.far.sum())
            p = np.where(says.far, 0.0, says.probability).reshape(-1, n)
            sure = np.maximum(p - says.spread.reshape(-1, n), 0.0)
            best[some], count[some] = sure.max(axis=1), (p >= 0.5).sum(axis=1)
        return best, count


def _documented(
    motion: int, com: np.ndarray, velocity: np.ndarray, R: np.ndarray, p_new: np.ndarray, R_new: np.ndarray
) -> np.ndarray:
    """(m n, 12 or 18) inputs of the documented networks for every state with every pose."""
    from learning.capture_features import documented_features

    m, n = len(com), len(p_new)
    zero = np.zeros((m * n, 3))
    views = CaptureViews(
        np.full(m * n, motion), np.broadcast_to(R, (m * n, 3, 3)), np.tile(p_new, (m, 1)), np.tile(R_new, (m, 1, 1)),
        np.repeat(com, n, axis=0), np.repeat(velocity, n, axis=0), zero,
    )  # fmt: skip
    return documented_features(views)


@njit(cache=True)
def _pairs(
    com: np.ndarray,
    velocity: np.ndarray,
    R: np.ndarray,
    p_new: np.ndarray,
    R_new: np.ndarray,
    makes: bool,
    x: np.ndarray,
) -> None:
    """Features of every state with every pose, without spin, row by row."""
    spin = np.zeros(3)
    n = len(p_new)
    for i in range(len(com)):
        for j in range(n):
            row = x[i * n + j]
            if j == 0:
                write_state(com[i], velocity[i], spin, R, row)
            else:
                row[:NUM_STATE] = x[i * n, :NUM_STATE]
            if makes:
                write_contact(com[i], velocity[i], p_new[j], R_new[j], row)
            else:
                row[NUM_STATE:] = 0.0
