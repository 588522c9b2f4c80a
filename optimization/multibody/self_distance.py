"""Which of a robot's shapes come near each other in which postures, compiled."""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.multibody.convex_distance import hull_distance, way_out
from optimization.multibody.kinematic_tree import KinematicTree, forward
from optimization.multibody.robot_shapes import RobotShapes
from optimization.multibody.terrain_clearance import in_link, place


class SelfPairs(NamedTuple):
    """R pairs of shapes that are near each other.

    Attributes:
        row: (R,) index of the posture.
        shape: (R, 2) indices of the shapes.
        distance: (R,) signed [m]; where they overlap, minus a way that parts them.
        point: (R, 2, 3) the nearest points on both, each in its shape's link [m].
        normal: (R, 3) unit vector in W from the second shape to the first.
    """

    row: np.ndarray
    shape: np.ndarray
    distance: np.ndarray
    point: np.ndarray
    normal: np.ndarray


def near_itself(tree: KinematicTree, shapes: RobotShapes, q: np.ndarray, distance: float) -> SelfPairs:
    """Every pair of shapes closer than a distance, in all postures.

    Args:
        tree: of the robot.
        shapes: its collision shapes, with the pairs that may not meet.
        q: (T, nq) postures, Drake's order.
        distance: pairs nearer than this are returned [m].
    """
    room = max(16 * len(q), 256)
    while True:
        pairs = SelfPairs(
            np.empty(room, np.int64),
            np.empty((room, 2), np.int64),
            np.empty(room),
            np.empty((room, 2, 3)),
            np.empty((room, 3)),
        )
        found = _find(tree, shapes, np.ascontiguousarray(q, float), float(distance), pairs)
        if found <= room:
            return SelfPairs(*(array[:found] for array in pairs))
        room = found


@njit(cache=True)
def _find(tree: KinematicTree, shapes: RobotShapes, q: np.ndarray, distance: float, pairs: SelfPairs) -> int:
    """Fills `pairs` as far as it has room; how many there are."""
    num_links, num_shapes = tree.parent.shape[0], shapes.link.shape[0]
    R, p = np.empty((num_links, 3, 3)), np.empty((num_links, 3))
    P, c = np.empty(shapes.p_LP.shape), np.empty((num_shapes, 3))
    p_A, p_B, n = np.empty(3), np.empty(3), np.empty(3)
    found = 0
    for t in range(q.shape[0]):
        forward(tree, q[t], R, p)
        for s in range(num_shapes):
            link = shapes.link[s]
            place(R[link], p[link], shapes.p_LC[s], c[s])
            for m in range(shapes.first[s], shapes.first[s + 1]):
                place(R[link], p[link], shapes.p_LP[m], P[m])
        for k in range(shapes.pair.shape[0]):
            a, b = shapes.pair[k, 0], shapes.pair[k, 1]
            reach = shapes.reach[a] + shapes.reach[b] + distance
            apart = (c[a, 0] - c[b, 0]) ** 2 + (c[a, 1] - c[b, 1]) ** 2 + (c[a, 2] - c[b, 2]) ** 2
            if apart > reach * reach:
                continue
            A, B = P[shapes.first[a] : shapes.first[a + 1]], P[shapes.first[b] : shapes.first[b + 1]]
            rounding = shapes.radius[a] + shapes.radius[b]
            gap = hull_distance(A, A.shape[0], B, B.shape[0], distance + rounding, p_A, p_B)
            if gap == np.inf:
                continue
            if gap > 0.0:
                for r in range(3):
                    n[r] = (p_A[r] - p_B[r]) / gap
            else:
                gap = -way_out(A, A.shape[0], B, B.shape[0], p_A, p_B, n)
            if gap - rounding >= distance:
                continue
            if found < pairs.row.shape[0]:
                pairs.row[found], pairs.shape[found, 0], pairs.shape[found, 1] = t, a, b
                pairs.distance[found] = gap - rounding
                for r in range(3):
                    p_A[r] -= shapes.radius[a] * n[r]
                    p_B[r] += shapes.radius[b] * n[r]
                    pairs.normal[found, r] = n[r]
                in_link(R[shapes.link[a]], p[shapes.link[a]], p_A, pairs.point[found, 0])
                in_link(R[shapes.link[b]], p[shapes.link[b]], p_B, pairs.point[found, 1])
            found += 1
    return found
