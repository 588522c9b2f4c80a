"""Soles that rest on part of themselves, or on several things at once: planks, bars, the edge of a step, a small stone.

What touches a sole are the parts of surfaces under it that lie within `FLUSH` of its plane and are turned from it by a degree
at most. Its support is their convex hull: between two planks it carries as a bridge does. Nothing else may rise into it.
Where no surface's plane supports it, a sole leans on edges: it has a plane of its own (`leaning_plane`), and what touches it is
what lies in that plane.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.contact import MOST_CORNERS, Contact, patch_corners
from scenes.effector import EFFECTORS
from scenes.footholds.leaning_plane import leaning_plane
from scenes.footholds.projection import (
    PatchShape,
    Placements,
    contact_axes,
    has_room,
    near_patches,
    no_placements,
    patch_shape,
)
from scenes.footholds.support_polygon import (
    EXACT,
    box_middle,
    convex_area,
    convex_hull,
    holds_a_disc,
    part_within,
    start_at_the_front_left,
    with_fewest_corners,
)
from scenes.robots.robot import EffectorSpec
from scenes.terrain.floors import FLUSH, LEVEL
from scenes.terrain.packed_terrain import PackedTerrain, height_at, near

INNER_RADIUS = 0.01  # [m] of the least support
LEAST_AREA = 2e-4  # [m^2] of the least support
ROUNDING = 1e-5  # [m] that a support is larger than the least, and lies nearer than `FLUSH`: files and checks round
MOST_POINTS = 256  # corners of all parts under one sole; where there are more the sole is given up
WIGGLE = 0.08  # [m] a sole may move this far to have more of itself supported
WIGGLES = 2
GAIN = 1.02  # factor of area for which it moves
NEAR_EDGE = 2e-3  # [m] what a sole that leans touches is this near to a polygon's edge; the verifier allows 3 mm
ON_EDGE = 1e-5  # [m] edges this near to the plane of a sole that leans on them touch it
TINY = 1e-7  # [m^2] parts of surfaces smaller than this do not count for friction


class Supports(NamedTuple):
    """What n contacts rest on.

    Attributes:
        corners: (n, 8, 2) corners in the contact frames [m], counter-clockwise, starting at the one farthest along x + y.
        count: (n,) how many are real; 0 where there is no contact.
        friction: (n,) least Coulomb coefficient of what touches.
    """

    corners: np.ndarray
    count: np.ndarray
    friction: np.ndarray

    def of(self, k: int, half_extent: tuple[float, float]) -> np.ndarray | None:
        """(V, 2) corners of one support, None where it is the whole patch.

        Args:
            k: which.
            half_extent: half length and half width of the patch [m].
        """
        corners = self.corners[k, : self.count[k]].copy()
        return None if np.array_equal(corners, patch_corners(half_extent)) else corners


def no_supports(n: int) -> Supports:
    """Room for the supports of n contacts, for a kernel to fill."""
    return Supports(np.zeros((n, MOST_CORNERS, 2)), np.zeros(n, np.int64), np.zeros(n))


@njit(cache=True)
def support_under(
    packed: PackedTerrain,
    effector: int,
    p: np.ndarray,
    R: np.ndarray,
    half_length: float,
    half_width: float,
    around: np.ndarray,
    corners: np.ndarray,
    leaning: bool,
) -> tuple[int, float, float]:
    """The support of a patch at pose (p, R): how many corners it has, its area [m^2] and the least friction; 0 where too small.

    Args:
        packed: the terrain.
        effector: index into `EFFECTORS`.
        p: (3,) contact point in W [m].
        R: (3, 3) contact frame in W.
        half_length: of the patch along x [m].
        half_width: of the patch along y [m].
        around: (m,) polygons near the patch, ascending.
        corners: (8, 2) written [m].
        leaning: whether only edges and corners touch.
    """
    points = np.empty((MOST_POINTS, 2))
    scratch = np.empty((2, packed.vertices.shape[1] + 8, 3))
    bound = np.array([half_length, half_width, ON_EDGE if leaning else FLUSH - ROUNDING])
    n, friction, reach = 0, np.inf, np.sqrt(half_length * half_length + half_width * half_width) + FLUSH
    for q in range(around.shape[0]):
        k = around[q]
        if k >= packed.num_surfaces:
            break  # ascending: triangles follow
        turned, apart = 0.0, not packed.allowed[k, effector]
        for a in range(3):
            turned += packed.normal[k, a] * R[a, 2]
            if packed.low[k, a] > p[a] + reach or packed.high[k, a] < p[a] - reach:
                apart = True
        if apart or (turned < LEVEL and not leaning):
            continue
        m, cur = part_within(packed.vertices[k], packed.count[k], p, R, bound, scratch)
        part = scratch[cur]
        if m < (1 if leaning else 3):
            continue
        if leaning and not _on_edges(packed.vertices[k], packed.count[k], p, R, part, m):
            continue  # a corner of the sole on a face: it would push along the face's normal, not the sole's
        if leaning or convex_area(part, m) > TINY:
            friction = min(friction, float(packed.friction[k]))
        if n + m > MOST_POINTS:
            return 0, 0.0, 0.0
        for i in range(m):
            for a in range(2):
                on_rim = abs(part[i, a]) > bound[a] - EXACT
                points[n, a] = (bound[a] if part[i, a] > 0.0 else -bound[a]) if on_rim else part[i, a]
            n += 1
    count = convex_hull(points, n)
    count = with_fewest_corners(points, count, corners)
    area = convex_area(corners, count)
    if count < 3 or area < LEAST_AREA or not holds_a_disc(corners, count, INNER_RADIUS + ROUNDING):
        return 0, 0.0, 0.0
    start_at_the_front_left(corners, count)
    return count, area, friction


@njit(cache=True)
def _on_edges(polygon: np.ndarray, count: int, p: np.ndarray, R: np.ndarray, part: np.ndarray, m: int) -> bool:
    """Whether the m points of a part (m, 3), in the frame (p, R), lie within `NEAR_EDGE` of a polygon's edges."""
    a, b = np.empty(3), np.empty(3)
    for i in range(m):
        nearest = np.inf
        for k in range(count):
            along = length = 0.0
            for r in range(3):
                here = p[r] + R[r, 0] * part[i, 0] + R[r, 1] * part[i, 1] + R[r, 2] * part[i, 2]
                a[r] = here - polygon[k, r]
                b[r] = polygon[(k + 1) % count, r] - polygon[k, r]
                along += a[r] * b[r]
                length += b[r] * b[r]
            share = min(max(along / max(length, 1e-300), 0.0), 1.0)
            off = 0.0
            for r in range(3):
                off += (a[r] - share * b[r]) ** 2
            nearest = min(nearest, off)
        if nearest > NEAR_EDGE * NEAR_EDGE:
            return False
    return True


@njit(cache=True)
def _rest_at(
    packed: PackedTerrain,
    effector: int,
    xy_yaw: np.ndarray,
    z_range: tuple[float, float],
    patch: PatchShape,
    around: np.ndarray,
    p: np.ndarray,
    R: np.ndarray,
    corners: np.ndarray,
    work: np.ndarray,
) -> tuple[int, int, float, float]:
    """The plane under a place that supports most of a sole: surface or -1, corners of the support, its area, its friction.

    A plane that leans on edges counts where no surface's does.

    Args:
        packed, effector, xy_yaw, z_range, patch, around: as in `rest_feet`, of one place.
        p: (3,), R: (3, 3) and corners: (8, 2) are written where a surface is found.
        work: (2, K + 8, 3) scratch.
    """
    x, y = xy_yaw[0], xy_yaw[1]
    reach = np.sqrt(patch.half_length**2 + patch.half_width**2)
    best, best_count, best_area, best_friction, best_z = -1, 0, 0.0, 0.0, -np.inf
    point, axes, found = np.empty(3), np.empty((3, 3)), np.empty((MOST_CORNERS, 2))
    for q in range(around.shape[0]):
        k = around[q]
        if k >= packed.num_surfaces:
            break  # ascending: triangles follow
        n = packed.normal[k]
        if not packed.allowed[k, effector] or n[2] < 1e-3:
            continue
        if x < packed.low[k, 0] - reach or x > packed.high[k, 0] + reach:
            continue
        if y < packed.low[k, 1] - reach or y > packed.high[k, 1] + reach:
            continue
        z = height_at(packed, k, x, y)
        if z > z_range[1] or z < z_range[0]:
            continue
        if best >= 0 and abs(z - best_z) < EXACT and np.abs(n - packed.normal[best]).max() < EXACT:
            continue  # another piece of the plane that was looked at
        contact_axes(n, xy_yaw[2], False, axes)
        point[0], point[1], point[2] = x, y, z
        count, area, friction = support_under(
            packed, effector, point, axes, patch.half_length, patch.half_width, around, found, False
        )
        if count == 0 or area <= best_area or not has_room(packed, k, point, axes, patch, around, work):
            continue
        best, best_count, best_area, best_friction, best_z = k, count, area, friction, z
        p[:], R[:], corners[:] = point, axes, found
    if best >= 0:
        return best, best_count, best_area, best_friction
    z, touched = leaning_plane(packed, xy_yaw, z_range, patch, around, axes[:, 2])
    if touched < 0 or touched >= packed.num_surfaces:
        return -1, 0, 0.0, 0.0
    contact_axes(axes[:, 2].copy(), xy_yaw[2], False, axes)
    point[0], point[1], point[2] = x, y, z
    count, area, friction = support_under(
        packed, effector, point, axes, patch.half_length, patch.half_width, around, found, True
    )
    if count == 0 or not has_room(packed, -1, point, axes, patch, around, work):
        return -1, 0, 0.0, 0.0
    p[:], R[:], corners[:] = point, axes, found
    return touched, count, area, friction


@njit(cache=True)
def rest_feet(
    packed: PackedTerrain,
    effector: int,
    xy_yaw: np.ndarray,
    wanted: np.ndarray,
    z_range: tuple[float, float],
    patch: PatchShape,
    wiggle: float,
    placed: Placements,
    supports: Supports,
) -> None:
    """Sets feet down on part of themselves at those of n places that are wanted; `xy_yaw` gets the places that they take.

    A foot moves towards the middle of its support, where that supports more of it.

    Args:
        packed: the terrain.
        effector: index into `EFFECTORS`.
        xy_yaw: (n, 3) place [m] and heading [rad] in W; written.
        wanted: (n,) bool.
        z_range: least and greatest height of the contact points in W [m].
        patch: the room that the foot takes.
        wiggle: how far a foot may move [m].
        placed: n contacts; written where a support is found.
        supports: n supports; written there.
    """
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    place, p, R, corners = np.empty(3), np.empty(3), np.empty((3, 3)), np.zeros((MOST_CORNERS, 2))
    for m in range(xy_yaw.shape[0]):
        if not wanted[m]:
            continue
        x, y = xy_yaw[m, 0], xy_yaw[m, 1]
        around = near_patches(packed, xy_yaw[m : m + 1], patch, wiggle)
        place[:] = xy_yaw[m]
        area = 0.0
        for _ in range(1 + WIGGLES):
            surface, count, more, friction = _rest_at(
                packed, effector, place, z_range, patch, around, p, R, corners, work
            )
            if surface < 0 or more < GAIN * area:
                break
            area = more
            placed.surface[m], placed.p[m], placed.R[m] = surface, p, R
            supports.corners[m], supports.count[m], supports.friction[m] = corners, count, friction
            xy_yaw[m] = place
            cx, cy = box_middle(corners, count)
            place[0], place[1] = p[0] + R[0, 0] * cx + R[0, 1] * cy, p[1] + R[1, 0] * cx + R[1, 1] * cy
            if (place[0] - x) ** 2 + (place[1] - y) ** 2 > wiggle * wiggle:
                break


def rest_down(
    packed: PackedTerrain, spec: EffectorSpec, place: tuple[float, float, float], z_range: tuple[float, float]
) -> Contact | None:
    """The foot contact straight below a point on the plane that supports most of the sole, or None.

    Args:
        packed: the terrain.
        spec: the foot.
        place: x, y of the contact point [m] and heading [rad] in W.
        z_range: least and greatest height of the contact point in W [m].
    """
    placed, supports, effector = no_placements(1), no_supports(1), EFFECTORS.index(spec.name)
    placed.surface[0] = -1
    at, window = np.array([place], float), (float(z_range[0]), float(z_range[1]))
    rest_feet(packed, effector, at, np.ones(1, bool), window, patch_shape(spec), 0.0, placed, supports)
    if placed.surface[0] < 0:
        return None
    X_WC = np.eye(4)
    X_WC[:3, :3], X_WC[:3, 3] = placed.R[0], placed.p[0]
    support = supports.of(0, spec.half_extent)
    return Contact(spec.name, int(placed.surface[0]), X_WC, float(supports.friction[0]), place[2], support)


def rests_whole(packed: PackedTerrain, contact: Contact, half_extent: tuple[float, float]) -> bool:
    """Whether what touches a patch holds all of it, as planks with gaps do that carry its ends.

    Args:
        packed: the terrain.
        contact: with its pose.
        half_extent: half length and half width of the patch [m].
    """
    reach, (x, y, _) = float(np.hypot(*half_extent)) + FLUSH, contact.p_WC
    around, corners = near(packed, x - reach, y - reach, x + reach, y + reach), np.zeros((MOST_CORNERS, 2))
    p, R = np.array(contact.p_WC), np.ascontiguousarray(contact.R_WC)
    count, _, _ = support_under(packed, EFFECTORS.index(contact.effector), p, R, *half_extent, around, corners, False)
    return count == 4 and np.allclose(corners[:4], patch_corners(half_extent), rtol=0, atol=ROUNDING)
