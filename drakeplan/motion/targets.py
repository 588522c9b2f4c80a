"""What every frame of the motion should do: contacts to hold, swings to follow, a CoM and a posture to stay near."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from drakeplan.motion.course_dynamics import monotone_course
from drakeplan.motion.key_postures import COM, HOLD, LIMIT_SLACK, Course, posture_weight
from drakeplan.motion.swing import HOVER, RISE, SwingCurve, hover, plan_swing, smooth_step
from drakeplan.timing.phases import BREAK, MAKE, MOVE, Schedule
from optimization.centroidal.trajectory import CentroidalTrajectory
from optimization.inverse_kinematics.frame_task import LEVER, TrackingTargets
from optimization.multibody.kinematic_tree import KinematicTree
from scenes.effector import is_foot
from scenes.footholds.projection import FOOT_CLEARANCE, PALM_CLEARANCE
from scenes.robots.robot import Robot
from scenes.stance import Stance, changed_effector
from scenes.terrain.packed_terrain import PackedTerrain

NEAR = np.array([100.0, 30.0])  # weights of a swinging end effector's place and turn beside its contacts
AIR = np.array([4.0, 0.5])  # and in the air, where the CoM leads and an ankle at its limit may give way
FAINT = np.array([8.0, 1.0])  # and in the air of a motion that is only smoothed
NEARBY = 0.15  # share of the swing over which one changes into the other
GUIDED = (0.0, 0.55)  # shares of a palm's way to its wall between which its curve takes over from the free arm
AROUND = 0.8  # how far that way bends away from the wall, in heights over the contact
TOUCH = 0.5  # share of that way over which it then goes from before the wall to the wall
LATE = 0.16  # of an interval between knots that the CoM's course is played late
MOST_LATE = 0.01  # [m]


@dataclass(frozen=True)
class Detour:
    """What is added to a swing's lowest curve [m]: height and sideways displacement."""

    raised: float = 0.0
    pushed: float = 0.0


def plan_swings(
    robot: Robot, packed: PackedTerrain, schedule: Schedule, detours: dict[int, Detour], clearance: float
) -> list[SwingCurve]:
    """One curve for each transition; for a palm that makes or breaks a contact only its part near the wall.

    Args:
        robot: its contact patches.
        packed: the terrain.
        schedule: the phases.
        detours: what is added to the lowest curve, by transition.
        clearance: margin of swinging feet and palms to the terrain [m].
    """
    swings = range(len(schedule.stances) - 1)
    return [plan_one_swing(robot, packed, schedule, k, detours.get(k, Detour()), clearance) for k in swings]


def plan_one_swing(
    robot: Robot, packed: PackedTerrain, schedule: Schedule, k: int, detour: Detour, clearance: float
) -> SwingCurve:
    """The curve of one transition.

    Args:
        robot: its contact patches.
        packed: the terrain.
        schedule: the phases.
        k: index of the transition.
        detour: what is added to the lowest curve.
        clearance: margin of the swinging foot or palm to the terrain [m].
    """
    return swing_between(robot, packed, schedule.stances[k], schedule.stances[k + 1], detour, clearance)


def swing_between(
    robot: Robot,
    packed: PackedTerrain,
    stance: Stance,
    following: Stance,
    detour: Detour,
    clearance: float,
    probe: bool = False,
) -> SwingCurve:
    """The curve of the effector in which two stances differ.

    Args:
        robot: its contact patches.
        packed: the terrain.
        stance: before the swing.
        following: after it.
        detour: what is added to the lowest curve.
        clearance: margin of the swinging foot or palm to the terrain [m].
        probe: as for `plan_swing`.
    """
    mover = changed_effector(stance, following)
    before, after = stance.contacts[mover], following.contacts[mover]
    at_wall = before or after
    if at_wall is not None and (before is None or after is None):
        return hover(at_wall, HOVER + detour.raised)
    assert before is not None  # consecutive stances differ
    assert after is not None
    foot = is_foot(robot.effectors[mover].name)
    return plan_swing(
        packed,
        before,
        after,
        robot.effectors[mover].half_extent,
        FOOT_CLEARANCE if foot else PALM_CLEARANCE,
        clearance=clearance,
        other=stance.contacts[1 - mover] if foot else None,
        raised=detour.raised,
        pushed=detour.pushed,
        probe=probe,
    )


def effector_targets(
    schedule: Schedule,
    swings: Sequence[SwingCurve],
    t: np.ndarray,
    free: np.ndarray | None = None,
    air: np.ndarray = AIR,
) -> tuple[np.ndarray, np.ndarray]:
    """(T, E, 4, 4) poses of the end effectors and (T, E, 2) weights of place and turn; 0 where one hangs free.

    Args:
        schedule: the phases, with their contacts.
        swings: the curve of each transition.
        t: (T,) times [s].
        free: (T, E, 4, 4) poses in W of arms that hang free. Palms on their way to or from a wall go from there to
            their curve; None: they are left free.
        air: (2,) weights of place and turn in the air.
    """
    held = schedule.contact_at(t)
    X_WE = np.tile(np.eye(4), (*held.shape, 1, 1))
    weight = np.where((held >= 0)[:, :, None], HOLD * np.array([1.0, LEVER]), 0.0)
    for c, contact in enumerate(schedule.contacts):
        X_WE[held == c] = contact.X_WC
    phase = schedule.phase_at(t)
    for k, curve in enumerate(swings):
        swing = schedule.phases[2 * k + 1]
        frames = np.flatnonzero(phase == 2 * k + 1)
        u = (t[frames] - swing.start) / (swing.end - swing.start)
        kind = schedule.kind(k)
        if kind == MOVE:
            X_WE[frames, swing.mover] = curve.poses(u)
            weight[frames, swing.mover] = _swing_weight(np.minimum(u, 1.0 - u), air)
        elif free is not None:
            to_wall = u if kind == MAKE else 1.0 - u
            # The curve's last RISE leads from before the wall to the wall.
            at_wall = curve.poses(np.maximum(1.0 - RISE * (1.0 - to_wall) / TOUCH, 0.5))
            around = AROUND * curve.lift * curve.X_WA[:3, 2]
            X_WE[frames, swing.mover] = _blended(free[frames, swing.mover], at_wall, to_wall, around)
            weight[frames, swing.mover] = _swing_weight(1.0 - to_wall, air)
    return X_WE, weight


def _swing_weight(from_contact: np.ndarray, air: np.ndarray) -> np.ndarray:
    """(n, 2) weights of an end effector this share of its swing away from a contact."""
    share = np.array([smooth_step(x / NEARBY) for x in from_contact])
    return NEAR + (air - NEAR) * share[:, None]


def _blended(X_WA: np.ndarray, X_WB: np.ndarray, to_wall: np.ndarray, around: np.ndarray) -> np.ndarray:
    """(n, 4, 4) poses on the way from X_WA (n, 4, 4) to X_WB, which takes over as `to_wall` (n,) goes to 1.

    The way bends by `around` (3,) [m] in its middle, away from the wall.
    """
    share = np.array([smooth_step((x - GUIDED[0]) / (GUIDED[1] - GUIDED[0])) for x in to_wall])
    X = np.tile(np.eye(4), (len(share), 1, 1))
    bump = 64.0 * (share * (1.0 - share)) ** 3
    X[:, :3, 3] = X_WA[:, :3, 3] + share[:, None] * (X_WB[:, :3, 3] - X_WA[:, :3, 3]) + bump[:, None] * around
    turn = (Rotation.from_matrix(X_WB[:, :3, :3]) * Rotation.from_matrix(X_WA[:, :3, :3]).inv()).as_rotvec()
    X[:, :3, :3] = Rotation.from_rotvec(share[:, None] * turn).as_matrix() @ X_WA[:, :3, :3]
    return X


def posture_reference(course: Course, t: np.ndarray) -> np.ndarray:
    """(T, nq) smooth trajectory through the postures of a course, at rest at both ends, without overshoot.

    Args:
        course: postures with their times.
        t: (T,) times [s].
    """
    q = np.array(course.q)
    for b in range(1, len(q)):
        if q[b, :4] @ q[b - 1, :4] < 0.0:
            q[b, :4] *= -1.0
    q = monotone_course(course.t, q, t)
    q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    return q


def smoothed(q: np.ndarray, frames: float) -> np.ndarray:
    """(T, nq) the motion filtered with a Gaussian window; the ends stay at rest.

    Args:
        q: (T, nq) positions, Drake's order.
        frames: standard deviation of the window [frames].
    """
    signs = np.cumprod(np.concatenate([[1.0], np.where((q[1:, :4] * q[:-1, :4]).sum(axis=1) < 0.0, -1.0, 1.0)]))
    q = np.concatenate([q[:, :4] * signs[:, None], q[:, 4:]], axis=1)
    course = gaussian_filter1d(q, frames, axis=0, mode="nearest")
    course[:, :4] /= np.linalg.norm(course[:, :4], axis=1, keepdims=True)
    return course


def smooth_com(knot_t: np.ndarray, knot_com: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(T, 3) twice continuously differentiable course through the knots' CoM, at rest at both ends [m].

    The knots' momentum is the mean of the interval before, com[n+1] = com[n] + dt l[n+1] / M, so that a course through
    the knots has it half an interval early. Played `LATE` of an interval late it lies between the two, but never more than
    `MOST_LATE` behind the knots, however fast they are.

    Args:
        knot_t: (N,) times of the knots [s], equally spaced.
        knot_com: (N, 3) CoM at the knots in W [m].
        t: (T,) times at which to evaluate the course [s].
    """
    if len(knot_t) < 3:
        return np.array([np.interp(t, knot_t, knot_com[:, i]) for i in range(3)]).T
    dt = knot_t[1] - knot_t[0]
    speed = float(np.linalg.norm(np.diff(knot_com, axis=0), axis=1).max()) / dt
    late = min(LATE * dt, MOST_LATE / max(speed, 1e-9))
    return CubicSpline(knot_t, knot_com, bc_type="clamped")(np.clip(t - late, knot_t[0], knot_t[-1]))


def momentum_course(trajectory: CentroidalTrajectory, com: np.ndarray, t: np.ndarray, mass: float) -> np.ndarray:
    """(T - 1, 6) angular momentum about the CoM [N m s] and linear momentum [kg m/s] in W between frames.

    The linear part is that of the CoM course, the angular part that of the dynamics.

    Args:
        trajectory: the dynamics.
        com: (T, 3) CoM course in W [m].
        t: (T,) times of the frames [s].
        mass: of the robot [kg].
    """
    middle = 0.5 * (t[1:] + t[:-1])
    angular = at_times(trajectory.t, trajectory.angular_momentum, middle)
    return np.hstack([angular, mass * np.diff(com, axis=0) / np.diff(t)[:, None]])


def at_times(knot_t: np.ndarray, x: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(n, 3) values between the knots, linear as between the rows of a plan file.

    Args:
        knot_t: (N,) times of the knots [s].
        x: (N, 3) values at the knots.
        t: (n,) times [s].
    """
    return np.stack([np.interp(t, knot_t, x[:, i]) for i in range(3)], axis=1)


def motion_targets(
    tree: KinematicTree,
    schedule: Schedule,
    swings: Sequence[SwingCurve],
    q_ref: np.ndarray,
    com: np.ndarray,
    t: np.ndarray,
) -> TrackingTargets:
    """Targets of all frames, without distances to keep.

    Args:
        tree: the robot's kinematic tree.
        schedule: the phases, with their contacts.
        swings: the curve of each transition.
        q_ref: (T, nq) positions to stay near, Drake's order.
        com: (T, 3) CoM in W [m].
        t: (T,) times [s].
    """
    X_WE, weight = effector_targets(schedule, swings, t)
    return TrackingTargets(
        X_WE=X_WE,
        place_weight=weight[:, :, 0],
        turn_weight=weight[:, :, 1],
        com=com,
        com_weight=np.full((len(t), 3), COM),
        q_ref=q_ref,
        posture_weight=posture_weight(len(tree.lower)),
        lower=tree.lower + LIMIT_SLACK,
        upper=tree.upper - LIMIT_SLACK,
    )


def contact_room(schedule: Schedule, t: np.ndarray) -> np.ndarray:
    """(T, E) share of the usual distance to the terrain that each end effector can keep: 0 while it is in contact.

    Args:
        schedule: the phases.
        t: (T,) times [s].
    """
    held = schedule.contact_at(t) >= 0
    room = np.where(held, 0.0, 1.0)
    phase = schedule.phase_at(t)
    for k in range(len(schedule.stances) - 1):
        swing = schedule.phases[2 * k + 1]
        frames = np.flatnonzero(phase == 2 * k + 1)
        u = (t[frames] - swing.start) / (swing.end - swing.start)
        kind = schedule.kind(k)
        away = 1.0 - u if kind == MAKE else u if kind == BREAK else np.minimum(u, 1.0 - u)
        room[frames, swing.mover] = [smooth_step((x - 0.05) / 0.3) for x in away]
    return room
