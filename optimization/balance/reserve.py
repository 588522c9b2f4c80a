"""What a plan leaves unused of friction and supports, because nothing plays it exactly."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scenes.input_error import InputError

EASED_PRESSURE = 0.8  # share of each support for the pressure, where no plan keeps more back


@dataclass(frozen=True)
class Reserve:
    """Limits inside those of physics; by default all that physics gives may be used.

    Attributes:
        friction: share of each friction coefficient that forces may use.
        pressure: share of each support, shrunk about the mean of its corners, in which the pressure stays.
        support: inner radius of the parts of a sole that are stood on, as a share of half the sole's width.
        brief: greatest normal force in the first interval of a contact and in its last, while another foot carries [M g]; None:
            as in all others.
    """

    friction: float = 1.0
    pressure: float = 1.0
    support: float = 0.0
    brief: float | None = None

    def __post_init__(self) -> None:
        for name in ("friction", "pressure"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise InputError(f"reserve: {name} must be above 0 and at most 1, got {getattr(self, name)}")
        if not 0.0 <= self.support < 1.0:
            raise InputError(f"reserve: support must be from 0 to below 1, got {self.support}")
        if self.brief is not None and not self.brief > 0.0:
            raise InputError(f"reserve: brief must be above 0, got {self.brief}")

    def eased(self) -> Reserve:
        """The same reserve with the pressure free in most of each support: what hard ground leaves more often."""
        return replace(self, pressure=max(self.pressure, EASED_PRESSURE))

    def supports(self, corners: np.ndarray) -> np.ndarray:
        """(..., V, 2) supports in which the pressure stays [m].

        Args:
            corners: (..., V, 2) of the whole supports [m]; those of fewer corners repeat their last one.
        """
        if self.pressure == 1.0:
            return corners
        own = np.ones((*corners.shape[:-1], 1))
        own[..., 1:, 0] = (corners[..., 1:, :] != corners[..., :-1, :]).any(axis=-1)
        middle = (own * corners).sum(axis=-2, keepdims=True) / own.sum(axis=-2, keepdims=True)
        return middle + self.pressure * (corners - middle)


ALL = Reserve()  # nothing is kept back
USUAL = Reserve(friction=0.9, pressure=0.6, support=0.96, brief=0.1)  # see docs/decisions/execution.md
