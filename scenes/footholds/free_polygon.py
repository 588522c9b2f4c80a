"""Where a footprint fits on a surface as a polygon in the plan view, and the foothold of each surface that is nearest to a place.

For questions that are asked once, of starts and goals; the search asks `scenes.footholds.foothold_table`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from scenes.contact import Contact
from scenes.effector import EFFECTORS
from scenes.footholds.free_space import Footprint, box_sides, footprint_of, free_space, half_planes
from scenes.footholds.projection import contact_axes, near_patches, patch_fits, patch_shape
from scenes.robots.robot import EffectorSpec
from scenes.terrain.packed_terrain import PackedTerrain, height_at

MARGIN = 0.01  # [m] contacts are set this far inside of where they fit, as far as there is room


def free_polygon(
    packed: PackedTerrain, surface: int, R: np.ndarray, footprint: Footprint, half_spaces: np.ndarray
) -> tuple[BaseGeometry, bool]:
    """The contact points on a surface where a footprint fits, in (x, y) of a contact frame at the origin of W [m].

    Args:
        packed: the terrain.
        surface: number of the surface.
        R: (3, 3) contact frame in W.
        footprint: in that frame.
        half_spaces: (L, 4) of W that the contact point has to be in: rows (n, b) mean n @ q <= b [m].

    Returns:
        The region; and whether it is all of it (`FreeSpace.complete`).
    """
    space = free_space(packed, surface, R, footprint, half_planes(half_spaces, R, packed.offset[surface]))
    if len(space.outline) < 3:
        return shapely.Polygon(), bool(space.complete)
    covers = [shapely.Polygon(c) for c in np.split(space.corner, space.start[1:-1]) if len(c) > 2]
    return shapely.Polygon(space.outline).difference(shapely.union_all(covers)), bool(space.complete)


def ground_near(packed: PackedTerrain, effector: int, around: np.ndarray) -> Iterator[int]:
    """Numbers of the surfaces among some polygons that a foot may stand on.

    Args:
        packed: the terrain.
        effector: index into `EFFECTORS`.
        around: (m,) numbers of polygons.
    """
    for k in around.tolist():
        if k < packed.num_surfaces and packed.allowed[k, effector] and packed.normal[k, 2] > 1e-3:
            yield k


def footholds_near(
    packed: PackedTerrain,
    spec: EffectorSpec,
    place: tuple[float, float, float],
    z_range: tuple[float, float],
    radius: float,
    half_spaces: np.ndarray,
) -> list[tuple[float, Contact]]:
    """The foothold of each surface that is nearest to a place at a heading, and its distance [m]; nearest first.

    Args:
        packed: the terrain.
        spec: the foot.
        place: x, y [m] and heading [rad] in W.
        z_range: least and greatest height of the footholds in W [m].
        radius: in the plan view, beyond which footholds are not looked for [m].
        half_spaces: (L, 4) of W that the contact point has to be in: rows (n, b) mean n @ q <= b [m].
    """
    x, y, yaw = place
    effector, patch = EFFECTORS.index(spec.name), patch_shape(spec)
    around = near_patches(packed, np.array([place]), patch, radius)
    low, high = np.array([x - radius, y - radius, z_range[0]]), np.array([x + radius, y + radius, z_range[1]])
    sides = np.vstack([half_spaces, box_sides(low, high)])
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    found = []
    for k in ground_near(packed, effector, around):
        R_WC = np.empty((3, 3))
        contact_axes(packed.normal[k], yaw, False, R_WC)
        region, _ = free_polygon(packed, k, R_WC, footprint_of(patch), sides)
        if region.is_empty:
            continue
        wanted = shapely.Point(np.array([x, y, height_at(packed, k, x, y)]) @ R_WC[:, :2])
        for point in _nearest(region, wanted):
            p_WC = R_WC[:, :2] @ point + packed.offset[k] * R_WC[:, 2]
            distance = float(np.hypot(p_WC[0] - x, p_WC[1] - y))
            if distance <= radius and patch_fits(packed, k, p_WC, R_WC, patch, around, work):
                X_WC = np.eye(4)
                X_WC[:3, :3], X_WC[:3, 3] = R_WC, p_WC
                found.append((distance, Contact(spec.name, k, X_WC, float(packed.friction[k]), yaw)))
                break
    return sorted(found, key=lambda one: one[0])


def _nearest(region: BaseGeometry, wanted: shapely.Point) -> list[np.ndarray]:
    """(2,) points of a region near another: off the edge where that is about as near, and the nearest."""
    inner = region.buffer(-MARGIN)
    roomy = not inner.is_empty and inner.distance(wanted) <= region.distance(wanted) + 2 * MARGIN
    choices = [inner, region] if roomy else [region]
    return [shapely.get_coordinates(shapely.shortest_line(one, wanted))[0] for one in choices]
