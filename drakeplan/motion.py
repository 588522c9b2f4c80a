"""From a contact sequence to momenta, forces and a whole-body motion that the verifier accepts.

    contacts -> phases -> key postures -> centroidal program -> swing curves -> postures frame by frame -> checks

What the checks find is repaired where it can be: bodies that come too near are held apart, swings are rerouted, a CoM
that the legs cannot follow goes back to the centroidal program, joints that are too fast get more time. What remains is
reported, never hidden.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drakeplan.dynamics import BOX, centroidal_options, com_course, relaxed, solve_dynamics
from drakeplan.encounters import Encounters, ProximityMonitor, joined
from drakeplan.key_postures import BalanceRegions, KeyPostures, solve_key_postures, solve_swing_postures
from drakeplan.motion_check import Problem, find_problems, transition_of, velocities
from drakeplan.motion_targets import (
    FAINT,
    Detour,
    contact_room,
    effector_targets,
    frame_of,
    motion_targets,
    plan_swings,
    posture_reference,
    smooth_com,
    smoothed,
)
from drakeplan.phases import MOVE, Schedule, make_schedule
from drakeplan.progress import Progress, ProgressEvent
from optimization.centroidal_trajectory import CentroidalTrajectory
from optimization.posture_tracking import TrackedPostures, track_postures
from optimization.whole_body_ik import WholeBodyIK
from scenes.packed_terrain import pack_terrain
from scenes.plant import RobotPlant, build_plant
from scenes.robot import Robot
from scenes.stance import Stance
from scenes.terrain import Terrain

SEEN = 0.05  # [m] pairs of bodies nearer than this are watched
APART = 0.02  # [m] distance that pairs are asked to keep
CLOSE, TOUCHING = 0.006, -0.001  # [m] pairs nearer than this are moved apart, at first and in a smoothed motion
SMOOTHINGS = 3  # of the whole motion, each followed by another look for collisions
SMEAR, FAITHFUL = 0.04, 10.0  # [s] of smoothing, and how much harder than usual its result is held to
WINDOW = 15  # frames before and after a collision that take part in moving out of its way
COM_FEEDBACK = 0.010  # [m] a CoM this far off the plan goes back to the centroidal program
MAX_STRETCH = 2.5  # longest that a phase becomes, times its usual duration


@dataclass(frozen=True)
class MotionOptions:
    """What a user may choose about dynamics and motion.

    Attributes:
        cone: friction cone by name.
        dt: step of the momentum trajectory [s].
        shift: time to shift the CoM before each swing [s] (Lin 2020 sec. 6.7).
        swing: time to move an end effector [s].
        rest: time to come to rest at the end [s].
        rate: frames of the motion per second [Hz].
        clearance: margin of swinging feet and palms to the terrain [m].
        rounds: of repairs within one timing.
        attempts: timings tried.
    """

    cone: str = "inner"
    dt: float = 0.2
    shift: float = 1.0
    swing: float = 1.0
    rest: float = 1.0
    rate: int = 50
    clearance: float = 0.025
    rounds: int = 6
    attempts: int = 3


@dataclass(frozen=True, eq=False)
class MotionResult:
    """A motion, or how far it got.

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


def make_motion(
    robot: Robot,
    terrain: Terrain,
    stances: Sequence[Stance],
    options: MotionOptions | None = None,
    *,
    progress: Progress | None = None,
    robot_plant: RobotPlant | None = None,
    ik: WholeBodyIK | None = None,
) -> MotionResult:
    """Dynamics and motion of a contact sequence.

    Args:
        stances: consecutive ones differ in one end effector; the robot starts and ends at rest.
        progress: told what is going on.
        robot_plant: of this robot on this terrain, where the caller has one already.
        ik: of this robot, where the caller has one already.

    Raises:
        ValueError: a sequence that is none (see `make_schedule`).
    """
    maker = MotionMaker(robot, terrain, options or MotionOptions(), robot_plant, ik)
    return maker.run(stances, progress or (lambda _: None))


class MotionMaker:
    """What is prepared once for a robot on a terrain, and the repairs of one motion after the other."""

    def __init__(
        self, robot: Robot, terrain: Terrain, options: MotionOptions, robot_plant: RobotPlant | None = None,
        ik: WholeBodyIK | None = None,
    ) -> None:  # fmt: skip
        self.robot, self.terrain, self.options = robot, terrain, options
        self.robot_plant = robot_plant or build_plant(robot, terrain)
        self.ik = ik or WholeBodyIK(robot)
        self.kinematics = self.ik.kinematics
        self.monitor = ProximityMonitor(self.robot_plant, self.kinematics)
        self.packed = pack_terrain(terrain)
        self.regions = BalanceRegions(robot, options.cone)

    def run(self, stances: Sequence[Stance], tell: Callable[[ProgressEvent], None]) -> MotionResult:
        """Tries the usual timing, then longer phases where joints were too fast or the dynamics infeasible."""
        num = len(stances) - 1
        shift, swing = np.full(num, self.options.shift), np.full(num, self.options.swing)
        timings = {"dynamics_s": 0.0, "motion_s": 0.0}
        for attempt in range(self.options.attempts):
            schedule = make_schedule(stances, shift=shift, swing=swing, rest=self.options.rest)
            result = self._attempt(schedule, timings, tell)
            longer = self._longer(schedule, result, shift, swing)
            if result.ok or longer is None or attempt == self.options.attempts - 1:
                return result
            shift, swing = longer
        return result

    def _attempt(self, schedule: Schedule, timings: dict[str, float], tell: Progress) -> MotionResult:
        began = time.perf_counter()
        tell(ProgressEvent("dynamics", f"key postures of {len(schedule.stances)} stances"))
        keys = solve_key_postures(self.robot, self.ik, schedule, self.regions, self.monitor)
        failed = sorted({max(b - 1, 0) // 2 for b in keys.failures()})
        trajectory = None
        reason = "no posture for " + ", ".join(f"transition {k}" for k in failed) if failed else ""
        if not failed:
            course = com_course(schedule, keys.com, schedule.times(self.options.dt))
            trajectory, reason = self._dynamics(schedule, course)
        timings["dynamics_s"] += time.perf_counter() - began
        if trajectory is None:
            return MotionResult(False, reason, tuple(failed), schedule, timings=timings)
        tell(ProgressEvent("motion", f"{schedule.duration:.1f} s at {self.options.rate} Hz"))
        began, dynamics_s = time.perf_counter(), timings["dynamics_s"]
        result = _Frames(self, schedule, keys, trajectory, timings).run()
        timings["motion_s"] += time.perf_counter() - began - (timings["dynamics_s"] - dynamics_s)
        return result

    def _dynamics(
        self, schedule: Schedule, reference: np.ndarray, box: np.ndarray | None = None
    ) -> tuple[CentroidalTrajectory | None, str]:
        """A feasible trajectory near the reference; the pull and the box give way where there is none."""
        options = centroidal_options(self.robot, self.options.cone, self.options.dt)
        tries = [(options, BOX if box is None else box)]
        tries += [(relaxed(options, 0.2), np.multiply(2.0, tries[0][1])), (relaxed(options, 0.05), (np.inf,) * 3)]
        reason = ""
        for options, half in tries:
            estimate = solve_dynamics(self.robot, schedule, options, reference, box=half)
            if estimate.feasible:
                return estimate.trajectory, ""
            reason = f"the dynamics are infeasible: {estimate.reason}"
        return None, reason

    def _longer(
        self, schedule: Schedule, result: MotionResult, shift: np.ndarray, swing: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Durations that give too fast joints their time; None where time is not what is missing."""
        shift, swing = shift.copy(), swing.copy()
        if result.centroidal is None:
            if result.failed_transitions or not len(shift):
                return None
            return self._on_grid(1.4 * shift), self._on_grid(1.2 * swing)
        fast = [p for p in result.problems if p.kind == "speed"]
        if not fast or len(fast) < len(result.problems) or max(p.value for p in fast) > MAX_STRETCH:
            return None
        for p in fast:
            phase = schedule.phases[int(schedule.phase_at(np.array([p.time]))[0])]
            durations = shift if phase.mover is None else swing
            durations[p.transition] *= 1.1 * p.value
        return self._on_grid(shift), self._on_grid(swing)

    def _on_grid(self, durations: np.ndarray) -> np.ndarray:
        return np.round(np.ceil(durations / self.options.dt - 1e-6) * self.options.dt, 9)


class _Frames:
    """The frames of one motion and their repairs."""

    def __init__(
        self, maker: MotionMaker, schedule: Schedule, keys: KeyPostures, trajectory: CentroidalTrajectory,
        timings: dict[str, float],
    ) -> None:  # fmt: skip
        self.maker, self.schedule, self.keys, self.trajectory, self.timings = maker, schedule, keys, trajectory, timings
        self.tree = maker.kinematics.tree
        self.t = schedule.times(1.0 / maker.options.rate)
        self.held = schedule.contact_at(self.t) >= 0
        self.room = contact_room(schedule, self.t)
        self.detours: dict[int, Detour] = {}
        self.free: np.ndarray | None = None

    def run(self) -> MotionResult:
        options = self.maker.options
        self._retarget()
        self.answer = self._track(np.repeat(self.keys.q[:1], len(self.t), axis=0), chained=True)
        self._guide_palms()
        self.met = self._near(np.ones(len(self.t), dtype=bool))
        for _ in range(options.rounds):
            if not (self._keep_apart() or self._reroute() or self._feed_back()):
                break
        for _ in range(SMOOTHINGS):
            self._smooth()
            if not self._keep_apart(TOUCHING):
                break
        problems = self._problems()
        v = velocities(self.answer.q, self.t[1] - self.t[0])
        plant = self.maker.robot_plant.plant
        failed = tuple(sorted({p.transition for p in problems}))
        more = f" and {len(problems) - 1} more" if len(problems) > 1 else ""
        reason = f"the motion fails: {problems[0]}{more}" if problems else ""
        return MotionResult(
            not problems, reason, failed, self.schedule, self.trajectory, self.t, self.answer.q, v,
            tuple(plant.GetPositionNames()), tuple(plant.GetVelocityNames()),
            self.timings, tuple(problems),
        )  # fmt: skip

    def _retarget(self) -> None:
        maker = self.maker
        self.swings = plan_swings(maker.robot, maker.packed, self.schedule, self.detours, maker.options.clearance)
        com = smooth_com(self.trajectory.t, self.trajectory.com, self.t)
        swing_t, swing_q = solve_swing_postures(
            maker.robot, maker.ik, self.schedule, self.keys, self.swings, maker.monitor
        )
        key_t = np.concatenate([self.schedule.boundaries, swing_t])
        order = np.argsort(key_t)
        q_ref = posture_reference(key_t[order], np.concatenate([self.keys.q, swing_q])[order], self.t)
        self.targets = motion_targets(self.tree, self.schedule, self.swings, q_ref, com, self.t)
        self._aim()

    def _aim(self) -> None:
        X_WE, weight = effector_targets(self.schedule, self.swings, self.t, self.free)
        self.targets = replace(self.targets, X_WE=X_WE, place_weight=weight[:, :, 0], turn_weight=weight[:, :, 1])

    def _track(self, q: np.ndarray, *, chained: bool = False, solve: np.ndarray | None = None) -> TrackedPostures:
        return track_postures(self.tree, self.targets, q, solve=solve, chained=chained, max_iterations=12)

    def _guide_palms(self) -> None:
        """Palms that make or break a contact: from where the free arm is to their curve."""
        wanted = np.zeros(len(self.t), dtype=bool)
        phase = self.schedule.phase_at(self.t)
        for k in range(len(self.schedule.stances) - 1):
            if self.schedule.kind(k) != MOVE:
                wanted |= phase == 2 * k + 1
        if not wanted.any():
            return
        self.free = np.tile(np.eye(4), (*self.held.shape, 1, 1))
        for f in np.flatnonzero(wanted):
            self.free[f] = self.maker.kinematics.effector_poses(self.answer.q[f])
        self._aim()
        self.answer = self._track(self.answer.q, solve=wanted)

    def _smooth(self) -> None:
        """Takes out what jerks: every frame once more, near the smoothed motion as far as contacts and CoM allow."""
        usual = self.targets
        _, weight = effector_targets(self.schedule, self.swings, self.t, self.free, FAINT)
        q = smoothed(self.answer.q, SMEAR * self.maker.options.rate)
        self.targets = replace(
            usual, q_ref=q, posture_weight=FAITHFUL * usual.posture_weight, place_weight=weight[:, :, 0],
            turn_weight=weight[:, :, 1],
        )  # fmt: skip
        self.answer = self._track(q)
        self.met = self._near(np.ones(len(self.t), dtype=bool))

    def _near(self, frames: np.ndarray) -> Encounters:
        return self.maker.monitor.near(self.answer.q, np.flatnonzero(frames), SEEN)

    def _keep_apart(self, near: float = CLOSE) -> bool:
        """Moves bodies apart that are nearer than `near` [m] to each other; False where there are none.

        A frame in collision does not know which way out is right, the frame before it does: stretches of frames are
        walked through one by one, each from the one before, with the pairs that are near there.
        """
        close = np.zeros(len(self.t), dtype=bool)
        close[self.met.frame[self.met.distance < self._wanted(self.met) - APART + near]] = True
        if not close.any():
            return False
        stretches = _stretches(close, WINDOW)
        q = self.answer.q.copy()
        for first, last in stretches:
            for f in range(max(first, 1), last):
                q[f] = self._away(f, q[f - 1] + (self.answer.q[f] - self.answer.q[f - 1]))
        changed = (q != self.answer.q).any(axis=1)
        self.answer = self._track(q, solve=np.zeros(len(self.t), dtype=bool))
        self.met = joined(self.met.where(~changed[self.met.frame]), self._near(changed))
        return True

    def _away(self, f: int, q: np.ndarray) -> np.ndarray:
        """(nq,) frame f solved from q with the pairs apart that are near there."""
        q[:4] /= np.linalg.norm(q[:4])
        targets = frame_of(self.targets, f)
        for _ in range(2):
            met = self.maker.monitor.near(q[None], [0], SEEN)
            wanted = self._wanted(replace(met, frame=np.full(len(met), f)))
            free = np.isfinite(wanted)
            near = replace(targets, rows=met.where(free).rows(1, wanted[free]))
            q = track_postures(self.tree, near, q[None], max_iterations=12).q[0]
        return q

    def _wanted(self, met: Encounters) -> np.ndarray:
        """(R,) distance that each pair should keep [m]: none of what stands on its contact, less where it takes off."""
        wanted = np.full(len(met), APART)
        sole = met.effector >= 0
        room = self.room[met.frame[sole], met.effector[sole]]
        wanted[sole] = np.where(room > 0.0, room * APART, -np.inf)
        return wanted

    def _reroute(self) -> bool:
        """Raises swings whose foot or hand meets the terrain, or pushes them aside; False where none does."""
        bad = (self.met.effector >= 0) & (self.met.distance < -0.006)
        bad[bad] = self.room[self.met.frame[bad], self.met.effector[bad]] > 0.0
        changed = False
        for k in np.unique(transition_of(self.schedule, self.t[self.met.frame[bad]])):
            detour = self.detours.get(int(k), Detour())
            if detour.raised < 0.12:
                self.detours[int(k)] = Detour(detour.raised + 0.04, detour.pushed + 0.02)
                changed = True
        if changed:
            self._restart()
        return changed

    def _feed_back(self) -> bool:
        """Gives the centroidal program the CoM that the legs can follow; False where they follow."""
        error = np.linalg.norm(self.answer.com_error, axis=1)
        if error.max() < COM_FEEDBACK:
            return False
        began = time.perf_counter()
        knots = self.trajectory.t
        frame = np.round(knots * self.maker.options.rate).astype(int)
        reached = self.targets.com[frame] + self.answer.com_error[frame]
        near = np.array([error[max(f - 10, 0) : f + 11].max() for f in frame]) > 0.5 * COM_FEEDBACK
        reference = np.where(near[:, None], reached, self.trajectory.com)
        box = np.where(near[:, None], [0.02, 0.02, 0.01], BOX)
        trajectory, _ = self.maker._dynamics(self.schedule, reference, box)
        self.timings["dynamics_s"] += time.perf_counter() - began
        if trajectory is None:
            return False
        self.trajectory = trajectory
        self._restart()
        return True

    def _restart(self) -> None:
        """New targets for all frames."""
        self._retarget()
        self.answer = self._track(self.answer.q)
        self.met = self._near(np.ones(len(self.t), dtype=bool))

    def _problems(self) -> list[Problem]:
        com = np.stack([np.interp(self.t, self.trajectory.t, self.trajectory.com[:, i]) for i in range(3)], axis=1)
        return find_problems(self.maker.kinematics, self.schedule, self.t, self.answer.q, com, self.met)


def _stretches(marked: np.ndarray, around: int) -> list[tuple[int, int]]:
    """Half-open ranges that cover the marked frames and `around` more on either side."""
    wide = np.convolve(marked, np.ones(2 * around + 1), mode="same") > 0.5
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wide, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
