"""The instants that an animation may have keyframes at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FRAMES_PER_SECOND = 25.0
MAX_FRAMES = 6000  # of longer motions fewer frames a second are kept


@dataclass(frozen=True, eq=False)
class FrameTimes:
    """The instants that keyframes may lie at.

    Attributes:
        rate: frames a second.
        t: (F,) seconds since the motion began; the last one is its end, moved to the next whole frame.
    """

    rate: float
    t: np.ndarray

    @property
    def last(self) -> int:
        """Number of the last frame."""
        return len(self.t) - 1

    def at(self, t: np.ndarray) -> np.ndarray:
        """(n,) number of the last frame at or before each time since the motion began [s]; so no change comes late."""
        return np.floor(t * self.rate + 1e-6).astype(int).clip(0, self.last)


def frame_times(duration: float) -> FrameTimes:
    """The frames of a motion of this many seconds."""
    rate = min(FRAMES_PER_SECOND, MAX_FRAMES / max(duration, 1e-9))
    return FrameTimes(rate, np.arange(int(np.ceil(duration * rate - 1e-9)) + 1) / rate)
