"""What a strip's configurations do to first order: end effectors, centre of mass, and distances that are short."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.elastic_strip.clearance import close_to_terrain, make_terrain_rows, terrain_row
from optimization.multibody.body_capsules import BodyCapsules, close_pairs, distance_row, make_rows
from optimization.multibody.kinematic_tree import KinematicTree, com_jacobian, forward, frame_jacobian, frame_pose
from scenes.terrain.packed_terrain import PackedTerrain

MAX_TERRAIN, MAX_SELF = 12, 8  # distances that a configuration looks at
SEEN = 0.06  # [m] beyond what is wanted, from which a distance is looked at


class StripRows(NamedTuple):
    """N configurations, linearised.

    Attributes:
        R_WE: (N, E, 3, 3) and p_WE: (N, E, 3) of the end effectors [m].
        J_E: (N, E, 6, nv) Jacobians of (w_WE, v_WE) in W.
        com: (N, 3) [m].
        J_com: (N, 2, nv) of its x and y.
        count: (N,) distances looked at.
        gap: (N, M) distance less what is wanted [m]; negative where it is short.
        J_gap: (N, M, nv).
    """

    R_WE: np.ndarray
    p_WE: np.ndarray
    J_E: np.ndarray
    com: np.ndarray
    J_com: np.ndarray
    count: np.ndarray
    gap: np.ndarray
    J_gap: np.ndarray


def make_strip_rows(num: int, num_effectors: int, num_velocities: int) -> StripRows:
    """Room for `num` configurations.

    Args:
        num: of configurations.
        num_effectors: E.
        num_velocities: nv.
    """
    M = MAX_TERRAIN + MAX_SELF
    return StripRows(
        np.zeros((num, num_effectors, 3, 3)),
        np.zeros((num, num_effectors, 3)),
        np.zeros((num, num_effectors, 6, num_velocities)),
        np.zeros((num, 3)),
        np.zeros((num, 2, num_velocities)),
        np.zeros(num, np.int64),
        np.zeros((num, M)),
        np.zeros((num, M, num_velocities)),
    )


@njit(cache=True)
def linearise(
    tree: KinematicTree,
    capsules: BodyCapsules,
    packed: PackedTerrain,
    effector_of: np.ndarray,
    q: np.ndarray,
    air: np.ndarray,
    limb_clearance: float,
    air_clearance: float,
    rows: StripRows,
) -> None:
    """Fills `rows` for configurations q (N, nq).

    Args:
        tree: of the robot.
        capsules: its shape, S shapes.
        packed: the terrain.
        effector_of: (S,) end effector that each shape of `capsules` belongs to, -1 for limbs and trunk.
        q: (N, nq) configurations.
        air: (N, E) end effectors that must keep away from the terrain.
        limb_clearance, air_clearance: distance that limbs and end effectors in the air should keep from it [m].
        rows: written.
    """
    n, nv, E = tree.parent.shape[0], q.shape[1] - 1, air.shape[1]
    R, p, J, J_com = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((6, nv)), np.empty((3, nv))
    ground, own = make_terrain_rows(MAX_TERRAIN), make_rows(MAX_SELF)
    counted = np.empty(effector_of.shape[0], np.bool_)
    furthest = max(limb_clearance, air_clearance)
    for t in range(q.shape[0]):
        forward(tree, q[t], R, p)
        for e in range(E):
            frame_pose(tree, R, p, e, rows.R_WE[t, e], rows.p_WE[t, e])
            frame_jacobian(tree, R, p, e, rows.J_E[t, e])
        com_jacobian(tree, R, p, rows.com[t], J_com)
        rows.J_com[t] = J_com[:2]
        for s in range(counted.shape[0]):
            counted[s] = effector_of[s] < 0 or air[t, effector_of[s]]
        m = 0
        for k in range(close_to_terrain(capsules, counted, packed, R, p, furthest + SEEN, ground)):
            wanted = limb_clearance if effector_of[ground.shape[k]] < 0 else air_clearance
            rows.gap[t, m] = ground.distance[k] - wanted
            terrain_row(tree, capsules, R, p, ground, k, J, rows.J_gap[t, m])
            m += 1
        for k in range(close_pairs(capsules, R, p, SEEN, own)):
            rows.gap[t, m] = own.distance[k] - capsules.clearance[own.pair[k]]
            distance_row(tree, R, p, own, k, rows.J_gap[t, m])
            m += 1
        rows.count[t] = m
