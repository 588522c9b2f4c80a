"""Stored plans made without a planner, straight walks with noise from a seed, and circles of contact regions to lay them on.

Nothing in them is physical but the order of things: feet take turns, palms touch walls at the sides, and every change of a
foot has a phase in which it carries nothing.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from drakeplan.experience.stored_plan import Outline, StoredPlan, plan_pose
from scenes.contact import contact_rotation
from scenes.effector import EFFECTORS, LEFT_FOOT, LEFT_PALM, RIGHT_FOOT, RIGHT_PALM
from scenes.footholds.contact_regions import ContactRegions

UP = np.array([0.0, 0.0, 1.0])
HALF_WIDTH = 0.1  # [m] from the middle to either foot
ARM = 0.6  # [m] from the middle to either wall
PHASE_TIME = 0.6  # [s]
ESCHER = "escher"
NO_MODEL = "0" * 64  # hash of a model that no file has


def made_up_outline(
    position: Sequence[Sequence[float]],
    effector: Sequence[int],
    stances: Sequence[Sequence[int]],
    quaternion: np.ndarray | None = None,
) -> Outline:
    """The outline of a table of contacts.

    Args:
        position: (C, 3) contact points [m].
        effector: (C,) index into `EFFECTORS`.
        stances: (S, 4) index into the contacts, -1 where free.
        quaternion: (C, 4) orientations (w, x, y, z); None for the world's axes.
    """
    p, table = np.array(position, float), np.array(stances)
    first = [min(s for s, row in enumerate(stances) if c in row) for c in range(len(p))]
    means = p[table[:, :2], :2].mean(axis=1)
    Q = np.tile([1.0, 0.0, 0.0, 0.0], (len(p), 1)) if quaternion is None else np.array(quaternion, float)
    return Outline(p, Q, np.array(effector), np.array(first), np.linalg.norm(means - means[0], axis=1))


def made_up_plan(
    steps: int = 6,
    stride: float = 0.25,
    *,
    noise: float = 0.0,
    seed: int = 0,
    palms: Sequence[int] = (),
    turn: float = 0.0,
    rise: float = 0.0,
    model: str = NO_MODEL,
    nq: int = 34,
) -> StoredPlan:
    """A straight walk in its own frame.

    Args:
        steps: how many feet are set down.
        stride: by which each step leads further than the one before [m].
        noise: standard deviation of where feet are set down [m].
        seed: of noise and configurations.
        palms: indices of those that touch a wall after the first steps, in this order.
        turn: standard deviation of how feet are turned [rad].
        rise: of every step over the one before [m].
        model: hash of the robot's model.
        nq: numbers in a configuration.
    """
    rng = np.random.default_rng(seed)
    position = [[0.0, HALF_WIDTH, 0.0], [0.0, -HALF_WIDTH, 0.0]]
    effector, yaw, stances = [LEFT_FOOT, RIGHT_FOOT], [0.0, 0.0], [[0, 1, -1, -1]]
    palms = list(palms)
    for step in range(1, steps + 1):
        foot = (LEFT_FOOT, RIGHT_FOOT)[step % 2]
        side = HALF_WIDTH if foot == LEFT_FOOT else -HALF_WIDTH
        sideways = noise * rng.standard_normal(2)
        for e, p, psi in [
            (foot, [stride * step + sideways[0], side + sideways[1], rise * step], turn * rng.normal())
        ] + [(e, [stride * step + 0.2, ARM if e == LEFT_PALM else -ARM, 1.2 + rise * step], 0.0) for e in palms[:1]]:
            stances.append([*stances[-1]])
            stances[-1][e] = len(position)
            position.append(p)
            effector.append(e)
            yaw.append(psi)
        palms = palms[1:]
    facing = {LEFT_PALM: np.array([0.0, -1.0, 0.0]), RIGHT_PALM: np.array([0.0, 1.0, 0.0])}
    R = np.array([contact_rotation(EFFECTORS[e], facing.get(e, UP), psi) for e, psi in zip(effector, yaw, strict=True)])
    p, table = np.array(position), np.array(stances)
    ahead = p[table[-1, :2]].mean(axis=0) - p[:2].mean(axis=0)  # the noise turned the way ahead by this much
    back = Rotation.from_euler("z", -np.arctan2(ahead[1], ahead[0])).as_matrix()
    p, R = p @ back.T, back @ R
    quaternion = Rotation.from_matrix(R).as_quat()[:, [3, 0, 1, 2]]
    phases = _phases(table)
    t, phase, share = _times(len(phases))
    q = 0.3 * rng.standard_normal((len(t), nq))
    q[:, :4] = [1.0, 0.0, 0.0, 0.0] + 0.1 * rng.standard_normal((len(t), 4))
    q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    q[:, 4:7] = np.outer(t / t[-1], p[table[-1, :2]].mean(axis=0)) + 0.9 * UP
    return StoredPlan(
        made_up_outline(p, effector, stances, quaternion),
        table,
        phases,
        t,
        q,
        phase,
        share,
        ESCHER,
        model,
        {"scene": "made up", "seed": seed},
    )


def _phases(stances: np.ndarray) -> np.ndarray:
    """(P, 4) every stance, and between two of them what carries while an end effector moves."""
    rows = [stances[0]]
    for before, after in itertools.pairwise(stances):
        between = np.where(before == after, after, -1)
        rows += [row for row in (between, after) if not np.array_equal(row, rows[-1])]
    return np.array(rows)


def _times(num_phases: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, phases and shares of three configurations a phase, and one at the end."""
    phase = np.append(np.repeat(np.arange(num_phases), 3), num_phases - 1)
    share = np.append(np.tile([0.0, 1 / 3, 2 / 3], num_phases), 0.0)
    t = PHASE_TIME * (phase + share)
    t[-1] = PHASE_TIME * num_phases
    return t, phase, share


# ---- contact regions


def circles(poses: np.ndarray, radius: float | np.ndarray) -> ContactRegions:
    """One circle about each of some poses (K, 4, 4)."""
    return ContactRegions(np.arange(len(poses)), np.array(poses), np.broadcast_to(radius, len(poses)).astype(float))


def floor(z: float) -> ContactRegions:
    """A level circle so wide that its edge is never met."""
    return circles(plan_pose(np.array([0.0, 0.0, z]), 0.0)[None], 50.0)


def contact_poses(outline: Outline, X_WL: np.ndarray) -> np.ndarray:
    """(C, 4, 4) contacts of a plan laid somewhere."""
    X = np.tile(np.eye(4), (len(outline.effector), 1, 1))
    X[:, :3, :3] = Rotation.from_quat(outline.quaternion[:, [1, 2, 3, 0]]).as_matrix()
    X[:, :3, 3] = outline.position
    return X_WL @ X


def random_regions(seed: int, most: int = 12) -> dict[int, ContactRegions]:
    """Circles anywhere about the way ahead, those of feet nearly level, those of palms nearly upright."""
    rng, found = np.random.default_rng(seed), {}
    for e in range(4):
        count = int(rng.integers(1, most))
        base = Rotation.identity() if e < 2 else Rotation.from_euler("x", 90 if e == LEFT_PALM else -90, degrees=True)
        poses = np.tile(np.eye(4), (count, 1, 1))
        poses[:, :3, :3] = (Rotation.from_rotvec(0.3 * rng.standard_normal((count, 3))) * base).as_matrix()
        poses[:, :3, 3] = rng.uniform([-0.5, -0.8, -0.2], [2.5, 0.8, 0.2], (count, 3)) + 1.2 * (e >= 2) * UP
        found[e] = circles(poses, rng.uniform(0.01, 0.3, count))
    return found
