"""One end effector held on one surface, and the frame that comes with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.effector import EFFECTORS, is_foot

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
    """

    effector: str
    surface: int
    X_WC: np.ndarray
    friction: float
    heading: float = 0.0

    def __post_init__(self) -> None:
        X_WC = np.array(self.X_WC, dtype=float)
        X_WC.setflags(write=False)
        object.__setattr__(self, "X_WC", X_WC)
        if self.effector not in EFFECTORS:
            raise ValueError(f"effector {self.effector!r} is none of {EFFECTORS}")
        if X_WC.shape != (4, 4) or not np.isfinite(X_WC).all():
            raise ValueError("X_WC must be a finite (4, 4) pose")

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
        return (self.effector, self.surface, self.friction) == (
            other.effector,
            other.surface,
            other.friction,
        ) and np.array_equal(self.X_WC, other.X_WC)

    def __hash__(self) -> int:
        return hash((self.effector, self.surface, self.friction, self.X_WC.tobytes()))


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
