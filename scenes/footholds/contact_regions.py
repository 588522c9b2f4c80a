"""Where an end effector may touch a terrain, as a union of circles on its surfaces (Lin 2020 sec. 4.5.1 and 4.5.2).

A circle holds positions of the end effector's centre, not of its patch: wherever the centre is within the circle, the
whole patch lies on the surface with nothing above it, for every rotation about the normal that was asked for. A
contact's distance from a circle (Lin 2020 eq. 4.4) says how far a plan is from a terrain.

Lin 2020: "Learning for Humanoid Multi-Contact Navigation Planning". The cover is that of Chung & Khatib 2015,
"Contact-consistent elastic strips for multi-contact locomotion planning of humanoid robots", ICRA.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from scenes.contact import contact_rotation
from scenes.effector import EFFECTORS
from scenes.footholds.circle_cover import cover_free_space
from scenes.footholds.free_space import ROUNDING, free_space, turned_footprint
from scenes.footholds.projection import PATCH_MARGIN, patch_shape
from scenes.robots.robot import EffectorSpec
from scenes.terrain.packed_terrain import PackedTerrain

COARSEST = 0.08  # [m] first spacing of the samples
FINEST = 0.01  # [m] d_cr,min, where refinement stops
TILT_WEIGHT = 0.5  # [m] w_r of Lin 2020 eq. 4.4, what a normal that points sideways counts
TINY = 1e-9  # [m] distances that count as equal
HOLDS = 1e-5  # [m] a contact this far off a circle is still held by it


@dataclass(frozen=True, eq=False)
class ContactRegions:
    """K circles on surfaces, for one end effector.

    Attributes:
        surface: (K,) index into the terrain's surfaces.
        X_WR: (K, 4, 4) frame R of each circle: z the surface's outward normal, origin the circle's centre.
        radius: (K,) [m].
    """

    surface: np.ndarray
    X_WR: np.ndarray
    radius: np.ndarray

    def __len__(self) -> int:
        return len(self.radius)

    def distance(self, X_WC: np.ndarray, tilt_weight: float = TILT_WEIGHT) -> np.ndarray:
        """(K,) distance of a contact pose from every circle [m], eq. 4.4 of Lin 2020:

            xi = sqrt(d_xy^2 + d_z^2) + w_r (1 - n_C . n_R),   d_xy = max(0, |(x, y)| - r),   d_z = |z|

        with (x, y, z) the contact point in the circle's frame. 0 where the pose is a contact of the circle.

        Args:
            X_WC: (4, 4).
            tilt_weight: w_r [m].
        """
        along, across = self._offsets(X_WC)
        sideways = np.maximum(np.linalg.norm(across, axis=1) - self.radius, 0.0)
        tilt = 1.0 - self.X_WR[:, :3, 2] @ X_WC[:3, 2]
        return np.hypot(sideways, along) + tilt_weight * tilt

    def nearest(self, X_WC: np.ndarray, tilt_weight: float = TILT_WEIGHT) -> tuple[int, float]:
        """Index of the nearest circle and its distance [m]; (-1, inf) where there is no circle.

        Of several that hold the contact, the one whose edge is furthest away is nearest.

        Args:
            X_WC: (4, 4) contact pose.
            tilt_weight: w_r of eq. 4.4 of Lin 2020 [m].
        """
        if not len(self):
            return -1, np.inf
        distance = self.distance(X_WC, tilt_weight)
        least = float(distance.min())
        tied = np.flatnonzero(distance <= least + TINY)
        depth = self.radius[tied] - np.linalg.norm(self._offsets(X_WC)[1][tied], axis=1)
        best = int(tied[np.argmax(depth)])
        return best, float(distance[best])

    def furthest_along(self, X_WC: np.ndarray, way: np.ndarray) -> int:
        """Index of the circle that holds the contact and lets it go furthest along `way` (3,) before it meets the rim.

        -1 where no circle holds the contact, or `way` is none.

        Args:
            X_WC: (4, 4) contact pose.
            way: (3,) direction in W, of any length.
        """
        along, across = self._offsets(X_WC)
        length = float(np.linalg.norm(way))
        holds = (np.abs(along) < HOLDS) & ((across**2).sum(axis=1) < (self.radius + HOLDS) ** 2)
        if length < HOLDS or not holds.any():
            return -1
        ahead = across @ (np.asarray(way) / length)
        reach = np.sqrt(np.maximum(ahead**2 - (across**2).sum(axis=1) + self.radius**2, 0.0)) - ahead
        return int(np.argmax(np.where(holds, reach, -np.inf)))

    def project(self, X_WC: np.ndarray, index: int) -> np.ndarray:
        """(4, 4) the contact pose moved to the nearest point of a circle and turned until its normal is the circle's.

        The turn is the smallest that does it; of those by 180 deg one about the pose's x axis.

        Args:
            X_WC: (4, 4) contact pose.
            index: of the circle.
        """
        across = self._offsets(X_WC)[1][index]
        length = np.linalg.norm(across)
        inside = across if length <= self.radius[index] else across * (self.radius[index] / length)
        projected = np.array(X_WC, dtype=float)
        projected[:3, 3] = self.X_WR[index, :3, 3] + inside
        projected[:3, :3] = _least_turn(X_WC[:3, 2], self.X_WR[index, :3, 2], X_WC[:3, 0]) @ X_WC[:3, :3]
        return projected

    def where(self, keep: np.ndarray) -> ContactRegions:
        """Those that the mask or the indices keep."""
        return ContactRegions(self.surface[keep], self.X_WR[keep], self.radius[keep])

    def _offsets(self, X_WC: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(K,) height of the contact point over each circle's plane, and (K, 3) its offset within the plane in W [m]."""
        normal = self.X_WR[:, :3, 2]
        offset = X_WC[:3, 3] - self.X_WR[:, :3, 3]
        along = (offset * normal).sum(axis=1)
        return along, offset - along[:, None] * normal


def _least_turn(a: np.ndarray, b: np.ndarray, spare: np.ndarray) -> np.ndarray:
    """(3, 3) the smallest rotation that takes the unit vector a to b (Rodrigues); about `spare` where b = -a."""
    w, c = np.cross(a, b), float(a @ b)
    if c < -1.0 + 1e-12:
        return 2.0 * np.outer(spare, spare) - np.eye(3)
    W = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    return np.eye(3) + W + W @ W / (1.0 + c)


def cover_terrain(
    packed: PackedTerrain,
    effector: EffectorSpec,
    *,
    heading: float | None = None,
    turn: float = 0.0,
    surfaces: Iterable[int] | None = None,
    around: np.ndarray | None = None,
    reach: float = np.inf,
    coarsest: float = COARSEST,
    finest: float = FINEST,
) -> ContactRegions:
    """Covers the surfaces that an end effector may touch with circles.

    Samples stand on a grid. From each that no circle holds yet a circle grows that holds it; cells that one circle does
    not cover are sampled again at half the spacing, down to `finest`.

    Args:
        packed: the terrain.
        effector: gives the patch and what the foot needs beyond it.
        heading: yaw of the end effector [rad]; palms on walls point up whatever it is. None allows every rotation
            about the normal, as documented: the surface is shrunk by a polygon around the circle around the patch.
        turn: how far the contact may turn about the normal from there, to either side [rad].
        surfaces: indices of those to cover, None for all.
        around: (3,) point near which circles are wanted, None for everywhere [m].
        reach: half width of the square about it, in the plane of each surface, that circles stay in [m].
        coarsest, finest: spacing of the samples, first and last [m].
    """
    index, patch = EFFECTORS.index(effector.name), patch_shape(effector)
    low, high = (-np.pi, np.pi) if heading is None else (-turn, turn)
    footprint = turned_footprint(patch, low, high, PATCH_MARGIN, ROUNDING)
    chosen = range(packed.num_surfaces) if surfaces is None else surfaces
    surface, X_WR, radius = [np.zeros(0, np.int64)], [np.zeros((0, 4, 4))], [np.zeros(0)]
    for k in chosen:
        if not packed.allowed[k, index]:
            continue
        R = contact_rotation(effector.name, packed.normal[k], 0.0 if heading is None else heading)
        sides = np.zeros((0, 3)) if around is None else _square(R[:, :2].T @ np.asarray(around), reach)
        circles = cover_free_space(free_space(packed, k, R, footprint, sides), coarsest, finest)
        X = np.tile(np.eye(4), (len(circles), 1, 1))
        X[:, :3, :3] = R
        X[:, :3, 3] = circles[:, :2] @ R[:, :2].T + packed.offset[k] * R[:, 2]
        surface.append(np.full(len(circles), k))
        X_WR.append(X)
        radius.append(circles[:, 2])
    return ContactRegions(np.concatenate(surface), np.concatenate(X_WR), np.concatenate(radius))


def _square(middle: np.ndarray, half: float) -> np.ndarray:
    """(4, 3) half planes of a square along the axes: rows (a, b, c) mean a u + b v <= c [m]."""
    axes = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    return np.column_stack([axes, axes @ middle + half])
