"""The rows of a centroidal program: coefficients and right sides, in the units of `optimization.centroidal.program`.

Every function gives the same places for the same contacts active at the same times, whatever the numbers are. Indices
are places of variables: of a state (N-1, 3), of wrenches (J, 6), of their residuals z (J, 3), of corner forces (J, 3 V).
"""

from __future__ import annotations

import numpy as np

from optimization.balance.contact_wrench import cross, pressure_residuals, skew
from optimization.centroidal.options import ARM, LEAST_PRESSURE_LOAD, UP
from optimization.convex.sparse_rows import SparseRows
from optimization.convex.updatable_program import Rows


def difference_rows(index: np.ndarray, rate: np.ndarray, step: np.ndarray, initial: np.ndarray) -> Rows:
    """x[n+1] - x[n] - step[n] rate[n] = 0 with x[0] = initial (3,).

    Args:
        index: (N-1, 3) places of x at knots 1..N-1.
        rate: (N-1, 3) places of the rates.
        step: (N-1,) factors of the rates.
        initial: (3,) x at knot 0.
    """
    rows, right = SparseRows(), np.zeros(index.shape)
    row = np.arange(index.size).reshape(index.shape)
    rows.add(row, index, 1.0)
    rows.add(row[1:], index[:-1], -1.0)
    rows.add(row, rate, -step[:, None])
    right[0] = initial
    return rows, None, right.ravel()


def total_force_rows(a: np.ndarray, wrench: np.ndarray, interval: np.ndarray, R: np.ndarray) -> Rows:
    """a - sum R f = -e_z.

    Args:
        a: (N-1, 3) places of the total force less the weight [M g].
        wrench: (J, 6) places of the contact wrenches.
        interval: (J,) interval of each wrench.
        R: (J, 3, 3) orientations R_WC.
    """
    rows = SparseRows()
    row = np.arange(a.size).reshape(-1, 3)
    rows.add(row, a, 1.0)
    rows.add_blocks(row[interval], wrench[:, :3], -R)
    return rows, None, np.tile(-UP, len(a))


def contact_wrench_rows(wrench: np.ndarray, force: np.ndarray, corner_map: np.ndarray) -> Rows:
    """(f, m) - map force = 0.

    Args:
        wrench: (J, 6) places of the contact wrenches.
        force: (J, 3 V) places of their corner forces.
        corner_map: (J, 6, 3 V) from corner forces to wrench.
    """
    rows = SparseRows()
    row = np.arange(wrench.size).reshape(-1, 6)
    rows.add(row, wrench, 1.0)
    rows.add_blocks(row, force, -corner_map)
    return rows, None, np.zeros(row.size)


def friction_rows(force: np.ndarray, faces: np.ndarray) -> Rows:
    """faces (J, R, 3) @ f <= 0 for each corner force f.

    Args:
        force: (J, 3 V) places of the corner forces.
        faces: (J, R, 3) outward normals of the cones' faces, in C.
    """
    rows = SparseRows()
    corners = force.shape[1] // 3
    count = corners * len(faces) * faces.shape[1]
    row = np.arange(count).reshape(len(faces), corners, faces.shape[1])
    rows.add_blocks(row, force.reshape(-1, corners, 3), faces[:, None])
    return rows, np.full(count, -np.inf), np.zeros(count)


def momentum_rate_rows(
    kdot: np.ndarray,
    com: np.ndarray,
    wrench: np.ndarray,
    interval: np.ndarray,
    pose: tuple[np.ndarray, np.ndarray],
    about: tuple[np.ndarray, np.ndarray],
    origin: np.ndarray,
) -> Rows:
    """kdot - sum ((p - com0) x R f / ARM + R m) - u0 x (com - com0) / ARM = 0.

    Args:
        kdot, com, wrench: indices.
        interval: (J,) interval of each wrench.
        pose: (J, 3) points p_WC [m] and (J, 3, 3) orientations R_WC.
        about: (N-1, 3) CoM com0 [m] and total force u0 [M g].
        origin: (3,) that the variables com are relative to [m].
    """
    (p, R), (com0, total_force) = pose, about
    rows = SparseRows()
    row = np.arange(kdot.size).reshape(-1, 3)
    rows.add(row, kdot, 1.0)
    rows.add_blocks(row, com, -skew(total_force) / ARM)
    lever = skew(p - com0[interval]) @ R / ARM
    rows.add_blocks(row[interval], wrench, -np.concatenate([lever, R], axis=2))
    return rows, None, -cross(total_force, com0 - origin).ravel() / ARM


def pressure_rows(z_index: np.ndarray, wrench_index: np.ndarray, wrench: np.ndarray, half: np.ndarray) -> Rows:
    """z - J wrench = z0 - J wrench0, with J the Jacobian of z about wrench0 (J, 6).

    Args:
        z_index: (J, 3) places of z.
        wrench_index: (J, 6) places of the wrenches.
        wrench: (J, 6) wrenches to linearise about, in C [M g, M g ARM].
        half: (J, 2) half extents of the supports [m].
    """
    z, jacobian = pressure_residuals(wrench, half, ARM, LEAST_PRESSURE_LOAD)
    rows = SparseRows()
    row = np.arange(z.size).reshape(z.shape)
    rows.add(row, z_index, 1.0)
    rows.add_blocks(row, wrench_index, -jacobian)
    return rows, None, (z - np.einsum("jab,jb->ja", jacobian, wrench)).ravel()


def reach_rows(
    com: np.ndarray,
    slack: np.ndarray,
    reach: tuple[np.ndarray, np.ndarray, np.ndarray],
    com0: np.ndarray,
    origin: np.ndarray,
) -> Rows:
    """e . (com - p) - ARM s <= reach, e pointing from the contact to com0: the ball's supporting half space.

    Args:
        com, slack: indices.
        reach: (K,) knot less one, (K, 3) contact points [m] and (K,) greatest distances [m].
        com0: (N-1, 3) [m].
        origin: (3,) that the variables com are relative to [m].
    """
    knot, points, limit = reach
    away = com0[knot] - points
    away = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    rows = SparseRows()
    row = np.arange(len(knot))
    rows.add(row[:, None], com[knot], away)
    rows.add(row, slack[knot, 0], -ARM)
    return rows, np.full(len(knot), -np.inf), limit + np.einsum("ka,ka->k", away, points - origin)


def soft_limit_rows(index: np.ndarray, slack: np.ndarray, limit: np.ndarray) -> Rows | None:
    """|x_i| - slack <= limit for the finite entries of `limit` (3,); None where there are none.

    Args:
        index: (n, 3) places of x.
        slack: (n, 1) places of the slacks.
        limit: (3,) of each axis, in the unit of x; inf for none.
    """
    axes = np.flatnonzero(np.isfinite(limit))
    if not len(axes):
        return None
    rows = SparseRows()
    row = np.arange(index[:, axes].size).reshape(len(index), -1)
    for offset, sign in ((0, 1.0), (row.size, -1.0)):
        rows.add(row + offset, index[:, axes], sign)
        rows.add(row + offset, slack, -1.0)
    upper = np.tile(limit[axes], 2 * len(index))
    return rows, np.full(upper.size, -np.inf), upper
