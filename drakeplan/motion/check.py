"""Violations of a motion: kind, time, size, and the body or joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded

from drakeplan.motion.proximity import Encounters
from drakeplan.timing.phases import Schedule
from optimization.inverse_kinematics.frame_task import LEVER
from optimization.kinodynamic.measured_motion import motion_poses
from optimization.multibody.kinematics import Kinematics, difference

# Slightly tighter than the verifier's limits: the verifier uses Drake, this check uses our own kinematics.
HELD, COM, PENETRATION, SOLE_PENETRATION = 4e-3, 0.018, 4e-3, 9e-3  # [m]
ACCELERATION = 140.0  # [rad/s^2] of any joint
CALM_ACCELERATION = 60.0  # [rad/s^2] what motions aim at
# [N m s] and [kg m/s] of the motion's angular and linear momentum off the plan's: the worst and the RMS
MOMENTUM = {"angular momentum": (9.0, 2.3), "linear momentum": (32.0, 6.5)}
CALM_MOMENTUM = {"angular momentum": (6.0, 2.0), "linear momentum": (6.0, 2.0)}  # what motions aim at
JUMP = 0.09  # [rad/s, m/s] of a frame's mean velocity beyond the velocities at its ends
SPEED_SHARE = 0.98  # of the joints' speed limits


@dataclass(frozen=True)
class Problem:
    """One violation.

    Attributes:
        kind: "held", "com", "speed", "jerk", "acceleration", "self collision", "terrain collision",
            "sole collision", "angular momentum" or "linear momentum".
        transition: index of the transition that it belongs to.
        time: where it is worst [s].
        value: how bad [m, share of a speed limit, rad/s, rad/s^2, N m s or kg m/s].
        limit: what is allowed.
        about: bodies, end effector or joint.
        span: times of the first and the last frame of the transition that exceed the limit [s].
    """

    kind: str
    transition: int
    time: float
    value: float
    limit: float
    about: str
    span: tuple[float, float] = (np.nan, np.nan)

    def __str__(self) -> str:
        return f"{self.kind} at {self.time:.2f} s: {self.about}, {self.value:.4g} (limit {self.limit:.4g})"


def excess(problems: Sequence[Problem]) -> float:
    """How many times its limit the worst problem is; 0 without any. Of two motions the one with less is nearer to good."""
    return max((p.value / p.limit for p in problems), default=0.0)


def mean_velocities(q: np.ndarray, step: float) -> np.ndarray:
    """(T - 1, nv) velocity that takes each frame to the next, in Drake's order.

    Args:
        q: (T, nq) positions, Drake's order.
        step: time between frames [s].
    """
    d = np.empty((len(q) - 1, q.shape[1] - 1))
    for t in range(len(d)):
        difference(q[t], q[t + 1], d[t])
    return d / step


def velocities(q: np.ndarray, step: float) -> np.ndarray:
    """(T, nv) velocity at each frame: that of the cubic spline through the frames, at rest at both ends.

    Its slopes follow from continuous accelerations, v[k-1] + 4 v[k] + v[k+1] = 3 (d[k-1] + d[k]) with d the mean
    velocities (de Boor 1978, ch. IV); turns of the base over a frame are small enough to add like vectors.

    Args:
        q: (T, nq) positions, Drake's order.
        step: time between frames [s].
    """
    v = np.zeros((len(q), q.shape[1] - 1))
    if len(q) > 2:
        d = mean_velocities(q, step)
        band = np.ones((3, len(q) - 2))
        band[1] = 4.0
        v[1:-1] = solve_banded((1, 1), band, 3.0 * (d[:-1] + d[1:]))
    return v


def transition_of(schedule: Schedule, t: np.ndarray) -> np.ndarray:
    """(n,) the transition that the phases at these times serve: a shift belongs to the swing that follows.

    Args:
        schedule: the phases.
        t: (n,) times [s].
    """
    return np.minimum(schedule.phase_at(t) // 2, max(len(schedule.stances) - 2, 0))


def find_problems(
    kinematics: Kinematics,
    schedule: Schedule,
    t: np.ndarray,
    q: np.ndarray,
    planned_com: np.ndarray,
    met: Encounters,
    acceleration: float = ACCELERATION,
) -> list[Problem]:
    """Every violation of a motion, the worst of each kind in each transition.

    Args:
        kinematics: of the robot.
        schedule: the phases, with their contacts.
        t: (T,) times [s].
        q: (T, nq) positions, Drake's order.
        planned_com: (T, 3) CoM of the momentum trajectory in W [m], interpolated linearly as the verifier does.
        met: pairs of bodies that come near each other, in all frames.
        acceleration: allowed of any joint [rad/s^2].
    """
    transition = transition_of(schedule, t)
    found: list[Problem] = []

    def add(kind: str, frames: np.ndarray, values: np.ndarray, limit: float, about: Sequence[str]) -> None:
        for k in np.unique(transition[frames[values > limit]]):
            own = np.flatnonzero(transition[frames] == k)
            worst = int(own[np.argmax(values[own])])
            over = t[frames[own[values[own] > limit]]]
            span = float(over.min()), float(over.max())
            found.append(
                Problem(kind, int(k), float(t[frames[worst]]), float(values[worst]), limit, about[worst], span)
            )

    frames = np.arange(len(t))
    X_WE, com = motion_poses(kinematics.tree, q)
    for e in range(X_WE.shape[1]):
        error = held_error(schedule, t, X_WE[:, e], e)
        add("held", frames, error, HELD, [kinematics.frames[e]] * len(t))
    add("com", frames, np.linalg.norm(com - planned_com, axis=1), COM, ["centre of mass"] * len(t))
    if len(t) > 1:
        share = np.abs(mean_velocities(q, t[1] - t[0])[:, 6:]) / kinematics.tree.speed
        worst = share.argmax(axis=1)
        add("speed", frames[1:], share.max(axis=1), SPEED_SHARE, [kinematics.joint_names[j] for j in worst])
        d, v = mean_velocities(q, t[1] - t[0]), velocities(q, t[1] - t[0])
        jump = np.maximum(np.minimum(v[:-1], v[1:]) - d, d - np.maximum(v[:-1], v[1:]))
        worst = jump.argmax(axis=1)
        axes = ["base"] * 6 + list(kinematics.joint_names)
        add("jerk", frames[1:], jump.max(axis=1), JUMP, [axes[j] for j in worst])
        a = np.abs(np.diff(v[:, 6:], axis=0)) / (t[1] - t[0])
        names = [kinematics.joint_names[j] for j in a.argmax(axis=1)]
        add("acceleration", frames[1:], a.max(axis=1), acceleration, names)
    names = [f"{a} and {b}" for a, b in met.bodies]
    sole, ground = met.effector >= 0, met.with_terrain
    for kind, own, limit in (
        ("self collision", ~ground, PENETRATION),
        ("terrain collision", ground & ~sole, PENETRATION),
        ("sole collision", sole, SOLE_PENETRATION),
    ):
        add(kind, met.frame[own], -met.distance[own], limit, [n for n, o in zip(names, own, strict=True) if o])
    return found


def momentum_problems(
    schedule: Schedule, t: np.ndarray, gap: np.ndarray, limits: Mapping[str, tuple[float, float]]
) -> list[Problem]:
    """Where the motion's momenta are off the plan's: the worst moments, and the greatest of all where the RMS is too much.

    Args:
        schedule: the phases.
        t: (T,) times [s].
        gap: (T - 1, 6) angular and linear momentum between frames less those of the plan [N m s, kg m/s].
        limits: of the worst and of the RMS, by kind.
    """
    found = []
    for kind, columns in (("angular momentum", gap[:, :3]), ("linear momentum", gap[:, 3:])):
        size, (worst, mean) = np.linalg.norm(columns, axis=1), limits[kind]
        if not len(size):
            continue
        rms, most = float(np.sqrt(np.mean(size**2))), int(size.argmax())
        if size[most] > worst or rms > mean:
            value, limit = max((float(size[most]), worst), (rms, mean), key=lambda pair: pair[0] / pair[1])
            over = t[1:][size > 0.5 * size[most]]
            k, time = int(transition_of(schedule, t[most : most + 1])[0]), float(t[most])
            found.append(Problem(kind, k, time, value, limit, "model", (float(over.min()), float(over.max()))))
    return found


def held_error(schedule: Schedule, t: np.ndarray, X_WE: np.ndarray, effector: int) -> np.ndarray:
    """(T,) distance of an end effector from the contact that it holds [m], 1 rad counting `LEVER`; 0 where it is free.

    Args:
        schedule: the phases, with their contacts.
        t: (T,) times [s].
        X_WE: (T, 4, 4) poses of the end effector in W.
        effector: its index into `EFFECTORS`.
    """
    error = np.zeros(len(t))
    for phase in schedule.phases:
        c = phase.contacts[effector]
        if c < 0:
            continue
        own = (t >= phase.start - 1e-9) & (t <= phase.end + 1e-9)
        X_WC = schedule.contacts[c].X_WC
        away = np.linalg.norm(X_WE[own, :3, 3] - X_WC[:3, 3], axis=1)
        chord = np.linalg.norm(X_WE[own, :3, :3] - X_WC[:3, :3], axis=(1, 2)) / np.sqrt(2.0)
        error[own] = np.maximum(error[own], np.hypot(away, LEVER * chord))
    return error
