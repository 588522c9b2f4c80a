"""A point cloud as terrain: planes become surfaces, what lies on none of them boxes that are only in the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import KDTree
from shapely import Polygon

from scenes.footholds.convex_cover import convex_pieces, min_width
from scenes.imports.cloud_outlines import outlines_of
from scenes.imports.cloud_planes import CloudPlanes, planes_of
from scenes.imports.cloud_sides import UPRIGHT, OuterSides
from scenes.imports.leftover_boxes import leftover_boxes
from scenes.imports.trimmed_walls import trimmed_wall
from scenes.meshes.mesh_import import NARROWEST
from scenes.terrain.surface import FOOT_MAX_TILT, PALM_TILT, Surface
from scenes.terrain.terrain import Box

SURFEL = 4.0  # points in a surfel on average
CELLS = (0.02, 0.25)  # [m] least and greatest edge of a surfel
NEIGHBOURS = 12  # by whose distance the density is measured
SAMPLES = 2000  # points at which it is
SPARSE = 20  # [%] of the points may lie sparser than the density that is reckoned with
CLEAR = 0.025  # [m] points this near a surface or its rim belong to it


@dataclass(frozen=True, eq=False)
class CloudTerrain:
    """What became of a point cloud.

    Attributes:
        surfaces: convex pieces of its planes.
        boxes: around what lies on no plane.
        points: (N, 3) the points that were used [m].
        planes: of those points.
        cell: edge of a surfel [m].
        filled: area of the small holes that were filled [m^2].
        narrow: how many planes no sole or palm fits on.
        leftover: points on no surface.
        noise: of those, how many are scattered so thinly that they were dropped.
        box_cell: edge of the cells that boxes are made of [m].
    """

    surfaces: tuple[Surface, ...]
    boxes: tuple[Box, ...]
    points: np.ndarray
    planes: CloudPlanes
    cell: float
    filled: float
    narrow: int
    leftover: int
    noise: int
    box_cell: float


def cloud_terrain(
    points: np.ndarray,
    *,
    friction: float,
    close: float,
    cell: float | None = None,
    normals: np.ndarray | None = None,
    viewpoint: np.ndarray | None = None,
) -> CloudTerrain:
    """Cuts surfaces out of a cloud.

    Args:
        points: (N, 3) finite, z up [m].
        friction: of every surface [-].
        close: holes in a surface up to this width are filled [m].
        cell: edge of a surfel [m]; None: by the density of the cloud.
        normals: (N, 3) that tell the outer side of each plane, None where they are not known.
        viewpoint: (3,) where the sensor was [m], which tells the outer side too; None where that is not known.
    """
    cell = float(np.clip(np.sqrt(SURFEL / _density(points)), *CELLS)) if cell is None else cell
    planes = planes_of(points, cell)
    order = np.argsort(planes.plane, kind="stable")
    bounds = np.searchsorted(planes.plane[order], np.arange(len(planes.origin) + 1))
    owned = [order[bounds[k] : bounds[k + 1]] for k in range(len(planes.origin))]
    sides = OuterSides.of(points, planes, normals, viewpoint)
    found = {k: _outlined(points[own], planes, k, cell, close) for k, own in enumerate(owned) if len(own) >= 3}
    outlines = _trimmed({k: shapes for k, (shapes, _) in found.items()}, planes)
    surfaces: list[Surface] = []
    counted = {"ground": 0, "wall": 0, "ceiling": 0}
    covered = np.zeros(len(points), bool)
    for k in sorted(outlines, key=lambda k: -len(owned[k])):
        pieces = [p for o in outlines[k] for p in convex_pieces(o) if min_width(p) >= NARROWEST]
        if not pieces:
            del outlines[k]
            continue
        own = owned[k]
        reach = shapely.union_all(outlines[k]).buffer(CLEAR)
        shapely.prepare(reach)
        covered[own] = shapely.contains_xy(reach, (points[own] - planes.origin[k]) @ planes.axes[k, :2].T)
        outward = sides.outward(planes.axes[k, 2], own)
        tilt = np.arccos(np.clip(outward[2], -1.0, 1.0))
        kind = "ground" if tilt <= FOOT_MAX_TILT else "wall" if tilt <= PALM_TILT[1] else "ceiling"
        name = f"{kind}_{counted[kind]}"
        counted[kind] += 1
        for number, corners in enumerate(pieces):
            vertices = planes.origin[k] + corners @ planes.axes[k, :2]
            vertices = vertices if outward @ planes.axes[k, 2] > 0 else vertices[::-1]
            surfaces.append(Surface(f"{name}/{number}" if len(pieces) > 1 else name, vertices, friction))
    rest = np.flatnonzero(~covered)
    rest = rest[~_near_surfaces(points[rest], planes, outlines)]
    corners, noise, box_cell = leftover_boxes(points[rest])
    boxes = tuple(_box(f"clutter_{k}", low, high) for k, (low, high) in enumerate(corners))
    return CloudTerrain(
        tuple(surfaces),
        boxes,
        points,
        planes,
        cell,
        sum(found[k][1] for k in outlines),
        len(found) - len(outlines),
        len(rest),
        noise,
        box_cell,
    )


def _outlined(
    points: np.ndarray, planes: CloudPlanes, k: int, cell: float, close: float
) -> tuple[list[Polygon], float]:
    """The outlines of a plane in its own axes, and the area of what was filled in them [m^2].

    Args:
        points: (N, 3) of the plane [m].
        planes: of the cloud.
        k: which of them.
        cell: edge of a surfel [m].
        close: holes up to this width are filled [m].
    """
    flat = (points - planes.origin[k]) @ planes.axes[k, :2].T
    return outlines_of(flat, _plane_density(flat, cell), close)


def _trimmed(outlines: dict[int, list[Polygon]], planes: CloudPlanes) -> dict[int, list[Polygon]]:
    """The outlines by plane, those of walls cut off where the ground above them begins.

    Args:
        outlines: by plane, in its own axes [m].
        planes: of the cloud.
    """
    grounds, walls = [], []
    for k, shapes in outlines.items():
        level = abs(planes.axes[k, 2, 2]) >= UPRIGHT
        for shape in shapes:
            corners = planes.origin[k] + shapely.get_coordinates(shape) @ planes.axes[k, :2]
            (grounds if level else walls).append((k, shape, corners.min(axis=0) - CLEAR, corners.max(axis=0) + CLEAR))
    trimmed = {k: list(shapes) for k, shapes in outlines.items() if abs(planes.axes[k, 2, 2]) >= UPRIGHT}
    for k, shape, low, high in walls:
        for g, ground, least, most in grounds:
            if (low <= most).all() and (least <= high).all() and not shape.is_empty:
                frames = (planes.origin[k], planes.axes[k]), (planes.origin[g], planes.axes[g])
                shape = trimmed_wall(shape, frames[0], ground, frames[1])
        parts = [part for part in shapely.get_parts(shape) if isinstance(part, Polygon) and not part.is_empty]
        trimmed.setdefault(k, []).extend(parts)
    return {k: trimmed.get(k, []) for k in outlines}


def _density(points: np.ndarray) -> float:
    """Points in a square metre of the sparser parts of a cloud."""
    count = min(NEIGHBOURS, len(points) - 1)
    tree = KDTree(points, balanced_tree=False, compact_nodes=False)
    queries = points[np.linspace(0, len(points) - 1, min(SAMPLES, len(points))).astype(int)]
    reach = np.maximum(tree.query(queries, k=count + 1)[0][:, -1], 1e-6)
    return float(np.percentile(count / (np.pi * reach**2), SPARSE))


def _plane_density(flat: np.ndarray, cell: float) -> float:
    """Points in a square metre of the sparser parts of a plane.

    Args:
        flat: (N, 2) its points in its own axes [m].
        cell: of the squares that are counted [m].
    """
    place = np.floor((flat - flat.min(axis=0)) / cell).astype(np.int64)
    counts = np.unique(place[:, 0] * (place[:, 1].max() + 1) + place[:, 1], return_counts=True)[1]
    return float(np.percentile(counts, SPARSE)) / cell**2


def _near_surfaces(points: np.ndarray, planes: CloudPlanes, kept: dict[int, list[Polygon]]) -> np.ndarray:
    """(N,) whether points lie within `CLEAR` of a surface or its rim.

    Args:
        points: (N, 3) [m].
        planes: of the cloud.
        kept: outlines of the planes that became surfaces.
    """
    near = np.zeros(len(points), bool)
    for k, outlines in kept.items():
        free = np.flatnonzero(~near)
        local = (points[free] - planes.origin[k]) @ planes.axes[k].T
        free, local = free[np.abs(local[:, 2]) <= CLEAR], local[np.abs(local[:, 2]) <= CLEAR]
        if len(free):
            reach = shapely.union_all(outlines).buffer(CLEAR)
            shapely.prepare(reach)
            near[free] = shapely.contains_xy(reach, local[:, :2])
    return near


def _box(name: str, low: np.ndarray, high: np.ndarray) -> Box:
    X_WO = np.eye(4)
    X_WO[:3, 3] = (low + high) / 2
    return Box(name, high - low, X_WO)
