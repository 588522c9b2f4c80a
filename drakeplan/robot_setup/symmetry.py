"""Joints of the left and the right side that mirror each other, and the sign with which they do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drakeplan.robot_setup.link_tree import LinkTree

PARALLEL = 0.95  # cosine between an axis and the mirror image of the other side's


@dataclass(frozen=True)
class MirroredJoint:
    """A joint of the left side and its partner on the right.

    Attributes:
        left: name of the joint.
        right: name of the joint.
        sign: +1 where equal angles are mirror images, -1 where opposite ones are.
    """

    left: str
    right: str
    sign: float


def mirrored_joints(tree: LinkTree, left: list[str], right: list[str]) -> list[MirroredJoint] | None:
    """The joints of two limbs in pairs; None where the limbs are no mirror images.

    A reflection in the plane y = 0 takes a turn about (x, y, z) to one about (-x, y, -z).

    Args:
        tree: of the robot.
        left: joints of the left limb, from the trunk outwards.
        right: of the right one.
    """
    if len(left) != len(right):
        return None
    pairs = []
    for a, b in zip(left, right, strict=True):
        match = float((tree.axis(a) * [-1, 1, -1]) @ tree.axis(b))
        if abs(match) < PARALLEL:
            return None
        pairs.append(MirroredJoint(a, b, float(np.sign(match))))
    return pairs
