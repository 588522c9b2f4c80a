"""How far the next foot or palm may be, as second-order cones (Deits & Tedrake 2014 sec. IV).

Seen from the standing foot, the next foot lies in the intersection of two discs, a lens, whose centres turn with the
standing foot. A held palm lies within an arm's length of a shoulder that moves with the mean of the feet (Lin 2020 eq. 3.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.robots.robot import Robot
from scenes.transition_model import TransitionModel

TURN_SHARE = 1.0  # of the transition model's greatest turns
ARM_SHARE = 0.95  # of the arm's reach: the shoulder is only approximated


@dataclass(frozen=True)
class StepReach:
    """Where feet and palms may go.

    Attributes:
        centre: (x, y) of the lens in the standing foot's frame, y to the side of the moving foot [m].
        half_length: of the lens, along x [m].
        half_width: of the lens, along y [m].
        rise: greatest height between the feet [m].
        stride: greatest translation of a foot in one step [m].
        turn_out, turn_in: greatest turn of the moving foot from the standing one, outwards and inwards [rad].
        shoulder: (3,) of the left arm in the frame of the feet's mean; the right one mirrors y [m].
        arm: greatest distance of a palm from it [m].
        palm_stride: greatest translation of a palm in one move [m].
    """

    centre: tuple[float, float]
    half_length: float
    half_width: float
    rise: float
    stride: float
    turn_out: float
    turn_in: float
    shoulder: tuple[float, float, float]
    arm: float
    palm_stride: float

    @property
    def radius(self) -> float:
        """Of both discs [m]."""
        return (self.half_length**2 + self.half_width**2) / (2.0 * self.half_width)

    @property
    def farthest(self) -> float:
        """No next foot is farther than this from the standing one in the plan view [m]."""
        x, y = self.centre
        return float(np.hypot(abs(x) + self.half_length, abs(y) + self.half_width))

    def discs(self, side: float) -> tuple[tuple[np.ndarray, float], ...]:
        """(centre (2,) in the standing foot's frame, radius) of both discs; side is +1 for a left foot, -1 for a right one."""
        away = self.radius - self.half_width
        x, y = self.centre
        return tuple((np.array([x, side * (y + sign * away)]), self.radius) for sign in (1.0, -1.0))

    def scaled(self, share: float) -> StepReach:
        """The reach with a lens, a rise and a stride of this share, about the same centre."""
        from dataclasses import replace

        return replace(
            self,
            half_length=share * self.half_length,
            half_width=share * self.half_width,
            rise=share * self.rise,
            stride=share * self.stride,
            arm=share * self.arm,
        )


def step_reach(robot: Robot, model: TransitionModel) -> StepReach:
    """The reach that spans a transition model's steps, narrowed to what this robot's legs and hips allow.

    Args:
        robot: gives legs and hips.
        model: the steps to span.
    """
    low, high = model.steps.min(axis=0), model.steps.max(axis=0)
    near = max(low[1], robot.foot_separation[0])
    if high[1] <= near:
        raise ValueError(f"the transition model {model.name} has no step wider than the feet's least separation {near}")
    return StepReach(
        centre=(0.5 * (low[0] + high[0]), 0.5 * (near + high[1])),
        half_length=0.5 * (high[0] - low[0]) + 0.02,
        half_width=0.5 * (high[1] - near) + 0.01,
        rise=robot.max_step_height,
        stride=robot.max_foot_translation,
        turn_out=TURN_SHARE * max(float(high[2]), 0.0),
        turn_in=TURN_SHARE * max(float(-low[2]), 0.0),
        shoulder=tuple(float(v) for v in robot.shoulder),  # type: ignore[arg-type]
        arm=ARM_SHARE * robot.arm_reach[1],
        palm_stride=robot.max_palm_translation,
    )
