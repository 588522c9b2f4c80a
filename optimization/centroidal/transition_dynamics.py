"""The dynamics of single transitions, again and again: the question that a search and a label campaign ask.

Lin 2020: Y.-C. Lin, "Learning for Humanoid Multi-Contact Navigation Planning" (dissertation), sec. 6.5 to 6.7.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.balance.reserve import ALL, Reserve
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.estimate import CentroidalEstimate
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program_cache import ProgramCache
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.stance import Stance


def transition_options(robot: Robot, cone: FrictionCone = DEFAULT_CONE, reserve: Reserve = ALL) -> CentroidalOptions:
    """The documents' timing and weights with a robot's limits; not at rest at the end, and quick where impossible.

    Args:
        robot: gives height, reach and force limits.
        cone: friction cone.
        reserve: what is left unused of friction and supports.
    """
    return replace(CentroidalOptions.for_robot(robot, cone, reserve), rest_at_end=False, explain=False)


def transition_schedule(stances: Sequence[Stance], options: CentroidalOptions) -> ContactSchedule:
    """Stances in the time that the options give each transition; one interval more makes the last contact count.

    Args:
        stances: consecutive ones; they differ in one end effector.
        options: dt, shift and swing time [s].

    Raises:
        InputError: a pair of stances that does not differ in exactly one end effector.
    """
    try:
        return ContactSchedule.from_stances(
            stances,
            dt=options.dt,
            shift_time=options.shift_time,
            swing_time=options.swing_time,
            settle_time=options.dt,
        )
    except ValueError as error:
        raise InputError(f"transition: {error}") from error


class TransitionDynamics:
    """Answers for one transition at a time what its least-effort dynamics are (Lin 2020 sec. 6.5).

    The CoM shifts for `shift_time` over the stance before, the end effector moves for `swing_time`, and one interval
    more makes the new contact count. The CoM must end in its box over the feet; it need not be at rest there. Angular
    momentum starts at zero, as in the documents.

    Args:
        robot: mass, patches and, where `options` is None, limits.
        options: by default `transition_options(robot)`.
    """

    def __init__(self, robot: Robot, options: CentroidalOptions | None = None) -> None:
        self.robot = robot
        self.options = options or transition_options(robot)
        self._programs = ProgramCache(self.options)

    def problem(self, before: Stance, after: Stance, com: np.ndarray, linear_momentum: np.ndarray) -> CentroidalProblem:
        """The centroidal problem of one transition; arguments as for `estimate`.

        Args:
            before, after: consecutive stances; they differ in one end effector.
            com: (3,) CoM at the start, in W [m].
            linear_momentum: (3,) at the start [kg m/s].
        """
        schedule = transition_schedule([before, after], self.options)
        return CentroidalProblem(
            schedule=schedule,
            mass=self.robot.mass,
            half_extent=self.robot.half_extents,
            initial_com=com,
            initial_linear_momentum=linear_momentum,
        )

    def estimate(
        self, before: Stance, after: Stance, com: np.ndarray, linear_momentum: np.ndarray
    ) -> CentroidalEstimate:
        """What the exact program says of this transition.

        Args:
            before, after: consecutive stances; they differ in one end effector.
            com: (3,) CoM at the start, in W [m].
            linear_momentum: (3,) at the start [kg m/s].

        Raises:
            InputError: the stances do not differ in exactly one end effector, or a number is not finite.
        """
        return self._programs.program(self.problem(before, after, com, linear_momentum)).solve()

    def final_state(self, estimate: CentroidalEstimate) -> tuple[np.ndarray, np.ndarray]:
        """(3,) CoM [m] and (3,) velocity [m/s] at the end of a transition, the child state's.

        Raises:
            ValueError: the estimate has no trajectory.
        """
        if estimate.trajectory is None:
            raise ValueError(f"the transition has no trajectory: {estimate.reason}")
        return estimate.trajectory.com[-1], estimate.trajectory.linear_momentum[-1] / self.robot.mass

    def lift_state(self, estimate: CentroidalEstimate) -> tuple[np.ndarray, np.ndarray]:
        """(3,) CoM [m] and (3,) velocity [m/s] where the end effector lifts, at the end of the shift.

        Raises:
            ValueError: the estimate has no trajectory.
        """
        if estimate.trajectory is None:
            raise ValueError(f"the transition has no trajectory: {estimate.reason}")
        n = round(self.options.shift_time / self.options.dt)
        return estimate.trajectory.com[n], estimate.trajectory.linear_momentum[n] / self.robot.mass
