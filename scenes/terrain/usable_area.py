"""What of a terrain can be stepped on, what can be leant on, and what is ignored, in square metres."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely

from scenes.effector import EFFECTORS, FEET, PALMS
from scenes.terrain.polygon import area_vectors
from scenes.terrain.surface import FOOT_MAX_TILT, PALM_TILT, Surface
from scenes.terrain.terrain import Box, Terrain

SAME_PLANE = 1e-4  # surfaces whose normals and offsets [m] round to the same multiple of this are counted in one plane


@dataclass(frozen=True)
class UsableArea:
    """Areas of a terrain's surfaces and meshes [m^2], each measured in its own plane.

    Attributes:
        walkable: surfaces for feet.
        palms: surfaces for palms.
        unused: surfaces that no end effector may use.
        narrow: mesh faces level enough for feet that belong to no surface: too narrow, or too rough.
        steep: mesh faces for palms by their tilt that belong to no surface.
        downward: mesh faces that face down too much.
        unknown: cells of height maps whose height is not known, in the plan view.
    """

    walkable: float
    palms: float
    unused: float
    narrow: float
    steep: float
    downward: float
    unknown: float


def usable_area(terrain: Terrain) -> UsableArea:
    """Measures a terrain."""
    feet, palms, unused = by_use(terrain.surfaces)
    on_mesh = [s for s, of_mesh in zip(terrain.surfaces, terrain.surfaces_of_meshes, strict=True) if of_mesh]
    faces = [o.triangles() for o in terrain.obstacles if not isinstance(o, Box)]
    doubled = area_vectors(np.concatenate(faces)) if faces else np.zeros((0, 3))
    length = np.linalg.norm(doubled, axis=1)
    tilt = np.arccos(np.clip(doubled[:, 2] / np.maximum(length, 1e-300), -1.0, 1.0))
    level, down = tilt <= FOOT_MAX_TILT + 1e-9, tilt > PALM_TILT[1] + 1e-9
    stood, leant, _ = by_use(on_mesh)
    return UsableArea(
        walkable=covered_area(feet),
        palms=covered_area(palms),
        unused=covered_area(unused),
        narrow=max(float(length[level].sum()) / 2 - covered_area(stood), 0.0),
        steep=max(float(length[~level & ~down].sum()) / 2 - covered_area(leant), 0.0),
        downward=float(length[down].sum()) / 2,
        unknown=float(sum(getattr(o, "unknown", 0.0) for o in terrain.obstacles)),
    )


def by_use(surfaces: Iterable[Surface]) -> tuple[list[Surface], list[Surface], list[Surface]]:
    """The surfaces that feet may use, those that palms may use, and those that nobody may."""
    listed = list(surfaces)
    feet = [s for s in listed if any(s.allows(e) for e in FEET)]
    palms = [s for s in listed if any(s.allows(e) for e in PALMS)]
    return feet, palms, [s for s in listed if not any(s.allows(e) for e in EFFECTORS)]


def covered_area(surfaces: Iterable[Surface]) -> float:
    """Area of surfaces [m^2], each point of a plane once: surfaces cut from one flat region overlap."""
    planes: dict[tuple[int, ...], list[Surface]] = {}
    for surface in surfaces:
        offset = float(surface.normal @ surface.vertices[0])
        key = np.round(np.array([*surface.normal, offset]) / SAME_PLANE).astype(int)
        planes.setdefault(tuple(key.tolist()), []).append(surface)
    total = 0.0
    for own in planes.values():
        normal = own[0].normal
        side = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.9 else [0.0, 1.0, 0.0])
        axes = np.stack([side, np.cross(normal, side)], axis=1) / np.linalg.norm(side)
        total += float(shapely.union_all([shapely.Polygon(s.vertices @ axes) for s in own]).area)
    return total
