"""Plays one plan in physics with feedback: phases that end by touch, and why it failed where it did.

Plan time s runs as simulated time t does, but waits at the end of a phase for a contact that is not there yet; a palm's swing
that nothing else goes on with is played at half speed. A contact is taken early where it is felt near its place late in the
swing. Forces fade in after a touch and out before a lift.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from scipy.spatial.transform import Rotation

from drakeplan.execution.controller import Gains, Hold, Swing, Task, WholeBodyController
from drakeplan.execution.landed import landed_support, landed_wrench
from drakeplan.execution.reference import Course, PlanReference
from drakeplan.execution.report import ExecutionReport
from drakeplan.execution.watch import SLIPPED, RunWatch
from drakeplan.execution.world import Physics, World
from drakeplan.plan.plan import Plan, PlanPhases
from scenes.effector import is_foot
from scenes.files.scene_file import scene_from_yaml
from scenes.gravity import GRAVITY

EARLY = 0.8  # share of a swing after which a touch counts
NEAR = 0.015  # [m] from the planned place, in which it counts
FELT_FOOT, FELT_PALM = 8.0, 4.0  # [N] that count as a touch: a foot that comes down on a corner gives way to 20 N
PRESS, PRESS_FROM = 0.005, 0.92  # [m] below the surface that a swing aims at in the end, from this share of it on
LOST, CARRIES = 5.0, 25.0  # [N] under which a foot that came down carries nothing, and over which the other one does
SEEK = 0.1  # [m/s] at which it looks for its surface then
FOOT_GRIP = 150.0  # [1/s^2] stiffness that lays a foot flat
PROBE = 0.06  # [m/s] at which an effector that finds nothing goes on
WAIT = 0.5  # [s] for a contact at most
RAMP = 0.15  # [s] in which forces fade in and out
LEAST_FOOT, LEAST_PALM = 40.0, 15.0  # [N] asked of a contact that was just made
MOST_FORCE = 2.0  # of M g on one foot; half of that on a palm
BLEND = 0.6  # share of a swing over which it comes from where the effector was to where the plan has it
PALM_SPEED, CHANGE = 0.5, 8.0  # of the playback while only palms move; how fast it changes to that and back [1/s]
PALM_ACCELERATION = 20.0  # [m/s^2] of feed-forward: an arm's jerks must not shake the body
PALM_SWING, PALM_FORCE = 0.5, 15.0  # emphasis of its swing and force
PALM_GRIP, PALM_DAMPING = 200.0, 25.0  # [1/s^2], [1/s] along its surface: an arm is light and friction uncertain
GRIP_AFTER = 0.05  # [s] from its touch on
CONE = 0.95  # of the friction coefficient that the controller uses
FILTER = 0.5  # of each new force in what is felt
STAND = 1.0  # [s] that it has to stand in the end
PATIENCE = 3.0  # times the plan's length at most


@dataclass(frozen=True)
class ExecutionOptions:
    """How a plan is played.

    Attributes:
        physics: of the world.
        gains: of the controller.
        period: of the controller [s].
        push: time [s] and (3,) change of velocity of the whole robot [m/s].
        noise: 1: what is measured of the base is off by 2 mm, of the joints by 0.5 mrad and 10 mrad/s; 0: nothing is.
        seed: of the noise.
    """

    physics: Physics = field(default_factory=Physics)
    gains: Gains = field(default_factory=Gains)
    period: float = 4e-3
    push: tuple[float, tuple[float, float, float]] | None = None
    noise: float = 0.0
    seed: int = 0


def play_plan(
    plan: Plan,
    model: str,
    options: ExecutionOptions | None = None,
    tell: Callable[[float, float], None] = lambda s, duration: None,
) -> ExecutionReport:
    """Plays a plan in Drake's physics.

    Args:
        plan: complete.
        model: file of the robot's model.
        options: physics, controller and disturbances.
        tell: told the plan time and the plan's length [s] about twice a second of it.

    Raises:
        InputError: the plan has no motion.
    """
    return _Player(plan, model, options or ExecutionOptions()).run(tell)


class _Player:
    """The state of one run: plan time, phase, what is held since when, and statistics."""

    def __init__(self, plan: Plan, model: str, options: ExecutionOptions) -> None:
        self.plan, self.options = plan, options
        alone = _robot_alone(model)
        self.reference = PlanReference(plan, alone)
        self.world = World(plan, model, options.physics)
        self.controller = WholeBodyController(_robot_alone(model), plan.effectors, plan.mass, options.gains)
        self.feet = [is_foot(name) for name in plan.effectors]
        self.rng = np.random.default_rng(options.seed)
        count = len(plan.effectors)
        assert plan.phases is not None
        self.phases: PlanPhases = plan.phases
        self.s, self.t, self.phase, self.waited, self.rate = 0.0, 0.0, 0, 0.0, 1.0
        self.held = [int(c) for c in self.phases.contact[0]]
        self.since = [np.inf] * count  # seconds for which a contact has been held; the first ones always were
        self.offset: list[tuple[np.ndarray, np.ndarray] | None] = [None] * count  # where a swing began, off the plan
        self.grip: list[tuple[np.ndarray, np.ndarray] | None] = [None] * count
        self.felt = np.zeros((count, 3))
        self.first = self.reference.at(0.0)
        self.watch = RunWatch(plan, self.first.com[2] - self._lowest(self.first.q))

    # The run -------------------------------------------------------------------------------------------------------

    def run(self, tell: Callable[[float, float], None]) -> ExecutionReport:
        """Plays until the robot has stood at the end for a while, or fell."""
        options, reference, watch = self.options, self.reference, self.watch
        self.world.begin(self.first.q)
        pushes = [] if options.push is None else [options.push]
        times, states = [], []
        began, reason = time.perf_counter(), ""
        while self.s < reference.duration + STAND:
            q, v = self.world.state()
            if not (np.isfinite(q).all() and np.isfinite(v).all()):
                reason = "the simulation gave numbers that are not finite"
                break
            force, others = self.world.contacts()
            self.felt += FILTER * (force - self.felt)
            self.controller.look(*self._measured(q, v))
            self._switch_phases()
            self._take_early_touches()
            self._set_rate()
            sample = reference.at(self.s)
            u = self.controller.torques(sample, self._rate(), self._tasks())
            watch.shares.append(self.controller.share_of_limit())
            watch.count(self.controller.poses, self.held, force, others)
            times.append(self.s)
            states.append(q)
            reason = watch.fall(self.controller.com, sample.com, self.controller.poses, q, self.phase)
            if reason or self.t > PATIENCE * reference.duration + STAND:
                reason = reason or "it did not come to the plan's end"
                break
            for push in list(pushes):
                if self.t >= push[0]:
                    self.world.push(np.array(push[1]))
                    pushes.remove(push)
            try:
                self._advance(u)
            except RuntimeError as error:
                reason = f"the physics could not go on: {str(error).splitlines()[0][:80]}"
                break
            if len(times) % 125 == 0:
                tell(self.s, reference.duration)
        return self._report(reason, time.perf_counter() - began, np.array(times), np.array(states))

    def _advance(self, u: np.ndarray) -> None:
        period, end = self.options.period, self._end()
        self.world.advance(self.t + period, u)
        self.t = round((self.t + period) / period) * period
        self.since = [seconds + period for seconds in self.since]
        if self._stalled():
            self.waited += period
        else:
            self.s = min(self.s + self.rate * period, end)

    def _measured(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The state as sensors give it."""
        if self.options.noise <= 0.0:
            return q, v
        noise, rng = self.options.noise, self.rng
        off = np.concatenate([np.zeros(4), rng.normal(0.0, 2e-3, 3), rng.normal(0.0, 5e-4, len(q) - 7)])
        return q + noise * off, v + noise * rng.normal(0.0, 0.01, len(v))

    # Phases --------------------------------------------------------------------------------------------------------

    def _end(self) -> float:
        """Plan time at which the phase ends; never for the last [s]."""
        return float(self.phases.end[self.phase]) if self.phase + 1 < len(self.phases.end) else np.inf

    def _stalled(self) -> bool:
        return self.s >= self._end() - 1e-9

    def _now(self) -> np.ndarray:
        return self.phases.contact[self.phase]

    def _next(self) -> np.ndarray:
        return self.phases.contact[min(self.phase + 1, len(self.phases.end) - 1)]

    def _share(self) -> float:
        """How much of the phase is over."""
        start, end = self.phases.start[self.phase], self.phases.end[self.phase]
        return float(np.clip((self.s - start) / (end - start), 0.0, 1.0))

    def _switch_phases(self) -> None:
        """Begins the next phase where this one is over and all its contacts are there, or were waited for long enough."""
        while self._stalled():
            following = self._next()
            missing = [e for e, c in enumerate(following) if c >= 0 and self.held[e] != c]
            if missing and self.waited < WAIT:
                return
            if missing or self.waited > 0.0:
                self.watch.late.append(self.waited)
            for e, c in enumerate(following):
                if c < 0 <= self.held[e]:
                    self._lift(e)
                elif c >= 0 and self.held[e] != c:
                    self._take(e, int(c))
            self.waited = 0.0
            self.phase += 1

    def _lift(self, e: int) -> None:
        """A swing begins where the effector is, not where the plan has it."""
        (p, R), course = self.controller.poses[e], self.reference.course(e, self.s)
        self.offset[e] = (p - course.p, Rotation.from_matrix(R @ course.R.T).as_rotvec())
        self.held[e], self.grip[e] = -1, None
        self.watch.begin_anew(e)

    def _take(self, e: int, contact: int) -> None:
        self.held[e], self.since[e] = contact, 0.0
        self.watch.begin_anew(e)

    def _take_early_touches(self) -> None:
        """Takes contacts that are felt near their places late in the swing, or while the plan waits for them."""
        if self._share() < EARLY:
            return
        for e, contact in enumerate(self._next()):
            if contact < 0 or self._now()[e] >= 0 or self.held[e] >= 0:
                continue
            X_WC = self.plan.contacts.X_WC[contact]
            near = NEAR + PROBE * self.waited
            force = float(self.felt[e] @ X_WC[:3, 2])
            felt = force > (FELT_FOOT if self.feet[e] else FELT_PALM)
            if felt and np.linalg.norm(self.controller.poses[e][0] - X_WC[:3, 3]) < near:
                self._take(e, int(contact))
                self.watch.early += not self._stalled()

    def _set_rate(self) -> None:
        """Slows the plan down while palms alone move, and lets it run again, gently."""
        now, following = self._now(), self._next()
        before = self.phases.contact[max(self.phase - 1, 0)]
        moving = [e for e, c in enumerate(now) if c < 0 and (following[e] >= 0 or before[e] >= 0)]
        wanted = PALM_SPEED if moving and not any(self.feet[e] for e in moving) else 1.0
        most = CHANGE * self.options.period
        self.rate += float(np.clip(wanted - self.rate, -most, most))

    def _rate(self) -> float:
        """Seconds of the plan in a second; 0 while it waits."""
        return 0.0 if self._stalled() else self.rate

    # What the end effectors do ---------------------------------------------------------------------------------------

    def _tasks(self) -> list[Task]:
        return [self._hold(e) if self.held[e] >= 0 else self._swing(e) for e in range(len(self.held))]

    def _hold(self, e: int) -> Hold:
        """A contact whose force fades in after its touch and out before its lift."""
        contact, plan = self.held[e], self.plan
        drift = np.zeros(3)
        if self._bounced(e):
            self.since[e], drift = 0.0, -SEEK * plan.contacts.X_WC[contact, :3, 2]
        leaves = self._now()[e] >= 0 > self._next()[e]
        left = (self._end() - self.s) / max(self.rate, 1e-6) if leaves else np.inf
        fade = min(float(np.clip(self.since[e] / RAMP, 0.1, 1.0)), float(np.clip(left / RAMP, 0.02, 1.0)))
        X_CE = self._landed(e, contact)
        wrench = fade * landed_wrench(self.reference.wrench(e, contact, self.s), X_CE)
        if np.isfinite(self.since[e]) and not leaves:
            wrench[5] = max(wrench[5], LEAST_FOOT if self.feet[e] else LEAST_PALM)
        most = MOST_FORCE * plan.mass * GRAVITY * fade * (1.0 if self.feet[e] else 0.5)
        corners = landed_support(plan.contacts.corners(contact), plan.half_extent[e], X_CE)
        friction = CONE * float(plan.contacts.friction[contact])
        if self.feet[e]:
            return Hold(corners, friction, wrench, most, 1.0, self._flat(e, contact), FOOT_GRIP, drift=drift)
        if self.grip[e] is None and self.since[e] > GRIP_AFTER:
            self.grip[e] = self.controller.poses[e]
        return Hold(corners, friction, wrench, most, PALM_FORCE, self._kept(e, contact), PALM_GRIP, PALM_DAMPING)

    def _landed(self, e: int, contact: int) -> np.ndarray:
        """(4, 4) pose of a patch in the frame of the contact that it holds."""
        (p, R), X_CE = self.controller.poses[e], np.eye(4)
        R_WC = self.plan.contacts.X_WC[contact, :3, :3]
        X_CE[:3, :3], X_CE[:3, 3] = R_WC.T @ R, R_WC.T @ (p - self.plan.contacts.X_WC[contact, :3, 3])
        return X_CE

    def _flat(self, e: int, contact: int) -> tuple[np.ndarray, np.ndarray]:
        """Where a foot comes to lie: flat on its surface."""
        p, X_WC = self.controller.poses[e][0], self.plan.contacts.X_WC[contact]
        above = float((p - X_WC[:3, 3]) @ X_WC[:3, 2])
        return p - above * X_WC[:3, 2], X_WC[:3, :3]

    def _kept(self, e: int, contact: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Where a palm is drawn back to along its surface; nothing draws it along the normal."""
        grip = self.grip[e]
        if grip is None:
            return None
        n = self.plan.contacts.X_WC[contact, :3, 2]
        return grip[0] + float((self.controller.poses[e][0] - grip[0]) @ n) * n, grip[1]

    def _bounced(self, e: int) -> bool:
        """Whether a foot that came down has left its surface again, while the other carries."""
        if not self.feet[e] or not np.isfinite(self.since[e]):
            return False
        normal = self.plan.contacts.X_WC[:, :3, 2]
        others = [k for k, foot in enumerate(self.feet) if foot and k != e and self.held[k] >= 0]
        carried = any(self.felt[k] @ normal[self.held[k]] > CARRIES for k in others)
        return carried and float(self.felt[e] @ normal[self.held[e]]) < LOST

    def _swing(self, e: int) -> Task:
        """The plan's course, from where the effector really was, and into the surface in the end; None for an idle arm."""
        now, following = self._now()[e], self._next()[e]
        if now < 0 and following < 0 and not self.feet[e]:
            return None
        course, rate, share = self.reference.course(e, self.s), self._rate(), self._share()
        p, R, v, w = course.p, course.R, rate * course.v, rate * course.w
        a, alpha = rate**2 * course.a, rate**2 * course.alpha
        length = float(self.phases.end[self.phase] - self.phases.start[self.phase])
        begun = self.offset[e]
        if begun is not None:
            z = min(share / BLEND, 1.0)
            fade, slope = 1.0 - z * z * (3.0 - 2.0 * z), -6.0 * z * (1.0 - z) / BLEND / length * rate
            p, v, w = p + fade * begun[0], v + slope * begun[0], w + slope * begun[1]
            R = Rotation.from_rotvec(fade * begun[1]).as_matrix() @ R
        if following >= 0:
            n, width = self.plan.contacts.X_WC[following, :3, 2], 1.0 - PRESS_FROM
            z = float(np.clip((share - PRESS_FROM) / width, 0.0, 1.0))
            p = p - (PRESS * z * z * (3.0 - 2.0 * z) + PROBE * self.waited) * n
            v = v - (PRESS * 6.0 * z * (1.0 - z) / width / length * rate + (PROBE if self._stalled() else 0.0)) * n
        if not self.feet[e]:
            a = a * min(1.0, PALM_ACCELERATION / max(float(np.linalg.norm(a)), 1e-9))
            alpha = alpha * min(1.0, 4.0 * PALM_ACCELERATION / max(float(np.linalg.norm(alpha)), 1e-9))
        return Swing(Course(p, R, v, w, a, alpha), 1.0 if self.feet[e] else PALM_SWING)

    # What comes out --------------------------------------------------------------------------------------------------

    def _lowest(self, q: np.ndarray) -> float:
        """Height of the lower foot [m]."""
        self.controller.look(q, np.zeros(len(q) - 1))
        return min(p[2] for (p, _), foot in zip(self.controller.poses, self.feet, strict=True) if foot)

    def _report(self, reason: str, wall: float, times: np.ndarray, states: np.ndarray) -> ExecutionReport:
        goal, distance = scene_from_yaml(self.plan.scene_yaml, "the plan").goal, None
        fell = self.t if reason else None
        if goal is not None and not reason:
            feet = [p for (p, _), foot in zip(self.controller.poses, self.feet, strict=True) if foot]
            distance = float(np.hypot(*(np.mean(feet, axis=0)[:2] - np.array(goal.xyz[:2]))))
            if distance > goal.radius + SLIPPED:
                reason = f"it stands {distance:.2f} m from the goal, whose radius is {goal.radius:g} m"
        notes = []
        if self.world.left_out:
            notes.append(f"{self.world.left_out} triangles of meshes do not collide: only surfaces and boxes do")
        if self.controller.unlimited:
            notes.append(f"the model has no torque limit for {', '.join(self.controller.unlimited[:3])}")
        shares = np.array(self.watch.shares) if self.watch.shares else np.zeros(1)
        return ExecutionReport(
            reached=not reason,
            reason=reason,
            fell_at_s=fell,
            at_plan_s=min(self.s, self.reference.duration),
            plan_s=self.reference.duration,
            simulated_s=self.t,
            real_time_factor=self.t / max(wall, 1e-9),
            goal_distance_m=distance,
            slips_m=dict(zip(self.plan.effectors, self.watch.slips.tolist(), strict=True)),
            com_error_m=self.watch.com_error,
            torque_share=float(shares.max()),
            saturated_share=float(np.mean(shares > 0.999)),
            late_touches=tuple(self.watch.late),
            early_touches=self.watch.early,
            collisions=self.watch.collisions,
            programs_failed=self.controller.failures,
            notes=tuple(notes),
            plan_time=times,
            q=states,
        )


def _robot_alone(model: str) -> MultibodyPlant:
    """The robot without a world, continuous."""
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(Path(model))
    plant.Finalize()
    return plant
