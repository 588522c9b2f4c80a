"""Zero- and one-step capture: whether a robot that was pushed can come to rest, where it stands or with one new contact.

Lin 2020: Y.-C. Lin, "Learning for Humanoid Multi-Contact Navigation Planning" (dissertation), sec. 7.5.
"""

from __future__ import annotations

import math
import re
import time
from dataclasses import dataclass, field, replace

import numpy as np

from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.capture.check import Fault, dynamics_faults, motion_faults, torque_fault
from optimization.capture.question import CaptureQuestion
from optimization.capture.state import FittedState, StateFit
from optimization.centroidal.contact_schedule import ContactSchedule
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.problem import CentroidalProblem
from optimization.kinodynamic.momentum_gap import MomentumGap
from optimization.kinodynamic.program import (
    KinodynamicEstimate,
    KinodynamicOptions,
    KinodynamicProblem,
    KinodynamicProgram,
)
from scenes.input_error import InputError
from scenes.robots.plant import build_plant
from scenes.robots.robot import Robot

STATE_COM, STATE_CONTACT, STATE_SPEED = 5e-3, 5e-3, 0.05  # [m, m, m/s] that a fitted start may be off
# Of 400 random questions none was captured after a gap of more than 7.7 agreements at first, or 1.2 the second time;
# none with a longer swing whose shortest one began with more than 10.3.
GIVE_UP = (10.0, 2.2)
FAR = 14.0
TOLERANCE = 1e-2  # of the centroidal program: it matters that there is a solution, not that it is the best
STATE_LINEAR, STATE_ANGULAR = 2.0, 2.0  # [kg m/s, N m s]


@dataclass(frozen=True)
class CaptureOptions:
    """What a user may choose about questions of capture; the documented times are the defaults.

    Attributes:
        swing_times: times that the new contact may take, ascending; any of them will do [s]. Where the dynamics of one
            have no solution the longer ones are not tried (a contact that is made early need not carry load early),
            nor where its kinematics come nowhere near them.
        horizon: time from the push to the end, where the robot must be at rest [s].
        dt: time between knots while it matters most [s]; must divide the swing times.
        fine_time: how long after the new contact, or after the push, knots are `dt` apart; then twice that [s].
        kinodynamic: of the alternation; its `iterations` are the documented three.
    """

    swing_times: tuple[float, ...] = (0.2, 0.4, 0.6)
    horizon: float = 2.0
    dt: float = 0.1
    fine_time: float = 0.8
    kinodynamic: KinodynamicOptions = field(default_factory=KinodynamicOptions)

    def __post_init__(self) -> None:
        for name in ("horizon", "dt", "fine_time"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"capture options: {name} must be a finite number > 0, got {value}")
        if not self.swing_times or list(self.swing_times) != sorted(set(self.swing_times)):
            raise InputError(f"capture options: swing_times must be one or more, ascending, got {self.swing_times}")
        for swing in self.swing_times:
            steps = swing / self.dt
            if not (0 < swing < self.horizon and abs(steps - round(steps)) < 1e-6):
                raise InputError(
                    f"capture options: a swing time must be a multiple of dt ({self.dt}) before the horizon, got {swing}"
                )

    def steps(self, swing_time: float) -> np.ndarray:
        """(N - 1,) intervals: `dt` until `fine_time` after the contact, then twice that, the horizon in all [s]."""
        total, fine = (round(t / self.dt) for t in (self.horizon, swing_time + self.fine_time))
        fine = min(fine, total)
        fine += (total - fine) % 2
        return self.dt * np.concatenate([np.ones(fine), np.full((total - fine) // 2, 2.0)])


def capture_options(robot: Robot, cone: FrictionCone = DEFAULT_CONE) -> CaptureOptions:
    """The documented times with a robot's limits; it must be at rest at the end, wherever its CoM is then.

    Args:
        robot: gives the limits.
        cone: friction cone.
    """
    centroidal = replace(
        CentroidalOptions.for_robot(robot, cone), final_half_width=None, rest_at_end=True, tolerance=TOLERANCE
    )
    return CaptureOptions(kinodynamic=KinodynamicOptions(centroidal=centroidal, give_up=GIVE_UP))


@dataclass(frozen=True, eq=False)
class CaptureAttempt:
    """What came of one swing time.

    Attributes:
        swing_time: [s], 0 for zero-step capture.
        reason: "" where captured, else phase, block and amount.
        gaps: kinematics less dynamics after each iteration.
        estimate: of the kino-dynamic program.
    """

    swing_time: float
    reason: str
    gaps: tuple[MomentumGap, ...]
    estimate: KinodynamicEstimate


@dataclass(frozen=True, eq=False)
class CaptureAnswer:
    """Answer to a question of capture.

    Attributes:
        captured: whether a motion was found that passed every check. A "no" is no proof.
        duration: swing time that captured [s], 0 for zero-step capture; None where nothing did.
        reason: "" where captured, else that of the attempt that came furthest.
        gaps: of the attempt that captured or came furthest, one for each iteration.
        time: wall clock of the whole question [s].
        state: the fitted start.
        attempts: one for each swing time that was tried, in this order.
    """

    captured: bool
    duration: float | None
    reason: str
    gaps: tuple[MomentumGap, ...]
    time: float
    state: FittedState
    attempts: tuple[CaptureAttempt, ...]


class CaptureChecker:
    """Answers questions of capture for one robot; programs are kept and take the next question's numbers.

    What is captured has passed the centroidal check (`centroidal_check`) and that of its motion (`capture_check`):
    contacts, joint limits, speeds, torques, momenta, rest. Torque limits bind the forces only where a first answer breaks
    them. Collisions of the body with itself and the terrain are left out, as in the document.

    ```python
    checker = CaptureChecker(load_robot("escher"))
    answer = checker.check(CaptureQuestion(stance, com, momentum).pushed(impulse))
    ```
    """

    def __init__(self, robot: Robot, options: CaptureOptions | None = None) -> None:
        self.robot, self.options = robot, options or capture_options(robot)
        self.fit = StateFit(robot)
        built, limited = build_plant(robot), replace(self.options.kinodynamic, torque_limits=True)
        self._program = KinodynamicProgram(robot, self.options.kinodynamic, robot_plant=built)
        self._limited = KinodynamicProgram(robot, limited, robot_plant=built)

    def check(self, question: CaptureQuestion) -> CaptureAnswer:
        """Tries the swing times one after the other until the robot comes to rest."""
        started = time.perf_counter()
        state = self.fit.fit(question.stance, question.com, question.linear_momentum, question.angular_momentum)
        attempts: list[CaptureAttempt] = []
        reason = state_fault(state)
        if not reason:
            for swing_time in self.options.swing_times if question.new_contact is not None else (0.0,):
                attempts.append(self.attempt(question, state, swing_time))
                if not attempts[-1].reason or self._longer_is_no_use(attempts[-1]):
                    break
        captured = bool(attempts) and not attempts[-1].reason
        furthest = max(attempts, key=lambda a: (not a.reason, len(a.gaps)), default=None)
        return CaptureAnswer(
            captured=captured,
            duration=attempts[-1].swing_time if captured else None,
            reason=reason or ("" if furthest is None else furthest.reason),
            gaps=() if furthest is None else furthest.gaps,
            time=time.perf_counter() - started,
            state=state,
            attempts=tuple(attempts),
        )

    def _longer_is_no_use(self, attempt: CaptureAttempt) -> bool:
        """Whether the dynamics have no solution, or kinematics are so far from it that more time does not help."""
        return not attempt.gaps or attempt.gaps[0].over(self.options.kinodynamic.agreement) > FAR

    def attempt(self, question: CaptureQuestion, state: FittedState, swing_time: float) -> CaptureAttempt:
        """One swing time [s], 0 for zero-step capture, from a fitted state.

        Args:
            question: stance, next contact and state.
            state: posture and joint velocities fitted to the question's state.
            swing_time: [s], 0 for zero-step capture.
        """
        problem = self.problem(question, swing_time)
        whole_body = KinodynamicProblem(problem, state.q, v_start=state.v)
        estimate = self._program.solve(whole_body)
        fault = self._fault(whole_body, state.v, estimate)
        if fault is not None and fault.block.startswith("torque"):
            estimate = self._limited.solve(whole_body)
            fault = self._fault(whole_body, state.v, estimate)
        reason = "" if fault is None else fault.told(question, swing_time)
        return CaptureAttempt(swing_time, reason, estimate.gaps, estimate)

    def problem(self, question: CaptureQuestion, swing_time: float) -> CentroidalProblem:
        """The centroidal problem: the swing's stance for `swing_time` [s], then the final one, to the horizon.

        Args:
            question: stance, next contact and state.
            swing_time: [s], 0 for zero-step capture.
        """
        dt = self.options.steps(swing_time)
        start = np.concatenate([[0.0], np.cumsum(dt)[:-1]])
        swing, final = question.swing_stance.contacts, question.final_stance.contacts
        rows = [swing if t < swing_time - 1e-9 else final for t in start]
        return CentroidalProblem(
            schedule=ContactSchedule.from_rows(rows, dt),
            mass=self.robot.mass,
            half_extent=self.robot.half_extents,
            initial_com=question.com,
            initial_linear_momentum=question.linear_momentum,
            initial_angular_momentum=question.angular_momentum,
        )

    def _fault(
        self, whole_body: KinodynamicProblem, v_start: np.ndarray, estimate: KinodynamicEstimate
    ) -> Fault | None:
        """The first thing that is wrong with an answer, None where it holds. The program's own verdict is not asked."""
        problem, dynamics, kinematics = whole_body.centroidal, estimate.centroidal, self.fit.kinematics
        if dynamics is None or dynamics.trajectory is None:
            return _unsolved("" if dynamics is None else dynamics.reason)
        options, trajectory = self.options.kinodynamic, dynamics.trajectory
        faults = dynamics_faults(problem, options.centroidal, trajectory)
        if faults:
            return faults[0]
        faults = motion_faults(kinematics, problem.schedule, trajectory, estimate.q, options.agreement)
        if faults and estimate.gaps and estimate.gaps[-1].over(options.agreement) > GIVE_UP[-1]:
            worst = faults[0]
            return Fault("motion", f"comes nowhere near the forces: {worst.block} {worst.detail}", worst.time)
        if faults:
            return faults[0]
        return torque_fault(kinematics, problem, trajectory, estimate.q, v_start, self._program.effort)


def _unsolved(reason: str) -> Fault:
    """The fault of dynamics without any trajectory; the reason names block and instant where they are known."""
    instant = re.search(r"\(([0-9.]+) s\)", reason)
    return Fault(reason or "the dynamics have no solution", "", float(instant[1]) if instant else 0.0)


def state_fault(state: FittedState) -> str:
    """What a fitted start misses, "" where it is near enough."""
    for name, amount, limit, unit in (
        ("contact off", state.contact_error, STATE_CONTACT, "m"),
        ("CoM off", state.com_error, STATE_COM, "m"),
        ("held contact moving", state.contact_speed, STATE_SPEED, "m/s"),
        ("linear momentum off", state.linear_gap, STATE_LINEAR, "kg m/s"),
        ("angular momentum off", state.angular_gap, STATE_ANGULAR, "N m s"),
    ):
        if amount > limit:
            return f"start: {name} by {amount:.3g} {unit}: no posture or joint speeds within the limits have this state"
    return ""
