"""Random questions of capture, as the documents draw them for learning.

Lin 2020: Y.-C. Lin, "Learning for Humanoid Multi-Contact Navigation Planning" (dissertation), sec. 7.6 and fig. 7.3: one
foot stands on a surface tilted by up to 25 deg, the CoM is within reach of it, the linear momentum is up to M 1 m/s and
within 45 deg of level; the capture contact is projected with random depth and tilt. Intervals are ours where the document
gives none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from optimization.capture.question import CaptureQuestion
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS, LEFT_FOOT, LEFT_PALM, RIGHT_FOOT, RIGHT_PALM
from scenes.robots.robot import Robot
from scenes.stance import Stance

# Lin 2020 fig. 7.3: stay on the foot, step with the other one, palm of the standing foot's side, palm of the other side
CAPTURE_MOTIONS = ("stay", "foot", "same_palm", "opposite_palm")
MAX_TILT = np.deg2rad(25.0)
MAX_SPEED = 1.0  # [m/s] of the CoM
MAX_CLIMB = np.deg2rad(45.0)  # of the momentum from level
FRICTION = 0.5
COM_BACK, COM_AHEAD = -0.15, 0.15  # [m] CoM before the standing foot
COM_OUT, COM_IN = -0.05, 0.20  # [m] CoM from the standing foot towards the other one
COM_LOW, COM_HIGH = 0.84, 1.0  # of the nominal height
STEP_BACK, STEP_AHEAD = -0.35, 0.45  # [m] new foothold before the standing foot
STEP_WIDEST = 0.55  # [m] of the feet apart
STEP_RISE = 0.12  # [m]
STEP_TURN = np.deg2rad(30.0)
PALM_YAW, PALM_PITCH = np.deg2rad(20.0), np.deg2rad(40.0)  # of the arm from sideways, in the authors' capture model
PALM_NEAREST = 0.30  # [m] of the palm from the shoulder


def random_question(
    rng: np.random.Generator, robot: Robot, motion: str, *, level: bool = False, friction: float = FRICTION
) -> CaptureQuestion:
    """One question about a stance of one foot near the origin, left or right at random, heading along x.

    Args:
        rng: source of the draws.
        robot: whose distances count.
        motion: one of `CAPTURE_MOTIONS`.
        level: no tilts and no steps up or down.
        friction: of all contacts.
    """
    if motion not in CAPTURE_MOTIONS:
        raise ValueError(f"motion {motion!r} is none of {CAPTURE_MOTIONS}")
    foot = int(rng.integers(2))
    inward = -1.0 if foot == LEFT_FOOT else 1.0  # sign of y from the standing foot to the other
    standing = _contact(foot, np.zeros(3), _tilted(rng, np.array([0.0, 0.0, 1.0]), level), 0.0)
    height = robot.com_height[1] * rng.uniform(COM_LOW, COM_HIGH)
    com = np.array([rng.uniform(COM_BACK, COM_AHEAD), inward * rng.uniform(COM_OUT, COM_IN), height])
    momentum = robot.mass * rng.uniform(0.0, MAX_SPEED) * _direction(rng)
    held: list[Contact | None] = [None] * len(EFFECTORS)
    new = None
    if motion == "foot":
        new = _step(rng, robot, RIGHT_FOOT if foot == LEFT_FOOT else LEFT_FOOT, inward, level)
    elif motion != "stay":
        outward = (motion == "same_palm") == (foot == LEFT_FOOT)  # whether it is the left palm
        new = _palm(rng, robot, LEFT_PALM if outward else RIGHT_PALM, com, level)
    held[foot] = replace(standing, friction=friction)
    new = None if new is None else replace(new, friction=friction)
    return CaptureQuestion(Stance(tuple(held)), com, momentum, new_contact=new)


def _direction(rng: np.random.Generator) -> np.ndarray:
    azimuth, climb = rng.uniform(-np.pi, np.pi), rng.uniform(-MAX_CLIMB, MAX_CLIMB)
    return np.array([np.cos(climb) * np.cos(azimuth), np.cos(climb) * np.sin(azimuth), np.sin(climb)])


def _tilted(rng: np.random.Generator, normal: np.ndarray, level: bool) -> np.ndarray:
    """The normal, turned by up to `MAX_TILT` about an axis at random."""
    angle, around = rng.uniform(0.0, MAX_TILT), rng.uniform(-np.pi, np.pi)
    if level:
        return normal
    first = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.7 else [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    sideways = np.cos(around) * first + np.sin(around) * np.cross(normal, first)
    return np.cos(angle) * normal + np.sin(angle) * sideways


def _contact(effector: int, point: np.ndarray, normal: np.ndarray, heading: float) -> Contact:
    name = EFFECTORS[effector]
    return Contact(name, 0, contact_pose(name, point, normal, heading), FRICTION, heading)


def _step(rng: np.random.Generator, robot: Robot, foot: int, inward: float, level: bool) -> Contact:
    apart = rng.uniform(robot.foot_separation[0], STEP_WIDEST)
    rise = 0.0 if level else rng.uniform(-STEP_RISE, STEP_RISE)
    point = np.array([rng.uniform(STEP_BACK, STEP_AHEAD), inward * apart, rise])
    normal = _tilted(rng, np.array([0.0, 0.0, 1.0]), level)
    return _contact(foot, point, normal, rng.uniform(-STEP_TURN, STEP_TURN))


def _palm(rng: np.random.Generator, robot: Robot, palm: int, com: np.ndarray, level: bool) -> Contact:
    """On a wall beside the shoulder, which stands over the CoM as it does in the nominal posture."""
    side = 1.0 if palm == LEFT_PALM else -1.0
    shoulder = com + np.array([robot.shoulder[0], side * robot.shoulder[1], robot.shoulder[2] - robot.com_height[1]])
    yaw, pitch = rng.uniform(-PALM_YAW, PALM_YAW), rng.uniform(-PALM_PITCH, PALM_PITCH)
    reach = np.array([np.cos(pitch) * np.sin(yaw), side * np.cos(pitch) * np.cos(yaw), np.sin(pitch)])
    point = shoulder + rng.uniform(PALM_NEAREST, robot.arm_reach[1]) * reach
    facing = np.array([-reach[0], -reach[1], 0.0])
    return _contact(palm, point, _tilted(rng, facing / np.linalg.norm(facing), level), 0.0)
