"""The momentum trajectory of a whole contact sequence, led through the CoM positions of its key postures."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from drakeplan.timing.phases import Schedule
from optimization.balance.friction import FrictionCone
from optimization.balance.reserve import ALL, Reserve
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions, CentroidalWeights
from optimization.centroidal.problem import CentroidalProblem
from optimization.centroidal.program import CentroidalProgram
from optimization.centroidal.trajectory import CentroidalTrajectory
from optimization.kinodynamic.joint_torques import TorqueRows
from scenes.effector import EFFECTORS
from scenes.robots.robot import Robot

# Lin 2020 sec. 6.7, with a pull towards the key postures that Lin 2020 does not have: without it the CoM takes
# the least effort over the feet, wherever the legs reach.
WEIGHTS = CentroidalWeights(com_tracking=2e4)
REACH_ROOM = 0.005  # [m] that limbs may reach further than in the postures of the course
BOX = (0.10, 0.10, 0.035)  # [m] half widths around the key postures' course: what the legs give in general


def centroidal_options(robot: Robot, cone: FrictionCone, dt: float, reserve: Reserve = ALL) -> CentroidalOptions:
    """The limits of a robot as options of the centroidal program.

    Args:
        robot: its limits.
        cone: friction cone of every contact.
        dt: step of the momentum trajectory [s].
        reserve: what is left unused of friction and supports.
    """
    # The last key posture says where the CoM ends.
    return replace(CentroidalOptions.for_robot(robot, cone, reserve), dt=dt, weights=WEIGHTS, final_half_width=None)


def monotone_course(key_t: np.ndarray, key_x: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(N, m) continuously differentiable course through given points, at rest at both ends.

    It does not overshoot: slopes are the harmonic mean of the secants where both go the same way, else zero (Fritsch &
    Butland 1984).

    Args:
        key_t: (n,) times of the points [s], ascending.
        key_x: (n, m) the points.
        t: (N,) times at which to evaluate the course [s].
    """
    slope = np.zeros_like(key_x)
    secant = np.diff(key_x, axis=0) / np.diff(key_t)[:, None]
    before, after = secant[:-1], secant[1:]
    same = before * after > 0.0
    slope[1:-1][same] = (2.0 * before * after)[same] / (before + after)[same]
    return CubicHermiteSpline(key_t, key_x, slope)(t)


@dataclass(frozen=True, eq=False)
class ComCourse:
    """CoM trajectory to follow, for sequences that no quasi-static walk can follow.

    Attributes:
        t: (N,) [s].
        com: (N, 3) [m].
    """

    t: np.ndarray
    com: np.ndarray

    def at(self, t: np.ndarray) -> np.ndarray:
        """(n, 3) CoM at these times [m]."""
        return CubicSpline(self.t, self.com)(np.clip(t, self.t[0], self.t[-1]))

    def meeting(self, key_t: np.ndarray, key_com: np.ndarray, t: np.ndarray) -> np.ndarray:
        """(N, 3) the course in W [m], changed so that it passes through the CoM of the key postures.

        Args:
            key_t: (n,) times of the key postures [s].
            key_com: (n, 3) their CoM in W [m].
            t: (N,) times at which to evaluate the course [s].
        """
        return self.at(t) + monotone_course(key_t, key_com - self.at(key_t), t)


class SequenceDynamics:
    """Forces and momenta over one whole sequence, from rest to rest; can be solved repeatedly with new references.

    Attributes:
        contacts: which of them may carry load when.

    Args:
        contacts: the contacts that may carry load in each interval.
    """

    def __init__(self, robot: Robot, schedule: Schedule, cone: FrictionCone, dt: float, reserve: Reserve = ALL) -> None:
        """Prepares the contact schedule of the programs.

        Args:
            robot: its mass, limits and contact patches.
            schedule: the phases.
            cone: friction cone of every contact.
            dt: step of the momentum trajectory [s]; it must divide every phase.
            reserve: what is left unused of friction and supports.
        """
        self._robot, self._usual = robot, centroidal_options(robot, cone, dt, reserve)
        t = schedule.times(dt)
        self.contacts = ContactSchedule(schedule.contacts, schedule.contact_at(t[:-1]), np.diff(t))
        self._programs: dict[float, CentroidalProgram] = {}
        self._last: CentroidalTrajectory | None = None

    def solve(
        self,
        reference: np.ndarray,
        spin: np.ndarray,
        box: np.ndarray | None = None,
        torques: TorqueRows | None = None,
        time_limit: float = np.inf,
    ) -> tuple[CentroidalTrajectory | None, str]:
        """A feasible trajectory near the reference, or the reason why there is none.

        Args:
            reference: (N, 3) CoM at the knots to stay near [m]; its first row is where the robot starts.
            spin: (N, 3) angular momentum to stay near [N m s].
            box: (N, 3) half widths of hard bounds around it [m]; without, the pull gives way where `BOX` is too small.
            torques: limits of the joint torques, kept where that is possible.
            time_limit: seconds after which no further convex program is started.
        """
        ends = time.perf_counter() + time_limit
        first = (1.0, BOX if box is None else box)
        tries = [first]
        if box is None:
            tries += [(0.2, 2.0 * np.array(BOX)), (0.05, np.full(3, np.inf))]
        reason = ""
        for pull, half, rows in [(*first, torques)] * (torques is not None) + [(*each, None) for each in tries]:
            problem = self.problem(reference, spin, half)
            estimate = self._program(pull, problem, rows).solve(ends - time.perf_counter())
            if estimate.feasible:
                self._last = estimate.trajectory
                return estimate.trajectory, ""
            reason = f"the dynamics are infeasible: {estimate.reason}"
        return None, reason

    def problem(
        self, reference: np.ndarray, spin: np.ndarray, half: np.ndarray | tuple[float, ...]
    ) -> CentroidalProblem:
        """The data of the centroidal program.

        Args:
            reference: (N, 3) CoM in W to stay near [m].
            spin: (N, 3) angular momentum about the CoM in W to stay near [N m s].
            half: half widths of the CoM's bounds around the reference along W's axes [m], (3,) or (N, 3).
        """
        return CentroidalProblem(
            schedule=self.contacts,
            mass=self._robot.mass,
            half_extent=self._robot.half_extents,
            initial_com=reference[0],
            com_reference=reference,
            com_box=np.broadcast_to(half, reference.shape),
            angular_momentum_reference=np.vstack([np.zeros(3), spin[1:]]),
        )

    def _widen_reach(self, problem: CentroidalProblem) -> bool:
        """Lets every limb reach as far as it does in the postures that the reference comes from; True where that is new.

        The robot's reach is one number for each limb and holds wherever the limb points; a posture that has been found
        says more about its place than that number does.
        """
        assert problem.com_reference is not None
        reach = list(self._usual.com_reach)
        active = self.contacts.active
        for number, contact in enumerate(self.contacts.contacts):
            knots = np.flatnonzero((active == number).any(axis=1))
            away = problem.com_reference[np.union1d(knots, knots + 1)] - contact.p_WC
            e = EFFECTORS.index(contact.effector)
            reach[e] = max(reach[e], float(np.linalg.norm(away, axis=1).max(initial=0.0)) + REACH_ROOM)
        wider = any(new > old + REACH_ROOM for new, old in zip(reach, self._usual.com_reach, strict=True))
        if wider:
            self._usual = replace(self._usual, com_reach=tuple(np.add(reach, REACH_ROOM).tolist()))
        return wider

    def _program(self, pull: float, problem: CentroidalProblem, torques: TorqueRows | None) -> CentroidalProgram:
        known = self._programs.get(pull)
        if self._widen_reach(problem):
            self._programs.clear()
            known = None
        if torques is not None:
            known = CentroidalProgram(problem, relaxed(self._usual, pull))
            index = known.data.index["wrench"]
            known.add_rows("joint torques", lambda: torques.in_program(index))
        elif known is None:
            known = self._programs[pull] = CentroidalProgram(problem, relaxed(self._usual, pull))
        else:
            known.update(problem)
        if self._last is not None:
            known.start_from(self._last)
        return known


def relaxed(options: CentroidalOptions, factor: float) -> CentroidalOptions:
    """The same options with the weight of CoM tracking multiplied by a factor.

    Args:
        options: the options to change.
        factor: multiplies the weight [-].
    """
    weights = replace(options.weights, com_tracking=options.weights.com_tracking * factor)
    return replace(options, weights=weights)
