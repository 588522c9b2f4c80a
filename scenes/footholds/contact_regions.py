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
from scenes.effector import EFFECTORS, is_foot
from scenes.footholds.circle_cover import FreeSpace, cover_free_space
from scenes.footholds.projection import COVER_GAP, FOOT_CLEARANCE, PALM_CLEARANCE, PATCH_MARGIN
from scenes.robots.robot import EffectorSpec
from scenes.terrain.packed_terrain import PackedTerrain, near
from scenes.terrain.polygon import clip, convex_hull

COARSEST = 0.08  # [m] first spacing of the samples
FINEST = 0.01  # [m] d_cr,min, where refinement stops
TILT_WEIGHT = 0.5  # [m] w_r of Lin 2020 eq. 4.4, what a normal that points sideways counts
TURN_STEP = np.deg2rad(5.0)  # between the rotations whose hull stands for a range of them
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
            about the normal, as documented: the surface is shrunk by the circle around the patch.
        turn: how far the contact may turn about the normal from there, to either side [rad].
        surfaces: indices of those to cover, None for all.
        around: (3,) point near which circles are wanted, None for everywhere [m].
        reach: half width of the square about it, in the plane of each surface, that circles stay in [m].
        coarsest, finest: spacing of the samples, first and last [m].
    """
    index = EFFECTORS.index(effector.name)
    chosen = range(packed.num_surfaces) if surfaces is None else surfaces
    surface, X_WR, radius = [np.zeros(0, np.int64)], [np.zeros((0, 4, 4))], [np.zeros(0)]
    for k in chosen:
        if not packed.allowed[k, index]:
            continue
        X_WS = _surface_frame(packed, k, effector.name, 0.0 if heading is None else heading)
        window = None if around is None else (X_WS[:3, :2].T @ (np.asarray(around) - X_WS[:3, 3]), reach)
        space = _free_space(packed, k, X_WS, effector, None if heading is None else turn, window)
        circles = cover_free_space(space, coarsest, finest)
        X = np.tile(X_WS, (len(circles), 1, 1))
        X[:, :3, 3] += circles[:, :2] @ X_WS[:3, :2].T
        surface.append(np.full(len(circles), k))
        X_WR.append(X)
        radius.append(circles[:, 2])
    return ContactRegions(np.concatenate(surface), np.concatenate(X_WR), np.concatenate(radius))


def _free_space(
    packed: PackedTerrain,
    k: int,
    X_WS: np.ndarray,
    effector: EffectorSpec,
    turn: float | None,
    window: tuple[np.ndarray, float] | None = None,
) -> FreeSpace:
    """What bounds the end effector's centre on a surface, in the plane of X_WS.

    Half planes n . x <= c (the outline, shrunk by the patch), polygons that it may not enter (what stands above the
    surface, grown by the patch and what the foot needs beyond it), and a distance to keep from those. A window, a point of
    the plane and the half width of the square about it [m], adds half planes.
    """
    hx, hy = effector.half_extent
    front, back, side = effector.overhang
    patch = _footprint(hx, hx, hy, turn)
    body = _footprint(hx + front, hx + back, hy + side, turn)
    keep_patch, keep_body = 0.0, 0.0
    if turn is None:  # any rotation: discs around the patch and around all of the foot
        keep_patch, keep_body = float(np.hypot(hx, hy)), float(np.hypot(hx + max(front, back), hy + side))
    count = packed.count[k]
    normals = packed.edge_normal[k, :count] @ X_WS[:3, :2]
    offsets = packed.edge_offset[k, :count] - packed.edge_normal[k, :count] @ X_WS[:3, 3]
    inset = (patch @ normals.T).max(axis=0) + keep_patch + PATCH_MARGIN
    height = FOOT_CLEARANCE if is_foot(effector.name) else PALM_CLEARANCE
    reach = float(np.linalg.norm(body, axis=1).max()) + keep_body + height
    low, high = packed.low[k, :2] - reach, packed.high[k, :2] + reach
    grown = []
    around = near(packed, low[0], low[1], high[0], high[1])
    over = (packed.vertices[around] - X_WS[:3, 3]) @ X_WS[:3, 2]  # padded with copies, which change no bound
    tall = (over.max(axis=1) > COVER_GAP) & (over.min(axis=1) < height)
    if window is not None:
        flat = (packed.vertices[around] - X_WS[:3, 3]) @ X_WS[:3, :2] - window[0]
        most = window[1] + reach
        tall &= ((flat.min(axis=1) < most) & (flat.max(axis=1) > -most)).all(axis=1)
    for j in around[tall]:
        above = _slab(packed.vertices[j, : packed.count[j]], X_WS, height) if j != k else np.zeros((0, 2))
        if len(above):
            grown.append(convex_hull((above[:, None] - body[None]).reshape(-1, 2)))
    counts = np.array([len(g) for g in grown], np.int64)
    blockers = np.zeros((len(grown), int(counts.max(initial=1)), 2))
    for i, g in enumerate(grown):
        blockers[i, : len(g)] = g
    offsets = offsets - inset
    if window is not None:
        square = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        normals, offsets = np.vstack([normals, square]), np.append(offsets, square @ window[0] + window[1])
    return FreeSpace(np.ascontiguousarray(normals), offsets, blockers, counts, keep_body)


def _surface_frame(packed: PackedTerrain, k: int, effector: str, heading: float) -> np.ndarray:
    """(4, 4) X_WS: the axes of a contact with this heading, at the middle of the surface."""
    X_WS = np.eye(4)
    X_WS[:3, :3] = contact_rotation(effector, packed.normal[k], heading)
    X_WS[:3, 3] = packed.vertices[k, : packed.count[k]].mean(axis=0)
    return X_WS


def _footprint(front: float, back: float, side: float, turn: float | None) -> np.ndarray:
    """(F, 2) points whose hull holds the rectangle at every rotation up to `turn`; the centre alone for None."""
    if turn is None:
        return np.zeros((1, 2))
    corners = np.array([[front, side], [-back, side], [-back, -side], [front, -side]])
    steps = int(np.ceil(turn / TURN_STEP - 1e-9))
    angles = np.linspace(-turn, turn, 2 * steps + 1)
    # Between two samples a corner leaves their chord: as far out, the chord would touch the arc.
    outwards = 1.0 / np.cos(0.5 * turn / steps) if steps else 1.0
    c, s = np.cos(angles), np.sin(angles)
    turned = np.einsum("aij,fj->afi", np.stack([np.stack([c, -s], 1), np.stack([s, c], 1)], 1), corners)
    return outwards * turned.reshape(-1, 2)


def _slab(polygon: np.ndarray, X_WS: np.ndarray, height: float) -> np.ndarray:
    """(m, 2) the part of a polygon (K, 3) between `COVER_GAP` and `height` above the plane of X_WS, seen from above."""
    points = (polygon - X_WS[:3, 3]) @ X_WS[:3, :3]
    for sign, bound in ((1.0, height), (-1.0, -COVER_GAP)):
        points = clip(points, sign * points[:, 2] - bound)
    return points[:, :2]
