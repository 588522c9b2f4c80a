"""Which pushes a standing robot can take, over their direction: a polar picture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from optimization.capture.checker import CaptureChecker
from optimization.capture.inverted_pendulum import angular_allowance, capture_point, frequency, support_polygon
from optimization.capture.question import CaptureQuestion
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS, LEFT_FOOT, RIGHT_FOOT
from scenes.robots.robot import Robot
from scenes.stance import Stance

PICTURE = Path("out/capture_impulses.png")
DIRECTIONS = 16
SPEEDS = np.arange(0.1, 1.01, 0.15)  # [m/s] impulses over the mass
FRICTION = 0.5
STEP_BACK, STEP_AHEAD, WIDEST = -0.35, 0.45, 0.5  # [m] footholds from the other foot
SWINGS = (0.1, 0.25)  # [s] after which a foothold meets the capture point
UP = np.array([0.0, 0.0, 1.0])


def standing(robot: Robot) -> CaptureQuestion:
    """Both feet side by side on level ground, at rest, the CoM over their middle."""
    apart = robot.foot_separation[1] / 2
    feet = [_foot(LEFT_FOOT, np.array([0.0, apart])), _foot(RIGHT_FOOT, np.array([0.0, -apart]))]
    com = np.array([0.0, 0.0, 0.97 * robot.com_height[1]])
    return CaptureQuestion(Stance((*feet, None, None)), com, np.zeros(3))


def footholds(question: CaptureQuestion, robot: Robot) -> list[Contact]:
    """Footholds for either foot near the pendulum's capture point, as far as the foot reaches.

    While the foot moves, the centre of pressure is the point under the other foot that is nearest to the capture
    point, which moves away from it with exp(omega t).

    Args:
        question: both feet on level ground, with a momentum.
        robot: its foot size and limits of a step.
    """
    point = capture_point(question.com, question.linear_momentum / robot.mass)
    omega = frequency(question.com[2])
    found = []
    for foot, other in ((LEFT_FOOT, RIGHT_FOOT), (RIGHT_FOOT, LEFT_FOOT)):
        held = question.stance.contacts[other]
        if held is None:
            continue
        side = 1.0 if foot == LEFT_FOOT else -1.0
        pressure = held.p_WC[:2] + np.clip(point - held.p_WC[:2], -robot.half_extents[other], robot.half_extents[other])
        for swing in SWINGS:
            x, y = pressure + (point - pressure) * np.exp(omega * swing) - held.p_WC[:2]
            apart = side * float(np.clip(side * y, robot.foot_separation[0], WIDEST))
            found.append(_foot(foot, held.p_WC[:2] + np.array([np.clip(x, STEP_BACK, STEP_AHEAD), apart])))
    return found


def draw_rose(checker: CaptureChecker, tell: Callable[[str], None], picture: Path = PICTURE) -> np.ndarray:
    """Solves for pushes in all directions and draws the results.

    Args:
        checker: answers the questions.
        tell: called with one line of progress.
        picture: file to write.

    Returns:
        (DIRECTIONS, len(SPEEDS)) 0 where a push is captured without a step, 1 with one, 2 not at all.
    """
    base, mass = standing(checker.robot), checker.robot.mass
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    verdict = np.full((DIRECTIONS, len(SPEEDS)), 2)
    for i, angle in enumerate(angles):
        for j, speed in enumerate(SPEEDS):
            pushed = base.pushed(mass * speed * np.array([np.cos(angle), np.sin(angle), 0.0]))
            verdict[i, j] = _verdict(checker, pushed)
    tell(f"standing: {(verdict == 0).sum()} pushes of {verdict.size} without a step, {(verdict == 1).sum()} with one")
    _draw(checker, base, angles, verdict, picture)
    return verdict


def _verdict(checker: CaptureChecker, pushed: CaptureQuestion) -> int:
    if checker.check(pushed).captured:
        return 0
    steps = (
        CaptureQuestion(pushed.stance, pushed.com, pushed.linear_momentum, new_contact=foothold)
        for foothold in footholds(pushed, checker.robot)
    )
    return 1 if any(checker.check(step).captured for step in steps) else 2


def _foot(foot: int, xy: np.ndarray) -> Contact:
    name = EFFECTORS[foot]
    return Contact(name, 0, contact_pose(name, np.array([*xy, 0.0]), UP, 0.0), FRICTION)


def _reach(region: BaseGeometry, start: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """(n,) how far from `start` the region goes in each direction [m]."""
    rays = [LineString([start, start + 5.0 * np.array([np.cos(a), np.sin(a)])]) for a in angles]
    return np.array([ray.intersection(region).length for ray in rays])


def _draw(
    checker: CaptureChecker, base: CaptureQuestion, angles: np.ndarray, verdict: np.ndarray, picture: Path
) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.projections.polar import PolarAxes

    robot = checker.robot
    omega = frequency(base.com[2])
    support = support_polygon(base.stance, robot)
    allowance = angular_allowance(checker.options.kinodynamic.centroidal, robot.mass, omega)
    figure, axes = plt.subplots(figsize=(6.4, 6.4), subplot_kw={"projection": "polar"}, layout="constrained")
    assert isinstance(axes, PolarAxes)
    kinds = (("tab:green", "o", "captured standing"), ("tab:orange", "s", "captured with one step"),
             ("0.6", "x", "not captured"))  # fmt: skip
    for kind, (colour, marker, label) in enumerate(kinds):
        i, j = np.nonzero(verdict == kind)
        axes.scatter(angles[i], robot.mass * SPEEDS[j], c=colour, marker=marker, s=28, label=label)
    fine = np.linspace(0, 2 * np.pi, 361)
    for region, style, label in (
        (support, "-", "pendulum: capture point at the edge of the feet"),
        (support.buffer(allowance), ":", "and what angular momentum allows at most"),
    ):
        axes.plot(fine, robot.mass * omega * _reach(region, base.com[:2], fine), style, color="tab:blue", label=label)
    axes.set_rlim(0, 1.4 * robot.mass * SPEEDS[-1])
    axes.set_theta_zero_location("N")  # ahead is up, left is left
    axes.set_title(f"Impulses on {robot.name}, standing on both feet [kg m/s]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.04), ncols=2, fontsize=8)
    picture.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(picture, dpi=130)
    plt.close(figure)
