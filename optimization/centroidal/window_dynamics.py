"""The dynamics of the last transitions of a path together: a step is prepared by the ones before it.

One transition at a time with least effort (Lin 2020 sec. 6.5) leaves the CoM where the next one may have no answer: onto a
slope that holds nobody one must step with the speed at which one will leave it. Here the CoM's path of the last few
transitions stays open until what follows is known, as in control with a receding horizon, seen from its end.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from optimization.centroidal.estimate import CentroidalEstimate
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program_cache import ProgramCache
from optimization.centroidal.trajectory import CentroidalTrajectory
from optimization.centroidal.transition_dynamics import transition_schedule
from scenes.robots.robot import Robot
from scenes.stance import Stance


@dataclass(frozen=True, eq=False)
class BodyState:
    """Where the whole body is and how it moves, in W.

    Attributes:
        com: (3,) [m].
        linear_momentum: (3,) [kg m/s].
        angular_momentum: (3,) about the CoM [N m s].
    """

    com: np.ndarray
    linear_momentum: np.ndarray = field(default_factory=lambda: np.zeros(3))
    angular_momentum: np.ndarray = field(default_factory=lambda: np.zeros(3))


class WindowDynamics:
    """Least-effort dynamics over consecutive stances from a given state, at the knots of the whole sequence's program.

    Each transition takes `shift_time` and `swing_time`; one interval more makes the last contact count. The CoM must end
    in its box over the feet; it need not be at rest there.

    Args:
        robot: mass, patches.
        options: limits, timing and cone; `rest_at_end` and `explain` are taken as False.

    Attributes:
        asked: questions answered, by who answered ("exact").
    """

    def __init__(self, robot: Robot, options: CentroidalOptions) -> None:
        self.robot = robot
        self.options = replace(options, rest_at_end=False, explain=False)
        self._shift = max(1, round(options.shift_time / options.dt))
        self._swing = max(1, round(options.swing_time / options.dt))
        self.asked: Counter[str] = Counter()
        self._programs = ProgramCache(self.options)

    def solve(self, start: BodyState, stances: Sequence[Stance]) -> CentroidalEstimate:
        """What the exact program says of these transitions in a row.

        Args:
            start: when the shift over the first stance begins.
            stances: consecutive ones differ in one end effector.

        Raises:
            InputError: a pair of stances that does not differ in exactly one end effector, or numbers that are not finite.
        """
        schedule = transition_schedule(stances, self.options)
        problem = CentroidalProblem(
            schedule=schedule,
            mass=self.robot.mass,
            half_extent=self.robot.half_extents,
            initial_com=start.com,
            initial_linear_momentum=start.linear_momentum,
            initial_angular_momentum=start.angular_momentum,
        )
        self.asked["exact"] += 1
        return self._programs.program(problem).solve()

    def at_touchdown(self, trajectory: CentroidalTrajectory, transition: int) -> BodyState:
        """The state when this transition (0, 1, ...) has ended and the shift over the stance it led to begins.

        Args:
            trajectory: answer of `solve`.
            transition: number of the transition in it, from 0.
        """
        n = (transition + 1) * (self._shift + self._swing)
        return BodyState(trajectory.com[n], trajectory.linear_momentum[n], trajectory.angular_momentum[n])

    def at_lift_off(self, trajectory: CentroidalTrajectory, transition: int) -> BodyState:
        """The state when the end effector of this transition leaves its old contact.

        Args:
            trajectory: answer of `solve`.
            transition: number of the transition in it, from 0.
        """
        n = transition * (self._shift + self._swing) + self._shift
        return BodyState(trajectory.com[n], trajectory.linear_momentum[n], trajectory.angular_momentum[n])
