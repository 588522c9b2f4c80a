"""Joints of the left and the right side that mirror each other, and the sign with which they do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drakeplan.robot_setup.link_tree import LinkTree

MISSED, TWISTED = 0.015, np.deg2rad(8.0)  # [m], [rad] of soles and palms that are meant to be mirror images
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


def mirror_pose(X_WL: np.ndarray, front: np.ndarray) -> np.ndarray:
    """(4, 4) pose of the right part whose left part is at X_WL: reflected in the plane through W's z and `front`.

    The reflected y axis is turned round, so that the frame stays right-handed.

    Args:
        X_WL: (4, 4) pose of the left part in W.
        front: (3,) horizontal unit vector.
    """
    left = np.array([-front[1], front[0], 0.0])
    M = np.eye(3) - 2.0 * np.outer(left, left)
    X = np.eye(4)
    X[:3, :3] = M @ X_WL[:3, :3] @ np.diag([1.0, -1.0, 1.0])
    X[:3, 3] = M @ X_WL[:3, 3]
    return X


def alike(X_W1: np.ndarray, X_W2: np.ndarray) -> bool:
    """Whether two poses differ by no more than meshes of mirrored parts do.

    Args:
        X_W1: (4, 4) one.
        X_W2: (4, 4) the other.
    """
    turn = float(np.arccos(np.clip(0.5 * (np.trace(X_W1[:3, :3].T @ X_W2[:3, :3]) - 1.0), -1.0, 1.0)))
    return bool(np.linalg.norm(X_W1[:3, 3] - X_W2[:3, 3]) < MISSED and turn < TWISTED)


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
