"""Which wrenches a contact can carry: friction cones, and the distance of a wrench from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize
import scipy.sparse

from .geometry import in_world


@dataclass(frozen=True)
class Cone:
    """A friction cone whose cross-section is a regular polygon; `sides` 0 is the true, round cone.

    Attributes:
        sides: of the polygon.
        radius: circumradius at unit friction and unit normal force.
        phase: angle of the first vertex from the contact frame's x axis [rad].
    """

    sides: int
    radius: float = 1.0
    phase: float = 0.0

    def gauge(self, tangential: np.ndarray) -> np.ndarray:
        """(...,) least friction coefficient whose cone holds unit normal force and `tangential` (..., 2)."""
        if not self.sides:
            return np.linalg.norm(tangential, axis=-1)
        middle = self.phase + np.pi * (2 * np.arange(self.sides) + 1) / self.sides
        rows = np.stack([np.cos(middle), np.sin(middle)]) / (self.radius * np.cos(np.pi / self.sides))
        return (tangential @ rows).max(axis=-1)

    def rays(self, friction: float) -> np.ndarray:
        """(3, G) generators with unit normal force; the round cone is replaced by its inscribed 32-gon.

        The 32-gon holds every vertex of the octagon and of the 16-gon, and reaches 99.5 % of the round cone elsewhere.
        """
        sides = self.sides or 32
        angle = self.phase + 2 * np.pi * np.arange(sides) / sides
        reach = friction * self.radius
        return np.stack([reach * np.cos(angle), reach * np.sin(angle), np.ones(sides)])


TRUE_CONE = Cone(0)
CONES = {
    "inner": Cone(8),  # regular octagon inscribed in the true cone
    "square": Cone(4, 1.0, np.pi / 4),  # |fx|, |fy| <= mu / sqrt 2 fz
    "second_order": TRUE_CONE,
    "diamond": Cone(4, math.sqrt(2.0)),  # |fx| + |fy| <= sqrt 2 mu fz: reaches outside the true cone
}


def wrench_distance(
    cone: Cone,
    f_C: np.ndarray,
    cop_C: np.ndarray,
    torque_n: np.ndarray,
    supports: Sequence[np.ndarray],
    friction: np.ndarray,
) -> np.ndarray:
    """(K,) how far each contact wrench is from a sum of corner forces inside the cone, in units of the force.

    Most wrenches pass a closed form: share the force among the corners by weights that put it at the centre of pressure,
    and turn it about that point until the torque is right. The rest go to one linear program.

    Args:
        cone: of the corner forces.
        f_C: (K, 3) force in the contact frame.
        cop_C: (K, 2) centre of pressure in the contact frame [m].
        torque_n: (K,) torque about the normal at the centre of pressure.
        supports: K of (n, 2), corners of the supports in the contact frame [m], counter-clockwise.
        friction: (K,) coefficients.
    """
    distance, sizes = np.zeros(len(f_C)), np.array([len(corners) for corners in supports], int)
    simple = np.zeros(len(f_C), bool)
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size)
        corners = np.array([supports[k] for k in rows.tolist()])
        simple[rows] = _simply_admissible(cone, f_C[rows], cop_C[rows], torque_n[rows], corners, friction[rows])
    rest = np.flatnonzero(~simple)
    if not len(rest):
        return distance
    moment = np.stack([cop_C[:, 1] * f_C[:, 2], -cop_C[:, 0] * f_C[:, 2]], axis=1)
    about_z = cop_C[:, 0] * f_C[:, 1] - cop_C[:, 1] * f_C[:, 0] + torque_n
    wrenches = np.column_stack([f_C, moment, about_z])
    blocks = [corner_wrenches(np.eye(4), supports[k], cone.rays(friction[k]), np.zeros(3)) for k in rest.tolist()]
    distance[rest] = distance_to_cones(blocks, wrenches[rest])
    return distance


def _simply_admissible(
    cone: Cone, f_C: np.ndarray, cop_C: np.ndarray, torque_n: np.ndarray, corners: np.ndarray, friction: np.ndarray
) -> np.ndarray:
    """(K,) whether the closed form finds corner forces inside the cone.

    Args:
        cone: of the corner forces.
        f_C: (K, 3) force in the contact frame.
        cop_C: (K, 2) centre of pressure in the contact frame [m].
        torque_n: (K,) torque about the normal at the centre of pressure.
        corners: (K, n, 2) of the supports [m].
        friction: (K,) coefficients.
    """
    weights = _shares(corners, cop_C)  # (K, n), sum 1
    arms = corners - cop_C[:, None]  # (K, n, 2) from the centre of pressure to the corners
    inertia = (weights * (arms**2).sum(2)).sum(1)  # [m^2], 0 at a corner: no torque there
    turn = torque_n / np.maximum(inertia, 1e-9)
    tangential = f_C[:, None, :2] + turn[:, None, None] * np.stack([-arms[..., 1], arms[..., 0]], axis=2)
    used = weights > 1e-9
    load = np.maximum(f_C[:, 2], 1e-12)
    needed = np.where(used, cone.gauge(tangential / load[:, None, None]), 0.0).max(axis=1)
    simple = (weights.min(axis=1) >= 0) & (f_C[:, 2] > 0) & (needed <= friction * (1 + 1e-9))
    simple &= (inertia > 1e-9) | (np.abs(torque_n) < 1e-10)
    simple |= (np.abs(f_C).max(axis=1) < 1e-10) & (np.abs(torque_n) < 1e-10)
    return simple


def _shares(corners: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(K, n) weights, sum 1, whose mean of the corners (K, n, 2) is a point (K, 2); NaN outside.

    Wachspress 1975, "A Rational Finite Element Basis": corner i weighs its own triangle with its neighbours times all
    triangles of the point and an edge that does not meet it. For a rectangle these are the bilinear weights.
    """
    before, after = np.roll(corners, 1, axis=1), np.roll(corners, -1, axis=1)
    edges = _doubled_area(corners, after, point[:, None])  # of edge i, from corner i to the next
    num = corners.shape[1]
    weights = _doubled_area(before, corners, after)
    for i in range(num):
        others = [k for k in range(num) if k not in (i, (i - 1) % num)]
        weights[:, i] *= edges[:, others].prod(axis=1)
    weights[(edges < 0).any(axis=1)] = np.nan
    return weights / weights.sum(axis=1, keepdims=True)


def _doubled_area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """(K, n) twice the areas of triangles of points (K, n, 2), positive counter-clockwise."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])


def corner_wrenches(X_WC: np.ndarray, support: np.ndarray, rays: np.ndarray, about: np.ndarray) -> np.ndarray:
    """(6, n G) force and moment about a point of W of every generator at every corner of a support.

    Args:
        X_WC: (4, 4) pose of the contact frame in W [m].
        support: (n, 2) corners in the contact frame [m].
        rays: (3, G) generators of the friction cone in the contact frame.
        about: (3,) point of moments in W [m].
    """
    forces = X_WC[:3, :3] @ rays
    columns = [np.vstack([forces, np.cross(p - about, forces.T).T]) for p in in_world(X_WC, support)]
    return np.hstack(columns)


def distance_to_cones(blocks: Sequence[np.ndarray], wrenches: np.ndarray) -> np.ndarray:
    """(K,) the l1 distance of each wrench (K, 6) from the cone that the columns of its block (6, G) span.

    One sparse linear program for all: min sum |slack| s.t. block x + slack = wrench, x >= 0.

    Args:
        blocks: K arrays (6, G) whose columns span the cones.
        wrenches: (K, 6) force and moment, in the frame and units of the blocks.
    """
    distances = []
    for first in range(0, len(blocks), 128):
        part = blocks[first : first + 128]
        slack = scipy.sparse.identity(6 * len(part), format="csc")
        cones = scipy.sparse.block_diag(part, format="csc")
        A = scipy.sparse.hstack([cones, slack, -slack], format="csc")
        num_rays = sum(block.shape[1] for block in part)
        cost = np.concatenate([np.zeros(num_rays), np.ones(12 * len(part))])
        target = wrenches[first : first + 128].ravel()
        answer = scipy.optimize.linprog(cost, A_eq=A, b_eq=target, method="highs")
        if answer.x is None:
            distances.append(np.full(len(part), np.nan))
            continue
        # Computed anew from the solver's forces, whatever its status: what they leave of the wrench.
        rest = cones @ np.maximum(answer.x[:num_rays], 0.0) - target
        distances.append(np.abs(rest).reshape(-1, 6).sum(axis=1))
    return np.concatenate(distances)
