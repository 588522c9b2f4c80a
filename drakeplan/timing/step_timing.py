"""Durations of the two phases of a transition; Lin 2020 sec. 6.7 fixes one second for each."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from optimization.balance.friction import FrictionCone
from optimization.balance.reserve import ALL, Reserve
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.transition_dynamics import transition_options
from scenes.input_error import InputError
from scenes.robots.robot import Robot

STEPS = (0.2, 0.1, 0.05)  # [s] between knots, the first that divides both parts
LEAST, MOST = 0.1, 10.0  # [s] of either part


@dataclass(frozen=True)
class Timing:
    """Durations of a transition.

    Attributes:
        shift: of the phase in which the CoM shifts over all contacts [s].
        swing: of the phase in which one end effector moves [s].
        free: whether the motion stage then changes all durations for less effort, in the same time altogether.
    """

    shift: float = 1.0
    swing: float = 1.0
    free: bool = False

    def __post_init__(self) -> None:
        for name in ("shift", "swing"):
            value = getattr(self, name)
            if not (math.isfinite(value) and LEAST <= value <= MOST):
                raise InputError(f"timing: {name}: expected {LEAST:g} to {MOST:g} s, got {value}")
        if self.step is None:
            raise InputError(f"timing: expected multiples of {STEPS[-1]:g} s, got {self.shift} and {self.swing}")

    @property
    def step(self) -> float | None:
        """Longest time between knots that divides both [s]; None where none does."""
        return next((dt for dt in STEPS if all(_divides(dt, x) for x in (self.shift, self.swing))), None)

    @property
    def times(self) -> tuple[float, float]:
        """Of shift and swing [s]; surrogates are trained for some."""
        return self.shift, self.swing

    def options(
        self, robot: Robot, cone: FrictionCone, *, rest_at_end: bool = False, reserve: Reserve = ALL
    ) -> CentroidalOptions:
        """The centroidal program's options for this robot, cone and timing.

        Args:
            robot: whose limits the options have.
            cone: friction cone of every contact.
            rest_at_end: whether CoM and momenta must be at rest at the end.
            reserve: what is left unused of friction and supports.
        """
        options = transition_options(robot, cone, reserve)
        return replace(
            options,
            shift_time=self.shift,
            swing_time=self.swing,
            dt=self.step or options.dt,
            rest_at_end=rest_at_end,
        )


def _divides(step: float, duration: float) -> bool:
    return abs(duration / step - round(duration / step)) < 1e-6


WALKING = Timing(0.6, 0.4)  # Lin 2020 sec. 7.7: double support, then a swing
