"""Reach, box and limits of a robot that stands: measured where they can be, else in proportion to its legs and arms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drakeplan.robot_setup.limbs import Limbs
from drakeplan.robot_setup.link_tree import LinkTree
from drakeplan.robot_setup.soles import Sole
from drakeplan.robot_setup.standing import Standing
from optimization.inverse_kinematics.robot_reach import ReachFigures

NEARLY = 0.985  # of the greatest reach: at the very end a limb is singular
NEAREST = 0.30  # of the greatest reach of an arm
SHORTEST = 0.36  # of the greatest length of a leg
LOWEST = 0.55  # of the nominal height of the CoM
STEP, RISE = 0.80, 0.34  # of the leg's length: the longest and the highest step
PALM_FORCE = (0.3, 0.5)  # least and greatest force limit of a palm, in multiples of M g
FOOT_FORCE = 2.0  # of a foot


@dataclass(frozen=True, eq=False)
class Figures:
    """The numbers of a robot file that are not poses; the names are those of the file.

    Lengths in m, points in frame T.
    """

    shoulder: tuple[float, ...] | None
    hip: tuple[float, ...]
    arm_reach: tuple[float, float] | None
    leg_reach: tuple[float, float]
    com_height: tuple[float, float, float]
    com_reach: tuple[float, float]
    torso_centre: tuple[float, float, float]
    torso_size: tuple[float, float, float]
    max_foot_translation: float
    max_palm_translation: float | None
    max_step_height: float
    foot_separation: tuple[float, float]
    foot_force: float
    palm_force: float


def torso_box(tree: LinkTree, limbs: Limbs, standing: Standing) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner, (3,) each, of what stands for the trunk in T [m].

    Trunk, head and the first links of the arms, from a little below the hips upwards; T is the mean of the feet.

    Args:
        tree: of the robot.
        limbs: its parts.
        standing: its nominal posture.
    """
    local = {n: (link.points - (X := tree.pose(n))[:3, 3]) @ X[:3, :3] for n, link in tree.links.items()}
    legs = {n for foot in limbs.feet for n in tree.way(foot)[1:]}
    arms = [way[way.index(limbs.torso) + 1 :] for way in map(tree.way, limbs.hands or ())]
    arm_links, first = {n for arm in arms for n in arm}, {arm[0] for arm in arms}
    trunk, beside = [], []
    with tree.posture(standing.q):
        for name, points in local.items():
            X = tree.pose(name)
            placed = points @ X[:3, :3].T + X[:3, 3]
            if name in first:
                beside.append(placed)
            elif name not in legs and name not in arm_links:
                trunk.append(placed)
        hips = float(np.mean([tree.origin(tree.way(f)[min(3, len(tree.way(f)) - 1)])[2] for f in limbs.feet]))
    body = np.concatenate([p for p in trunk if len(p)] or [np.array([[0.1, 0.15, hips + 0.4], [-0.1, -0.15, hips]])])
    low, high = body.min(axis=0), body.max(axis=0)
    if any(len(p) for p in beside):
        wide = np.concatenate(beside)
        low[1], high[1] = min(low[1], wide[:, 1].min()), max(high[1], wide[:, 1].max())
    low[2] = 0.86 * hips
    half = 0.5 * max(high[1] - low[1], 0.1)
    low[1], high[1] = -half, half
    return low, high


def make_figures(
    tree: LinkTree, limbs: Limbs, soles: tuple[Sole, Sole], standing: Standing, measured: ReachFigures, mass: float
) -> Figures:
    """All figures, rounded.

    Args:
        tree: of the robot.
        limbs: its parts.
        soles: of both feet.
        standing: its nominal posture.
        measured: of the robot as it is described so far.
        mass: [kg].
    """
    low, high = torso_box(tree, limbs, standing)
    leg = NEARLY * measured.leg_reach[1]
    arm = NEARLY * measured.arm_reach[1] if measured.arm_reach else None
    least, nominal, most = measured.com_height
    return Figures(
        shoulder=None if measured.shoulder is None else _rounded(measured.shoulder),
        hip=_rounded(measured.hip),
        arm_reach=None if arm is None else (round(max(NEAREST * arm, measured.arm_reach[0]), 3), round(arm, 3)),  # type: ignore[index]
        leg_reach=(round(max(SHORTEST * leg, min(measured.leg_reach[0], 0.8 * leg)), 3), round(leg, 3)),
        com_height=(
            round(min(max(least, LOWEST * nominal), nominal), 3),
            round(nominal, 3),
            round(0.99 * most if 0.99 * most > nominal else most, 3),
        ),
        com_reach=(round(measured.com_reach[0], 2), round(measured.com_reach[1], 2)),
        torso_centre=_rounded(0.5 * (low + high)),  # type: ignore[arg-type]
        torso_size=_rounded(high - low),  # type: ignore[arg-type]
        max_foot_translation=_to_five(STEP * leg),
        max_palm_translation=None if arm is None else _to_five(STEP * leg),
        max_step_height=round(RISE * leg, 2),
        foot_separation=(round(min(measured.foot_separation, standing.separation), 3), round(standing.separation, 3)),
        foot_force=FOOT_FORCE,
        palm_force=PALM_FORCE[1] if limbs.hands is None else _palm_force(tree, limbs, arm or 1.0, mass),
    )


def _palm_force(tree: LinkTree, limbs: Limbs, arm: float, mass: float) -> float:
    """What the shoulder's weakest of its first two motors holds at half the arm's reach, in multiples of M g."""
    assert limbs.hands is not None
    way = tree.way(limbs.hands[0])
    joints = [tree.links[n].joint for n in way[way.index(limbs.torso) + 1 :]][:2]
    limit = {
        tree.plant.get_joint_actuator(a).joint().name(): tree.plant.get_joint_actuator(a).effort_limit()
        for a in tree.plant.GetJointActuatorIndices()
    }
    efforts = [limit[j] for j in joints if j in limit and np.isfinite(limit[j]) and limit[j] > 0.0]
    if not efforts:
        return PALM_FORCE[0]
    return round(float(np.clip(min(efforts) / (0.5 * arm) / (mass * 9.81), *PALM_FORCE)), 2)


def _rounded(values: np.ndarray) -> tuple[float, ...]:
    return tuple(round(float(v), 3) + 0.0 for v in values)


def _to_five(value: float) -> float:
    return round(round(value / 0.05) * 0.05, 2)
