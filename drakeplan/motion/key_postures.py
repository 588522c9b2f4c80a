"""Whole-body postures at the boundaries of phases: where every motion must pass (Lin 2020 sec. 3.3).

A transition has two critical configurations: the mover has just left its old contact, and it is about to make the new
one. At both the CoM lies over what the shared contacts can balance. They bound the swing phase, so one posture for
each phase boundary gives the CoM a course that statics and kinematics agree on, and the motion a posture to stay near.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drakeplan.motion.course_dynamics import ComCourse
from drakeplan.motion.posture_branches import COMFORT, MISSED, best_of, holding_joints, on_one_branch
from drakeplan.motion.proximity import ProximityMonitor
from drakeplan.motion.resting_place import BalanceRegions, inset, resting_point
from drakeplan.motion.separation import Room, Shortage, separate_bodies, shortages
from drakeplan.motion.swing import SwingCurve
from drakeplan.motion.ways_to_stand import ways_to_stand
from drakeplan.timing.phases import MOVE, Schedule
from optimization.inverse_kinematics.frame_task import LEVER, TrackingTargets
from optimization.inverse_kinematics.posture_tracking import TrackedPostures, track_postures
from optimization.inverse_kinematics.standing_postures import StandingPostures, Way, standing_postures
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from optimization.multibody.kinematic_tree import KinematicTree
from scenes.robots.robot import Robot
from scenes.terrain.packed_terrain import PackedTerrain

MARGINS = (0.02, 0.012, 0.006, 0.0)  # [m] tried where the legs do not reach that
HOLD, COM, LOW, UPRIGHT, POSTURE = 300.0, 10.0, 3.0, 0.6, 0.1  # weights of contacts, CoM, its height, base, joints
KNEE_SLACK = 0.15  # [rad] of every joint's range that key postures leave unused, so that the motion has some
CLOSEST = 0.006  # [m] that bodies built to pass each other closely keep in a second attempt, and all in a third
LIMIT_SLACK = 2e-3  # [rad] of every joint's range that the motion leaves unused
WHOLE_RANGE = 0.1  # [rad^2] what a posture costs that needs more of its joints' ranges than `KNEE_SLACK` leaves
SPREAD = 0.06  # [m] distance that arms which hang free keep from everything else in key postures
HALFWAY = 0.45  # share of a phase at which its middle posture is taken
STRAIGHT = 0.008  # [m] that a CoM halfway between key postures may be off where it only shifts
FLY = (6.0, 0.3)  # weights of place and turn of the end effector in the air there
COURSE_WIDTH = 0.05  # [m] that the CoM may be off its course, per axis
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
GOOD_CONTACT, GOOD_COM = 1e-3, 5e-3  # [m] errors up to which a posture is one


@dataclass(frozen=True)
class Complaint:
    """Why a boundary has no posture.

    Attributes:
        cause: the same text for boundaries that fail alike: "its own bodies", the two bodies that meet, "balance", "reach"
            or "centre of mass".
        sentence: what is wrong, and by how much.
    """

    cause: str
    sentence: str


@dataclass(frozen=True, eq=False)
class KeyPostures:
    """One posture for each phase boundary, P + 1 of them.

    Attributes:
        q: (P + 1, nq).
        com: (P + 1, 3) their centres of mass [m].
        contact_error: (P + 1,) greatest distance of a placed end effector from its contact [m].
        com_error: (P + 1,) horizontal distance of the CoM from where it was wanted [m].
        regions: (P + 1) balance polygons (V, 2) of the contacts that carry there, CCW [m].
        ways: P + 1 ways to stand that they stay near.
        inside: (P + 1,) bool, whether a part of trunk, head or arms is inside a solid.
        near: bodies that are nearer to each other than asked, at boundaries without a posture.
    """

    q: np.ndarray
    com: np.ndarray
    contact_error: np.ndarray
    com_error: np.ndarray
    regions: tuple[np.ndarray, ...]
    ways: tuple[Way, ...]
    inside: np.ndarray
    near: dict[int, Shortage] = field(default_factory=dict)

    def failures(self) -> list[int]:
        """Boundaries without a posture."""
        bad = (self.contact_error > GOOD_CONTACT) | (self.com_error > GOOD_COM) | self.inside
        return np.flatnonzero(bad).tolist()

    def complaint(self, boundary: int) -> Complaint:
        """What is wrong with the posture at a boundary that has none."""
        if boundary in self.near:
            short = self.near[boundary]
            gap = f"{1e3 * short.distance:.0f} mm apart, {1e3 * short.asked:.0f} asked"
            pair = " and ".join(short.bodies)
            return Complaint("its own bodies" if short.own else pair, f"{pair} {gap}")
        contact, com = float(self.contact_error[boundary]), float(self.com_error[boundary])
        if self.inside[boundary]:
            return Complaint("no room", "the body has no room, however low and with whatever arms")
        if not np.isfinite(com):
            return Complaint("balance", "the contacts balance nowhere")
        if contact / GOOD_CONTACT > com / GOOD_COM:
            return Complaint("reach", f"an end effector stays {1e3 * contact:.0f} mm off its contact")
        return Complaint(
            "centre of mass", f"the centre of mass stays {1e3 * com:.0f} mm from where the contacts balance it"
        )


def solve_key_postures(
    robot: Robot,
    ik: WholeBodyIK,
    schedule: Schedule,
    regions: BalanceRegions,
    monitor: ProximityMonitor,
    *,
    spread: float = SPREAD,
    com_course: ComCourse | None = None,
) -> KeyPostures:
    """Solves all key postures together, moves bodies apart that are too near each other or the terrain, retries failures.

    The first attempt asks for the CoM well inside the balance polygon. Where the legs do not reach that, the
    planner's own inverse kinematics finds how far the CoM can come, and the posture is computed from there.

    Args:
        robot: whose postures.
        ik: its inverse kinematics.
        schedule: the phases; one posture for each phase boundary.
        regions: balance polygons of the contacts.
        monitor: distances of the robot's bodies to each other and the terrain.
        spread: distance that free arms keep from everything [m].
        com_course: CoM at each boundary, whether or not it is in static balance there; None: from the balance
            polygons.
    """
    placed, support = _boundary_contacts(schedule)
    if com_course is None:
        polygons = tuple(regions(tuple(schedule.contacts[c] for c in row if c >= 0)) for row in support)
    else:
        polygons = tuple(com[:2] + COURSE_WIDTH * SQUARE for com in com_course.at(schedule.boundaries))
    com = None if com_course is None else com_course.at(schedule.boundaries)
    standing = standing_postures(ik)
    targets, ways = _targets(standing, schedule, placed, polygons, com, monitor.packed)
    q = targets.q_ref
    tree = ik.kinematics.tree
    answer = track_postures(tree, targets, q, chained=False, max_iterations=60)
    answer = on_one_branch(tree, targets, answer, placed, (GOOD_CONTACT, GOOD_COM))
    room = Room.of(robot, monitor, spread)
    answer = separate_bodies(tree, monitor, targets, answer, placed, room)
    keys = _judged(standing, answer, polygons, ways, monitor.packed)
    failures = keys.failures()
    if failures:
        targets = _reachable(ik, targets, answer.q, placed, polygons, failures)
        solve = np.isin(np.arange(len(q)), failures)
        q = np.where(solve[:, None], targets.q_ref, answer.q)
        answer = track_postures(tree, targets, q, solve=solve, chained=False, max_iterations=60)
        answer = separate_bodies(tree, monitor, targets, answer, placed, room, reserve=0.0, closest=CLOSEST)
        keys = _judged(standing, answer, polygons, ways, monitor.packed)
        failures = keys.failures()
        if failures:  # everything a little nearer: the motion keeps no more than this either
            solve = np.isin(np.arange(len(q)), failures)
            answer = track_postures(tree, targets, answer.q, solve=solve, chained=False, max_iterations=60)
            answer = separate_bodies(
                tree, monitor, targets, answer, placed, room, reserve=0.0, closest=CLOSEST, apart=CLOSEST
            )
            keys = _judged(standing, answer, polygons, ways, monitor.packed)
        keys = replace(keys, near=shortages(monitor, keys.q, keys.failures(), placed, CLOSEST, CLOSEST))
    return keys


@dataclass(frozen=True, eq=False)
class Course:
    """Postures to pass in order.

    Attributes:
        t: (n,) when [s], ascending.
        q: (n, nq).
        com: (n, 3) their centres of mass [m].
    """

    t: np.ndarray
    q: np.ndarray
    com: np.ndarray


def solve_course(
    robot: Robot,
    ik: WholeBodyIK,
    schedule: Schedule,
    keys: KeyPostures,
    swings: Sequence[SwingCurve],
    monitor: ProximityMonitor,
    *,
    spread: float = SPREAD,
    com_course: ComCourse | None = None,
) -> Course:
    """The key postures, and one more in the middle of each swing from contact to contact.

    The posture in the middle of a swing is solved separately: interpolated between two key postures it may neither
    bend the knee nor bring the CoM to its place. The same is done within a shift of the CoM where legs that stand far
    apart do not let it move in a straight line.

    Args:
        robot: whose postures.
        ik: its inverse kinematics.
        schedule: the phases.
        keys: one posture for each phase boundary.
        swings: the curve of each transition's end effector.
        monitor: distances of the robot's bodies to each other and the terrain.
        spread: distance that free arms keep from everything [m].
        com_course: CoM to follow between the key postures; None: a straight line.
    """
    swinging = [2 * k + 1 for k in range(len(swings)) if schedule.kind(k) == MOVE]
    shifting = [n for n, phase in enumerate(schedule.phases) if phase.mover < 0]
    middle = swinging + shifting
    num, num_effectors = len(middle), schedule.stance_contact.shape[1]
    X_WE = np.tile(np.eye(4), (num, num_effectors, 1, 1))
    place, com = np.zeros((num, num_effectors)), np.zeros((num, 3))
    standing = standing_postures(ik)
    t, q = np.zeros(num), np.zeros((num, keys.q.shape[1]))
    for i, n in enumerate(middle):
        phase = schedule.phases[n]
        t[i] = phase.start + HALFWAY * (phase.end - phase.start)
        com[i] = keys.com[n] + HALFWAY * (keys.com[n + 1] - keys.com[n])
        if com_course is not None:
            com[i] = com_course.meeting(schedule.boundaries, keys.com, t[i : i + 1])[0]
        for e, c in enumerate(phase.contacts):
            if c >= 0:
                X_WE[i, e], place[i, e] = schedule.contacts[c].X_WC, HOLD
        if phase.mover >= 0:
            X_WE[i, phase.mover] = swings[n // 2].poses(np.array([HALFWAY]))[0]
            place[i, phase.mover] = FLY[0]
        last = len(schedule.stance_contact) - 1
        feet, heading = _stand(schedule, schedule.stance_contact[[n // 2, min((n + 1) // 2, last)]])
        q[i] = standing.over(max(keys.ways[n : n + 2]), feet, heading)
    tree = ik.kinematics.tree
    turn = np.where(place == HOLD, LEVER * HOLD, np.where(place > 0.0, FLY[1], 0.0))
    targets = TrackingTargets(
        X_WE,
        place,
        turn,
        com,
        np.full((num, 3), COM),
        q,
        posture_weight(len(tree.lower)),
        tree.lower + KNEE_SLACK,
        tree.upper - KNEE_SLACK,
    )
    answer = _between(tree, targets, keys, np.array(middle), place == HOLD)
    room = Room.of(robot, monitor, spread)
    q = separate_bodies(tree, monitor, targets, answer, np.where(place > 0.0, 0, -1), room).q
    reached = np.array([ik.kinematics.com(x) for x in q])
    needed = np.arange(num) < len(swinging)
    needed |= np.linalg.norm(reached - com, axis=1) > STRAIGHT
    key_t = np.concatenate([schedule.boundaries, t[needed]])
    order = np.argsort(key_t)
    all_com = np.concatenate([keys.com, reached[needed]])
    return Course(key_t[order], np.concatenate([keys.q, q[needed]])[order], all_com[order])


def _between(
    tree: KinematicTree, targets: TrackingTargets, keys: KeyPostures, phase: np.ndarray, held: np.ndarray
) -> TrackedPostures:
    """Postures within phases: solved from the reference, from the key posture before and from the one after.

    Of those that keep their contacts the one is taken whose holding limbs turn least on the way from key to key.
    """
    whole = replace(targets, lower=tree.lower + LIMIT_SLACK, upper=tree.upper - LIMIT_SLACK)
    starts = (targets.q_ref, keys.q[phase], keys.q[phase + 1])
    answers = [
        track_postures(tree, each, q, chained=False, max_iterations=60) for each in (targets, whole) for q in starts
    ]
    limb = holding_joints(tree, held)
    cost = np.empty((len(answers), len(phase)))
    for k, answer in enumerate(answers):
        joints = answer.q[:, 7:]
        way = (joints - keys.q[phase, 7:]) ** 2 + (keys.q[phase + 1, 7:] - joints) ** 2
        missed = np.where(held, answer.effector_error, 0.0).max(axis=1)
        cost[k] = (limb * way).sum(axis=1) + COMFORT * ((joints - targets.q_ref[:, 7:]) ** 2).sum(axis=1)
        cost[k] += MISSED * np.maximum(missed / GOOD_CONTACT - 1.0, 0.0)
        cost[k] += WHOLE_RANGE * (k >= len(starts))
    return best_of(answers, cost.argmin(axis=0))


def _judged(
    standing: StandingPostures,
    answer: TrackedPostures,
    polygons: tuple[np.ndarray, ...],
    ways: tuple[Way, ...],
    packed: PackedTerrain | None,
) -> KeyPostures:
    com = np.array([standing.ik.kinematics.com(x) for x in answer.q])
    com_error = np.linalg.norm(answer.com_error[:, :2], axis=1)
    com_error[[len(p) < 3 for p in polygons]] = np.inf
    inside = np.array([packed is not None and standing.is_inside(packed, x) for x in answer.q])
    return KeyPostures(answer.q, com, answer.effector_error.max(axis=1), com_error, polygons, ways, inside)


def _reachable(
    ik: WholeBodyIK,
    targets: TrackingTargets,
    q: np.ndarray,
    placed: np.ndarray,
    polygons: tuple[np.ndarray, ...],
    failures: list[int],
) -> TrackingTargets:
    """Targets whose CoM and reference posture at the failures are what the planner's inverse kinematics finds."""
    com, q_ref = targets.com.copy(), targets.q_ref.copy()
    for b in failures:
        if len(polygons[b]) < 3:
            continue
        for margin in MARGINS:
            region = inset(polygons[b], margin)
            found = ik.solve(targets.X_WE[b], placed[b] >= 0, region, q[b]) if len(region) else None
            if found is None or not found.ok:
                found = ik.solve(targets.X_WE[b], placed[b] >= 0, region, None) if len(region) else None
            if found is not None and found.ok:
                reached = ik.kinematics.com(found.q)
                low = targets.com_weight[b, 2] > 0.0  # then it stays low, and near its way to stand
                com[b, : 2 if low else 3] = reached[: 2 if low else 3]
                q_ref[b] = q_ref[b] if low else found.q
                break
    return replace(targets, com=com, q_ref=q_ref, lower=ik.kinematics.tree.lower, upper=ik.kinematics.tree.upper)


def _boundary_contacts(schedule: Schedule) -> tuple[np.ndarray, np.ndarray]:
    """(P + 1, E) contacts in place, and contacts that carry, at every boundary: swings decide on both of their ends."""
    num = len(schedule.phases)
    placed, support = np.empty((num + 1, 4), np.int64), np.empty((num + 1, 4), np.int64)
    for b in range(num + 1):
        placed[b] = schedule.stance_contact[b // 2 if b < num else (num - 1) // 2]
        swing = b if b % 2 else b - 1
        support[b] = schedule.phases[swing].contacts if 0 <= swing < num and swing % 2 else placed[b]
    return placed, support


def _stands(schedule: Schedule, placed: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Mean of the feet [m] and heading [rad] at every boundary."""
    return [_stand(schedule, row) for row in placed]


def _stand(schedule: Schedule, rows: np.ndarray) -> tuple[np.ndarray, float]:
    """Mean of the feet [m] and heading [rad] of one or several rows of contacts (..., E)."""
    feet = [schedule.contacts[c] for c in rows[..., :2].ravel()]
    x = np.sum([c.R_WC[:2, 0] for c in feet], axis=0)
    return np.mean([c.p_WC for c in feet], axis=0), float(np.arctan2(x[1], x[0]))


def _targets(
    standing: StandingPostures,
    schedule: Schedule,
    placed: np.ndarray,
    polygons: tuple[np.ndarray, ...],
    com_course: np.ndarray | None,
    packed: PackedTerrain | None,
) -> tuple[TrackingTargets, tuple[Way, ...]]:
    """Targets of all key postures, their CoM in the polygons or on a course (P + 1, 3), and the ways to stand that they stay near."""
    num, num_effectors = placed.shape
    X_WE = np.tile(np.eye(4), (num, num_effectors, 1, 1))
    for b, e in zip(*np.nonzero(placed >= 0), strict=True):
        X_WE[b, e] = schedule.contacts[placed[b, e]].X_WC
    stands = _stands(schedule, placed)
    com = np.zeros((num, 3))
    for b, (feet, _) in enumerate(stands):
        com[b, :2] = resting_point(polygons[b], feet[:2]) if len(polygons[b]) >= 3 else feet[:2]
    com = com if com_course is None else np.array(com_course)
    places = np.column_stack([com[:, :2], [feet[2] for feet, _ in stands]])
    ways = ways_to_stand(standing, packed, places, np.array([heading for _, heading in stands]))
    q_ref = np.stack([standing.over(way, *stand) for way, stand in zip(ways, stands, strict=True)])
    com_weight = np.tile([COM, COM, 0.0], (num, 1))
    for b, (drop, _) in enumerate(ways):  # a robot that has to be low is held there, whatever its legs would like
        if drop:
            com[b, 2], com_weight[b, 2] = standing.ik.kinematics.com(q_ref[b])[2], LOW
    tree = standing.ik.kinematics.tree
    hold = np.where(placed >= 0, HOLD, 0.0)
    weight = posture_weight(len(tree.lower))
    return TrackingTargets(
        X_WE,
        hold,
        LEVER * hold,
        com,
        com_weight,
        q_ref,
        weight,
        tree.lower + KNEE_SLACK,
        tree.upper - KNEE_SLACK,
    ), tuple(ways)


def posture_weight(num_joints: int) -> np.ndarray:
    """(nv,) weights of base orientation, base position (none) and joints."""
    return np.concatenate([np.full(3, UPRIGHT), np.zeros(3), np.full(num_joints, POSTURE)])
