"""How far a whole-body motion is from the momentum trajectory that it should bring about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Gap:
    """Distance of two curves in space: root mean square and greatest length of their difference."""

    rms: float
    worst: float

    @staticmethod
    def of(difference: np.ndarray) -> Gap:
        """Of (n, 3) differences."""
        squared = np.sum(np.square(difference), axis=1)
        return Gap(float(np.sqrt(squared.mean())), float(np.sqrt(squared.max()))) if len(squared) else Gap(0.0, 0.0)

    def within(self, other: Gap) -> bool:
        """Whether neither is greater than the other's."""
        return self.rms <= other.rms and self.worst <= other.worst

    def over(self, other: Gap) -> float:
        """The greater of both ratios to the other's."""
        return max(self.rms / other.rms, self.worst / other.worst)


@dataclass(frozen=True)
class MomentumGap:
    """Kinematics less dynamics.

    Attributes:
        com: centre of mass [m].
        linear: linear momentum [kg m/s].
        angular: angular momentum about the centre of mass [N m s].
    """

    com: Gap
    linear: Gap
    angular: Gap

    def within(self, other: MomentumGap) -> bool:
        """Whether every part is within the other's."""
        return self.com.within(other.com) and self.linear.within(other.linear) and self.angular.within(other.angular)

    def over(self, other: MomentumGap) -> float:
        """The greatest ratio to the other's parts: at most 1 where it is within the other."""
        return max(self.com.over(other.com), self.linear.over(other.linear), self.angular.over(other.angular))

    def __str__(self) -> str:
        parts = ((self.com, 1e3, "mm"), (self.linear, 1.0, "kg m/s"), (self.angular, 1.0, "N m s"))
        return ", ".join(f"{g.rms * s:.2f} ({g.worst * s:.2f}) {unit}" for g, s, unit in parts)


# What the motion promises of its momenta at every frame; the CoM is what the plan's verifier allows, less a reserve.
PROMISED = MomentumGap(Gap(0.01, 0.018), Gap(2.0, 6.0), Gap(2.0, 6.0))
