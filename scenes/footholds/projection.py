"""Candidate contacts set down on the terrain: whole patch inside the surface or its floor, nothing above it.

Feet are looked for straight below a point of the plan view, palms along rays (Lin 2020 sec. 3.2, fig. 3.1).
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.contact import NEAR_LEVEL, Contact
from scenes.effector import EFFECTORS, is_foot
from scenes.footholds.floor_patch import lies_on_floor
from scenes.robots.robot import EffectorSpec
from scenes.terrain.floors import JOINT
from scenes.terrain.packed_terrain import PackedTerrain, height_at, near, over_polygon, polygon_meets_box
from scenes.terrain.solids import in_solid

COVER_GAP = 0.003  # [m] what rises less than this above a patch does not cover it
FOOT_CLEARANCE = 0.09  # [m] height over the sole that the foot itself fills
LEG_CLEARANCE = 0.2  # [m] height over the sole that must be free for the foot to come and go, and for the shin over it
PALM_CLEARANCE = 0.05  # [m] the same for a hand
PATCH_MARGIN = 1e-4  # [m] patches stay this far inside, so that rounding in files never puts them outside


class PatchShape(NamedTuple):
    """The room that an end effector takes over a surface, in its contact frame.

    Attributes:
        half_length: of the patch along x [m]; all of the patch lies on the surface.
        half_width: of the patch along y [m].
        front: how far the foot reaches beyond its patch along x [m]; nothing may stand there above the surface.
        back: the same to the back [m].
        side: the same to each side [m].
        clearance: height over the surface that has to be free [m].
    """

    half_length: float
    half_width: float
    front: float
    back: float
    side: float
    clearance: float


class Placements(NamedTuple):
    """Contacts that a kernel has set down, n of them.

    Attributes:
        p: (n, 3) contact points in W [m].
        R: (n, 3, 3) contact frames in W.
        surface: (n,) number of the surface of each, -1 where none was found.
    """

    p: np.ndarray
    R: np.ndarray
    surface: np.ndarray


def patch_shape(spec: EffectorSpec) -> PatchShape:
    """The room that an end effector of a robot takes; palms take none beyond their patch."""
    overhang = spec.overhang if is_foot(spec.name) else (0.0, 0.0, 0.0)
    return PatchShape(*spec.half_extent, *overhang, LEG_CLEARANCE if is_foot(spec.name) else PALM_CLEARANCE)


def no_placements(n: int) -> Placements:
    """Room for n contacts, for a kernel to fill."""
    return Placements(np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros(n, np.int64))


@njit(cache=True)
def contact_axes(normal: np.ndarray, heading: float, palm: bool, R_WC: np.ndarray) -> None:
    """Writes `scenes.contact.contact_rotation` into R_WC (3, 3).

    Args:
        normal: (3,) outward unit normal of the surface in W.
        heading: yaw of the contact in W [rad].
        palm: whether a palm touches, not a foot.
        R_WC: (3, 3) is written here.
    """
    fx, fy, fz = np.cos(heading), np.sin(heading), 0.0
    if palm and abs(normal[2]) < NEAR_LEVEL:
        fx, fy, fz = 0.0, 0.0, 1.0
    d = fx * normal[0] + fy * normal[1] + fz * normal[2]
    x0, x1, x2 = fx - d * normal[0], fy - d * normal[1], fz - d * normal[2]
    s = 1.0 / np.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
    x0, x1, x2 = s * x0, s * x1, s * x2
    R_WC[0, 0], R_WC[1, 0], R_WC[2, 0] = x0, x1, x2
    R_WC[0, 1] = normal[1] * x2 - normal[2] * x1
    R_WC[1, 1] = normal[2] * x0 - normal[0] * x2
    R_WC[2, 1] = normal[0] * x1 - normal[1] * x0
    R_WC[0, 2], R_WC[1, 2], R_WC[2, 2] = normal[0], normal[1], normal[2]


@njit(cache=True)
def patch_fits(
    packed: PackedTerrain,
    surface: int,
    p: np.ndarray,
    R: np.ndarray,
    patch: PatchShape,
    around: np.ndarray,
    work: np.ndarray,
) -> bool:
    """Whether a patch at pose (p, R) lies inside the surface with nothing above it, nor above what reaches beyond it.

    What has no face there may still be a solid that the patch is wholly inside of.
    Where the surface is a piece of a floor, the patch may lie on several of its pieces.

    Args:
        packed: the terrain.
        surface: number of the surface.
        p: (3,) contact point in W [m].
        R: (3, 3) contact frame in W.
        patch: the room that it takes.
        around: (m,) polygons that may be in the way.
        work: (2, K + 8, 3) scratch for polygons of K vertices.
    """
    hx, hy = patch.half_length, patch.half_width
    inside = True
    for a in range(4):
        sx = hx if (a == 0 or a == 3) else -hx
        sy = hy if a < 2 else -hy
        qx = p[0] + sx * R[0, 0] + sy * R[0, 1]
        qy = p[1] + sx * R[1, 0] + sy * R[1, 1]
        qz = p[2] + sx * R[2, 0] + sy * R[2, 1]
        inside = inside and over_polygon(packed, surface, qx, qy, qz, -PATCH_MARGIN)
    if not inside and not (
        packed.floor[surface] >= 0
        and lies_on_floor(packed, surface, p, R, hx + PATCH_MARGIN, hy + PATCH_MARGIN, around)
    ):
        return False
    return has_room(packed, surface, p, R, patch, around, work)


@njit(cache=True)
def has_room(
    packed: PackedTerrain,
    surface: int,
    p: np.ndarray,
    R: np.ndarray,
    patch: PatchShape,
    around: np.ndarray,
    work: np.ndarray,
) -> bool:
    """Whether nothing rises into an end effector at pose (p, R), and it is in no solid.

    Args:
        packed: the terrain.
        surface: a polygon that lies in the patch's plane and is not looked at, -1 for none.
        p: (3,) contact point in W [m].
        R: (3, 3) contact frame in W.
        patch: the room that it takes.
        around: (m,) polygons that may be in the way.
        work: (2, K + 8, 3) scratch for polygons of K vertices.
    """
    hx, hy, clearance = patch.half_length, patch.half_width, patch.clearance
    low = np.array([-hx - patch.back, -hy - patch.side, COVER_GAP])
    high = np.array([hx + patch.front, hy + patch.side, clearance])
    reach = np.sqrt((hx + max(patch.front, patch.back)) ** 2 + (hy + patch.side) ** 2 + clearance * clearance)
    for q in range(around.shape[0]):
        k = around[q]
        if k == surface:
            continue
        apart = False
        for a in range(3):
            if packed.low[k, a] > p[a] + reach or packed.high[k, a] < p[a] - reach:
                apart = True
        if not apart and polygon_meets_box(packed.vertices[k], packed.count[k], R, p, low, high, work):
            return False
    height = 0.5 * (COVER_GAP + clearance)  # where no face is near, all of the patch is inside a solid or none of it
    return not in_solid(packed, p[0] + height * R[0, 2], p[1] + height * R[1, 2], p[2] + height * R[2, 2])


@njit(cache=True)
def near_patches(packed: PackedTerrain, xy_yaw: np.ndarray, patch: PatchShape, beyond: float) -> np.ndarray:
    """(m,) polygons that may be under or in the way of a foot at one of n places, ascending.

    Args:
        packed: the terrain.
        xy_yaw: (n, 3) place [m] and heading [rad] in W.
        patch: the room that the foot takes.
        beyond: how far it may be moved from there [m].
    """
    longer = patch.half_length + max(patch.front, patch.back)
    margin = np.sqrt(longer**2 + (patch.half_width + patch.side) ** 2) + patch.clearance + beyond
    return near(
        packed,
        xy_yaw[:, 0].min() - margin,
        xy_yaw[:, 1].min() - margin,
        xy_yaw[:, 0].max() + margin,
        xy_yaw[:, 1].max() + margin,
    )


@njit(cache=True)
def project_foot(
    packed: PackedTerrain,
    effector: int,
    xy_yaw: np.ndarray,
    z_range: tuple[float, float],
    patch: PatchShape,
    around: np.ndarray,
    p: np.ndarray,
    R: np.ndarray,
    work: np.ndarray,
) -> int:
    """The highest surface in a range of heights that takes a whole sole, -1 if none does.

    Args:
        packed: the terrain.
        effector: index into `EFFECTORS`.
        xy_yaw: (3,) place [m] and heading [rad] in W.
        z_range: least and greatest height of the contact point in W [m].
        patch: the room that the foot takes.
        around: (m,) polygons near there, ascending.
        p: (3,) the contact point in W [m] is written here.
        R: (3, 3) the contact frame in W is written here.
        work: (2, K + 8, 3) scratch for polygons of K vertices.
    """
    x, y, yaw = xy_yaw[0], xy_yaw[1], xy_yaw[2]
    z_low, z_high = z_range
    best = -1
    best_z = -np.inf
    for q in range(around.shape[0]):
        k = around[q]
        if k >= packed.num_surfaces:
            break  # ascending: triangles follow
        if not packed.allowed[k, effector] or packed.normal[k, 2] < 1e-3:
            continue
        slack = JOINT if packed.floor[k] >= 0 else 0.0  # the middle of a sole may lie over a joint
        if x < packed.low[k, 0] - slack or x > packed.high[k, 0] + slack:
            continue
        if y < packed.low[k, 1] - slack or y > packed.high[k, 1] + slack:
            continue
        z = height_at(packed, k, x, y)
        if z > z_high or z < z_low or z <= best_z:
            continue
        if over_polygon(packed, k, x, y, z, slack):
            contact_axes(packed.normal[k], yaw, False, R)
            p[0], p[1], p[2] = x, y, z
            if patch_fits(packed, k, p, R, patch, around, work):
                best, best_z = k, z
    if best < 0:
        return -1
    contact_axes(packed.normal[best], yaw, False, R)
    p[0], p[1], p[2] = x, y, best_z
    return best


@njit(cache=True)
def project_feet(
    packed: PackedTerrain,
    effector: int,
    xy_yaw: np.ndarray,
    z_range: tuple[float, float],
    patch: PatchShape,
    placed: Placements,
) -> None:
    """Sets feet down straight below n candidates, each on the highest surface that takes it.

    Args:
        packed: the terrain.
        effector: index into `EFFECTORS`.
        xy_yaw: (n, 3) place [m] and heading [rad] in W.
        z_range: least and greatest height of the contact points in W [m].
        patch: the room that the foot takes.
        placed: n contacts, filled here.
    """
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    around = near_patches(packed, xy_yaw, patch, 0.0)
    for m in range(xy_yaw.shape[0]):
        placed.surface[m] = project_foot(
            packed, effector, xy_yaw[m], z_range, patch, around, placed.p[m], placed.R[m], work
        )


@njit(cache=True)
def cast_ray(
    packed: PackedTerrain,
    effector: int,
    origin: np.ndarray,
    ray: np.ndarray,
    reach: tuple[float, float],
    around: np.ndarray,
) -> tuple[int, float]:
    """The surface that a ray meets first, where an end effector may touch it, else -1; and how far away that is [m].

    Args:
        packed: the terrain.
        effector: index into `EFFECTORS`.
        origin: (3,) of the ray in W [m].
        ray: (3,) unit vector in W.
        reach: least and greatest distance of a contact point [m].
        around: (m,) polygons that the ray may meet, ascending.
    """
    surface, nearest = -1, reach[1]
    for q in range(around.shape[0]):
        k = around[q]
        n = packed.normal[k]
        along = n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2]
        if abs(along) < 1e-6:
            continue
        t = (packed.offset[k] - n[0] * origin[0] - n[1] * origin[1] - n[2] * origin[2]) / along
        if t <= 0 or t >= nearest + (1e-6 if k < packed.num_surfaces else -1e-6):
            continue
        x, y, z = origin[0] + t * ray[0], origin[1] + t * ray[1], origin[2] + t * ray[2]
        if over_polygon(packed, k, x, y, z, 0.0):
            if k >= packed.num_surfaces and surface >= 0 and t > nearest - 1e-4:
                continue  # the mesh face that this surface lies on
            nearest = t
            usable = k < packed.num_surfaces and packed.allowed[k, effector] and along < -0.2
            surface = k if usable and t >= reach[0] else -1
    return surface, nearest


@njit(cache=True)
def project_palms(
    packed: PackedTerrain,
    effector: int,
    origin: np.ndarray,
    rays: np.ndarray,
    heading: float,
    reach: tuple[float, float],
    patch: PatchShape,
    placed: Placements,
) -> None:
    """Casts n rays from a shoulder point and sets a palm down where each meets a surface.

    The nearest polygon along a ray decides; if a palm may not use it, it blocks the ray.

    Args:
        packed: the terrain.
        effector: index into `EFFECTORS`.
        origin: (3,) shoulder point in W [m].
        rays: (n, 3) unit vectors in W.
        heading: of the body [rad].
        reach: least and greatest distance of a contact point from the shoulder [m].
        patch: the room that the palm takes.
        placed: n contacts, filled here.
    """
    p, R, surface = placed
    reach_low, reach_high = reach
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    around = near(
        packed, origin[0] - reach_high, origin[1] - reach_high, origin[0] + reach_high, origin[1] + reach_high
    )
    for m in range(rays.shape[0]):
        surface[m], nearest = cast_ray(packed, effector, origin, rays[m], (reach_low, reach_high), around)
        if surface[m] < 0:
            continue
        k = surface[m]
        for a in range(3):
            p[m, a] = origin[a] + nearest * rays[m, a]
        contact_axes(packed.normal[k], heading, True, R[m])
        if not patch_fits(packed, k, p[m], R[m], patch, around, work):
            surface[m] = -1


def set_down(
    packed: PackedTerrain,
    effector: str,
    x: float,
    y: float,
    yaw: float,
    half_extent: tuple[float, float],
    z_range: tuple[float, float] = (-np.inf, np.inf),
    overhang: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Contact | None:
    """The foot contact straight below a point on the highest surface that takes it, or None.

    Args:
        packed: the terrain.
        effector: name of the foot.
        x: of the contact point in W [m].
        y: of the contact point in W [m].
        yaw: heading of the foot in W [rad].
        half_extent: half length and half width of the patch [m].
        z_range: least and greatest height of the contact point in W [m].
        overhang: how far the foot reaches beyond its patch to the front, to the back and to each side [m].
    """
    placed, window = no_placements(1), (float(z_range[0]), float(z_range[1]))
    patch = PatchShape(*half_extent, *overhang, LEG_CLEARANCE)
    project_feet(packed, EFFECTORS.index(effector), np.array([[x, y, yaw]], float), window, patch, placed)
    surface = int(placed.surface[0])
    if surface < 0:
        return None
    X_WC = np.eye(4)
    X_WC[:3, :3], X_WC[:3, 3] = placed.R[0], placed.p[0]
    return Contact(effector, surface, X_WC, float(packed.friction[surface]), yaw)
