"""Contact wrenches as sums of corner forces: what a flat support can transmit through a friction cone.

A wrench is admissible when it is such a sum with each corner force inside the cone; friction, centre of pressure and
yaw torque then hold together (Caron et al. 2015, see `optimization.balance.friction`).
"""

from __future__ import annotations

import numpy as np

from optimization.balance.friction import FrictionCone, cone_rows

SMALLEST = 1e-6  # [m] lengths below this count as this much where something is divided by them


def skew(a: np.ndarray) -> np.ndarray:
    """(..., 3, 3) matrix of the cross product with a (..., 3)."""
    out = np.zeros((*a.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = a[..., 2], -a[..., 1], a[..., 0]
    return out


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n, 3) cross products of (n, 3) and (n, 3): `numpy.cross` takes five times as long for short arrays.

    Args:
        a, b: (n, 3) vectors in one frame.
    """
    out = np.empty(a.shape)
    out[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    out[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    out[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return out


class CornerForces:
    """Forces at the V corners of the support of each of J contacts.

    Args:
        cone: `optimization.balance.friction.FrictionCone`.
        friction: (J,) coefficients.
        corners: (J, V, 2) corners of the supports in C [m].
        arm: moments are written in (unit of force) x arm [m].

    Attributes:
        count: V.
        map: (J, 6, 3 V) from the corner forces, one after another, to the wrench (f, m / arm).
        rows: (J, R, 3) faces of the (polyhedral) cone: rows @ f <= 0 for each corner force.
    """

    def __init__(self, cone: FrictionCone, friction: np.ndarray, corners: np.ndarray, arm: float) -> None:
        self.cone, self.friction = cone, friction
        self.count = num_corners = corners.shape[1]
        points = np.concatenate([corners, np.zeros((*corners.shape[:2], 1))], axis=2)
        self.map = np.zeros((len(corners), 6, 3 * num_corners))
        self.map[:, :3] = np.tile(np.eye(3), num_corners)
        self.map[:, 3:] = (skew(points) / arm).transpose(0, 2, 1, 3).reshape(-1, 3, 3 * num_corners)
        known = {mu: cone_rows(cone, mu)[:-1] for mu in np.unique(friction)}  # they imply f_z >= 0 together
        count = len(cone_rows(cone, 1.0)) - 1
        self.rows = np.array([known[mu] for mu in friction]).reshape(-1, count, 3)

    def wrench(self, forces: np.ndarray) -> np.ndarray:
        """(J, 6) wrenches of corner forces (J, V, 3)."""
        return np.einsum("jab,jb->ja", self.map, forces.reshape(-1, self.map.shape[2]))

    def project(self, forces: np.ndarray) -> np.ndarray:
        """Corner forces (J, V, 3) with the tangential part that sticks out of the cone cut off."""
        normal = np.maximum(forces[..., 2:], 0.0)
        tangent = forces[..., :2]
        if self.cone == "second_order":
            need = np.linalg.norm(tangent, axis=2, keepdims=True)
            limit = self.friction[:, None, None] * normal
        else:
            apothem = -self.rows[:, 0, 2][:, None, None]
            need = np.einsum("jra,jca->jcr", self.rows[..., :2], tangent).max(axis=2, keepdims=True)
            limit = apothem * normal
        scale = np.where(need > limit, limit / np.maximum(need, 1e-300), 1.0)
        return np.concatenate([tangent * scale, normal], axis=2)


def pressure_residuals(
    wrench: np.ndarray, half: np.ndarray, arm: float, least_load: float
) -> tuple[np.ndarray, np.ndarray]:
    """Centre of pressure over the support's lengths and normal torque there, with their derivatives.

    cop = (-m_y, m_x) / f_z and tau = m_z + (m_x f_x + m_y f_y) / f_z; f_z counts as `least_load` at least.

    Args:
        wrench: (J, 6) force and moment over `arm` about the contact points, in the contact frames.
        half: (J, 2) half extents of the supports [m].
        arm: unit of length of the moments [m].
        least_load: in the unit of force.

    Returns:
        (J, 3) cop_x / (2 hx), cop_y / (2 hy) [-] and tau / arm; (J, 3, 6) Jacobian.
    """
    fx, fy, fz, mx, my, mz = wrench.T
    load = np.maximum(fz, least_load)
    slope = np.where(fz > least_load, 1.0, 0.0)
    a, b = (arm / (2 * np.maximum(h, SMALLEST)) for h in half.T)
    turn = (mx * fx + my * fy) / load
    z = np.stack([-a * my / load, b * mx / load, mz + turn], axis=1)
    jacobian = np.zeros((len(wrench), 3, 6))
    jacobian[:, 0, 4], jacobian[:, 1, 3] = -a / load, b / load
    jacobian[:, 2, 0], jacobian[:, 2, 1], jacobian[:, 2, 5] = mx / load, my / load, 1.0
    jacobian[:, 2, 3], jacobian[:, 2, 4] = fx / load, fy / load
    jacobian[:, 0, 2], jacobian[:, 1, 2] = -slope * z[:, 0] / load, -slope * z[:, 1] / load
    jacobian[:, 2, 2] = -slope * turn / load
    return z, jacobian
