"""The campaign that asks whether a pushed robot comes to rest (Lin 2020 sec. 7.5, 7.6).

Lin 2020: Y.-C. Lin, "Learning for Humanoid Multi-Contact Navigation Planning" (dissertation), sec. 7.5, 7.6, fig. 7.2, 7.3.

A task asks a fixed number of questions of each capture motion. Half of them are drawn as the document draws them
(`optimization.capture.sampling`). The other half are states that a planner meets: a walk of feet alone through a random tilted
environment, a moment of a swing, a push, and one of the contacts that the environment offers there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa

from drakeplan.campaigns.campaign import Row
from drakeplan.campaigns.campaign_robot import campaign_ik, campaign_robot
from drakeplan.campaigns.card import Card
from drakeplan.campaigns.label_walk import Label, LabelWalk, WalkOptions
from drakeplan.campaigns.tilted_environment import draw_environment
from drakeplan.robustness.capture_poses import CapturePoses
from drakeplan.timing.step_timing import WALKING
from learning.capture_labels import CAMPAIGN, SCHEMA, VERSION
from learning.capture_view import motion_of, view_of
from optimization.balance.friction import DEFAULT_CONE, FrictionCone
from optimization.capture.checker import CaptureAnswer, CaptureChecker, CaptureOptions, capture_options
from optimization.capture.question import CaptureQuestion
from optimization.capture.sampling import CAPTURE_MOTIONS, MAX_CLIMB, random_question
from optimization.centroidal.options import CentroidalOptions
from optimization.centroidal.transition_dynamics import TransitionDynamics
from scenes.effector import EFFECTORS, RIGHT_FOOT
from scenes.input_error import InputError
from scenes.robots.robot import Robot
from scenes.stance import Stance

PER_MOTION = 32  # questions of each motion in a task
SLOW, SLOWER = 0.5, 0.5  # share of the questions with less momentum, and by what factor; most fast ones have one answer
FAST_PUSH = 0.9  # [m/s] greatest push of a walking robot, as a velocity
SPIN, SPIN_SHARE = 6.0, 0.5  # [N m s] greatest angular momentum of random questions along an axis; how many have some
WALKS = 12  # environments that are drawn for the questions about walks, at most
SHIFTS = tuple(
    replace(shift, probability=0.5) for shift in WalkOptions().shifts[:2]
)  # as the planner meets them, or nearly
WALK = WalkOptions(quota=48, per_state=4, max_states=40, shifts=SHIFTS)


@dataclass(frozen=True)
class CaptureCampaign:
    """Labels of questions of capture for one robot.

    Attributes:
        robot: its name.
        friction: of every surface; 0.5 in Lin 2020 sec. 7.8.
        cone: friction cone of the program.
        packages: names and folders of package:// addresses in the robot's model.
    """

    robot: str = "escher"
    friction: float = 0.5
    cone: FrictionCone = DEFAULT_CONE
    walk: WalkOptions = field(default=WALK)
    packages: tuple[tuple[str, str], ...] = ()

    @property
    def name(self) -> str:
        return CAMPAIGN

    @property
    def version(self) -> int:
        return VERSION

    @property
    def schema(self) -> pa.Schema:
        return SCHEMA

    @property
    def count_by(self) -> Sequence[str]:
        return ("motion", "source", "captured")

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The robot with its model, how questions are drawn, and the program that answers."""
        robot = campaign_robot(self.robot, self.packages)
        options = self._options(robot)
        return {
            "robot": robot.name,
            "robot_model_sha256": robot.model_sha256,
            "friction": self.friction,
            "cone": str(self.cone),
            "per_motion": PER_MOTION,
            "slower": [SLOW, SLOWER],
            "push": FAST_PUSH,
            "spin": [SPIN, SPIN_SHARE],
            "walk": asdict(self.walk),
            "timing": [WALKING.shift, WALKING.swing],
            "swing_times": list(options.swing_times),
            "horizon": options.horizon,
            "dt": options.dt,
            "fine_time": options.fine_time,
        }

    def rows(self, seed: np.random.SeedSequence, task: int) -> Sequence[Row]:
        """The labels of one task.

        Args:
            seed: of the task's random numbers.
            task: its number in the campaign.
        """
        rng = np.random.default_rng(seed)
        robot = campaign_robot(self.robot, self.packages)
        # New for each task: what a program answers may depend, in the last bits, on what it was asked before.
        checker = CaptureChecker(robot, self._options(robot))
        asked = list(self._random_questions(rng, robot)) + list(self._walked_questions(rng, robot))
        return [question_row(q, checker.check(q), robot.mass, source, task) for source, q in asked]

    def _options(self, robot: Robot) -> CaptureOptions:
        """As a user asks, but no clock may decide what a label says."""
        options = capture_options(robot, self.cone)
        centroidal = replace(options.kinodynamic.centroidal, time_limit=1e6)
        return replace(options, kinodynamic=replace(options.kinodynamic, centroidal=centroidal))

    def _random_questions(self, rng: np.random.Generator, robot: Robot) -> Iterator[tuple[str, CaptureQuestion]]:
        for motion in CAPTURE_MOTIONS:
            for _ in range(PER_MOTION // 2):
                question = random_question(rng, robot, motion, friction=self.friction)
                share = SLOWER if rng.uniform() < SLOW else 1.0
                spin = rng.uniform(-SPIN, SPIN, 3) * (rng.uniform() < SPIN_SHARE)
                yield (
                    "random",
                    replace(question, linear_momentum=share * question.linear_momentum, angular_momentum=spin),
                )

    def _walked_questions(self, rng: np.random.Generator, robot: Robot) -> Iterator[tuple[str, CaptureQuestion]]:
        missing = np.full(len(CAPTURE_MOTIONS), PER_MOTION // 2)
        for _ in range(WALKS):
            environment = draw_environment(rng, self.friction)
            dynamics = TransitionDynamics(robot, self._walking(robot))
            ik = campaign_ik(self.robot, self.packages)
            try:
                walk = LabelWalk(environment, robot, ik, dynamics, self.walk, rng, palms=False)
            except InputError:
                continue
            poses = CapturePoses(walk.domain.packed, robot, walk.pool)
            for label in walk.labels():
                if not label.estimate.feasible:
                    continue
                question = _of_swing(rng, robot, walk, label, poses, missing)
                if question is not None:
                    missing[motion_of(question)] -= 1
                    yield "walk", question
                if not missing.any():
                    return

    def _walking(self, robot: Robot) -> CentroidalOptions:
        return replace(WALKING.options(robot, self.cone), time_limit=1e6)


def _of_swing(
    rng: np.random.Generator, robot: Robot, walk: LabelWalk, label: Label, poses: CapturePoses, missing: np.ndarray
) -> CaptureQuestion | None:
    """A moment of a transition's swing, pushed at random, with a motion that is still missing; None where the place offers none."""
    trajectory = label.estimate.trajectory
    assert trajectory is not None
    mover = label.child[4]
    foot = label.child[1 - mover]
    around = poses.about(foot)
    offered = [m for m in np.flatnonzero(missing).tolist() if m == 0 or (around.motion == m).any()]
    if not offered:
        return None
    motion = int(rng.choice(offered))
    first = round(WALKING.shift / (WALKING.step or 0.2))  # knot at which the foot has lifted
    last = round((WALKING.shift + WALKING.swing) / (WALKING.step or 0.2))
    n = int(rng.integers(first, last))
    held: list = [None] * len(EFFECTORS)
    held[1 - mover] = walk.pool.contact(foot)
    new = None
    if motion:
        new = walk.pool.contact(int(rng.choice(around.numbers[around.motion == motion])))
    azimuth, climb = rng.uniform(-np.pi, np.pi), rng.uniform(-MAX_CLIMB, MAX_CLIMB) * (rng.uniform() < 0.5)
    way = np.array([np.cos(climb) * np.cos(azimuth), np.cos(climb) * np.sin(azimuth), np.sin(climb)])
    push = robot.mass * rng.uniform(0.0, FAST_PUSH) * way
    momentum = trajectory.linear_momentum[n] + push
    return CaptureQuestion(Stance(tuple(held)), trajectory.com[n], momentum, trajectory.angular_momentum[n], new)


def question_row(question: CaptureQuestion, answer: CaptureAnswer, mass: float, source: str, task: int) -> Row:
    """One row of the data set.

    Args:
        question: about a stance of one foot.
        answer: to it.
        mass: of the robot [kg].
        source: where it comes from.
        task: its number in the campaign.
    """
    seen = view_of(question, mass)
    return {
        "scene": task,
        "source": source,
        "motion": int(seen.motion[0]),
        "mirrored": question.stance.contacts[RIGHT_FOOT] is not None,
        "foot_R": seen.foot_R.ravel(),
        "p_new": seen.p_new[0],
        "R_new": seen.R_new.ravel(),
        "com": seen.com[0],
        "velocity": seen.velocity[0],
        "spin": seen.spin[0],
        "friction": min(c.friction for c in question.final_stance.held),
        "captured": answer.captured,
        "swing_time": -1.0 if answer.duration is None else answer.duration,
        "reason": answer.reason,
    }


def counts_text(card: Card) -> str:
    """A table: labels of each capture motion, how many are captured, and of how many sources."""
    lines = ["motion         labels  captured    random      walk"]
    for number, name in enumerate(CAPTURE_MOTIONS):
        kind = Counter[str]()
        for entry in card.counts:
            if entry["motion"] == number:
                kind["all"] += entry["rows"]
                kind["captured"] += entry["rows"] * entry["captured"]
                kind[entry["source"]] += entry["rows"]
        share = 100.0 * kind["captured"] / max(kind["all"], 1)
        lines.append(f"{name:<13}{kind['all']:8d}{share:8.1f} %{kind['random']:10d}{kind['walk']:10d}")
    return "\n".join(lines)
