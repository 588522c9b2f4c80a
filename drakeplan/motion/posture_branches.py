"""Key postures on one branch of the inverse kinematics for as long as a contact is held.

Each key posture is solved alone, from the nominal posture. An arm whose palm stays on a wall may then have its elbow down in
one posture and up in the next, and no motion leads from one to the other while the palm is held. The same targets are
therefore solved in three ways: alone, each from the posture before it, and each from the posture after it. The course
through these candidates that turns the joints of holding limbs least is the shortest path in a layered graph:

    min  sum_b  sum_{limbs that hold one contact at b - 1 and b} |q_limb(b) - q_limb(b - 1)|^2
                + COMFORT |q(b) - q_ref(b)|^2 + MISSED (where the posture misses its contacts or its CoM)
"""

from __future__ import annotations

import numpy as np

from optimization.inverse_kinematics.frame_task import TrackingTargets
from optimization.inverse_kinematics.posture_tracking import TrackedPostures, track_postures
from optimization.multibody.kinematic_tree import KinematicTree
from optimization.multibody.kinematics import limb_links

COMFORT = 0.02  # weight of the joints' distance from the reference beside that of their way
MISSED = 1e3  # [rad^2] what a posture costs that misses its targets


def on_one_branch(
    tree: KinematicTree,
    targets: TrackingTargets,
    answer: TrackedPostures,
    placed: np.ndarray,
    good: tuple[float, float],
    max_iterations: int = 60,
) -> TrackedPostures:
    """The same postures, each on the branch that the limbs which hold a contact keep from one to the next.

    Args:
        tree: the robot's kinematic tree.
        targets: of the n postures, in order.
        answer: the n postures, each solved alone.
        placed: (n, E) contact numbers, -1 where an end effector is free.
        good: greatest distances from the contacts and of the CoM on the map [m] at which a posture meets its targets.
        max_iterations: of Gauss-Newton, a posture.
    """
    same = (placed[1:] == placed[:-1]) & (placed[1:] >= 0)
    if not same[:, 2:].any():  # feet alone: a leg has one branch
        return answer
    candidates = [answer, *(_chained(tree, targets, answer.q, order, max_iterations) for order in (1, -1))]
    chosen = _shortest(tree, targets, candidates, same, good)
    return best_of(candidates, chosen)


def best_of(candidates: list[TrackedPostures], chosen: np.ndarray) -> TrackedPostures:
    """Of several answers for n postures, for each posture the chosen one.

    Args:
        candidates: the answers.
        chosen: (n,) index of one of them.
    """

    def pick(name: str) -> np.ndarray:
        return np.stack([getattr(c, name) for c in candidates])[chosen, np.arange(len(chosen))]

    return TrackedPostures(pick("q"), pick("effector_error"), pick("com_error"), pick("iterations"))


def holding_joints(tree: KinematicTree, held: np.ndarray) -> np.ndarray:
    """(n, J) 1 where a joint belongs to a limb that holds a contact, else 0.

    Args:
        tree: the robot's kinematic tree.
        held: (n, E) bool.
    """
    limb = np.zeros((held.shape[1], len(tree.lower)))
    for e in range(len(limb)):
        limb[e, np.array(limb_links(tree, e)) - 1] = 1.0  # the joint of link i is the (i - 1)-th
    return np.minimum(held @ limb, 1.0)


def _chained(
    tree: KinematicTree, targets: TrackingTargets, q: np.ndarray, order: int, max_iterations: int
) -> TrackedPostures:
    """All postures, each solved from its neighbour; `order` 1 walks forwards, -1 backwards."""
    turned = TrackingTargets(
        targets.X_WE[::order],
        targets.place_weight[::order],
        targets.turn_weight[::order],
        targets.com[::order],
        targets.com_weight[::order],
        targets.q_ref[::order],
        targets.posture_weight,
        targets.lower,
        targets.upper,
    )
    found = track_postures(tree, turned, q[::order], chained=True, max_iterations=max_iterations)
    return TrackedPostures(
        found.q[::order], found.effector_error[::order], found.com_error[::order], found.iterations[::order]
    )


def _shortest(
    tree: KinematicTree,
    targets: TrackingTargets,
    candidates: list[TrackedPostures],
    same: np.ndarray,
    good: tuple[float, float],
) -> np.ndarray:
    """(n,) index of the candidate at every posture on the shortest way through all."""
    joints = np.stack([c.q[:, 7:] for c in candidates])  # (C, n, J)
    contact = np.stack([c.effector_error.max(axis=1) for c in candidates])
    com = np.stack([np.linalg.norm(c.com_error[:, :2], axis=1) for c in candidates])
    own = COMFORT * ((joints - targets.q_ref[:, 7:]) ** 2).sum(axis=2)
    own += MISSED * ((contact > good[0]) | (com > good[1]))
    weight = holding_joints(tree, same)
    num = joints.shape[1]
    cost, came = own[:, 0], np.zeros((num, len(candidates)), np.int64)
    for b in range(1, num):
        turn = joints[None, :, b] - joints[:, None, b - 1]  # (from, to, J)
        total = cost[:, None] + (weight[b - 1] * turn**2).sum(axis=2)
        came[b] = total.argmin(axis=0)
        cost = total.min(axis=0) + own[:, b]
    chosen = np.empty(num, np.int64)
    chosen[-1] = int(cost.argmin())
    for b in range(num - 1, 0, -1):
        chosen[b - 1] = came[b, chosen[b]]
    return chosen
