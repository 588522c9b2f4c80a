"""From a file's unit, axes and place to metres, z up, near the origin."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.input_error import InputError
from scenes.terrain.georeference import FAR, is_far, offset_for, offset_note

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "foot": 0.3048}  # [m]
UPWARD = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "x": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
}  # (3, 3) from the file's axes to x, y, z
LARGEST = 1000.0  # [m] without --unit nothing larger is taken for metres
LARGE = 150.0  # [m] larger, and it is asked whether it is metres
SMALL = 0.4  # [m] smaller, and it is asked too: two soles need more


@dataclass(frozen=True, eq=False)
class Placement:
    """How a file's coordinates become those of a scene.

    Attributes:
        scale: the file's unit [m].
        R: (3, 3) from its axes.
        offset: subtracted then [m], None for nothing.
        notes: what is said of it.
        hints: what is asked of it.
    """

    scale: float
    R: np.ndarray
    offset: tuple[float, float, float] | None
    notes: tuple[str, ...]
    hints: tuple[str, ...]

    def points(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) points of the scene [m] from points of the file."""
        placed = self.scale * points @ self.R.T
        return placed if self.offset is None else placed - self.offset

    def directions(self, directions: np.ndarray) -> np.ndarray:
        """(..., 3) directions in the scene from those of the file."""
        return directions @ self.R.T


def placement_of(
    points: np.ndarray, path: Path, unit: str | None, up: str, offset: tuple[float, float, float] | None = None
) -> Placement:
    """The placement of a file with these points, checked and asked about.

    Args:
        points: (N, 3) finite, in the file's frame and unit.
        path: for errors.
        unit: one of `UNITS`; None means metres and that the size is checked.
        up: the file's axis that points up.
        offset: to subtract from georeferenced coordinates [m]; None: one is found.

    Raises:
        InputError: it is too large for metres, or too far out for any map.
    """
    scale, R = UNITS[unit or "m"], UPWARD[up]
    with np.errstate(over="ignore", invalid="ignore"):
        corners = scale * np.array([points.min(axis=0), points.max(axis=0)]) @ R.T
        extent = float(np.abs(corners[1] - corners[0]).max())
    if not np.isfinite(extent) or np.abs(corners).max() > 1e8:
        raise InputError(f"{path}: reaches {np.abs(corners).max():.3g} m from the origin, expected a map of the earth")
    if unit is None and extent > LARGEST:
        raise InputError(
            f"{path}: {extent:.4g} m across: give --unit cm (then {extent / 100:.4g} m), --unit mm ({extent / 1000:.4g} m), "
            "or --unit m if it is that large"
        )
    notes: tuple[str, ...] = ()
    if not is_far(corners):
        offset = None
    elif offset is None:
        offset = offset_for(corners)
        notes = (offset_note(offset),)
    local = corners if offset is None else corners - offset
    if np.abs(local).max() > FAR:
        raise InputError(f"{path}: reaches {np.abs(local).max():.3g} m from its origin, expected at most 100 km")
    return Placement(scale, R, offset, notes, size_hints(extent, unit))


def size_hints(extent: float, unit: str | None) -> tuple[str, ...]:
    """What is asked of a terrain of this size [m], where no unit was given.

    Args:
        extent: along its longest axis [m].
        unit: that was given, None for none.
    """
    if unit is not None:
        return ()
    if extent > LARGE:
        return (f"{extent:.4g} m across: if its numbers are centimetres or millimetres, give --unit cm or --unit mm",)
    if extent < SMALL:
        return (f"{extent:.3g} m across, too small to stand on: if its numbers are not metres, give --unit",)
    return ()
