"""Poses as people write them: xyz [m] and roll, pitch, yaw [rad] in the sense of Drake's RollPitchYaw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def rpy_rotation(rpy: Sequence[float] | np.ndarray) -> np.ndarray:
    """(3, 3) R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rotation_rpy(R: np.ndarray) -> np.ndarray:
    """(3,) roll, pitch, yaw that give back R to rounding, also where pitch is at +-90 deg and yaw is free.

    Palms on upright walls sit exactly there: their x axis points up.
    """
    horizontal = np.hypot(R[0, 0], R[1, 0])
    pitch = np.arctan2(-R[2, 0], horizontal)
    yaw = np.arctan2(R[1, 0], R[0, 0]) if horizontal > 1e-12 else 0.0
    # Roll is read off after yaw is undone, so that whatever yaw was chosen, the product is R.
    s, c = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw]) + 0.0  # no -0.0 in files


def pose_matrix(xyz: Sequence[float] | np.ndarray, rpy: Sequence[float] | np.ndarray) -> np.ndarray:
    """(4, 4) pose of a frame at xyz [m] turned by rpy [rad].

    Args:
        xyz: (3,) origin of the frame [m].
        rpy: (3,) roll, pitch and yaw [rad], as Drake's RollPitchYaw.
    """
    X = np.eye(4)
    X[:3, :3] = rpy_rotation(rpy)
    X[:3, 3] = xyz
    return X
