"""Random contact transitions on tilted surfaces, easy and impossible ones alike, by a seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS, LEFT_PALM, RIGHT_PALM, is_foot
from scenes.robots.robot import Robot
from scenes.stance import Stance

CATEGORIES = {"feet": 0, "one palm": 1, "both palms": 2}  # palms held before the transition

FRICTION = (0.25, 0.6)  # around the 0.5 of Lin 2020 sec. 6.7, and less
TILT = np.deg2rad(26.0)  # [rad] of foot surfaces about x and y
WALL_TILT = 0.3  # tangent of a wall's lean and turn
VIGOUR = {"feet": 1.0, "one palm": 1.5, "both palms": 2.2}  # palms catch more: so that each category has both verdicts
SPEED = np.array([1.0, 0.8, 0.2])  # [m/s]
COM_SHIFT = np.array([0.2, 0.15, 0.08])  # [m] about the mean of the feet at nominal height
STEP = ((-0.2, 0.75), (0.12, 0.4), (-0.25, 0.25))  # [m] ahead of, beside and above the standing foot
PALM = ((-0.4, 1.1), (0.4, 0.7), (0.8, 1.6))  # [m] ahead of, beside and above the mean of the feet


@dataclass(frozen=True, eq=False)
class RandomTransition:
    """One transition and the state that it starts from.

    Attributes:
        before, after: the stances.
        com: (3,) in W [m].
        linear_momentum: (3,) [kg m/s].
    """

    before: Stance
    after: Stance
    com: np.ndarray
    linear_momentum: np.ndarray


def random_transition(rng: np.random.Generator, robot: Robot, category: str) -> RandomTransition:
    """A stance of two feet and the category's palms, a next stance, and a state of the CoM.

    A foot moves in every transition of `feet` and in half of the others; there else a palm moves or lets go.

    Args:
        rng: source of all random choices.
        robot: its mass and CoM height.
        category: one of `CATEGORIES`.
    """
    left = _stone(rng, 0, np.array([0.0, 0.1, 0.0]))
    feet = [left, _beside(rng, left, 1)]
    middle = (feet[0].p_WC + feet[1].p_WC) / 2
    count = CATEGORIES[category]
    sides = rng.permutation([LEFT_PALM, RIGHT_PALM])[:count].tolist()
    palms = [_palm(rng, e, middle) if e in sides else None for e in (LEFT_PALM, RIGHT_PALM)]
    before = Stance((*feet, *palms))
    if not count or rng.random() < 0.5:
        moving = int(rng.integers(2))
        after = before.replace(moving, _beside(rng, feet[1 - moving], moving))
    else:
        moving = int(rng.choice(sides))
        after = before.replace(moving, _palm(rng, moving, middle) if rng.random() < 0.6 else None)
    com = middle + [0, 0, robot.com_height[1]] + rng.uniform(-1, 1, 3) * COM_SHIFT
    velocity = VIGOUR[category] * SPEED * rng.uniform(-1, 1, 3)
    return RandomTransition(before, after, com, robot.mass * velocity)


def _stone(rng: np.random.Generator, effector: int, point: np.ndarray) -> Contact:
    normal = np.append(np.tan(rng.uniform(-TILT, TILT, 2)), 1.0)
    return _contact(rng, effector, point, normal, float(rng.uniform(-0.3, 0.3)))


def _beside(rng: np.random.Generator, standing: Contact, effector: int) -> Contact:
    """The other foot on a stone beside the standing one."""
    side = 1.0 if EFFECTORS[effector].startswith("left") else -1.0
    offset = np.array([rng.uniform(*STEP[0]), side * rng.uniform(*STEP[1]), rng.uniform(*STEP[2])])
    return _stone(rng, effector, standing.p_WC + offset)


def _palm(rng: np.random.Generator, effector: int, middle: np.ndarray) -> Contact:
    """A palm on a wall at the robot's side, which leans and turns a little."""
    side = 1.0 if EFFECTORS[effector].startswith("left") else -1.0
    offset = np.array([rng.uniform(*PALM[0]), side * rng.uniform(*PALM[1]), rng.uniform(*PALM[2])])
    lean = rng.uniform(-WALL_TILT, WALL_TILT, 2)
    return _contact(rng, effector, middle + offset, np.array([lean[0], -side, lean[1]]), 0.0)


def _contact(rng: np.random.Generator, effector: int, point: np.ndarray, normal: np.ndarray, heading: float) -> Contact:
    name = EFFECTORS[effector]
    pose = contact_pose(name, point, normal / np.linalg.norm(normal), heading)
    return Contact(name, 0, pose, float(rng.uniform(*FRICTION)), heading if is_foot(name) else 0.0)
