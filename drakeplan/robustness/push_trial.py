"""Whether a plan survives a push at one moment, by the exact kino-dynamic question (Lin 2020 sec. 7.5, 7.8).

First with the contacts that are held, then with one new contact: the likeliest capture poses first, as the networks see them,
until one holds. In double support one foot may be lifted for it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drakeplan.contact_planning.contact_pool import ContactPool
from drakeplan.robustness.capture_odds import CaptureOdds
from drakeplan.robustness.capture_poses import CapturePoses
from drakeplan.robustness.moments import Moment
from learning.capture_networks import load_capture
from learning.weights import NoWeightsError, OtherRobotError
from optimization.balance.friction import FrictionCone
from optimization.capture.checker import CaptureChecker, capture_options
from optimization.capture.question import CaptureQuestion
from scenes.contact import Contact
from scenes.effector import LEFT_FOOT, RIGHT_FOOT
from scenes.gravity import GRAVITY
from scenes.robots.robot import Robot
from scenes.terrain.packed_terrain import PackedTerrain

FALLS, STANDS, CATCHES = 0, 1, 2  # not captured; with what is held; with one new contact
APART = 0.08  # [m] between capture poses of one end effector that are tried
SAMPLES = 10  # capture poses that are tried at most


@dataclass(frozen=True, eq=False)
class Trial:
    """What came of one push.

    Attributes:
        captured: `FALLS`, `STANDS` or `CATCHES`.
        contact: that caught the robot, None for none.
        asked: exact questions that it took.
        reason: of the fall: what failed with the contacts that are held; "" where it was captured.
    """

    captured: int
    contact: Contact | None
    asked: int
    reason: str = ""


class PushTrials:
    """Tries pushes on one terrain with one robot.

    Attributes:
        note: where no networks say what is likely, that; else "".
    """

    def __init__(
        self, packed: PackedTerrain, robot: Robot, cone: FrictionCone, samples: int = SAMPLES, palms: bool = True
    ) -> None:
        """Prepares the programs.

        Args:
            packed: the terrain.
            robot: that is pushed.
            cone: friction cone.
            samples: capture poses that are tried at most.
            palms: whether palms may catch the robot.
        """
        self.robot, self.samples, self.note = robot, samples, ""
        self._pool = ContactPool(packed)
        self._poses = CapturePoses(packed, robot, self._pool, palms=palms)
        self._checker = CaptureChecker(robot, capture_options(robot, cone))
        self._numbers: dict[tuple[str, bytes], int] = {}
        self._odds: CaptureOdds | None = None
        try:
            self._odds = CaptureOdds(load_capture(robot), self._poses)
        except (NoWeightsError, OtherRobotError):
            self.note = (
                f"robot {robot.name!r} has no learned capture: capture poses near the capture point are tried first"
            )

    def ask(self, moment: Moment, impulse: np.ndarray) -> Trial:
        """Whether the robot comes to rest after a push.

        Args:
            moment: of the plan.
            impulse: (3,) [kg m/s].
        """
        momentum = moment.linear_momentum + impulse
        standing = CaptureQuestion(moment.stance, moment.com, momentum, moment.angular_momentum)
        answer = self._checker.check(standing)
        if answer.captured:
            return Trial(STANDS, None, 1)
        asked = 1
        for contact in self.candidates(moment, impulse):
            asked += 1
            question = CaptureQuestion(moment.stance, moment.com, momentum, moment.angular_momentum, contact)
            if self._checker.check(question).captured:
                return Trial(CATCHES, contact, asked)
        return Trial(FALLS, None, asked, answer.reason)

    def candidates(self, moment: Moment, impulse: np.ndarray) -> list[Contact]:
        """Contacts that may catch the robot, the likeliest first, apart from each other, at most `samples`.

        Args:
            moment: of the plan.
            impulse: (3,) [kg m/s].
        """
        velocity = (moment.linear_momentum + impulse) / self.robot.mass
        ranked: list[tuple[float, int]] = []
        for foot in (LEFT_FOOT, RIGHT_FOOT):
            contact = moment.stance.contacts[foot]
            if contact is not None:
                numbers, likely = self._likeliest(self._number(contact), moment.com, velocity)
                ranked += [(-p, n) for n, p in zip(numbers.tolist(), likely.tolist(), strict=True) if n >= 0]
        held = [self._number(c) for c in moment.stance.held]
        chosen: list[int] = []
        for _, number in sorted(ranked):
            if len(chosen) == self.samples:
                break
            same = [n for n in (*chosen, *held) if self._pool.effector[n] == self._pool.effector[number]]
            near = np.linalg.norm(self._pool.p[same] - self._pool.p[number], axis=1) < APART
            if not near.any():
                chosen.append(number)
        return [self._pool.contact(n) for n in chosen]

    def _likeliest(self, foot: int, com: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Capture poses about a standing foot and how likely they are."""
        if self._odds is not None:
            return self._odds.likeliest(foot, com, velocity)
        numbers = self._poses.about(foot).numbers
        height = max(float(com[2] - self._pool.p[foot, 2]), 0.1)
        target = com[:2] + velocity[:2] * np.sqrt(height / GRAVITY)
        return numbers, np.exp(-np.linalg.norm(self._pool.p[numbers, :2] - target, axis=1))

    def _number(self, contact: Contact) -> int:
        """The number of a plan's contact in the pool."""
        key = contact.effector, contact.X_WC.tobytes()
        if key not in self._numbers:
            self._numbers[key] = self._pool.add_contact(contact)
        return self._numbers[key]
