"""Fewer keyframes that play the same: samples that interpolation restores within a tolerance are dropped.

Ramer (1972) and Douglas & Peucker (1973), on time series: keep the ends, then the worst sample, and so on.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Errors = Callable[[np.ndarray, np.ndarray], np.ndarray]  # (samples, what a player shows there) -> (n,) errors


def thin_positions(times: np.ndarray, positions: np.ndarray, tolerance: float) -> np.ndarray:
    """Indices of the keyframes that keep (T, 3) positions within `tolerance` [m] under linear interpolation."""
    return _thin(times, positions, tolerance, lambda samples, shown: np.linalg.norm(samples - shown, axis=1))


def thin_quaternions(times: np.ndarray, quaternions: np.ndarray, tolerance: float) -> np.ndarray:
    """Indices of the keyframes that keep (T, 4) unit quaternions within `tolerance` [rad] of rotation.

    The sign must be continuous in time. Players interpolate on the great circle; between neighbours as close as
    keyframes are here, the normalised chord differs from it by less than a hundredth of the tolerance.
    """
    return _thin(times, quaternions, tolerance, _angles)


def continuous_signs(quaternions: np.ndarray) -> np.ndarray:
    """(T, 4) the same rotations, each quaternion in the half space of the one before."""
    dots = np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1])
    signs = np.concatenate([[1.0], np.cumprod(np.where(dots < 0, -1.0, 1.0))])
    return quaternions * signs[:, None]


def _angles(samples: np.ndarray, shown: np.ndarray) -> np.ndarray:
    shown = shown / np.maximum(np.linalg.norm(shown, axis=1, keepdims=True), 1e-12)
    return 2.0 * np.arccos(np.clip(np.abs(np.einsum("ij,ij->i", samples, shown)), 0.0, 1.0))


def _thin(times: np.ndarray, values: np.ndarray, tolerance: float, errors: Errors) -> np.ndarray:
    count = len(times)
    keep = np.zeros(count, dtype=bool)
    keep[[0, -1]] = True
    open_spans = [(0, count - 1)]
    while open_spans:
        first, last = open_spans.pop()
        if last - first < 2:
            continue
        inside = slice(first + 1, last)
        share = ((times[inside] - times[first]) / (times[last] - times[first]))[:, None]
        wrong = errors(values[inside], (1.0 - share) * values[first] + share * values[last])
        worst = int(np.argmax(wrong))
        if wrong[worst] > tolerance:
            middle = first + 1 + worst
            keep[middle] = True
            open_spans += [(first, middle), (middle, last)]
    return np.flatnonzero(keep)
