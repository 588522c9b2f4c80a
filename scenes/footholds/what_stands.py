"""What is in the way of a start or a goal, for messages: the obstacle that stands there, or the edge of the ground."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely

from scenes.contact import Contact
from scenes.footholds.projection import FOOT_CLEARANCE
from scenes.terrain.packed_terrain import PackedTerrain, height_at
from scenes.terrain.solids import solid_at
from scenes.terrain.terrain import Terrain

ONE_PLANE = 3e-3  # [m] surfaces that differ by less in height are one floor
ONE_TILT = np.cos(np.deg2rad(1.0))  # and by less than this in tilt


def what_stands(terrain: Terrain, packed: PackedTerrain, points: Iterable[tuple[float, float]], z: float) -> str:
    """The solid that stands on the ground at the first of some points that has one, "box 'crate'", or "".

    Args:
        terrain: has the names.
        packed: the same, packed.
        points: (x, y) in W [m].
        z: height of the ground that is meant [m]; NaN: any.
    """
    for x, y in points:
        for height in _ground(packed, x, y, z):
            found = solid_at(terrain, packed, x, y, height + 0.5 * FOOT_CLEARANCE)
            if found:
                return found
    return ""


def _ground(packed: PackedTerrain, x: float, y: float, z: float) -> list[float]:
    """Heights of the surfaces for feet under a point [m], those near z first."""
    heights = []
    for k in range(packed.num_surfaces):
        inside = (packed.low[k, :2] <= (x, y)).all() and (packed.high[k, :2] >= (x, y)).all()
        if inside and packed.allowed[k, :2].any() and packed.normal[k, 2] > 1e-3:
            heights.append(float(height_at(packed, k, x, y)))
    return sorted(heights, key=lambda h: abs(h - z)) if np.isfinite(z) else sorted(heights)


def patch_off_surface(terrain: Terrain, contact: Contact, half_extent: tuple[float, float]) -> float:
    """How far a patch reaches beyond its surface and the surfaces that continue it in one plane [m]; 0 if it does not.

    Args:
        terrain: has the surfaces.
        contact: with its pose and surface.
        half_extent: half length and half width of the patch [m].
    """
    corners = np.array([[sx * half_extent[0], sy * half_extent[1]] for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1))])
    patch = shapely.Polygon(corners)
    reach = float(np.hypot(*half_extent))
    floor = []
    for k, surface in enumerate(terrain.surfaces):
        if k != contact.surface and (
            not surface.allows(contact.effector) or surface.normal @ contact.R_WC[:, 2] < ONE_TILT
        ):
            continue
        low, high = surface.vertices.min(axis=0) - reach, surface.vertices.max(axis=0) + reach
        if (contact.p_WC < low).any() or (contact.p_WC > high).any():
            continue
        if k == contact.surface or abs((contact.p_WC - surface.centroid) @ surface.normal) <= ONE_PLANE:
            seen = (surface.vertices - contact.p_WC) @ contact.R_WC
            floor.append(shapely.Polygon(seen[:, :2]))
    ground = shapely.union_all(shapely.buffer(floor, 1e-6))
    beyond = shapely.difference(patch, ground)
    if beyond.is_empty:
        return 0.0
    return float(shapely.distance(shapely.points(shapely.get_coordinates(beyond)), ground).max())
