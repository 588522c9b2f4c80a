"""Fingers are closed: the angles at which a hand is shortest, so that its knuckles carry and not its finger tips."""

# pydrake's stubs read "float64[3, 1]" as a shape and refuse every array.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

import numpy as np

from drakeplan.robot_setup.link_tree import LinkTree
from scenes.robots.drake_parser import set_joint

SHARES = (0.0, 0.5, 1.0)  # of the way from 0 to a limit that are tried


def closed_fingers(tree: LinkTree, hand: str, out: np.ndarray) -> dict[str, float]:
    """Angles of the joints below a hand, from the palm outwards: each brings what hangs on it back as far as it can.

    Args:
        tree: of the robot.
        hand: link of the hand.
        out: (3,) where the hand points, away from the arm, in W at the zero posture.

    Returns:
        Joint name -> angle [rad].
    """
    angles: dict[str, float] = {}
    local = {}
    for name in tree.below(hand):
        X = tree.pose(name)
        local[name] = (tree.links[name].points - X[:3, 3]) @ X[:3, :3]
    with tree.posture(tree.plant.GetPositions(tree.context).copy()):
        for name in tree.below(hand)[1:]:
            joint = tree.plant.GetJointByName(str(tree.links[name].joint))
            low, high = float(joint.position_lower_limits()[0]), float(joint.position_upper_limits()[0])
            tried = sorted({float(np.clip(s * limit, low, high)) for limit in (low, high) for s in SHARES}, key=abs)
            reach = []
            for angle in tried:
                set_joint(joint, tree.context, angle)
                ends = [_reach(tree, n, local[n], out) for n in tree.below(name)]
                reach.append(max(ends))
            best = tried[int(np.argmin(np.round(reach, 4)))]
            set_joint(joint, tree.context, best)
            angles[joint.name()] = best
    return angles


def _reach(tree: LinkTree, name: str, points: np.ndarray, out: np.ndarray) -> float:
    X = tree.pose(name)
    return float(((points @ X[:3, :3].T + X[:3, 3]) @ out).max()) if len(points) else float(X[:3, 3] @ out)
