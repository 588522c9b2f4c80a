"""Contact transitions as rows of numbers: ten categories, one side of the body, one frame (Lin et al. 2019 fig. 3, sec. VII).

A transition is the stance before, the end effector that moves and where it goes, and the CoM with its velocity at the
start. Its dynamics do not change when the world is shifted, turned, or mirrored left to right, so it is brought to one
representative:

    frame F     origin the mean of the two feet before, z up; x is
                "heading": the mean heading of the feet (the documents' encoding has the yaw removed)
                "quarter": the axis of W, +-x or +-y, that is nearest to it
    mirror      y -> -y and left <-> right, where that puts the only palm held, else the mover, on the left side

Turned by any angle the physics are the same; our program also has a box for the final CoM and bounds on momentum along
W's axes, so that it is the same after quarter turns only. Frame "quarter" is exact, "heading" the documents'.

    category        mover              inputs (documented encoding)
    0  feet only    moves a foot       24
    1               adds a palm        24
    2  one palm     moves inner foot   30      inner: the foot on the side of the palm that is held
    3               moves outer foot   30
    4               breaks the palm    24
    5               moves the palm     30
    6               adds the other     30
    7  both palms   moves a foot       36
    8               breaks a palm      30
    9               moves a palm       36

The documented encoding (Lin et al. 2019 sec. VII) is position and Tait-Bryan angles X-Y-Z of each contact in F, then CoM and
velocity: a list of its own for each category. Another one is in `relative_features.py`.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numba import njit

from learning.transition_batch import TransitionArrays, TransitionBatch
from scenes.effector import EFFECTORS
from scenes.stance import Stance

CATEGORIES = (
    "feet only: move a foot",
    "feet only: add a palm",
    "one palm: move the inner foot",
    "one palm: move the outer foot",
    "one palm: break it",
    "one palm: move it",
    "one palm: add the other",
    "both palms: move a foot",
    "both palms: break one",
    "both palms: move one",
)
NUM_CATEGORIES = len(CATEGORIES)
Frame = Literal["heading", "quarter"]
UNKNOWN = -1  # a foot in the air before or after, a palm broken that was not held, ...
SLOTS = (*EFFECTORS, "new")  # of the representative: contacts before, then the contact that is made
_SLOTS_OF_CATEGORY = (
    (0, 1, 4), (0, 1, 4),
    (0, 1, 2, 4), (0, 1, 2, 4), (0, 1, 2), (0, 1, 2, 4), (0, 1, 2, 4),
    (0, 1, 2, 3, 4), (0, 1, 2, 3), (0, 1, 2, 3, 4),
)  # fmt: skip
_MIRROR = np.array([1.0, -1.0, 1.0])


class CanonicalTransitions(NamedTuple):
    """The representatives of n transitions, in frame F, mirrored where that is said.

    Attributes:
        category: (n,) 0..9 or `UNKNOWN`; rows of unknown category hold zeros.
        mirrored: (n,) bool.
        origin: (n, 3) of F in W [m].
        heading: (n, 2) cos and sin of F's yaw in W.
        mover: (n,) the end effector that moves, after mirroring.
        present: (n, 5) bool, which of `SLOTS` hold a contact.
        p: (n, 5, 3) contact points in F [m]; 0 where absent.
        R: (n, 5, 3, 3) contact frames in F; 0 where absent.
        com: (n, 3) in F [m].
        velocity: (n, 3) in F [m/s].
        feet_after: (n, 3) mean of the feet after the transition in F [m].
    """

    category: np.ndarray
    mirrored: np.ndarray
    origin: np.ndarray
    heading: np.ndarray
    mover: np.ndarray
    present: np.ndarray
    p: np.ndarray
    R: np.ndarray
    com: np.ndarray
    velocity: np.ndarray
    feet_after: np.ndarray

    def take(self, rows: np.ndarray) -> CanonicalTransitions:
        """These rows of it, by index or mask."""
        return CanonicalTransitions(*(array[rows] for array in self))

    def vectors_from_world(self, v_W: np.ndarray) -> np.ndarray:
        """(n, 3) free vectors of W in the axes of F, mirrored like the rows."""
        c, s = self.heading.T
        v_F = np.stack([c * v_W[:, 0] + s * v_W[:, 1], c * v_W[:, 1] - s * v_W[:, 0], v_W[:, 2]], axis=1)
        return np.where(self.mirrored[:, None], v_F * _MIRROR, v_F)

    def vectors_to_world(self, v_F: np.ndarray) -> np.ndarray:
        """(n, 3) the inverse of `vectors_from_world`."""
        v_F = np.where(self.mirrored[:, None], v_F * _MIRROR, v_F)
        c, s = self.heading.T
        return np.stack([c * v_F[:, 0] - s * v_F[:, 1], c * v_F[:, 1] + s * v_F[:, 0], v_F[:, 2]], axis=1)

    def points_from_world(self, p_W: np.ndarray) -> np.ndarray:
        """(n, 3) points of W [m] in F, mirrored like the rows."""
        return self.vectors_from_world(p_W - self.origin)

    def points_to_world(self, p_F: np.ndarray) -> np.ndarray:
        """(n, 3) the inverse of `points_from_world`."""
        return self.vectors_to_world(p_F) + self.origin


def canonicalise(batch: TransitionBatch, frame: Frame = "heading") -> CanonicalTransitions:
    """Brings every transition to the representative of its class (see the top of the file).

    Args:
        batch: n transitions in W.
        frame: which frame F, see the top of the file.
    """
    n = len(batch)
    c = CanonicalTransitions(
        category=np.full(n, UNKNOWN, np.int64),
        mirrored=np.zeros(n, np.bool_),
        origin=np.zeros((n, 3)),
        heading=np.zeros((n, 2)),
        mover=np.zeros(n, np.int64),
        present=np.zeros((n, 5), np.bool_),
        p=np.zeros((n, 5, 3)),
        R=np.zeros((n, 5, 3, 3)),
        com=np.zeros((n, 3)),
        velocity=np.zeros((n, 3)),
        feet_after=np.zeros((n, 3)),
    )
    _canonicalise(batch.arrays, frame == "quarter", c)
    return c


def canonical(before: Stance, after: Stance, com: np.ndarray, velocity: np.ndarray) -> tuple[int, np.ndarray, bool]:
    """Category, documented feature row and whether it was mirrored, of one transition.

    Args:
        before: stance at the start.
        after: stance at the end, different in one end effector.
        com: (3,) in W at the start [m].
        velocity: (3,) in W [m/s].

    Returns:
        The row is empty where the category is `UNKNOWN`.
    """
    c = canonicalise(TransitionBatch.from_stances([(before, after)], com, velocity))
    category = int(c.category[0])
    row = np.zeros(0) if category == UNKNOWN else documented_features(c, category)[0]
    return category, row, bool(c.mirrored[0])


def documented_feature_names(category: int) -> tuple[str, ...]:
    """Names of the documented inputs of one category, in order."""
    slots = [f"{SLOTS[s]}.{part}" for s in _SLOTS_OF_CATEGORY[category] for part in ("x", "y", "z", "rx", "ry", "rz")]
    return (*slots, *(f"com.{a}" for a in "xyz"), *(f"velocity.{a}" for a in "xyz"))


def documented_features(c: CanonicalTransitions, category: int) -> np.ndarray:
    """(m, d) documented inputs of the m rows of this category, in their order; angles in [-pi, pi).

    Args:
        c: representatives, in frame "heading".
        category: 0..9.
    """
    rows = np.flatnonzero(c.category == category)
    slots = np.array(_SLOTS_OF_CATEGORY[category])
    pose = np.concatenate([c.p[rows][:, slots], tait_bryan(c.R[rows][:, slots])], axis=2)
    return np.concatenate([pose.reshape(len(rows), -1), c.com[rows], c.velocity[rows]], axis=1)


def tait_bryan(R: np.ndarray) -> np.ndarray:
    """(..., 3) angles a, b, c in [-pi, pi) with R = Rx(a) Ry(b) Rz(c), of rotations (..., 3, 3) [rad].

    In this order the angles of palms on side walls stay clear of the singularity (the normal along +-x of F).
    """
    a = np.arctan2(-R[..., 1, 2], R[..., 2, 2])
    b = np.arctan2(R[..., 0, 2], np.hypot(R[..., 0, 0], R[..., 0, 1]))
    c = np.arctan2(-R[..., 0, 1], R[..., 0, 0])
    angles = np.stack([a, b, c], axis=-1)
    return np.where(angles >= np.pi, angles - 2 * np.pi, angles)


@njit(cache=True)
def _canonicalise(batch: TransitionArrays, quarter: bool, canonical: CanonicalTransitions) -> None:
    """Fills the representatives, which hold zeros."""
    p, R, com, velocity, makes = batch.p, batch.R, batch.com, batch.velocity, batch.makes
    origin, p_F, R_F = canonical.origin, canonical.p, canonical.R
    com_F, velocity_F = canonical.com, canonical.velocity
    for i in range(batch.held.shape[0]):
        m = batch.mover[i]
        kind, flip = _category(batch.held[i], m, makes[i])
        canonical.category[i] = kind
        if kind < 0:
            canonical.heading[i, 0] = 1.0
            continue
        canonical.mirrored[i] = flip
        c, s = _mean_heading(R[i])
        if quarter:
            c, s = (1.0 if c > 0 else -1.0, 0.0) if abs(c) >= abs(s) else (0.0, 1.0 if s > 0 else -1.0)
        canonical.heading[i, 0], canonical.heading[i, 1] = c, s
        for a in range(3):
            origin[i, a] = 0.5 * (p[i, 0, a] + p[i, 1, a])
        y = -1.0 if flip else 1.0
        for e in range(4):
            if batch.held[i, e]:
                slot = e ^ 1 if flip else e  # left and right are neighbours in EFFECTORS
                canonical.present[i, slot] = True
                _set_pose(p[i, e], R[i, e], origin[i], c, s, y, p_F[i, slot], R_F[i, slot])
        if makes[i]:
            canonical.present[i, 4] = True
            _set_pose(batch.p_new[i], batch.R_new[i], origin[i], c, s, y, p_F[i, 4], R_F[i, 4])
        mover = m ^ 1 if flip else m
        canonical.mover[i] = mover
        x0, x1 = com[i, 0] - origin[i, 0], com[i, 1] - origin[i, 1]
        com_F[i, 0], com_F[i, 1], com_F[i, 2] = c * x0 + s * x1, y * (c * x1 - s * x0), com[i, 2] - origin[i, 2]
        v = velocity[i]
        velocity_F[i, 0], velocity_F[i, 1], velocity_F[i, 2] = c * v[0] + s * v[1], y * (c * v[1] - s * v[0]), v[2]
        for a in range(3):
            left, right = p_F[i, 0, a], p_F[i, 1, a]
            if makes[i] and mover == 0:
                left = p_F[i, 4, a]
            elif makes[i] and mover == 1:
                right = p_F[i, 4, a]
            canonical.feet_after[i, a] = 0.5 * (left + right)


@njit(cache=True)
def _category(held: np.ndarray, mover: int, makes: bool) -> tuple[int, bool]:
    """Category of a transition and whether its representative is mirrored; both feet must stand before and after."""
    if mover < 0 or mover > 3 or not (held[0] and held[1]) or (mover < 2 and not makes):
        return -1, False
    palms = int(held[2]) + int(held[3])
    if mover >= 2 and not makes and not held[mover]:
        return -1, False
    right_mover = mover == 1 or mover == 3
    if palms == 0:
        return (0, right_mover) if mover < 2 else (1, right_mover)
    if palms == 2:
        kind = 7 if mover < 2 else 9 if makes else 8
        return kind, right_mover
    flip = bool(held[3])  # the palm that is held comes to the left side
    inner = right_mover == flip
    if mover < 2:
        return (2 if inner else 3), flip
    if not inner:
        return 6, flip
    return (5 if makes else 4), flip


@njit(cache=True)
def _mean_heading(R: np.ndarray) -> tuple[float, float]:
    """cos and sin of the mean yaw of the two feet; that of the left foot where they point in opposite directions."""
    c, s, c_left, s_left = 0.0, 0.0, 1.0, 0.0
    for e in range(2):
        length = np.hypot(R[e, 0, 0], R[e, 1, 0])
        if length > 1e-9:
            c, s = c + R[e, 0, 0] / length, s + R[e, 1, 0] / length
            if e == 0:
                c_left, s_left = c, s
    length = np.hypot(c, s)
    if length < 1e-6:
        return c_left, s_left
    return c / length, s / length


@njit(cache=True)
def _set_pose(
    p: np.ndarray, R: np.ndarray, origin: np.ndarray, c: float, s: float, y: float, p_F: np.ndarray, R_F: np.ndarray
) -> None:
    """X_FC of a contact X_WC; mirrored (y = -1) it is M X_FC M with M = diag(1, -1, 1), again a rotation."""
    x0, x1 = p[0] - origin[0], p[1] - origin[1]
    p_F[0], p_F[1], p_F[2] = c * x0 + s * x1, y * (c * x1 - s * x0), p[2] - origin[2]
    for a in range(3):
        z = y if a == 1 else 1.0
        R_F[0, a] = z * (c * R[0, a] + s * R[1, a])
        R_F[1, a] = z * y * (c * R[1, a] - s * R[0, a])
        R_F[2, a] = z * R[2, a]
