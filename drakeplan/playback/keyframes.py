"""Fewer keyframes that play the same: samples that interpolation restores within a tolerance are dropped.

Ramer (1972) and Douglas & Peucker (1973), on time series: keep the ends, then the worst sample, and so on.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Errors = Callable[[np.ndarray, np.ndarray], np.ndarray]  # (samples, what a player shows there) -> (n,) errors


def thin_positions(times: np.ndarray, positions: np.ndarray, tolerance: float) -> np.ndarray:
    """Indices of the keyframes that keep positions within a tolerance under linear interpolation.

    Args:
        times: (T,) [s].
        positions: (T, 3) in W [m].
        tolerance: greatest error [m].
    """
    return _thin(times, positions, tolerance, _distances)


def thin_quaternions(times: np.ndarray, quaternions: np.ndarray, tolerance: float) -> np.ndarray:
    """Indices of the keyframes that keep rotations within a tolerance.

    The sign must be continuous in time. Players interpolate on the great circle; between neighbours as close as
    keyframes are here, the normalised chord differs from it by less than a hundredth of the tolerance.

    Args:
        times: (T,) [s].
        quaternions: (T, 4) unit quaternions.
        tolerance: greatest error [rad].
    """
    return _thin(times, quaternions, tolerance, _angles)


def continuous_signs(quaternions: np.ndarray) -> np.ndarray:
    """(T, 4) the same rotations, each quaternion in the half space of the one before."""
    dots = np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1])
    signs = np.concatenate([[1.0], np.cumprod(np.where(dots < 0, -1.0, 1.0))])
    return quaternions * signs[:, None]


def _distances(samples: np.ndarray, shown: np.ndarray) -> np.ndarray:
    return np.sqrt(np.square(samples - shown).sum(axis=1))


def _angles(samples: np.ndarray, shown: np.ndarray) -> np.ndarray:
    shown = shown / np.maximum(np.linalg.norm(shown, axis=1, keepdims=True), 1e-12)
    return 2.0 * np.arccos(np.clip(np.abs(np.einsum("ij,ij->i", samples, shown)), 0.0, 1.0))


def _thin(times: np.ndarray, values: np.ndarray, tolerance: float, errors: Errors) -> np.ndarray:
    """Splits every span between kept samples at its worst sample, all spans in one sweep, until none is too bad."""
    count = len(times)
    keep = np.zeros(count, dtype=bool)
    keep[[0, -1]] = True
    left = np.arange(count if count > 2 else 0)  # samples of the spans that may still be too bad
    while len(left):
        kept = np.flatnonzero(keep)
        span = np.searchsorted(kept[1:-1], left, side="right")
        first, last = kept[span], kept[span + 1]
        share = ((times[left] - times[first]) / (times[last] - times[first]))[:, None]
        wrong = errors(values[left], (1.0 - share) * values[first] + share * values[last])
        begins = np.flatnonzero(np.diff(span, prepend=-1))  # of the spans in `left`
        worst = np.repeat(np.maximum.reduceat(wrong, begins), np.diff(begins, append=len(left)))
        candidates = np.flatnonzero((wrong == worst) & (worst > tolerance))
        _, one_each = np.unique(span[candidates], return_index=True)
        keep[left[candidates[one_each]]] = True
        left = left[worst > tolerance]
    return np.flatnonzero(keep)
