"""The patch at the end of each hand that leans on walls: where the forearm ends, fingers as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from drakeplan.robot_setup.link_tree import LinkTree
from drakeplan.robot_setup.symmetry import alike, mirror_pose

SIZES = (0.045, 0.035, 0.025, 0.02, 0.015, 0.01)  # [m] half extents that are tried, largest first
OFF_BODY = 0.008  # [m] of the patch's corners from the hand, at most; the verifier allows 10 mm
INSIDE = 0.004  # [m] that the patch may lie inside the hand
OFFSETS = np.linspace(-0.03, 0.03, 13)  # [m] across the end of the hand where its patch is looked for


@dataclass(frozen=True, eq=False)
class Palm:
    """A square that leans.

    Attributes:
        link: that it sits on.
        body: of the link, whose frame the pose is given in.
        X_BE: (4, 4) contact frame in the body: z from the wall into the hand, x up when the hand leans on a wall ahead.
        half_extent: of the square [m].
        off_body: of its worst corner from the hand [m].
    """

    link: str
    body: str
    X_BE: np.ndarray
    half_extent: float
    off_body: float


def find_palms(tree: LinkTree, hands: Sequence[str], torso: str, front: np.ndarray) -> tuple[Palm, Palm] | None:
    """The patches of both hands, of the same size; None where a hand has no shape that could carry one.

    Args:
        tree: of the robot.
        hands: links of the left and the right hand.
        torso: link that carries the arms.
        front: (3,) where the robot faces at the zero posture.
    """
    for half in SIZES:
        left, right = (_palm(tree, hand, torso, front, half) for hand in hands)
        if left is not None and right is not None:
            X_WR = mirror_pose(tree.pose(left.body) @ left.X_BE, front)
            if alike(X_WR, tree.pose(right.body) @ right.X_BE):
                right = replace(right, X_BE=np.linalg.inv(tree.pose(right.body)) @ X_WR)
            return left, right
    return None


def _palm(tree: LinkTree, hand: str, torso: str, front: np.ndarray, half: float) -> Palm | None:
    points = np.concatenate([tree.links[n].points for n in tree.below(hand)])
    way = tree.way(hand)
    arm = way[way.index(torso) + 1 :] if torso in way else way[1:]
    elbow = next((n for n in reversed(arm[:-1]) if np.linalg.norm(tree.origin(n) - tree.origin(hand)) > 0.05), arm[0])
    out = points.mean(axis=0) - tree.origin(elbow) if len(points) else np.zeros(3)
    if len(points) < 4 or np.linalg.norm(out) < 1e-3:
        return None
    out = _along_hand(tree, hand, out / np.linalg.norm(out))
    up = _up_when_leaning(out, front)
    R = np.column_stack([up, np.cross(-out, up), -out])
    local = points @ R
    try:
        hull = ConvexHull(local)
    except QhullError:
        return None
    corners = half * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], float)
    tip = local[:, 2].min()
    near = local[local[:, 2] < tip + 0.02].mean(axis=0)
    best: tuple[float, np.ndarray] | None = None
    for dx in OFFSETS:
        for dy in OFFSETS:
            centre = np.array([near[0] + dx, near[1] + dy, tip])
            for depth in (0.0, 0.25 * INSIDE, 0.5 * INSIDE, 0.75 * INSIDE, INSIDE):
                at = centre + np.array([0.0, 0.0, depth])
                off = _off(hull, local, at + corners)
                cost = off + 0.05 * float(np.hypot(dx, dy)) + 0.1 * depth
                if off <= OFF_BODY and (best is None or cost < best[0]):
                    best = (cost, at)
    if best is None:
        return None
    X_WE = np.eye(4)
    X_WE[:3, :3] = R
    X_WE[:3, 3] = R @ best[1]
    return Palm(hand, hand, np.linalg.inv(tree.pose(hand)) @ X_WE, half, _off(hull, local, best[1] + corners))


def _along_hand(tree: LinkTree, hand: str, out: np.ndarray) -> np.ndarray:
    """The axis of the hand's own frame that points out of the arm, where one does within 20 deg: patches lie straight."""
    axes = tree.pose(hand)[:3, :3].T
    candidates = np.concatenate([axes, -axes])
    best = candidates[int(np.argmax(candidates @ out))]
    return best if best @ out > np.cos(np.deg2rad(20.0)) else out


def _up_when_leaning(out: np.ndarray, front: np.ndarray) -> np.ndarray:
    """(3,) the direction in the hand that points up once the shortest turn has made the arm point ahead."""
    axis, cosine = np.cross(out, front), float(out @ front)
    up = np.array([0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-6:
        return up if cosine > 0 else -up
    axis /= sine
    # up in the hand is what the turn takes to up in W: the inverse turn of up (Rodrigues)
    back = cosine * up - sine * np.cross(axis, up) + (1 - cosine) * (axis @ up) * axis
    back -= (back @ out) * out
    return back / np.linalg.norm(back)


def _off(hull: ConvexHull, points: np.ndarray, corners: np.ndarray) -> float:
    """How far the farthest corner is from the hull, or half of how deep it is inside [m]; a bound, exact near one facet."""
    outside = corners @ hull.equations[:, :3].T + hull.equations[:, 3]
    depth = outside.max(axis=1)
    near = np.array([np.linalg.norm(points - c, axis=1).min() for c in corners])
    return float(np.where(depth > 0.0, np.minimum(np.maximum(depth, 0.0) * 1.2, near), 0.0).max())
