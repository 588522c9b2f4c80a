"""Distances between bodies in postures: bodies too near are moved apart, and hips to where no leg is straight."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drakeplan.motion.proximity import KEEP, Encounters, ProximityMonitor
from optimization.inverse_kinematics.frame_task import TrackingTargets
from optimization.inverse_kinematics.posture_tracking import TrackedPostures, track_postures
from optimization.multibody.kinematic_tree import KinematicTree, forward
from optimization.multibody.kinematics import limb_links
from scenes.robots.nominal_distances import ordered
from scenes.robots.plant import nominal_posture
from scenes.robots.robot import Robot

APART, SEEN = 0.02, 0.05  # [m] distance that bodies keep in key postures, and from which they are watched
RESERVE, BEND = 0.02, 5.0  # [m] of a leg's length that key postures leave unused, and the weight of that
TOLERATED = 2e-3  # [m] by which bodies may be nearer than asked
ROUNDS = 4  # of moving bodies apart


@dataclass(frozen=True)
class Room:
    """Distances that free arms keep from everything, no greater than those in the nominal posture.

    Attributes:
        spread: distance where nothing says otherwise [m].
        least: distance of bodies that are nearer than that in the nominal posture [m], by their names.
    """

    spread: float
    least: dict[tuple[str, str], float]

    @classmethod
    def of(cls, robot: Robot, monitor: ProximityMonitor, spread: float) -> Room:
        """Measures the nominal posture.

        Args:
            robot: whose nominal posture.
            monitor: distances of the robot's bodies to each other.
            spread: distance to keep where the nominal posture does not have less [m].
        """
        met = monitor.near(np.array(nominal_posture(robot), float)[None], [0], spread)
        met = met.where(~met.with_terrain)
        apart = monitor.at_most_nominal(met, np.full(len(met), APART))
        least: dict[tuple[str, str], float] = {}
        for bodies, distance, lowest in zip(met.bodies, met.distance.tolist(), apart.tolist(), strict=True):
            least[bodies] = max(min(distance, least.get(bodies, spread)), lowest)
        return cls(spread, least)

    def wanted(self, met: Encounters) -> np.ndarray:
        """(R,) distance of these pairs [m]."""
        return np.array([self.least.get(bodies, self.spread) for bodies in met.bodies])


def separate_bodies(
    tree: KinematicTree,
    monitor: ProximityMonitor,
    targets: TrackingTargets,
    answer: TrackedPostures,
    placed: np.ndarray,
    room: Room,
    reserve: float = RESERVE,
    closest: float = np.inf,
    apart: float = APART,
) -> TrackedPostures:
    """Moves bodies apart that are too near, and hips to where no leg is straight; contacts in place stay.

    Args:
        tree: the robot's kinematic tree.
        monitor: distances of the robot's bodies to each other and the terrain.
        targets: what the postures track; n of them.
        answer: the n postures to start from.
        placed: (n, E) contact numbers, not negative where an end effector may not move.
        room: distance that arms keep which are not placed; everything else keeps `APART`, bodies that are nearer than that
            in the nominal posture nearly what they have there.
        reserve: length that legs keep unused [m].
        closest: what is enough for bodies that are built to pass each other closely [m].
        apart: what everything but free arms keeps [m].
    """
    num = len(answer.q)
    chains = {e: limb_links(tree, e) for e in (2, 3)}
    arms = {link: e for e, chain in chains.items() for link in chain[: len(chain) // 2]}  # forearms and hands
    for _ in range(ROUNDS):
        met = monitor.near(answer.q, range(num), room.spread + SEEN)
        met = met.where((met.effector < 0) | (placed[met.frame, met.effector] < 0))
        legs, left = _legs(tree, answer.q)
        arm = np.array([[arms.get(int(link), -1) for link in pair] for pair in met.link]).reshape(-1, 2)
        free = ((arm >= 0) & (placed[met.frame[:, None], np.maximum(arm, 0)] < 0)).any(axis=1)
        asked = monitor.at_most_nominal(met, np.full(len(met), apart), closest)
        wanted = np.where(free & (apart == APART), room.wanted(met), asked)
        if closest < np.inf:
            wanted = monitor.at_most_nominal(met, wanted, closest)
        close = np.zeros(num, dtype=bool)
        close[met.frame[met.distance < wanted - TOLERATED]] = True
        close[legs.frame[left < reserve - TOLERATED]] = True
        if not close.any():
            break
        both = met.joined(legs)
        order = np.argsort(np.concatenate([met.frame, legs.frame]), kind="stable")
        goal = np.concatenate([wanted, reserve - _lengths(tree)[legs.effector]])[order]
        weight = np.concatenate([np.full(len(met), KEEP), np.full(len(legs), BEND)])[order]
        rows = both.rows(num, goal, weight)
        targets = replace(targets, rows=rows)
        answer = track_postures(tree, targets, answer.q, solve=close, chained=False, max_iterations=40)
    return answer


@dataclass(frozen=True)
class Shortage:
    """Two bodies that are nearer to each other than they are asked to be.

    Attributes:
        bodies: their names, in alphabetical order.
        distance: between them [m].
        asked: what they should keep [m].
        own: whether both are the robot's.
    """

    bodies: tuple[str, str]
    distance: float
    asked: float
    own: bool


def shortages(
    monitor: ProximityMonitor,
    q: np.ndarray,
    frames: list[int],
    placed: np.ndarray,
    closest: float = np.inf,
    apart: float = APART,
) -> dict[int, Shortage]:
    """The two bodies that fall shortest of what they are asked to keep, by frame; frames without any are left out.

    Args:
        monitor: distances of the robot's bodies to each other and the terrain.
        q: (n, nq) postures.
        frames: indices into q, ascending.
        placed: (n, E) contact numbers, not negative where an end effector stands on the terrain.
        closest: what is enough for bodies that are built to pass each other closely [m].
        apart: what all others keep [m].
    """
    met = monitor.near(q, frames, apart)
    met = met.where((met.effector < 0) | (placed[met.frame, met.effector] < 0))
    asked = monitor.at_most_nominal(met, np.full(len(met), apart), closest)
    own = ~met.with_terrain
    found: dict[int, Shortage] = {}
    for k in np.argsort(met.distance - asked, kind="stable"):
        if met.distance[k] < asked[k] - TOLERATED:
            worst = Shortage(ordered(met.bodies[k]), float(met.distance[k]), float(asked[k]), bool(own[k]))
            found.setdefault(int(met.frame[k]), worst)
    return found


def _legs(tree: KinematicTree, q: np.ndarray) -> tuple[Encounters, np.ndarray]:
    """Both legs in every configuration as pairs (hip, ankle) that must not be further apart than wanted.

    The normal points from hip to ankle, so that the distance along it is minus their distance. Returns the pairs, and
    (R,) what is left of each leg's length [m].
    """
    num_links = tree.parent.shape[0]
    R, p = np.empty((num_links, 3, 3)), np.empty((num_links, 3))
    links = [(limb_links(tree, e)[-1], int(tree.frame_link[e])) for e in (0, 1)]
    normal, room = np.empty((len(q), 2, 3)), np.empty((len(q), 2))
    lengths = _lengths(tree)
    for b, row in enumerate(q):
        forward(tree, row, R, p)
        for e, (hip, ankle) in enumerate(links):
            leg = p[ankle] - p[hip]
            length = max(float(np.linalg.norm(leg)), 1e-6)
            normal[b, e], room[b, e] = leg / length, lengths[e] - length
    count = 2 * len(q)
    pairs = Encounters(
        np.repeat(np.arange(len(q)), 2),
        room.ravel(),
        np.tile(np.array(links), (len(q), 1)),
        np.zeros((count, 2, 3)),
        normal.reshape(-1, 3),
        np.tile([0, 1], len(q)),
        (("hip", "ankle"),) * count,
    )
    return pairs, room.ravel()


def _lengths(tree: KinematicTree) -> np.ndarray:
    """(2,) length of each leg stretched, from its first joint to its last [m]."""
    return np.array([np.linalg.norm(tree.p_PF[limb_links(tree, e)[:-1]], axis=1).sum() for e in (0, 1)])
