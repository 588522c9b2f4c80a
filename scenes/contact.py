"""One end effector held on one surface, the frame that comes with it, and the part of its patch that rests there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from scenes.effector import EFFECTORS, is_foot

MOST_CORNERS = 8  # of a support
NEAR_LEVEL = 0.98  # |n_z| from which the world's up says nothing about where a palm's fingers point


@dataclass(frozen=True, eq=False)
class Contact:
    """One end effector held on one surface.

    Frame C sits at the centre of the sole or palm patch: z along the surface's outward normal, x forward.

    Attributes:
        effector: one of `EFFECTORS`.
        surface: index into the terrain's surfaces.
        X_WC: (4, 4) pose of the contact frame in W [m].
        friction: Coulomb coefficient there [-].
        heading: yaw that the x axis was projected from [rad].
        support: (V, 2) convex hull of what touches [m], counter-clockwise in C, at most `MOST_CORNERS` corners; None: the
            whole patch. Contact forces act at its corners, and nowhere else.
    """

    effector: str
    surface: int
    X_WC: np.ndarray
    friction: float
    heading: float = 0.0
    support: np.ndarray | None = None

    def __post_init__(self) -> None:
        X_WC = np.array(self.X_WC, dtype=float)
        X_WC.setflags(write=False)
        object.__setattr__(self, "X_WC", X_WC)
        if self.effector not in EFFECTORS:
            raise ValueError(f"effector {self.effector!r} is none of {EFFECTORS}")
        if X_WC.shape != (4, 4) or not np.isfinite(X_WC).all():
            raise ValueError("X_WC must be a finite (4, 4) pose")
        if self.support is not None:
            support = np.array(self.support, dtype=float)
            require_support(support)
            support.setflags(write=False)
            object.__setattr__(self, "support", support)

    @property
    def p_WC(self) -> np.ndarray:
        """(3,) contact point in W [m]."""
        return self.X_WC[:3, 3]

    @property
    def R_WC(self) -> np.ndarray:
        """(3, 3) orientation of the contact frame in W."""
        return self.X_WC[:3, :3]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Contact):
            return NotImplemented
        return self._key() == other._key() and np.array_equal(self.X_WC, other.X_WC)

    def __hash__(self) -> int:
        return hash((*self._key(), self.X_WC.tobytes()))

    def _key(self) -> tuple[str, int, float, bytes]:
        support = b"" if self.support is None else (self.support + 0.0).tobytes()  # -0.0 becomes 0.0
        return self.effector, self.surface, self.friction, support


def require_support(support: np.ndarray) -> None:
    """Raises ValueError unless (V, 2) points are a convex polygon, counter-clockwise, of 3 to `MOST_CORNERS` corners."""
    if support.ndim != 2 or support.shape[1] != 2 or not 3 <= len(support) <= MOST_CORNERS:
        raise ValueError(f"a support has 3 to {MOST_CORNERS} corners (x, y), got shape {support.shape}")
    edge = np.roll(support, -1, axis=0) - support
    following = np.roll(edge, -1, axis=0)
    turn = edge[:, 0] * following[:, 1] - edge[:, 1] * following[:, 0]
    once = np.arctan2(turn, (edge * following).sum(axis=1)).sum()
    if not np.isfinite(support).all() or turn.min() < -1e-12 or abs(once - 2 * np.pi) > 1e-3:
        raise ValueError("a support must be a convex polygon, counter-clockwise in the contact frame")


def patch_corners(half_extent: ArrayLike) -> np.ndarray:
    """(..., 4, 2) corners of rectangular patches in C [m], counter-clockwise from (+x, +y).

    Args:
        half_extent: (..., 2) half length along x and half width along y [m].
    """
    return np.asarray(half_extent, float)[..., None, :] * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])


def support_corners(contacts: Sequence[Contact], half_extents: np.ndarray) -> np.ndarray:
    """(n, V, 2) corners of n supports in their contact frames [m]; those of fewer corners than V repeat their last one.

    Args:
        contacts: n of them.
        half_extents: (E, 2) of the patch of each of `EFFECTORS` [m].
    """
    whole = patch_corners(half_extents)
    each = [whole[EFFECTORS.index(c.effector)] if c.support is None else c.support for c in contacts]
    most = max((len(corners) for corners in each), default=4)
    filled = [np.vstack([c, np.repeat(c[-1:], most - len(c), axis=0)]) for c in each]
    return np.array(filled, float).reshape(len(each), most, 2)


def contact_rotation(effector: str, normal: np.ndarray, heading: float) -> np.ndarray:
    """(3, 3) R_WC: z along the surface normal, x the heading (feet) or the world's up (palms) projected on it.

    On a nearly level surface up says nothing, and a palm's fingers point along the heading.

    Args:
        effector: name of the end effector.
        normal: (3,) outward unit normal of the surface in W.
        heading: yaw of the contact in W [rad].
    """
    forward = np.array([np.cos(heading), np.sin(heading), 0.0])
    if not is_foot(effector) and abs(normal[2]) < NEAR_LEVEL:
        forward = np.array([0.0, 0.0, 1.0])
    x = forward - (forward @ normal) * normal
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal], axis=1)


def contact_pose(effector: str, point: np.ndarray, normal: np.ndarray, heading: float) -> np.ndarray:
    """(4, 4) X_WC of an end effector placed at `point` [m] on a surface with this outward normal.

    Args:
        effector: name of the end effector.
        point: (3,) contact point in W [m].
        normal: (3,) outward unit normal of the surface in W.
        heading: yaw of the contact in W [rad].
    """
    X_WC = np.eye(4)
    X_WC[:3, :3] = contact_rotation(effector, np.asarray(normal, float), heading)
    X_WC[:3, 3] = point
    return X_WC


def contact_heading(X_WC: np.ndarray) -> float:
    """The heading whose projection on the contact's plane is its x axis [rad]; the inverse of `contact_rotation`."""
    x, n = X_WC[:3, 0], X_WC[:3, 2]
    level = x - (x[2] / n[2]) * n if abs(n[2]) > 1e-9 else x
    return float(np.arctan2(level[1], level[0]))
