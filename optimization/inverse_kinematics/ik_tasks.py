"""The rows of one inverse-kinematics step: each adds a weighted least-squares term to the normal equations.

A step v (nv,) minimises 1/2 sum_k w_k^2 |J_k v - e_k|^2 within bounds, e the error still to go; as a quadratic program,
H += w^2 J^T J and g += w^2 J^T e, upper triangle only. An inequality a v >= b becomes the row a v - t = b with an
unknown t >= 0 of its own, so that the bounded program of `optimization.convex.box_qp` decides which rows push.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from optimization.multibody.kinematic_tree import KinematicTree, frame_pose, rotation_error


class StepProgram(NamedTuple):
    """The bounded quadratic program of one step: nv velocities, then a slack for each inequality row.

    Fields: H (m, m), g (m,), lower (m,), upper (m,), x (m,), side (m,) int64; m is nv and the most rows it can take.
    """

    H: np.ndarray
    g: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    x: np.ndarray
    side: np.ndarray


@njit(cache=True)
def make_program(num_velocities: int, max_rows: int) -> StepProgram:
    """An empty program with room for `max_rows` inequality rows.

    Args:
        num_velocities: nv.
        max_rows: inequality rows that it can take.
    """
    m = num_velocities + max_rows
    return StepProgram(np.zeros((m, m)), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m, np.int64))


@njit(cache=True)
def clear_program(program: StepProgram) -> None:
    """Takes all terms out; keeps the bounds and the guess of the active ones."""
    program.H[:] = 0.0
    program.g[:] = 0.0


@njit(cache=True)
def frame_error(tree: KinematicTree, R: np.ndarray, p: np.ndarray, e: int, X_WE: np.ndarray, error: np.ndarray) -> None:
    """Writes error (6,): the rotation vector [rad] and the translation [m], in W, from frame e to its target X_WE.

    Args:
        tree: of the robot.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        e: number of the named frame.
        X_WE: (4, 4) target in W [m].
        error: (6,) written.
    """
    R_WE, p_WE = np.empty((3, 3)), np.empty(3)
    frame_pose(tree, R, p, e, R_WE, p_WE)
    rotation_error(R_WE, X_WE[:3, :3], error[:3])
    for a in range(3):
        error[3 + a] = X_WE[a, 3] - p_WE[a]


@njit(cache=True)
def add_frame_task(
    tree: KinematicTree,
    R: np.ndarray,
    p: np.ndarray,
    e: int,
    error: np.ndarray,
    angular_weight: float,
    linear_weight: float,
    program: StepProgram,
) -> None:
    """Adds a task that moves frame e by error (6,): rotation [rad], then translation [m], in W.

    Only the columns of the base and of the joints between it and the frame are touched.

    Args:
        tree: of the robot.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        e: number of the named frame.
        error: (6,) from `frame_error`.
        angular_weight: of the rotation [1/rad].
        linear_weight: of the translation [1/m].
        program: added to.
    """
    link, o = tree.frame_link[e], tree.p_LE[e]
    x = p[link, 0] + R[link, 0, 0] * o[0] + R[link, 0, 1] * o[1] + R[link, 0, 2] * o[2]
    y = p[link, 1] + R[link, 1, 0] * o[0] + R[link, 1, 1] * o[1] + R[link, 1, 2] * o[2]
    z = p[link, 2] + R[link, 2, 0] * o[0] + R[link, 2, 1] * o[1] + R[link, 2, 2] * o[2]
    depth, k = 0, link
    while k > 0:
        depth += 1
        k = tree.parent[k]
    n = 6 + depth
    column, J = np.empty(n, np.int64), np.zeros((n, 6))
    for a in range(6):
        column[a] = a
        J[a, a] = 1.0
    _cross(1.0, 0.0, 0.0, x - p[0, 0], y - p[0, 1], z - p[0, 2], J[0])
    _cross(0.0, 1.0, 0.0, x - p[0, 0], y - p[0, 1], z - p[0, 2], J[1])
    _cross(0.0, 0.0, 1.0, x - p[0, 0], y - p[0, 1], z - p[0, 2], J[2])
    k = link
    for a in range(n - 1, 5, -1):
        column[a] = 5 + k
        ax, ay, az = float(R[k, 0, 2]), float(R[k, 1, 2]), float(R[k, 2, 2])
        if tree.prismatic[k]:
            J[a, 3], J[a, 4], J[a, 5] = ax, ay, az
        else:
            J[a, 0], J[a, 1], J[a, 2] = ax, ay, az
            _cross(ax, ay, az, x - p[k, 0], y - p[k, 1], z - p[k, 2], J[a])
        k = tree.parent[k]
    wa, wl = angular_weight * angular_weight, linear_weight * linear_weight
    for a in range(n):
        i, u = column[a], J[a]
        u0, u1, u2, u3, u4, u5 = wa * u[0], wa * u[1], wa * u[2], wl * u[3], wl * u[4], wl * u[5]
        program.g[i] += u0 * error[0] + u1 * error[1] + u2 * error[2] + u3 * error[3] + u4 * error[4] + u5 * error[5]
        for b in range(a, n):
            v = J[b]
            program.H[i, column[b]] += u0 * v[0] + u1 * v[1] + u2 * v[2] + u3 * v[3] + u4 * v[4] + u5 * v[5]


@njit(cache=True)
def _cross(ax: float, ay: float, az: float, rx: float, ry: float, rz: float, column: np.ndarray) -> None:
    """Writes a x r to entries 3 to 5."""
    column[3], column[4], column[5] = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx


@njit(cache=True)
def add_row(row: np.ndarray, error: float, weight: float, program: StepProgram) -> None:
    """Adds the task row v = error; row is (nv,).

    Args:
        row: (nv,) coefficients.
        error: to move by, in the unit of row v.
        weight: of the error [1 / its unit].
        program: added to.
    """
    w = weight * weight
    n = row.shape[0]
    for i in range(n):
        a = w * row[i]
        if a != 0.0:
            program.g[i] += a * error
            target = program.H[i]
            for j in range(i, n):
                target[j] += a * row[j]


@njit(cache=True)
def add_inequality(row: np.ndarray, bound: float, weight: float, num_rows: int, program: StepProgram) -> int:
    """Adds row v >= bound as number `num_rows`, row (nv,); returns how many there are. A full program ignores it.

    Args:
        row: (nv,) coefficients.
        bound: b, in the unit of row v.
        weight: of what is missing [1 / its unit].
        num_rows: inequality rows that the program has.
        program: added to.
    """
    n = row.shape[0]
    s = n + num_rows
    if s >= program.g.shape[0]:
        return num_rows
    add_row(row, bound, weight, program)
    w = weight * weight
    for i in range(n):
        program.H[i, s] = -w * row[i]
    program.H[s, s] = w
    program.g[s] = -w * bound
    program.lower[s], program.upper[s] = 0.0, np.inf
    program.side[s] = -1 if bound > 0.0 else 0
    return num_rows + 1


@njit(cache=True)
def add_diagonal(i: int, error: float, weight: float, program: StepProgram) -> None:
    """Adds the task v[i] = error.

    Args:
        i: number of the velocity.
        error: to move by [rad or m].
        weight: of the error [1 / its unit].
        program: added to.
    """
    program.H[i, i] += weight * weight
    program.g[i] += weight * weight * error


@njit(cache=True)
def predicted_gain(program: StepProgram, num_velocities: int, m: int, length: float) -> float:
    """How much sum_k w_k^2 |r_k|^2 should fall along `length` of the answer x, were the tasks as linear as the rows.

    A step of nothing leaves each inequality's slack at what is satisfied already, so the comparison starts there.

    Args:
        program: solved.
        num_velocities: nv.
        m: number of unknowns, slacks included.
        length: part of the step, 0 to 1.
    """
    gain = 0.0
    for i in range(m):
        if i >= num_velocities:
            # At v = 0 the row's t is max(0, -bound); g[i] = -w^2 bound, H[i, i] = w^2.
            bound = -program.g[i] / program.H[i, i]
            if bound < 0.0:
                gain -= program.H[i, i] * bound * bound
        x = length * program.x[i] if i < num_velocities else program.x[i]
        Hx = program.H[i, i] * x
        for j in range(i + 1, m):
            Hx += 2.0 * program.H[i, j] * (length * program.x[j] if j < num_velocities else program.x[j])
        gain += x * (2.0 * program.g[i] - Hx)
    return gain


@njit(cache=True)
def edge_normal(region: np.ndarray, k: int, n: int, normal: np.ndarray) -> float:
    """Writes the outward unit normal (2,) of edge k of a counter-clockwise polygon; returns b in normal . x <= b.

    An edge of no length has the normal 0 and bounds nothing.

    Args:
        region: (V, 2) polygon, counter-clockwise [m].
        k: number of the edge.
        n: number of vertices that count.
        normal: (2,) written.
    """
    j = k + 1 if k + 1 < n else 0
    dx, dy = region[j, 0] - region[k, 0], region[j, 1] - region[k, 1]
    length = np.sqrt(dx * dx + dy * dy)
    if length < 1e-9:
        normal[0], normal[1] = 0.0, 0.0
        return np.inf
    normal[0], normal[1] = dy / length, -dx / length
    return normal[0] * region[k, 0] + normal[1] * region[k, 1]
