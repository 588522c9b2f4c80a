"""Candidate contacts set down on the terrain: whole patch inside the surface, nothing above it.

Feet are looked for straight below a point of the plan view, palms along rays (Lin 2020 sec. 3.2, fig. 3.1).
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

import numpy as np
from numba import njit

from scenes.contact import NEAR_LEVEL, Contact
from scenes.effector import EFFECTORS
from scenes.terrain.packed_terrain import PackedTerrain, near, polygon_meets_box

COVER_GAP = 0.003  # [m] what rises less than this above a patch does not cover it
FOOT_CLEARANCE = 0.09  # [m] height over the sole that the foot itself fills
PALM_CLEARANCE = 0.05  # [m] the same for a hand
PATCH_MARGIN = 1e-4  # [m] patches stay this far inside, so that rounding in files never puts them outside


@njit(cache=True)
def contact_axes(normal: np.ndarray, heading: float, palm: bool, R_WC: np.ndarray) -> None:
    """Writes `scenes.contact.contact_rotation` into R_WC (3, 3)."""
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
    packed: PackedTerrain, surface: int, p: np.ndarray, R: np.ndarray, hx: float, hy: float,
    front: float, back: float, side: float, clearance: float, around: np.ndarray, work: np.ndarray,
) -> bool:  # fmt: skip
    """Whether a patch of half extent (hx, hy) at pose (p, R) lies inside the surface with nothing above it.

    Nor may anything stand above the surface where the foot reaches beyond its patch: by front, back and side [m].
    """
    for a in range(4):
        sx = hx if (a == 0 or a == 3) else -hx
        sy = hy if a < 2 else -hy
        qx = p[0] + sx * R[0, 0] + sy * R[0, 1]
        qy = p[1] + sx * R[1, 0] + sy * R[1, 1]
        qz = p[2] + sx * R[2, 0] + sy * R[2, 1]
        for k in range(packed.count[surface]):
            e = packed.edge_normal[surface, k]
            if e[0] * qx + e[1] * qy + e[2] * qz > packed.edge_offset[surface, k] - PATCH_MARGIN:
                return False
    low = np.array([-hx - back, -hy - side, COVER_GAP])
    high = np.array([hx + front, hy + side, clearance])
    reach = np.sqrt((hx + max(front, back)) ** 2 + (hy + side) ** 2 + clearance * clearance)
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
    return True


@njit(cache=True)
def project_foot(
    packed: PackedTerrain, effector: int, x: float, y: float, yaw: float, z_low: float, z_high: float,
    hx: float, hy: float, front: float, back: float, side: float, around: np.ndarray, p: np.ndarray, R: np.ndarray,
    work: np.ndarray,
) -> int:  # fmt: skip
    """The highest surface between z_low and z_high that takes a whole sole at (x, y, yaw); -1 if none does.

    Writes the contact point into p (3,) and the contact frame's axes into R (3, 3).
    """
    best = -1
    best_z = -np.inf
    for q in range(around.shape[0]):
        k = around[q]
        if k >= packed.num_surfaces:
            break  # ascending: triangles follow
        if not packed.allowed[k, effector] or packed.normal[k, 2] < 1e-3:
            continue
        if x < packed.low[k, 0] or x > packed.high[k, 0] or y < packed.low[k, 1] or y > packed.high[k, 1]:
            continue
        z = (packed.offset[k] - packed.normal[k, 0] * x - packed.normal[k, 1] * y) / packed.normal[k, 2]
        if z > z_high or z < z_low or z <= best_z:
            continue
        inside = True
        for e in range(packed.count[k]):
            n = packed.edge_normal[k, e]
            if n[0] * x + n[1] * y + n[2] * z > packed.edge_offset[k, e]:
                inside = False
                break
        if inside:
            contact_axes(packed.normal[k], yaw, False, R)
            p[0], p[1], p[2] = x, y, z
            if patch_fits(packed, k, p, R, hx, hy, front, back, side, FOOT_CLEARANCE, around, work):
                best, best_z = k, z
    if best < 0:
        return -1
    contact_axes(packed.normal[best], yaw, False, R)
    p[0], p[1], p[2] = x, y, best_z
    return best


@njit(cache=True)
def project_feet(
    packed: PackedTerrain, effector: int, xy_yaw: np.ndarray, z_low: float, z_high: float, hx: float, hy: float,
    front: float, back: float, side: float, p: np.ndarray, R: np.ndarray, surface: np.ndarray,
) -> None:  # fmt: skip
    """Sets candidates (n, 3) of x, y, yaw down: fills p (n, 3), R (n, 3, 3), surface (n,), -1 where none fits."""
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    margin = np.sqrt((hx + max(front, back)) ** 2 + (hy + side) ** 2) + FOOT_CLEARANCE
    around = near(
        packed,
        xy_yaw[:, 0].min() - margin,
        xy_yaw[:, 1].min() - margin,
        xy_yaw[:, 0].max() + margin,
        xy_yaw[:, 1].max() + margin,
    )
    for m in range(xy_yaw.shape[0]):
        surface[m] = project_foot(
            packed, effector, xy_yaw[m, 0], xy_yaw[m, 1], xy_yaw[m, 2], z_low, z_high, hx, hy, front, back, side,
            around, p[m], R[m], work,
        )  # fmt: skip


@njit(cache=True)
def project_palms(
    packed: PackedTerrain, effector: int, origin: np.ndarray, rays: np.ndarray, heading: float, reach_low: float,
    reach_high: float, hx: float, hy: float, p: np.ndarray, R: np.ndarray, surface: np.ndarray,
) -> None:  # fmt: skip
    """Casts rays (n, 3) from a shoulder point: fills p, R, surface with the palm contacts they find, -1 where none.

    The nearest polygon along a ray decides; if a palm may not use it, it blocks the ray.
    """
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    around = near(
        packed, origin[0] - reach_high, origin[1] - reach_high, origin[0] + reach_high, origin[1] + reach_high
    )
    for m in range(rays.shape[0]):
        surface[m] = -1
        nearest = reach_high
        for q in range(around.shape[0]):
            k = around[q]
            n = packed.normal[k]
            along = n[0] * rays[m, 0] + n[1] * rays[m, 1] + n[2] * rays[m, 2]
            if abs(along) < 1e-6:
                continue
            t = (packed.offset[k] - n[0] * origin[0] - n[1] * origin[1] - n[2] * origin[2]) / along
            if t <= 0 or t >= nearest + (1e-6 if k < packed.num_surfaces else -1e-6):
                continue
            hit = True
            for e in range(packed.count[k]):
                w = packed.edge_normal[k, e]
                d = w[0] * (origin[0] + t * rays[m, 0]) + w[1] * (origin[1] + t * rays[m, 1])
                if d + w[2] * (origin[2] + t * rays[m, 2]) > packed.edge_offset[k, e]:
                    hit = False
                    break
            if hit:
                if k >= packed.num_surfaces and surface[m] >= 0 and t > nearest - 1e-4:
                    continue  # the mesh face that this surface lies on
                nearest = t
                usable = k < packed.num_surfaces and packed.allowed[k, effector] and along < -0.2
                surface[m] = k if usable and t >= reach_low else -1
        if surface[m] < 0:
            continue
        k = surface[m]
        for a in range(3):
            p[m, a] = origin[a] + nearest * rays[m, a]
        contact_axes(packed.normal[k], heading, True, R[m])
        if not patch_fits(packed, k, p[m], R[m], hx, hy, 0.0, 0.0, 0.0, PALM_CLEARANCE, around, work):
            surface[m] = -1


@njit(cache=True)
def box_is_free(packed: PackedTerrain, p: np.ndarray, yaw: float, centre: np.ndarray, size: np.ndarray) -> bool:
    """Whether an upright box (`centre`, `size` in the frame at p with this yaw) touches no polygon."""
    c, s = np.cos(yaw), np.sin(yaw)
    low, high = centre - 0.5 * size, centre + 0.5 * size
    reach = np.sqrt(max(low[0] ** 2, high[0] ** 2) + max(low[1] ** 2, high[1] ** 2))
    cell = packed.cell[0]
    i0 = max(int(np.floor((p[0] - reach - packed.origin[0]) / cell)), 0)
    j0 = max(int(np.floor((p[1] - reach - packed.origin[1]) / cell)), 0)
    i1 = min(int(np.floor((p[0] + reach - packed.origin[0]) / cell)), packed.shape[0] - 1)
    j1 = min(int(np.floor((p[1] + reach - packed.origin[1]) / cell)), packed.shape[1] - 1)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            first = packed.cell_start[i * packed.shape[1] + j]
            for q in range(first, packed.cell_start[i * packed.shape[1] + j + 1]):
                k = packed.cell_items[q]
                if packed.low[k, 2] > p[2] + high[2] or packed.high[k, 2] < p[2] + low[2]:
                    continue
                if packed.low[k, 0] > p[0] + reach or packed.high[k, 0] < p[0] - reach:
                    continue
                if packed.low[k, 1] > p[1] + reach or packed.high[k, 1] < p[1] - reach:
                    continue
                work = np.empty((2, packed.vertices.shape[1] + 8, 3))
                R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
                if polygon_meets_box(packed.vertices[k], packed.count[k], R, p, low, high, work):
                    return False
    return True


@njit(cache=True)
def boxes_are_free(
    packed: PackedTerrain, p: np.ndarray, yaw: np.ndarray, centre: np.ndarray, size: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """(n,) `wanted`, less where the box at p (n, 3) and yaw (n,) touches a polygon."""
    free = wanted.copy()
    for k in range(p.shape[0]):
        if free[k]:
            free[k] = box_is_free(packed, p[k], yaw[k], centre, size)
    return free


@njit(cache=True)
def nothing_near(packed: PackedTerrain, x: float, y: float, reach: float, z_low: float, z_high: float) -> bool:
    """Whether no polygon's bounds meet the square of half width `reach` about (x, y) between z_low and z_high."""
    cell = packed.cell[0]
    i0 = max(int(np.floor((x - reach - packed.origin[0]) / cell)), 0)
    j0 = max(int(np.floor((y - reach - packed.origin[1]) / cell)), 0)
    i1 = min(int(np.floor((x + reach - packed.origin[0]) / cell)), packed.shape[0] - 1)
    j1 = min(int(np.floor((y + reach - packed.origin[1]) / cell)), packed.shape[1] - 1)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            first = packed.cell_start[i * packed.shape[1] + j]
            for q in range(first, packed.cell_start[i * packed.shape[1] + j + 1]):
                k = packed.cell_items[q]
                if (
                    packed.low[k, 2] <= z_high
                    and packed.high[k, 2] >= z_low
                    and packed.low[k, 0] <= x + reach
                    and packed.high[k, 0] >= x - reach
                    and packed.low[k, 1] <= y + reach
                    and packed.high[k, 1] >= y - reach
                ):
                    return False
    return True


def set_down(
    packed: PackedTerrain, effector: str, x: float, y: float, yaw: float, half_extent: tuple[float, float],
    z_range: tuple[float, float] = (-np.inf, np.inf), overhang: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Contact | None:  # fmt: skip
    """The foot contact straight below (x, y) on the highest surface in `z_range` that takes it, or None."""
    p, R, surface = np.zeros((1, 3)), np.zeros((1, 3, 3)), np.zeros(1, np.int64)
    project_feet(
        packed, EFFECTORS.index(effector), np.array([[x, y, yaw]]), *z_range, *half_extent, *overhang, p, R, surface
    )
    if surface[0] < 0:
        return None
    X_WC = np.eye(4)
    X_WC[:3, :3], X_WC[:3, 3] = R[0], p[0]
    return Contact(effector, int(surface[0]), X_WC, float(packed.friction[surface[0]]), yaw)
