"""Plain arcs for end effectors on their way from contact to contact, where nobody has planned better ones."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from optimization.centroidal.contact_schedule import ContactSchedule

LIFT = 0.06  # [m] height of an arc over the straight line, along the mean of both normals


def effector_arcs(
    schedule: ContactSchedule, X_start: np.ndarray, hold: float, swing: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """(N, E, 4, 4) poses of the end effectors at the knots, and (N, E, 2) weights of place and turn.

    A contact is held at both ends of every interval in which it is active. In the air an end effector goes along an arc
    from where it was, at first from `X_start`, to its next contact; where none follows it is free.

    Args:
        schedule: contacts in time.
        X_start: (E, 4, 4) poses at knot 0.
        hold: weight of contacts that are held [1/m]; 1 rad counts 0.3 m.
        swing: weights in the air [1/m, 1/rad].
    """
    N, E = schedule.num_knots, schedule.active.shape[1]
    X_WE, weight = np.tile(np.eye(4), (N, E, 1, 1)), np.zeros((N, E, 2))
    for e in range(E):
        held = np.full(N, -1)
        held[:-1] = schedule.active[:, e]
        held[1:] = np.where(held[1:] >= 0, held[1:], schedule.active[:, e])
        last, X_last = 0, X_start[e]
        for n in range(N):
            if held[n] < 0:
                continue
            X_WC = schedule.contacts[held[n]].X_WC
            X_WE[n, e], weight[n, e] = X_WC, (hold, 0.3 * hold)
            for i in range(last + 1, n):
                share = (schedule.times[i] - schedule.times[last]) / (schedule.times[n] - schedule.times[last])
                X_WE[i, e], weight[i, e] = _on_arc(X_last, X_WC, share), swing
            last, X_last = n, X_WC
    return X_WE, weight


def _on_arc(X_WA: np.ndarray, X_WB: np.ndarray, share: float) -> np.ndarray:
    """(4, 4) pose at this share of the time from A to B, at rest at both ends."""
    s = share * share * (3.0 - 2.0 * share)
    X = np.eye(4)
    up = X_WA[:3, 2] + X_WB[:3, 2]
    X[:3, 3] = X_WA[:3, 3] + s * (X_WB[:3, 3] - X_WA[:3, 3])
    X[:3, 3] += 16.0 * (share * (1.0 - share)) ** 2 * LIFT * up / max(float(np.linalg.norm(up)), 1e-9)
    turn = Rotation.from_matrix(X_WB[:3, :3] @ X_WA[:3, :3].T).as_rotvec()
    X[:3, :3] = Rotation.from_rotvec(s * turn).as_matrix() @ X_WA[:3, :3]
    return X
