"""The frames of one motion: each frame is solved alone, then collisions, jerks and CoM errors are repaired."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from drakeplan.motion.asked_distances import AskedDistances
from drakeplan.motion.check import (
    ACCELERATION,
    CALM_ACCELERATION,
    CALM_MOMENTUM,
    MOMENTUM,
    Problem,
    excess,
    find_problems,
    mean_velocities,
    momentum_problems,
)
from drakeplan.motion.course_dynamics import BOX, ComCourse, SequenceDynamics, monotone_course
from drakeplan.motion.emphasis import Emphasis
from drakeplan.motion.key_postures import SPREAD, KeyPostures, posture_weight, solve_course
from drakeplan.motion.proximity import KEEP
from drakeplan.motion.setting import Setting
from drakeplan.motion.targets import (
    FAINT,
    Detour,
    at_times,
    contact_room,
    effector_targets,
    momentum_course,
    motion_targets,
    plan_swings,
    posture_reference,
    smooth_com,
    smoothed,
)
from drakeplan.motion.windows import stretches, track_windows, widened
from drakeplan.timing.phases import MOVE, Schedule
from optimization.centroidal.trajectory import CentroidalTrajectory
from optimization.inverse_kinematics.frame_task import TrackingTargets, frame_targets
from optimization.inverse_kinematics.posture_tracking import TrackedPostures, track_postures
from optimization.kinodynamic.alternation import alternate
from optimization.kinodynamic.joint_torques import TorqueRows
from optimization.kinodynamic.measured_motion import motion_momentum, motion_poses
from optimization.kinodynamic.momentum_gap import Gap, MomentumGap
from optimization.kinodynamic.momentum_tracking import MomentumTargets

SEEN = 0.05  # [m] pairs of bodies nearer than this are watched
APART, MOST_APART = 0.02, 0.05  # [m] distance that pairs are asked to keep, at first and at most
CLOSE, TOUCHING = 0.006, -0.001  # [m] pairs nearer than this are moved apart, at first and in a smoothed motion
FOLLOW = (0.1, 0.05)  # weights of angular and linear momentum [1/(N m s), s/(kg m)]
CALM = 1e-2  # weight of accelerations [s^2/rad]
MENDS, MENDABLE = 6, 3.0  # repairs of a motion where it is wrong, and times its limit that the worst may be for them
PROGRESS = 0.8  # of the least excess so far that another round must come under to be worth another
HOPELESS = 10.0  # times its limit that the worst may be after the first round; other contacts are sooner found
GENTLE = 0.95  # share of the joints' speed limits that all frames together aim to keep
STEPS, ENOUGH = 4, 0.03  # of Gauss-Newton over all frames, and the relative decrease of cost that ends it
TORQUE_SHARE = 0.9  # of the joints' torque limits that the dynamics may use at the knots
ITERATIONS = 3  # of dynamics and motion
# Good enough: better than promised. Another iteration does not change how the CoM is followed.
AGREEMENT = MomentumGap(Gap(np.inf, np.inf), Gap(np.inf, np.inf), Gap(1.0, 4.0))
SMOOTHINGS = 3  # of the whole motion, each followed by another look for collisions
SMEAR = 0.04  # [s] standard deviation of smoothing
FAITHFUL, FIRM_COM = 10.0, 40.0  # how much harder than usual the smoothed posture is held to; the CoM's weight then
WINDOW = 15  # frames before and after a collision that take part in moving out of its way
FEEDBACKS = 3  # of where the CoM cannot be followed, before all frames are solved together
COM_FEEDBACK, NEAR_FEEDBACK = 0.008, 0.3  # [m, s] a CoM this far off goes back to the dynamics, with what is near it
TIGHTER, LEAST_BOX = 0.3, 0.004  # how the CoM's bounds shrink there each time, and the least of them [m]
WIDER_ARMS, MOST_SPREAD = 0.03, 0.13  # [m] how much further free arms keep away each time, and at most
ROUGH = ("jerk", "acceleration")  # problems of smoothness
DOING = "during the motion"  # for the message of a deadline
HIGHER, WIDER, MOST_RAISED = 0.04, 0.02, 0.20  # [m] what a swing that hits something gains each time, and at most


class MotionFrames:
    """Makes the frames of one motion.

    Attributes:
        trajectory: the momentum trajectory that the motion follows, once `solve_dynamics` has found one.
        t: (T,) [s].
        q: (T, nq) the motion.
        dynamics_s: time that was spent in the dynamics [s].
    """

    trajectory: CentroidalTrajectory

    def __init__(
        self,
        setting: Setting,
        schedule: Schedule,
        keys: KeyPostures,
        dynamics: SequenceDynamics,
        com_course: ComCourse | None = None,
    ) -> None:
        """Prepares the frames and plans the course through the key postures.

        Args:
            setting: robot, terrain and options.
            schedule: the phases.
            keys: one posture for each phase boundary.
            dynamics: the centroidal program of the sequence.
            com_course: CoM to follow from key posture to key posture; None: the CoM takes the shortest way.
        """
        self.setting, self.schedule, self.keys = setting, schedule, keys
        self.tree = setting.ik.kinematics.tree
        self.t = schedule.times(1.0 / setting.rate)
        self.dynamics_s = 0.0
        self.gaps: tuple[MomentumGap, ...] = ()
        self._dynamics, self._com_course = dynamics, com_course
        self._held = schedule.contact_at(self.t) >= 0
        self._asked = AskedDistances(setting.monitor, contact_room(schedule, self.t), self.t, APART)
        self._detours: dict[int, Detour] = {}
        self._free: np.ndarray | None = None
        self._spread = SPREAD
        self._bound = False
        self._emphasis = Emphasis(self.t)
        self._plan_course()

    def solve_dynamics(self, knots: np.ndarray) -> str:
        """Momenta along the course at these times (N,); the reason where there are none, else "".

        The postures of the course swing their limbs already: the dynamics start with their angular momentum.
        """
        self._knots, self._box = knots, np.tile(BOX, (len(knots), 1))
        q = posture_reference(self._course, self.t)
        _, momentum = motion_momentum(self.tree, q, np.diff(self.t))
        return self._solve(self._at_knots(momentum[:, :3]) * self.setting.feedback, None)

    def _solve(self, spin: np.ndarray, box: np.ndarray | None, torques: TorqueRows | None = None) -> str:
        self.setting.deadline.check(DOING)
        began = time.perf_counter()
        follow = monotone_course if self._com_course is None else self._com_course.meeting
        reference = follow(self._course.t, self._course.com, self._knots)
        trajectory, reason = self._dynamics.solve(reference, spin, box, torques, self.setting.deadline.left())
        self.dynamics_s += time.perf_counter() - began
        if trajectory is not None:
            self.trajectory, self._spin = trajectory, spin
        return reason

    def _at_knots(self, between: np.ndarray) -> np.ndarray:
        """(N, 3) of values (T - 1, 3) between the frames, 0 at both ends."""
        middle = 0.5 * (self.t[1:] + self.t[:-1])
        values = at_times(middle, between, self._knots)
        values[[0, -1]] = 0.0
        return values

    @property
    def q(self) -> np.ndarray:
        """(T, nq) the motion as it stands."""
        return self._answer.q

    def run(self, rounds: int) -> list[Problem]:
        """Makes the motion; what is left of its problems."""
        self._retarget()
        self._answer = self._track(np.repeat(self.keys.q[:1], len(self.t), axis=0), chained=True)
        self._lead_palms()
        tried: list[tuple[list[Problem], CentroidalTrajectory, TrackedPostures, tuple[MomentumGap, ...]]] = []
        for _ in range(rounds):
            self._follow()
            gaps = self._agree()
            for _ in range(SMOOTHINGS):
                moved = self._keep_apart(TOUCHING)
                if not moved.any():
                    break
                gaps = (*gaps[:-1], self._settle(widened(moved, WINDOW)))
            problems = self._mend()
            gaps = (*gaps[:-1], self._gap(*motion_momentum(self.tree, self.q, np.diff(self.t))))
            least = min((excess(one[0]) for one in tried), default=HOPELESS / PROGRESS)
            stuck = excess(problems) > PROGRESS * least
            tried.append((problems, self.trajectory, self._answer, gaps))
            if not problems or stuck or not self._try_harder(problems):
                break
            self._restart()
        problems, self.trajectory, self._answer, self.gaps = min(tried, key=lambda one: excess(one[0]))
        return problems

    def _follow(self) -> None:
        """Where the CoM cannot be followed the dynamics learn of it; bodies are moved apart when that has settled."""
        for _ in range(FEEDBACKS - 1):
            if not self._feed_back():
                break
        self._look()
        self._keep_apart(CLOSE)
        if self._feed_back():
            self._look()
            self._keep_apart(CLOSE)

    def _mend(self) -> list[Problem]:
        """Solves the frames about each problem once more, with more weight on what was not kept; what is left.

        Joints are calmed beyond what is required, as far as a few repairs bring it.
        """
        wrong = self._problems(calm=True)
        for _ in range(MENDS):
            if not 0.0 < excess(wrong) < MENDABLE:
                break
            before = self._answer, self._momentum, self._met
            self._settle(self._emphasis.stress(wrong))
            after = self._problems(calm=True)
            if excess(after) >= excess(wrong):
                self._answer, self._momentum, self._met = before
                break
            wrong = after
        return self._problems()

    def _restart(self) -> None:
        """New targets for all frames, from the postures that keys give, not from where the last round went."""
        self._retarget()
        self._answer = self._track(np.repeat(self.keys.q[:1], len(self.t), axis=0), chained=True)

    # ---- what the frames should do

    def _plan_course(self) -> None:
        setting = self.setting
        self._swings = plan_swings(setting.robot, setting.packed, self.schedule, self._detours, setting.clearance)
        self._course = solve_course(
            setting.robot,
            setting.ik,
            self.schedule,
            self.keys,
            self._swings,
            setting.monitor,
            com_course=self._com_course,
        )
        self._asked.learn(self._course.t, self._course.q)

    def _retarget(self) -> None:
        com = smooth_com(self.trajectory.t, self.trajectory.com, self.t)
        q_ref = posture_reference(self._course, self.t)
        self._targets = motion_targets(self.tree, self.schedule, self._swings, q_ref, com, self.t)
        self._aim()

    def _aim(self) -> None:
        X_WE, weight = effector_targets(self.schedule, self._swings, self.t, self._free)
        self._targets = replace(self._targets, X_WE=X_WE, place_weight=weight[:, :, 0], turn_weight=weight[:, :, 1])

    def _lead_palms(self) -> None:
        """Palms that make or break a contact: from where the free arm is to their curve."""
        wanted = np.zeros(len(self.t), dtype=bool)
        phase = self.schedule.phase_at(self.t)
        for k in range(len(self.schedule.stances) - 1):
            if self.schedule.kind(k) != MOVE:
                wanted |= phase == 2 * k + 1
        if not wanted.any():
            return
        self._free = np.tile(np.eye(4), (*self._held.shape, 1, 1))
        self._free[wanted] = motion_poses(self.tree, self.q[wanted])[0]
        self._aim()
        self._answer = self._track(self.q, solve=wanted)

    def _track(self, q: np.ndarray, *, chained: bool = False, solve: np.ndarray | None = None) -> TrackedPostures:
        self.setting.deadline.check(DOING)
        return track_postures(self.tree, self._targets, q, solve=solve, chained=chained, max_iterations=12)

    def _settle(self, where: np.ndarray | None = None) -> MomentumGap:
        """All frames together: momenta as the dynamics say, bodies apart, no jerks, near the motion as it is.

        Args:
            where: (T,) the frames that are solved, the others stay; None: all.
        """
        self.setting.deadline.check(DOING)
        num = len(self.t)
        com = smooth_com(self.trajectory.t, self.trajectory.com, self.t)
        q_ref = smoothed(self.q, SMEAR * self.setting.rate)
        targets, links = self._joint_targets(q_ref, com), self._links(com)
        start, solved = (q_ref, np.ones(num, dtype=bool)) if where is None else (self.q, where)
        check = partial(self.setting.deadline.check, DOING)
        q = track_windows(self.tree, targets, links, start, solved, max_iterations=STEPS, tolerance=ENOUGH, check=check)
        self._targets = targets
        reached, self._momentum = motion_momentum(self.tree, q, np.diff(self.t))
        nothing = np.zeros(self._held.shape)
        self._answer = TrackedPostures(q, nothing, reached - com, np.zeros(num, np.int64))
        self._look(where)
        return self._gap(reached, self._momentum)

    def _joint_targets(self, q_ref: np.ndarray, com: np.ndarray) -> TrackingTargets:
        """What each frame should do where all are solved together, near q_ref (T, nq) and a CoM (T, 3) [m]."""
        more = self._emphasis
        _, weight = effector_targets(self.schedule, self._swings, self.t, self._free, FAINT)
        wanted = self._asked.wanted(self._met)
        apart = self._met.where(np.isfinite(wanted))
        keep = KEEP * more.apart[apart.frame]
        return replace(
            self._targets,
            q_ref=q_ref,
            posture_weight=FAITHFUL * posture_weight(len(self.tree.lower)),
            place_weight=weight[:, :, 0] * more.hold[:, None],
            turn_weight=weight[:, :, 1] * more.hold[:, None],
            com=com,
            com_weight=FIRM_COM * np.repeat(more.com[:, None], 3, axis=1),
            rows=apart.rows(len(self.t), wanted[np.isfinite(wanted)], keep),
        )

    def _links(self, com: np.ndarray) -> MomentumTargets:
        """What joins the frames: momenta of a CoM course (T, 3) [m] and of the dynamics, calm joints, rest at the ends."""
        num, nv = len(self.t), 6 + len(self.tree.lower)
        return MomentumTargets(
            dt=np.full(num - 1, 1.0 / self.setting.rate),
            momentum=momentum_course(self.trajectory, com, self.t, self.tree.total_mass),
            weight=np.outer(self._emphasis.follow[1:], np.repeat(FOLLOW, 3)) * self.setting.feedback,
            smooth=np.repeat(CALM * self._emphasis.calm[:, None], nv, axis=1),
            speed=GENTLE * self.tree.speed,
            v_start=np.zeros(nv),
            v_end=np.zeros(nv),
            acceleration=GENTLE * CALM_ACCELERATION,
        )

    def _agree(self) -> tuple[MomentumGap, ...]:
        """Dynamics and motion in turns; at first the motion as it is, then all its frames together."""
        first = self._measure()
        if not self.setting.feedback:
            return first, self._settle()
        self._feed_spin_back()
        return first, *alternate(self._settle, self._feed_spin_back, lambda gap: gap.within(AGREEMENT), ITERATIONS - 1)

    def _measure(self) -> MomentumGap:
        """The frames as they are, each made by itself: their momenta once they are smooth."""
        com, self._momentum = motion_momentum(self.tree, smoothed(self.q, SMEAR * self.setting.rate), np.diff(self.t))
        return self._gap(com, self._momentum)

    def _gap(self, com: np.ndarray, momentum: np.ndarray) -> MomentumGap:
        """CoM (T, 3) and momenta (T - 1, 6) of the motion less those of the dynamics, linear between its knots."""
        gap = self._momentum_gap(momentum)
        away = com - at_times(self.trajectory.t, self.trajectory.com, self.t)
        return MomentumGap(Gap.of(away), Gap.of(gap[:, 3:]), Gap.of(gap[:, :3]))

    def _momentum_gap(self, momentum: np.ndarray) -> np.ndarray:
        """(T - 1, 6) angular and linear momentum of the motion less those of the dynamics."""
        c, middle = self.trajectory, 0.5 * (self.t[1:] + self.t[:-1])
        planned = [at_times(c.t, h, middle) for h in (c.angular_momentum, c.linear_momentum)]
        return momentum - np.hstack(planned)

    def _feed_spin_back(self) -> bool:
        """The dynamics once more, with the motion's own angular momentum and, where they bind, its joint torques."""
        return not self._solve(self._at_knots(self._momentum[:, :3]), self._box, self._torque_rows())

    def _torque_rows(self) -> TorqueRows | None:
        """Limits of the joint torques about the motion as it is at the knots; None where none is near its limit."""
        q = smoothed(self.q, SMEAR * self.setting.rate)[np.round(self._knots * self.setting.rate).astype(int)]
        v = mean_velocities(q, self._knots[1] - self._knots[0])
        v = np.vstack([np.zeros(v.shape[1]), v])
        kinematics, effort = self.setting.ik.kinematics, self.setting.effort
        problem = self._dynamics.problem(self.trajectory.com, self.trajectory.angular_momentum, self._box)
        rows = TorqueRows(kinematics, problem, TORQUE_SHARE * effort, q, v)
        return rows if (np.abs(rows.torques(self.trajectory)) > TORQUE_SHARE * effort).any() else None

    # ---- bodies that come too near

    def _look(self, frames: np.ndarray | None = None) -> None:
        """Asks for what is near in these frames (T,), in all by default."""
        if frames is None:
            self._met = self.setting.monitor.near(self.q, range(len(self.t)), SEEN)
        else:
            fresh = self.setting.monitor.near(self.q, np.flatnonzero(frames), SEEN)
            self._met = self._met.where(~frames[self._met.frame]).joined(fresh)

    def _keep_apart(self, near: float) -> np.ndarray:
        """Moves bodies apart that are nearer than `near` [m] to each other; (T,) bool, the frames that have changed.

        A frame in collision does not know which way out is right, the frame before it does: stretches of frames are
        walked through one by one, each from the one before, with the pairs that are near there.
        """
        close = np.zeros(len(self.t), dtype=bool)
        close[self._met.frame[self._asked.near(self._met, near)]] = True
        if not close.any():
            return close
        q = self.q.copy()
        for first, last in stretches(close, WINDOW):
            for f in range(max(first, 1), last):
                q[f] = self._away(f, q[f - 1] + (self.q[f] - self.q[f - 1]))
        changed = (q != self.q).any(axis=1)
        self._answer = self._track(q, solve=np.zeros(len(self.t), dtype=bool))
        self._look(changed)
        return changed

    def _away(self, f: int, q: np.ndarray) -> np.ndarray:
        """(nq,) frame f solved from q with the pairs apart that are near there."""
        self.setting.deadline.check(DOING)
        q[:4] /= np.linalg.norm(q[:4])
        targets = frame_targets(self._targets, f)
        for _ in range(2):
            met = self.setting.monitor.near(q[None], [0], SEEN)
            wanted = self._asked.wanted(replace(met, frame=np.full(len(met), f)))
            free = np.isfinite(wanted)
            near = replace(targets, rows=met.where(free).rows(1, wanted[free]))
            q = track_postures(self.tree, near, q[None], max_iterations=12).q[0]
        return q

    # ---- what is left

    def _feed_back(self) -> bool:
        """Binds the dynamics to the course's CoM where the legs cannot follow; False where they follow or it cannot."""
        error = np.linalg.norm(self._answer.com_error, axis=1)
        if error.max() < COM_FEEDBACK:
            return False
        frame = np.round(self._knots * self.setting.rate).astype(int)
        around = round(NEAR_FEEDBACK * self.setting.rate)
        off = np.array([error[max(f - around, 0) : f + around + 1].max() for f in frame])
        box = np.where((off > 0.5 * COM_FEEDBACK)[:, None], np.maximum(TIGHTER * self._box, LEAST_BOX), self._box)
        self._bound = bool(self._solve(self._spin, box))
        if self._bound:
            return False
        self._box = box
        self._restart()
        return True

    def _try_harder(self, problems: Sequence[Problem]) -> bool:
        """Gives the next round more distance or other swings, or a tighter CoM; False where nothing is left to try."""
        before, detours = (self._asked.apart, self._spread), dict(self._detours)
        self._emphasis.stress(problems)
        for p in problems:
            if p.kind == "sole collision":
                detour = self._detours.get(p.transition, Detour())
                if detour.raised < MOST_RAISED:
                    self._detours[p.transition] = Detour(detour.raised + HIGHER, detour.pushed + WIDER)
            elif p.kind.endswith("collision"):
                self._asked.apart = min(self._asked.apart + 0.015, MOST_APART)
            if p.kind in ("self collision", "speed", *ROUGH):
                self._spread = min(self._spread + WIDER_ARMS, MOST_SPREAD)
        if (before[1], detours) != (self._spread, self._detours):
            self._plan_course()
        off = any(p.kind in ("com", "held") for p in problems) and not self._bound
        off |= any(p.kind in ROUGH for p in problems)
        return before != (self._asked.apart, self._spread) or detours != self._detours or off

    def _problems(self, *, calm: bool = False) -> list[Problem]:
        """What exceeds its limit; where `calm` also what exceeds the aims of a calm motion."""
        com = at_times(self.trajectory.t, self.trajectory.com, self.t)
        most = CALM_ACCELERATION if calm else ACCELERATION
        found = find_problems(self.setting.ik.kinematics, self.schedule, self.t, self.q, com, self._met, most)
        if not self.setting.feedback:
            return found
        limits = CALM_MOMENTUM if calm else MOMENTUM
        return found + momentum_problems(self.schedule, self.t, self._momentum_gap(self._momentum), limits)
