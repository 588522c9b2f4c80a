"""A floating-base tree of one-degree-of-freedom joints as packed arrays, and its kinematics in numba.

Bodies that are welded together are one link. Link i > 0 hangs on its parent by joint i, which turns about (or slides
along) the z axis of a frame F fixed in the parent; the link's own frame L is the joint's moving frame, so

    X_WL[i] = X_WL[parent i] X_PF[i] Rz(q)        revolute        X_WL[parent i] X_PF[i] Tz(q)        prismatic

and the joint's axis in W is the third column of R_WL[i], through the point p_WL[i] (Featherstone, Rigid Body Dynamics
Algorithms, 2008, sec. 4.4, with every joint frame turned so that its axis is z).

Positions and velocities are in Drake's order: q = (quaternion w x y z, p_WB, joints), v = (w_WB, v_WB, joints), both in
W and B the floating base, link 0. Joint i owns q[6 + i] and v[5 + i]. Nothing here imports Drake.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit


class KinematicTree(NamedTuple):
    """The constants of a tree of n links with E named frames; all arrays are C-contiguous.

    Attributes:
        parent: (n,) -1 for the base, else less than the link's own index.
        prismatic: (n,) whether the link's joint slides.
        R_PF, p_PF: (n, 3, 3) and (n, 3) the joint's frame in the parent link [m].
        mass: (n,) [kg].
        p_LLcm: (n, 3) centre of mass in the link [m].
        I_LLcm_L: (n, 3, 3) inertia about the centre of mass, in the link's axes [kg m^2].
        frame_link: (E,) link that carries each named frame.
        R_LE, p_LE: (E, 3, 3) and (E, 3) the named frames in their links [m].
        lower, upper: (n - 1,) position limits of the joints [rad or m].
        speed: (n - 1,) speed limits [rad/s or m/s].
        total_mass: [kg].
    """

    parent: np.ndarray
    prismatic: np.ndarray
    R_PF: np.ndarray
    p_PF: np.ndarray
    mass: np.ndarray
    p_LLcm: np.ndarray
    I_LLcm_L: np.ndarray
    frame_link: np.ndarray
    R_LE: np.ndarray
    p_LE: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray
    total_mass: float


@njit(cache=True)
def rotation_of_quaternion(q: np.ndarray, R: np.ndarray) -> None:
    """Writes the (3, 3) rotation of q = (w, x, y, z), which need not be normalised.

    Args:
        q: (4 or more,) starts with the quaternion.
        R: (3, 3) written.
    """
    w, x, y, z = q[0], q[1], q[2], q[3]
    s = 2.0 / (w * w + x * x + y * y + z * z)
    R[0, 0] = 1.0 - s * (y * y + z * z)
    R[0, 1] = s * (x * y - w * z)
    R[0, 2] = s * (x * z + w * y)
    R[1, 0] = s * (x * y + w * z)
    R[1, 1] = 1.0 - s * (x * x + z * z)
    R[1, 2] = s * (y * z - w * x)
    R[2, 0] = s * (x * z - w * y)
    R[2, 1] = s * (y * z + w * x)
    R[2, 2] = 1.0 - s * (x * x + y * y)


@njit(cache=True)
def forward(tree: KinematicTree, q: np.ndarray, R: np.ndarray, p: np.ndarray) -> None:
    """Writes every link's pose in W: rotations R (n, 3, 3) and origins p (n, 3) [m] from positions q (7 + n - 1,).

    Args:
        tree: n links.
        q: (6 + n,) positions.
        R, p: (n, 3, 3) and (n, 3) written.
    """
    rotation_of_quaternion(q, R[0])
    p[0, 0], p[0, 1], p[0, 2] = q[4], q[5], q[6]
    for i in range(1, tree.parent.shape[0]):
        k = tree.parent[i]
        theta = q[6 + i]
        slide = 0.0
        c, s = 1.0, 0.0
        if tree.prismatic[i]:
            slide = theta
        else:
            c, s = np.cos(theta), np.sin(theta)
        for a in range(3):
            r0, r1, r2 = R[k, a, 0], R[k, a, 1], R[k, a, 2]
            x = r0 * tree.R_PF[i, 0, 0] + r1 * tree.R_PF[i, 1, 0] + r2 * tree.R_PF[i, 2, 0]
            y = r0 * tree.R_PF[i, 0, 1] + r1 * tree.R_PF[i, 1, 1] + r2 * tree.R_PF[i, 2, 1]
            z = r0 * tree.R_PF[i, 0, 2] + r1 * tree.R_PF[i, 1, 2] + r2 * tree.R_PF[i, 2, 2]
            p[i, a] = p[k, a] + r0 * tree.p_PF[i, 0] + r1 * tree.p_PF[i, 1] + r2 * tree.p_PF[i, 2] + slide * z
            R[i, a, 0] = c * x + s * y
            R[i, a, 1] = c * y - s * x
            R[i, a, 2] = z


@njit(cache=True)
def frame_pose(tree: KinematicTree, R: np.ndarray, p: np.ndarray, e: int, R_WE: np.ndarray, p_WE: np.ndarray) -> None:
    """Writes the pose of named frame e in W, R_WE (3, 3) and p_WE (3,) [m], from the link poses of `forward`.

    Args:
        tree: n links.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        e: number of the named frame.
        R_WE, p_WE: (3, 3) and (3,) written.
    """
    k = tree.frame_link[e]
    for a in range(3):
        r0, r1, r2 = R[k, a, 0], R[k, a, 1], R[k, a, 2]
        p_WE[a] = p[k, a] + r0 * tree.p_LE[e, 0] + r1 * tree.p_LE[e, 1] + r2 * tree.p_LE[e, 2]
        for b in range(3):
            R_WE[a, b] = r0 * tree.R_LE[e, 0, b] + r1 * tree.R_LE[e, 1, b] + r2 * tree.R_LE[e, 2, b]


@njit(cache=True)
def point_jacobian(
    tree: KinematicTree, R: np.ndarray, p: np.ndarray, link: int, x: float, y: float, z: float, J: np.ndarray
) -> None:
    """Writes J (6, nv): angular, then linear velocity in W of the point (x, y, z) [m] of W that moves with a link.

    Args:
        tree: n links.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        link: number of the link.
        x, y, z: the point in W [m].
        J: (6, nv) written.
    """
    J[:] = 0.0
    for a in range(3):
        J[a, a] = 1.0
        J[3 + a, 3 + a] = 1.0
    rx, ry, rz = x - p[0, 0], y - p[0, 1], z - p[0, 2]
    J[3, 1], J[3, 2] = rz, -ry
    J[4, 0], J[4, 2] = -rz, rx
    J[5, 0], J[5, 1] = ry, -rx
    k = link
    while k > 0:
        ax, ay, az = R[k, 0, 2], R[k, 1, 2], R[k, 2, 2]
        col = 5 + k
        if tree.prismatic[k]:
            J[3, col], J[4, col], J[5, col] = ax, ay, az
        else:
            rx, ry, rz = x - p[k, 0], y - p[k, 1], z - p[k, 2]
            J[0, col], J[1, col], J[2, col] = ax, ay, az
            J[3, col] = ay * rz - az * ry
            J[4, col] = az * rx - ax * rz
            J[5, col] = ax * ry - ay * rx
        k = tree.parent[k]


@njit(cache=True)
def frame_jacobian(tree: KinematicTree, R: np.ndarray, p: np.ndarray, e: int, J: np.ndarray) -> None:
    """Writes J (6, nv): spatial velocity (w_WE, v_WE) of named frame e, in W, a unit of v each column.

    Args:
        tree: n links.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        e: number of the named frame.
        J: (6, nv) written.
    """
    k = tree.frame_link[e]
    o = tree.p_LE[e]
    x = p[k, 0] + R[k, 0, 0] * o[0] + R[k, 0, 1] * o[1] + R[k, 0, 2] * o[2]
    y = p[k, 1] + R[k, 1, 0] * o[0] + R[k, 1, 1] * o[1] + R[k, 1, 2] * o[2]
    z = p[k, 2] + R[k, 2, 0] * o[0] + R[k, 2, 1] * o[1] + R[k, 2, 2] * o[2]
    point_jacobian(tree, R, p, k, x, y, z, J)


@njit(cache=True)
def center_of_mass(tree: KinematicTree, R: np.ndarray, p: np.ndarray, com: np.ndarray) -> None:
    """Writes the centre of mass of the whole tree in W, com (3,) [m].

    Args:
        tree: n links.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        com: (3,) written.
    """
    for a in range(3):
        com[a] = 0.0
        for i in range(tree.parent.shape[0]):
            o = tree.p_LLcm[i]
            com[a] += tree.mass[i] * (p[i, a] + R[i, a, 0] * o[0] + R[i, a, 1] * o[1] + R[i, a, 2] * o[2])
        com[a] /= tree.total_mass


@njit(cache=True)
def com_jacobian(tree: KinematicTree, R: np.ndarray, p: np.ndarray, com: np.ndarray, J: np.ndarray) -> None:
    """Writes the centre of mass com (3,) [m] in W and its Jacobian J (3, nv).

    Joint i moves the links that it carries; with their mass m_i and first moment s_i about the base's origin,
    M J[:, i] = axis_i x (s_i - m_i (p_i - p_0)).

    Args:
        tree: n links.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        com: (3,) written.
        J: (3, nv) written.
    """
    n = tree.parent.shape[0]
    m = np.empty(n)
    s = np.empty((n, 3))
    for i in range(n):
        o = tree.p_LLcm[i]
        m[i] = tree.mass[i]
        for a in range(3):
            s[i, a] = m[i] * (p[i, a] - p[0, a] + R[i, a, 0] * o[0] + R[i, a, 1] * o[1] + R[i, a, 2] * o[2])
    for i in range(n - 1, 0, -1):
        k = tree.parent[i]
        m[k] += m[i]
        for a in range(3):
            s[k, a] += s[i, a]
    M = tree.total_mass
    for i in range(1, n):
        ax, ay, az = R[i, 0, 2] / M, R[i, 1, 2] / M, R[i, 2, 2] / M
        if tree.prismatic[i]:
            J[0, 5 + i], J[1, 5 + i], J[2, 5 + i] = m[i] * ax, m[i] * ay, m[i] * az
            continue
        rx = s[i, 0] - m[i] * (p[i, 0] - p[0, 0])
        ry = s[i, 1] - m[i] * (p[i, 1] - p[0, 1])
        rz = s[i, 2] - m[i] * (p[i, 2] - p[0, 2])
        J[0, 5 + i] = ay * rz - az * ry
        J[1, 5 + i] = az * rx - ax * rz
        J[2, 5 + i] = ax * ry - ay * rx
    rx, ry, rz = s[0, 0] / M, s[0, 1] / M, s[0, 2] / M
    J[:, :6] = 0.0
    J[0, 1], J[0, 2], J[0, 3] = rz, -ry, 1.0
    J[1, 0], J[1, 2], J[1, 4] = -rz, rx, 1.0
    J[2, 0], J[2, 1], J[2, 5] = ry, -rx, 1.0
    com[0], com[1], com[2] = p[0, 0] + rx, p[0, 1] + ry, p[0, 2] + rz


@njit(cache=True)
def _carried_inertia(
    tree: KinematicTree, R: np.ndarray, p: np.ndarray, m: np.ndarray, s: np.ndarray, H: np.ndarray
) -> None:
    """Writes what each joint carries: mass m (n,), first moment s (n, 3) and inertia H (n, 3, 3) about p_WB, in W."""
    n = tree.parent.shape[0]
    T = np.empty((3, 3))
    c = np.empty(3)
    for i in range(n):
        o, I_L = tree.p_LLcm[i], tree.I_LLcm_L[i]
        m[i] = tree.mass[i]
        for a in range(3):
            r0, r1, r2 = R[i, a, 0], R[i, a, 1], R[i, a, 2]
            c[a] = p[i, a] - p[0, a] + r0 * o[0] + r1 * o[1] + r2 * o[2]
            s[i, a] = m[i] * c[a]
            for b in range(3):
                T[a, b] = r0 * I_L[0, b] + r1 * I_L[1, b] + r2 * I_L[2, b]
        cc = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
        for a in range(3):
            for b in range(3):
                H[i, a, b] = T[a, 0] * R[i, b, 0] + T[a, 1] * R[i, b, 1] + T[a, 2] * R[i, b, 2] - m[i] * c[a] * c[b]
            H[i, a, a] += m[i] * cc
    for i in range(n - 1, 0, -1):
        k = tree.parent[i]
        m[k] += m[i]
        for a in range(3):
            s[k, a] += s[i, a]
            for b in range(3):
                H[k, a, b] += H[i, a, b]


@njit(cache=True)
def momentum_matrix(tree: KinematicTree, R: np.ndarray, p: np.ndarray, com: np.ndarray, A: np.ndarray) -> None:
    """Writes com (3,) [m] and the centroidal momentum matrix A (6, nv) (Orin, Goswami & Lee 2013, eq. 23).

    A v = (angular momentum about the centre of mass [kg m^2/s], linear momentum [kg m/s]), both in W. Each column is
    the momentum of what the joint carries when it alone moves, taken about p_WB and then shifted to the CoM.

    Args:
        tree: n links.
        R, p: (n, 3, 3) and (n, 3) poses of the links in W [m].
        com: (3,) written.
        A: (6, nv) written.
    """
    n = tree.parent.shape[0]
    m, s, H = np.empty(n), np.empty((n, 3)), np.empty((n, 3, 3))
    _carried_inertia(tree, R, p, m, s, H)
    cx, cy, cz = s[0, 0] / m[0], s[0, 1] / m[0], s[0, 2] / m[0]
    com[0], com[1], com[2] = p[0, 0] + cx, p[0, 1] + cy, p[0, 2] + cz
    for col in range(6 + n - 1):
        i = max(col - 5, 0)
        ax, ay, az = R[i, 0, 2], R[i, 1, 2], R[i, 2, 2]
        if col < 6:
            ax, ay, az = 1.0 * (col % 3 == 0), 1.0 * (col % 3 == 1), 1.0 * (col % 3 == 2)
        sx, sy, sz = s[i, 0], s[i, 1], s[i, 2]
        if 3 <= col < 6 or (i > 0 and tree.prismatic[i]):
            lx, ly, lz = m[i] * ax, m[i] * ay, m[i] * az
            hx, hy, hz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
        else:
            ox, oy, oz = p[i, 0] - p[0, 0], p[i, 1] - p[0, 1], p[i, 2] - p[0, 2]
            rx, ry, rz = sx - m[i] * ox, sy - m[i] * oy, sz - m[i] * oz
            lx, ly, lz = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
            ux, uy, uz = ay * oz - az * oy, az * ox - ax * oz, ax * oy - ay * ox
            hx = H[i, 0, 0] * ax + H[i, 0, 1] * ay + H[i, 0, 2] * az - (sy * uz - sz * uy)
            hy = H[i, 1, 0] * ax + H[i, 1, 1] * ay + H[i, 1, 2] * az - (sz * ux - sx * uz)
            hz = H[i, 2, 0] * ax + H[i, 2, 1] * ay + H[i, 2, 2] * az - (sx * uy - sy * ux)
        A[0, col] = hx - (cy * lz - cz * ly)
        A[1, col] = hy - (cz * lx - cx * lz)
        A[2, col] = hz - (cx * ly - cy * lx)
        A[3, col], A[4, col], A[5, col] = lx, ly, lz


@njit(cache=True)
def rotation_error(R_WA: np.ndarray, R_WB: np.ndarray, w: np.ndarray) -> float:
    """Writes w (3,) [rad], the rotation vector in W that takes A to B, exp([w]x) R_WA = R_WB; returns its angle.

    Args:
        R_WA, R_WB: (3, 3) orientations.
        w: (3,) written.
    """
    # E = R_WB R_AW; its skew part is sin(angle) axis, its trace 1 + 2 cos(angle).
    wx, wy, wz, trace = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        wx += 0.5 * (R_WB[2, k] * R_WA[1, k] - R_WB[1, k] * R_WA[2, k])
        wy += 0.5 * (R_WB[0, k] * R_WA[2, k] - R_WB[2, k] * R_WA[0, k])
        wz += 0.5 * (R_WB[1, k] * R_WA[0, k] - R_WB[0, k] * R_WA[1, k])
        trace += R_WB[0, k] * R_WA[0, k] + R_WB[1, k] * R_WA[1, k] + R_WB[2, k] * R_WA[2, k]
    s = np.sqrt(wx * wx + wy * wy + wz * wz)
    c = 0.5 * (trace - 1.0)
    angle = np.arctan2(s, c)
    if s < 1e-6 and c < 0.0:
        return _half_turn(R_WA, R_WB, angle, w)
    f = angle / s if s > 1e-9 else 1.0
    w[0], w[1], w[2] = f * wx, f * wy, f * wz
    return angle


@njit(cache=True)
def _half_turn(R_WA: np.ndarray, R_WB: np.ndarray, angle: float, w: np.ndarray) -> float:
    """The case of `rotation_error` in which the skew part vanishes: the axis is a column of E + 1 = 2 axis axis^T."""
    best = -1.0
    for j in range(3):
        u0, u1, u2 = 0.0, 0.0, 0.0
        for k in range(3):
            u0 += R_WB[0, k] * R_WA[j, k]
            u1 += R_WB[1, k] * R_WA[j, k]
            u2 += R_WB[2, k] * R_WA[j, k]
        u0, u1, u2 = u0 + (j == 0), u1 + (j == 1), u2 + (j == 2)
        length = np.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
        if length > best:
            best = length
            w[0], w[1], w[2] = angle * u0 / length, angle * u1 / length, angle * u2 / length
    return angle


@njit(cache=True)
def integrate(q: np.ndarray, v: np.ndarray, dt: float, out: np.ndarray) -> None:
    """Writes the positions after moving at constant v (nv,) for dt [s]; the quaternion by the exponential map.

    The base's angular velocity is in W, so quat(out) = exp(w dt / 2) * quat(q), normalised. `out` may be `q`.

    Args:
        q: (nq,) positions.
        v: (nv,) velocity, in Drake's order [rad/s, m/s].
        dt: [s].
        out: (nq,) written.
    """
    x, y, z = 0.5 * dt * v[0], 0.5 * dt * v[1], 0.5 * dt * v[2]
    half = np.sqrt(x * x + y * y + z * z)
    f = np.sin(half) / half if half > 1e-8 else 1.0 - half * half / 6.0
    c, x, y, z = np.cos(half), f * x, f * y, f * z
    w0, x0, y0, z0 = q[0], q[1], q[2], q[3]
    w1 = c * w0 - x * x0 - y * y0 - z * z0
    x1 = c * x0 + x * w0 + y * z0 - z * y0
    y1 = c * y0 + y * w0 + z * x0 - x * z0
    z1 = c * z0 + z * w0 + x * y0 - y * x0
    norm = np.sqrt(w1 * w1 + x1 * x1 + y1 * y1 + z1 * z1)
    out[0], out[1], out[2], out[3] = w1 / norm, x1 / norm, y1 / norm, z1 / norm
    for i in range(4, q.shape[0]):
        out[i] = q[i] + dt * v[i - 1]


@njit(cache=True)
def difference(q1: np.ndarray, q2: np.ndarray, v: np.ndarray) -> None:
    """Writes the v (nv,) with integrate(q1, v, 1) = q2, turning the base by the shorter way (at most pi).

    Args:
        q1, q2: (nq,) positions.
        v: (nv,) written [rad, m].
    """
    w1, x1, y1, z1 = q1[0], q1[1], q1[2], q1[3]
    w2, x2, y2, z2 = q2[0], q2[1], q2[2], q2[3]
    # quat(q2) * conj(quat(q1)); atan2 forgives quaternions that are not normalised.
    c = w2 * w1 + x2 * x1 + y2 * y1 + z2 * z1
    x = -w2 * x1 + x2 * w1 - y2 * z1 + z2 * y1
    y = -w2 * y1 + y2 * w1 - z2 * x1 + x2 * z1
    z = -w2 * z1 + z2 * w1 - x2 * y1 + y2 * x1
    if c < 0.0:
        c, x, y, z = -c, -x, -y, -z
    s = np.sqrt(x * x + y * y + z * z)
    f = 2.0 * np.arctan2(s, c) / s if s > 1e-9 * c else 2.0 / c
    v[0], v[1], v[2] = f * x, f * y, f * z
    for i in range(4, q1.shape[0]):
        v[i - 1] = q2[i] - q1[i]
