"""Poses in a URDF: the origins of its elements, and how far a joint moves them."""

from __future__ import annotations

import numpy as np
from lxml import etree  # type: ignore[attr-defined]


def numbers(text: str | None, default: str) -> np.ndarray:
    """The numbers of an attribute.

    Args:
        text: of the attribute, None where it is missing.
        default: the text that it stands for then.
    """
    return np.array([float(v) for v in (text or default).split()])


def pose(xyz: np.ndarray, rpy: np.ndarray) -> np.ndarray:
    """(4, 4) pose of an origin.

    Args:
        xyz: (3,) translation [m].
        rpy: (3,) roll, pitch and yaw [rad], about fixed axes.
    """
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    X = np.eye(4)
    X[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    X[:3, 3] = xyz
    return X


def origin(element: etree._Element) -> np.ndarray:
    """(4, 4) pose of an element's origin, the identity where it has none."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    return pose(numbers(origin.get("xyz"), "0 0 0"), numbers(origin.get("rpy"), "0 0 0"))


def origin_element(X: np.ndarray) -> etree._Element:
    """The <origin> of a pose (4, 4)."""
    R = X[:3, :3]
    rpy = (np.arctan2(R[2, 1], R[2, 2]), np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])), np.arctan2(R[1, 0], R[0, 0]))
    text = {k: " ".join(f"{v:.9f}" for v in values) for k, values in {"xyz": X[:3, 3], "rpy": rpy}.items()}
    return etree.Element("origin", **text)


def inverse_origin(joint: etree._Element) -> etree._Element:
    """The origin of a joint seen from its child."""
    return origin_element(np.linalg.inv(origin(joint)))


def turn(joint: etree._Element, angle: float) -> np.ndarray:
    """(4, 4) displacement of a joint.

    Args:
        joint: its element.
        angle: [rad], or length [m].
    """
    axis = numbers(joint.find("axis").get("xyz") if joint.find("axis") is not None else None, "1 0 0")
    axis = axis / np.linalg.norm(axis)
    X = np.eye(4)
    if joint.get("type") == "prismatic":
        X[:3, 3] = axis * angle
        return X
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    X[:3, :3] = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    return X
