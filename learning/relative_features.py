"""What the shared network sees of a contact transition: one list of numbers for all ten categories.

Beside the contacts themselves it holds what decides the dynamics and takes products or kinks to compute, so that the
network need not find it from data: where the CoM falls to (the capture point, Koolen et al. 2012), how that lies in the
frames of the soles, and by how much feet and CoM miss the box in which the CoM must end.

Frame: "quarter" (see `transition_features.py`). The box's sides lie along W's axes, so a transition turned about the vertical by
other than quarter turns is another problem, and frame F along the mean heading would hide which.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from learning.transition_features import NUM_CATEGORIES, SLOTS, CanonicalTransitions, Frame
from optimization.centroidal.options import CentroidalOptions
from scenes.gravity import GRAVITY

RELATIVE_FRAME: Frame = "quarter"
_HALF_BOX = float((CentroidalOptions().final_half_width or (0.12,))[0])  # [m] of the box in which the CoM must end
_LEAST_HEIGHT = 0.3  # [m] of the CoM, under the root of the capture point
_SLOT = 11  # held, p (3), x axis (3), normal (3), distance


def relative_feature_names() -> tuple[str, ...]:
    """Names of the inputs, in order; those of slots are 0 where the slot is empty."""
    parts = ("held", "x", "y", "z", "xx", "xy", "xz", "nx", "ny", "nz", "distance")
    feet = ("left_foot", "right_foot")
    return (
        *(f"{slot}.{part}" for slot in SLOTS for part in parts),
        *(f"category{k}" for k in range(NUM_CATEGORIES)),
        *(f"com_over_feet.{a}" for a in "xyz"),
        *(f"velocity.{a}" for a in "xyz"),
        *(f"feet_after_from_com.{a}" for a in "xyz"),
        *(f"feet_that_stay_from_com.{a}" for a in "xyz"),
        *(f"capture_point.{a}" for a in "xy"),
        *(f"{what}_from_capture_point.{a}" for what in (*feet, "feet_after", "feet_that_stay") for a in "xy"),
        *(f"{what}_beyond_box_{_HALF_BOX:g}.{a}" for what in ("feet_that_stay", "com", "capture_point") for a in "xy"),
        *(f"{what}_in_{foot}.{a}" for foot in feet for what in ("capture_point", "feet_after") for a in "xy"),
    )


NUM_RELATIVE = len(relative_feature_names())


def relative_features(c: CanonicalTransitions) -> np.ndarray:
    """(n, NUM_RELATIVE) float32 inputs for all categories; zeros where the category is unknown."""
    out = np.zeros((len(c.category), NUM_RELATIVE), np.float32)
    _fill(c.category, c.mover, c.present, c.p, c.R, c.com, c.velocity, c.feet_after, out)
    return out


@njit(cache=True)
def _fill(
    category: np.ndarray, mover: np.ndarray, present: np.ndarray, p: np.ndarray, R: np.ndarray, com: np.ndarray,
    velocity: np.ndarray, feet_after: np.ndarray, out: np.ndarray,
) -> None:  # fmt: skip
    stay, capture = np.empty(3), np.empty(3)
    for i in range(out.shape[0]):
        if category[i] < 0:
            continue
        row, r, after = out[i], com[i], feet_after[i]
        _fill_slots(present[i], p[i], R[i], r, row)
        k = 5 * _SLOT
        row[k + category[i]] = 1.0
        k += NUM_CATEGORIES
        fall_time = np.sqrt(max(r[2], _LEAST_HEIGHT) / GRAVITY)
        for a in range(3):
            stay[a] = p[i, 1, a] if mover[i] == 0 else p[i, 0, a] if mover[i] == 1 else 0.5 * (p[i, 0, a] + p[i, 1, a])
            capture[a] = r[a] + fall_time * velocity[i, a]
            row[k + a], row[k + 3 + a] = r[a], velocity[i, a]
            row[k + 6 + a], row[k + 9 + a] = after[a] - r[a], stay[a] - r[a]
        k += 12
        for a in range(2):
            row[k + a] = capture[a]
            row[k + 2 + a], row[k + 4 + a] = p[i, 0, a] - capture[a], p[i, 1, a] - capture[a]
            row[k + 6 + a], row[k + 8 + a] = after[a] - capture[a], stay[a] - capture[a]
            row[k + 10 + a] = _beyond_box(stay[a] - after[a])
            row[k + 12 + a] = _beyond_box(r[a] - after[a])
            row[k + 14 + a] = _beyond_box(capture[a] - after[a])
        k += 16
        for foot in range(2):
            for a in range(2):
                for b in range(3):
                    row[k + a] += R[i, foot, b, a] * (capture[b] - p[i, foot, b])
                    row[k + 2 + a] += R[i, foot, b, a] * (after[b] - p[i, foot, b])
            k += 4


@njit(cache=True)
def _fill_slots(present: np.ndarray, p: np.ndarray, R: np.ndarray, com: np.ndarray, row: np.ndarray) -> None:
    for slot in range(5):
        if not present[slot]:
            continue
        k, square = _SLOT * slot, 0.0
        row[k] = 1.0
        for a in range(3):
            offset = p[slot, a] - com[a]
            square += offset * offset
            row[k + 1 + a], row[k + 4 + a], row[k + 7 + a] = offset, R[slot, a, 0], R[slot, a, 2]
        row[k + 10] = np.sqrt(square)


@njit(cache=True)
def _beyond_box(offset: float) -> float:
    """By how much a coordinate from the feet's mean after lies outside the box."""
    return offset - min(max(offset, -_HALF_BOX), _HALF_BOX)
