"""Contact transitions as arrays: what a search hands to a surrogate, one row a child."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.effector import EFFECTORS
from scenes.stance import Stance, changed_effector


class TransitionArrays(NamedTuple):
    """The arrays of a `TransitionBatch` as kernels take them; see there."""

    held: np.ndarray
    p: np.ndarray
    R: np.ndarray
    mover: np.ndarray
    makes: np.ndarray
    p_new: np.ndarray
    R_new: np.ndarray
    com: np.ndarray
    velocity: np.ndarray


@dataclass(frozen=True, eq=False)
class TransitionBatch:
    """n transitions as arrays; poses of end effectors that hold nothing may be anything finite.

    Attributes:
        held: (n, E) bool, which end effectors hold a contact before.
        p: (n, E, 3) their contact points in W [m].
        R: (n, E, 3, 3) their contact frames in W.
        mover: (n,) int, the end effector that moves, index into `EFFECTORS`.
        makes: (n,) bool, whether the mover holds a contact after.
        p_new: (n, 3) its contact point in W [m].
        R_new: (n, 3, 3) its contact frame in W.
        com: (n, 3) CoM in W at the start [m].
        velocity: (n, 3) its velocity in W [m/s].
        friction: (n,) least coefficient among the contacts that take part [-], or None: as in training.
    """

    held: np.ndarray
    p: np.ndarray
    R: np.ndarray
    mover: np.ndarray
    makes: np.ndarray
    p_new: np.ndarray
    R_new: np.ndarray
    com: np.ndarray
    velocity: np.ndarray
    friction: np.ndarray | None = None

    def __post_init__(self) -> None:
        n, E = len(self.held), len(EFFECTORS)
        shapes = {"held": (n, E), "p": (n, E, 3), "R": (n, E, 3, 3), "mover": (n,), "makes": (n,), "p_new": (n, 3),
                  "R_new": (n, 3, 3), "com": (n, 3), "velocity": (n, 3)}  # fmt: skip
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"transition batch: {name} has shape {getattr(self, name).shape}, expected {shape}")
        if self.friction is not None and self.friction.shape != (n,):
            raise ValueError(f"transition batch: friction has shape {self.friction.shape}, expected {(n,)}")

    def __len__(self) -> int:
        return len(self.held)

    @property
    def arrays(self) -> TransitionArrays:
        """All of it but the friction, for kernels."""
        return TransitionArrays(
            self.held, self.p, self.R, self.mover, self.makes, self.p_new, self.R_new, self.com, self.velocity
        )

    def take(self, rows: np.ndarray) -> TransitionBatch:
        """These rows of it, by index or mask."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(self, **{name: None if a is None else a[rows] for name, a in arrays.items()})

    @classmethod
    def from_stances(
        cls, stances: Sequence[tuple[Stance, Stance]], com: np.ndarray, velocity: np.ndarray
    ) -> TransitionBatch:
        """The batch of n pairs of stances.

        Args:
            stances: before and after each transition.
            com: (n, 3) CoM in W at the start [m].
            velocity: (n, 3) its velocity in W [m/s].

        Raises:
            ValueError: a pair differs in none or in more than one end effector.
        """
        n, E = len(stances), len(EFFECTORS)
        held, makes, mover = np.zeros((n, E), bool), np.zeros(n, bool), np.zeros(n, np.int64)
        X, X_new, friction = np.tile(np.eye(4), (n, E, 1, 1)), np.tile(np.eye(4), (n, 1, 1)), np.full(n, np.inf)
        for i, (before, after) in enumerate(stances):
            mover[i] = changed_effector(before, after)
            for e, contact in enumerate(before.contacts):
                if contact is not None:
                    held[i, e], X[i, e] = True, contact.X_WC
            made = after.contacts[mover[i]]
            if made is not None:
                makes[i], X_new[i] = True, made.X_WC
            friction[i] = min((c.friction for c in (*before.held, *after.held)), default=np.inf)
        return cls(
            held, X[..., :3, 3].copy(), X[..., :3, :3].copy(), mover, makes, X_new[:, :3, 3].copy(),
            X_new[:, :3, :3].copy(), np.array(com, float).reshape(n, 3), np.array(velocity, float).reshape(n, 3), friction,
        )  # fmt: skip

    @classmethod
    def of_children(
        cls,
        p: np.ndarray,
        R: np.ndarray,
        before: Sequence[int] | np.ndarray,
        after: np.ndarray,
        com: np.ndarray,
        velocity: np.ndarray,
        friction: np.ndarray | None = None,
    ) -> TransitionBatch:
        """The n children of one search state, from contacts by number.

        Args:
            p: (C, 3) points of all contacts in W [m].
            R: (C, 3, 3) their frames in W.
            before: (E,) contact number of each end effector, -1 where it is free.
            after: (n, E) the same after each transition; each differs from `before` in one end effector.
            com: (3,) CoM in W at the start [m].
            velocity: (3,) its velocity in W [m/s].
            friction: (C,) coefficients of all contacts, or None: as in training.

        Raises:
            ValueError: a child differs from its parent in none or in more than one end effector.
        """
        before, after = np.asarray(before, np.int64), np.asarray(after, np.int64).reshape(-1, len(EFFECTORS))
        n = len(after)
        children = TransitionArrays(
            held=np.zeros((n, 4), np.bool_),
            p=np.zeros((n, 4, 3)),
            R=np.zeros((n, 4, 3, 3)),
            mover=np.zeros(n, np.int64),
            makes=np.zeros(n, np.bool_),
            p_new=np.zeros((n, 3)),
            R_new=np.zeros((n, 3, 3)),
            com=np.empty((n, 3)),
            velocity=np.empty((n, 3)),
        )
        children.com[:], children.velocity[:] = com, velocity
        mu, least = np.zeros(0) if friction is None else np.asarray(friction, float), np.full(n, np.inf)
        if not _children(p, R, mu, before, after, children, least):
            raise ValueError("a child must differ from its parent in one end effector")
        return cls(*children, None if friction is None else least)


@njit(cache=True)
def _children(
    p: np.ndarray,
    R: np.ndarray,
    mu: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
    children: TransitionArrays,
    least: np.ndarray,
) -> bool:
    """Fills `children` and `least`; False where a row differs from `before` in none or in more than one entry."""
    held, p_held, R_held, mover, makes = children.held, children.p, children.R, children.mover, children.makes
    for i in range(len(after)):
        changed = 0
        for e in range(4):
            number = before[e]
            if after[i, e] != number:
                changed += 1
                mover[i] = e
            if number >= 0:
                held[i, e] = True
                p_held[i, e], R_held[i, e] = p[number], R[number]
                if len(mu):
                    least[i] = min(least[i], mu[number])
        if changed != 1:
            return False
        number = after[i, mover[i]]
        if number >= 0:
            makes[i] = True
            children.p_new[i], children.R_new[i] = p[number], R[number]
            if len(mu):
                least[i] = min(least[i], mu[number])
    return True
