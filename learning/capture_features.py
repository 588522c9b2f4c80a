"""What networks of capture are told about a question, in frame F of the standing foot (`capture_view.py`).

Ours are 45 numbers for every capture motion; without a new contact its numbers are 0. The capture point of the linear inverted
pendulum, xi = com + v / omega with omega^2 = g / z (Pratt et al. 2006), is among them: it decides most questions on level ground.
A step in time d captures the pendulum where xi lies in exp(-omega d) A + (1 - exp(-omega d)) B, A the support after the step and B
before (Koolen et al. 2012 sec. 3.3): hence where xi lies from the line between their middles, for each of three times.
Those of Lin 2020 fig. 7.3 are contact poses as positions and Tait-Bryan angles X-Y-Z, the CoM, and its velocity.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from learning.capture_view import STAY, CaptureViews
from learning.transition_features import tait_bryan
from scenes.gravity import GRAVITY

NUM_FEATURES = 45
NUM_STATE = 20  # of them are of the state and the standing foot
SWINGS = (0.2, 0.4, 0.6)  # [s] of a step (Lin 2020 sec. 7.5)
NAMES = (
    "com.x", "com.y", "com.z", "velocity.x", "velocity.y", "velocity.z", "spin.x", "spin.y", "spin.z",
    "foot.xx", "foot.xz", "foot.nx", "foot.ny", "foot.nz", "capture_point.x", "capture_point.y",
    "capture_point_in_foot.x", "capture_point_in_foot.y", "reach_0.2", "reach_0.4",
    "new.x", "new.y", "new.z", "new.xx", "new.xy", "new.xz", "new.nx", "new.ny", "new.nz",
    "new_from_capture_point.x", "new_from_capture_point.y", "new_from_com.distance", "closing_speed", "speed_along_normal",
    "off_line_0.2.x", "off_line_0.2.y", "along_line_0.2", "off_line_0.4.x", "off_line_0.4.y", "along_line_0.4",
    "off_line_0.6.x", "off_line_0.6.y", "along_line_0.6", "new_reach_0.2", "new_reach_0.4",
)  # fmt: skip
SPIN = slice(6, 9)
LEAST_HEIGHT = 0.1  # [m] of the CoM in the pendulum's frequency
DOCUMENTED = (12, 18)  # inputs of Lin 2020 fig. 7.3, without and with a new contact
ANGLES = (3, 4, 5, 9, 10, 11)  # of them that are angles; the last three with a new contact only


def features(views: CaptureViews) -> np.ndarray:
    """(n, 45) float32 of n questions, in the order of `NAMES`."""
    out = np.empty((len(views), NUM_FEATURES), np.float32)
    makes = views.motion != STAY
    _rows(views.com, views.velocity, views.spin, views.foot_R, views.p_new, views.R_new, makes, out)
    return out


@njit(cache=True)
def _rows(
    com: np.ndarray,
    velocity: np.ndarray,
    spin: np.ndarray,
    foot_R: np.ndarray,
    p_new: np.ndarray,
    R_new: np.ndarray,
    makes: np.ndarray,
    out: np.ndarray,
) -> None:
    for i in range(len(com)):
        write_state(com[i], velocity[i], spin[i], foot_R[i], out[i])
        if makes[i]:
            write_contact(com[i], velocity[i], p_new[i], R_new[i], out[i])
        else:
            out[i, NUM_STATE:] = 0.0


@njit(cache=True)
def write_state(com: np.ndarray, velocity: np.ndarray, spin: np.ndarray, foot_R: np.ndarray, row: np.ndarray) -> None:
    """The first 20 features: of the state and the standing foot.

    Args:
        com: (3,) in F [m].
        velocity: (3,) of it [m/s].
        spin: (3,) angular momentum over mass [m^2/s].
        foot_R: (3, 3) frame of the standing foot's contact in F.
        row: (45,) written here.
    """
    for a in range(3):
        row[a], row[3 + a], row[6 + a] = com[a], velocity[a], spin[a]
        row[11 + a] = foot_R[a, 2]
    row[9], row[10] = foot_R[0, 0], foot_R[2, 0]
    fall = np.sqrt(max(com[2], LEAST_HEIGHT) / GRAVITY)
    x, y = com[0] + fall * velocity[0], com[1] + fall * velocity[1]
    row[14], row[15] = x, y
    row[16], row[17] = foot_R[0, 0] * x + foot_R[1, 0] * y, foot_R[0, 1] * x + foot_R[1, 1] * y
    for k in range(2):
        far = 0.0
        for a in range(3):
            far += (com[a] + SWINGS[k] * velocity[a]) ** 2
        row[18 + k] = np.sqrt(far)


@njit(cache=True)
def write_contact(com: np.ndarray, velocity: np.ndarray, p_new: np.ndarray, R_new: np.ndarray, row: np.ndarray) -> None:
    """The last 25 features: of the new contact. Those of the state have to be there.

    Args:
        com: (3,) in F [m].
        velocity: (3,) of it [m/s].
        p_new: (3,) new contact in F [m].
        R_new: (3, 3) its frame in F.
        row: (45,) written here.
    """
    far, closing, along = 0.0, 0.0, 0.0
    for a in range(3):
        row[20 + a], row[23 + a], row[26 + a] = p_new[a], R_new[a, 0], R_new[a, 2]
        d = p_new[a] - com[a]
        far += d * d
        closing += d * velocity[a]
        along += R_new[a, 2] * velocity[a]
    far = np.sqrt(far)
    row[29], row[30] = p_new[0] - row[14], p_new[1] - row[15]
    row[31], row[32], row[33] = far, closing / max(far, 0.05), along
    omega = np.sqrt(GRAVITY / max(com[2], LEAST_HEIGHT))
    length = p_new[0] * p_new[0] + p_new[1] * p_new[1]
    for k in range(3):
        shrink = np.exp(-omega * SWINGS[k])
        share = (row[14] * p_new[0] + row[15] * p_new[1]) / max(shrink * length, 1e-9)
        share = min(max(share, 0.0), 1.0)
        row[34 + 3 * k] = row[14] - share * shrink * p_new[0]
        row[35 + 3 * k] = row[15] - share * shrink * p_new[1]
        row[36 + 3 * k] = share
    for k in range(2):
        far = 0.0
        for a in range(3):
            far += (p_new[a] - com[a] - SWINGS[k] * velocity[a]) ** 2
        row[43 + k] = np.sqrt(far)


def documented_features(views: CaptureViews) -> np.ndarray:
    """(n, 12 or 18) float32 inputs of Lin 2020 fig. 7.3, of questions about one capture motion.

    Standing foot, new contact where one is made: position [m] and Tait-Bryan angles X-Y-Z [rad]; CoM [m], its velocity [m/s].
    """
    makes = bool(len(views)) and views.motion[0] != STAY
    zero = np.zeros((len(views), 3))
    parts = [zero, tait_bryan(views.foot_R)]
    if makes:
        parts += [views.p_new, tait_bryan(views.R_new)]
    return np.concatenate([*parts, views.com, views.velocity], axis=1).astype(np.float32)
