"""From a contact sequence to momenta, forces and a whole-body motion that the verifier accepts.

    contacts -> phases -> key postures -> centroidal program -> swing curves -> postures frame by frame -> checks

What the checks find is repaired where it can be: bodies that come too near are moved apart, swings are rerouted, a CoM
that the legs cannot follow goes back to the centroidal program, joints that are too fast get more time. What remains is
reported, never hidden.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from drakeplan.context import QueryContext
from drakeplan.motion.check import Problem, excess, velocities
from drakeplan.motion.course_dynamics import ComCourse, SequenceDynamics
from drakeplan.motion.frames import ROUGH, MotionFrames
from drakeplan.motion.free_timing import effort, free_durations
from drakeplan.motion.key_postures import solve_key_postures
from drakeplan.motion.proximity import ProximityMonitor
from drakeplan.motion.resting_place import BalanceRegions
from drakeplan.motion.setting import Setting
from drakeplan.motion.targets import Detour, plan_swings, swing_between
from drakeplan.progress import Progress, ProgressEvent
from drakeplan.timing.phases import Schedule, make_schedule
from optimization.centroidal.trajectory import CentroidalTrajectory
from optimization.kinodynamic.joint_torques import motion_torques
from optimization.kinodynamic.momentum_gap import MomentumGap
from optimization.multibody.inverse_dynamics import actuated_joints, effort_limits, joint_damping
from scenes.stance import Stance

FREE_BOUNDS = (
    (0.6, 1.6),
    (0.8, 1.25),
)  # of free durations, as factors; the next where joints are too slow for the first
FEW = 3  # transitions that must all fail for one cause before other contacts are given up
MAX_STRETCH = 5.0  # times its limit up to which a speed or jerk gets more time; a jump would not be mended by that


@dataclass(frozen=True)
class MotionOptions:
    """What a user may choose about dynamics and motion.

    Attributes:
        dt: step of the momentum trajectory [s].
        shift: time to shift the CoM before each swing [s] (Lin 2020 sec. 6.7).
        swing: time to move an end effector [s].
        rest: time to come to rest at the end [s].
        free: whether all of these are then changed for less effort, in the same time altogether.
        rate: frames of the motion per second [Hz].
        clearance: margin of swinging feet and palms to the terrain [m].
        rounds: of repairs within one timing.
        attempts: timings tried.
        feedback: whether dynamics and motion are made to agree; without, each motion follows the CoM alone.
    """

    dt: float = 0.2
    shift: float = 1.0
    swing: float = 1.0
    rest: float = 1.0
    free: bool = False
    rate: int = 50
    clearance: float = 0.025
    rounds: int = 4
    attempts: int = 3
    feedback: bool = True


@dataclass(frozen=True)
class TorqueNeed:
    """The joint torque of a motion that is the greatest share of its joint's limit.

    Attributes:
        share: of the limit; above 1 the robot cannot play the motion.
        joint: its name.
        time: when [s].
    """

    share: float
    joint: str
    time: float


@dataclass(frozen=True, eq=False)
class MotionResult:
    """A motion, or the results up to the step that failed.

    Attributes:
        ok: whether nothing is left to complain about.
        reason: "" where ok, else one line.
        failed_transitions: where it failed, as far as that is known; empty where ok.
        schedule: the phases.
        centroidal: momenta and forces, None where there are none.
        t: (T,) [s].
        q: (T, nq) positions, Drake's order.
        v: (T, nv) velocities.
        position_names, velocity_names: of the plant.
        timings: "dynamics_s" (key postures and centroidal program) and "motion_s" [s].
        problems: what is left.
        gaps: momenta of the motion less those of the dynamics, after each iteration of the two.
        tau: (T, A) torques of the actuators under the planned contact forces [N m], from each frame to the next.
        actuator_names: of its columns.
        torque: the greatest of them; None without a motion.
        blocked: whether a foot or palm has no way past the terrain: known before anything is solved.
        alike: whether every transition fails for one cause, so that other contacts of the same kind would not help.

    Args:
        ok: whether no problems are left.
    """

    ok: bool
    reason: str
    failed_transitions: tuple[int, ...]
    schedule: Schedule
    centroidal: CentroidalTrajectory | None = None
    t: np.ndarray = field(default_factory=lambda: np.zeros(0))
    q: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    v: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    position_names: tuple[str, ...] = ()
    velocity_names: tuple[str, ...] = ()
    timings: dict[str, float] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()
    gaps: tuple[MomentumGap, ...] = ()
    tau: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    actuator_names: tuple[str, ...] = ()
    torque: TorqueNeed | None = None
    alike: bool = False
    blocked: bool = False


class MotionMaker:
    """Prepares the motion stage once for a query and makes motions over contact sequences."""

    def __init__(self, context: QueryContext, options: MotionOptions | None = None) -> None:
        """Prepares the motion stage.

        Args:
            context: robot, terrain and kinematics.
            options: see `MotionOptions`.
        """
        options = options or MotionOptions()
        self.robot, self.cone, self.options, self.reserve = context.robot, context.cone, options, context.reserve
        self._deadline = context.deadline
        self.robot_plant = context.robot_plant
        ik = context.ik
        monitor = ProximityMonitor(self.robot_plant, ik.kinematics, context.packed, context.scene.terrain)
        plant = self.robot_plant.plant
        self.effort, self._actuated, self._damping = effort_limits(plant), actuated_joints(plant), joint_damping(plant)
        self.setting = Setting(
            self.robot,
            ik,
            monitor,
            context.packed,
            options.rate,
            options.clearance,
            self.effort,
            context.deadline,
            options.feedback,
        )
        self.regions = BalanceRegions(self.robot, self.cone, self.reserve)

    def run(
        self, stances: Sequence[Stance], tell: Callable[[ProgressEvent], None], com_course: ComCourse | None = None
    ) -> MotionResult:
        """Tries the usual timing, then longer phases where joints were too fast or the dynamics infeasible.

        With a `com_course` the timing stays as it is.

        Args:
            stances: the contact sequence; consecutive ones differ in one end effector.
            tell: receives progress events.
            com_course: CoM to follow, for the usual timing; None: the CoM passes through points of static balance.

        Raises:
            OutOfTimeError: the query has to stop.
        """
        num = len(stances) - 1
        shift, swing = np.full(num, self.options.shift), np.full(num, self.options.swing)
        timings = {"dynamics_s": 0.0, "motion_s": 0.0}
        results: list[MotionResult] = []
        for _ in range(self.options.attempts):
            schedule = make_schedule(stances, shift=shift, swing=swing, rest=self.options.rest)
            result = self._attempt(schedule, timings, tell, com_course)
            results.append(result)
            longer = None if result.ok or com_course is not None else self._longer(schedule, result, shift, swing)
            if longer is None:
                break
            shift, swing = longer
        best = min(results, key=lambda r: (r.centroidal is None, excess(r.problems)))
        return self._with_free_timing(best, timings, tell) if self.options.free and best.ok else best

    def _with_free_timing(
        self, fixed: MotionResult, timings: dict[str, float], tell: Callable[[ProgressEvent], None]
    ) -> MotionResult:
        """The motion with durations of least effort where it holds and takes less; the given one where not."""
        cone, dt = self.cone, self.options.dt
        for bounds in FREE_BOUNDS:
            began = time.perf_counter()
            durations = free_durations(self.robot, fixed.schedule, cone, dt, bounds, self.reserve)
            timings["dynamics_s"] += time.perf_counter() - began
            if durations is None:
                continue
            shift, swing, rest = durations
            schedule = make_schedule(fixed.schedule.stances, shift=shift, swing=swing, rest=rest)
            result = self._attempt(schedule, timings, tell)
            if not result.ok or result.centroidal is None or fixed.centroidal is None:
                continue
            efforts = [effort(self.robot, r.schedule, cone, r.centroidal) for r in (result, fixed)]  # type: ignore[arg-type]
            if efforts[0] < efforts[1]:
                return result
        return fixed

    def _attempt(
        self, schedule: Schedule, timings: dict[str, float], tell: Progress, com_course: ComCourse | None = None
    ) -> MotionResult:
        self._deadline.check("during the motion")
        began = time.perf_counter()
        blocked = self._blocked_swings(schedule)
        if blocked:
            timings["dynamics_s"] += time.perf_counter() - began
            mover = self.robot.effectors[schedule.phases[2 * blocked[0] + 1].mover].name
            reason = f"no way for the {mover} past the terrain in transition {', '.join(map(str, blocked[:3]))}"
            return MotionResult(False, reason, tuple(blocked), schedule, timings=timings, blocked=True)
        tell(ProgressEvent("dynamics", f"key postures of {len(schedule.stances)} stances"))
        keys = solve_key_postures(
            self.robot, self.setting.ik, schedule, self.regions, self.setting.monitor, com_course=com_course
        )
        last = max(len(schedule.stances) - 2, 0)
        failed = sorted({min(max(b - 1, 0) // 2, last) for b in keys.failures()})
        if failed:
            timings["dynamics_s"] += time.perf_counter() - began
            more = f" and {len(failed) - 3} more" if len(failed) > 3 else ""
            complaints = [keys.complaint(b) for b in keys.failures()]
            where = f"no posture found for transition {', '.join(map(str, failed[:3]))}{more}"
            causes = {c.cause for c in complaints}
            alike = len(failed) == last + 1 >= FEW and len(causes) == 1
            reason = f"{where}: {complaints[0].sentence}"
            return MotionResult(False, reason, tuple(failed), schedule, timings=timings, alike=alike)
        self._deadline.check("during the motion")
        dynamics = SequenceDynamics(self.robot, schedule, self.cone, self.options.dt, self.reserve)
        frames = MotionFrames(self.setting, schedule, keys, dynamics, com_course)
        reason = frames.solve_dynamics(schedule.times(self.options.dt))
        timings["dynamics_s"] += time.perf_counter() - began
        if reason:
            return MotionResult(False, reason, (), schedule, timings=timings)
        tell(ProgressEvent("motion", f"{schedule.duration:.1f} s at {self.options.rate} Hz"))
        began, frames.dynamics_s = time.perf_counter(), 0.0
        problems = frames.run(self.options.rounds)
        timings["dynamics_s"] += frames.dynamics_s
        timings["motion_s"] += time.perf_counter() - began - frames.dynamics_s
        more = f" and {len(problems) - 1} more" if len(problems) > 1 else ""
        plant = self.robot_plant.plant
        v = velocities(frames.q, frames.t[1] - frames.t[0])
        tree = self.setting.ik.kinematics.tree
        tau = motion_torques(tree, frames.t, frames.q, v, frames.trajectory, dynamics.contacts, self._damping)
        return MotionResult(
            ok=not problems,
            reason=f"the motion fails: {problems[0]}{more}" if problems else "",
            failed_transitions=tuple(sorted({p.transition for p in problems})),
            schedule=schedule,
            centroidal=frames.trajectory,
            t=frames.t,
            q=frames.q,
            v=v,
            position_names=tuple(plant.GetPositionNames()),
            velocity_names=tuple(plant.GetVelocityNames()),
            timings=timings,
            problems=tuple(problems),
            gaps=frames.gaps,
            tau=tau[:, list(self._actuated.values())],
            actuator_names=tuple(self._actuated),
            torque=self._greatest(frames.t, tau),
        )

    def _blocked_swings(self, schedule: Schedule) -> list[int]:
        """Transitions whose foot or palm meets the terrain on every curve that is tried: found out in milliseconds."""
        swings = plan_swings(self.robot, self.setting.packed, schedule, {}, self.options.clearance)
        return [k for k, swing in enumerate(swings) if not swing.clear]

    def swing_is_clear(self, stance: Stance, following: Stance) -> bool:
        """Whether the foot or palm in which two stances differ finds a way past the terrain.

        Args:
            stance: before the swing.
            following: after it.
        """
        clearance = self.options.clearance
        return swing_between(self.robot, self.setting.packed, stance, following, Detour(), clearance, probe=True).clear

    def _greatest(self, t: np.ndarray, tau: np.ndarray) -> TorqueNeed:
        share = np.abs(tau) / self.effort
        frame, joint = np.unravel_index(int(share.argmax()), share.shape)
        name = self.setting.ik.kinematics.joint_names[joint]
        return TorqueNeed(float(share[frame, joint]), name, float(t[frame]))

    def _longer(
        self, schedule: Schedule, result: MotionResult, shift: np.ndarray, swing: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Durations that give too fast joints their time; None where time is not what is missing."""
        shift, swing = shift.copy(), swing.copy()
        if result.centroidal is None:
            if result.failed_transitions or not len(shift):
                return None
            return self._on_grid(1.4 * shift), self._on_grid(1.2 * swing)
        fast = [p for p in result.problems if p.kind in ("speed", *ROUGH)]
        if not fast or len(fast) < len(result.problems) or max(p.value / p.limit for p in fast) > MAX_STRETCH:
            return None
        for p in fast:
            phase = schedule.phases[int(schedule.phase_at(np.array([p.time]))[0])]
            durations = shift if phase.mover < 0 else swing
            durations[min(p.transition, len(durations) - 1)] *= 1.1 * np.sqrt(p.value / p.limit)
        return self._on_grid(shift), self._on_grid(swing)

    def _on_grid(self, durations: np.ndarray) -> np.ndarray:
        return np.round(np.ceil(durations / self.options.dt - 1e-6) * self.options.dt, 9)
