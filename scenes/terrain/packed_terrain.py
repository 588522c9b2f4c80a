"""A terrain packed into arrays that compiled kernels can read, with a grid that finds what is near."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.effector import EFFECTORS
from scenes.terrain.clipping import clip_between, seen_from
from scenes.terrain.closed_bodies import solid_of_triangles
from scenes.terrain.floors import floors_of
from scenes.terrain.polygon import area_vectors
from scenes.terrain.terrain import Terrain

CELL = 0.5  # [m] edge of a grid cell; a query box of a step's size touches a handful
MAX_CELLS = 4_000_000  # a terrain wider than this many cells gets larger ones
THICKNESS = 0.02  # [m] how far a plate reaches behind its face
COVERED = 1e-4  # [m] a triangle this near to the inside of a mesh's face is that face
PLATE_SPLIT = 1e-9  # area below which a triangle of an obstacle is dropped


class PackedTerrain(NamedTuple):
    """Polygons (surfaces first, then obstacle triangles) as arrays, and a uniform grid over their xy boxes.

    Attributes:
        num_surfaces: S; polygons S and beyond are obstacle triangles that nothing may touch.
        vertices: (P, K, 3) [m] in W, padded; `count` (P,) tells how many are real.
        count: (P,) vertices of each polygon.
        normal: (P, 3) outward unit normals; a point p on the plane has normal @ p = offset.
        offset: (P,) [m].
        edge_normal: (P, K, 3) outward in-plane unit normals of the edges.
        edge_offset: (P, K) inside means edge_normal @ p <= edge_offset.
        low, high: (P, 3) axis-aligned bounds [m].
        allowed: (P, 4) whether each end effector may touch the polygon.
        body: (P,) whether bodies collide with the polygon: plates, faces of meshes, and the triangles of obstacles that no
            face of a mesh covers.
        depth: (P,) how far the solid behind the polygon reaches [m]: `THICKNESS` for plates, 0 for faces of obstacles,
            which have others behind them.
        solid: (P,) number of the obstacle whose closed body the triangle bounds, -1 for all others.
        friction: (P,) Coulomb coefficient.
        floor: (S,) number of the floor that each surface is a piece of, -1 where it is alone.
        joint_start: (S + 1,) and joint (J, 3, 3): triangles that fill the joints beside each surface [m], see `floors`.
        origin: (2,) lowest x and y of the grid [m].
        cell: (1,) edge of a cell [m].
        shape: (2,) cells in x and y.
        cell_start: (cells + 1,) and cell_items: polygons of each cell, in CSR form.
    """

    num_surfaces: int
    vertices: np.ndarray
    count: np.ndarray
    normal: np.ndarray
    offset: np.ndarray
    edge_normal: np.ndarray
    edge_offset: np.ndarray
    low: np.ndarray
    high: np.ndarray
    allowed: np.ndarray
    body: np.ndarray
    depth: np.ndarray
    solid: np.ndarray
    friction: np.ndarray
    floor: np.ndarray
    joint_start: np.ndarray
    joint: np.ndarray
    origin: np.ndarray
    cell: np.ndarray
    shape: np.ndarray
    cell_start: np.ndarray
    cell_items: np.ndarray


def pack_terrain(terrain: Terrain) -> PackedTerrain:
    """The arrays of a terrain; work once per scene, proportional to its size."""
    polygons = [s.vertices for s in terrain.surfaces]
    large = _solid(terrain.triangles)
    triangles = terrain.triangles[large]
    num_surfaces, total = len(polygons), len(polygons) + len(triangles)
    width = max([len(p) for p in polygons] + [3])
    vertices = np.zeros((total, width, 3))
    count = np.full(total, 3)
    for i, polygon in enumerate(polygons):
        count[i] = len(polygon)
        vertices[i, : len(polygon)] = polygon
        vertices[i, len(polygon) :] = polygon[0]
    vertices[num_surfaces:, :3] = triangles
    vertices[num_surfaces:, 3:] = triangles[:, :1]

    rolled = np.roll(vertices, -1, axis=1)
    rolled[np.arange(total), count - 1] = vertices[:, 0]
    normal = np.cross(vertices - vertices[:, :1], rolled - vertices[:, :1]).sum(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    edge_normal = np.cross(rolled - vertices, normal[:, None])
    length = np.linalg.norm(edge_normal, axis=2, keepdims=True)
    edge_normal = np.divide(edge_normal, length, out=np.zeros_like(edge_normal), where=length > 1e-12)
    allowed = np.zeros((total, len(EFFECTORS)), dtype=np.bool_)
    for i, surface in enumerate(terrain.surfaces):
        allowed[i] = [surface.allows(e) for e in EFFECTORS]
    of_mesh = np.array(terrain.surfaces_of_meshes, dtype=np.bool_)
    depth = np.zeros(total)
    depth[:num_surfaces] = np.where(of_mesh, 0.0, THICKNESS)
    solid = np.full(total, -1)
    solid[num_surfaces:] = solid_of_triangles(terrain)[large]
    friction = np.zeros(total)
    friction[:num_surfaces] = [s.friction for s in terrain.surfaces]
    low, high = vertices.min(axis=1), vertices.max(axis=1)
    own = slice(num_surfaces)
    floors = floors_of(vertices[own], count[own], normal[own], friction[own], allowed[own])
    packed = PackedTerrain(
        num_surfaces,
        vertices,
        count,
        normal,
        (normal * vertices[:, 0]).sum(axis=1),
        edge_normal,
        (edge_normal * vertices).sum(axis=2),
        low,
        high,
        allowed,
        np.ones(total, dtype=np.bool_),
        depth,
        solid,
        friction,
        *floors,
        *_grid(low, high),
    )
    _leave_out_covered(packed, of_mesh)
    return packed


def polygon_names(terrain: Terrain) -> tuple[str, ...]:
    """(P,) names of the packed polygons: of their surfaces, and of the obstacles that their triangles belong to."""
    counts = [len(obstacle.triangles()) for obstacle in terrain.obstacles]
    owners = np.repeat(np.arange(len(counts)), counts)[_solid(terrain.triangles)]
    return (*(s.name for s in terrain.surfaces), *(terrain.obstacles[k].name for k in owners.tolist()))


def _solid(triangles: np.ndarray) -> np.ndarray:
    """(K,) whether each triangle encloses an area."""
    return np.linalg.norm(area_vectors(triangles), axis=1) > 2 * PLATE_SPLIT


def _grid(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, ...]:
    """(origin, cell, shape, cell_start, cell_items) of the uniform grid over the polygons' xy boxes."""
    origin = low[:, :2].min(axis=0) - 1e-6
    extent = high[:, :2].max(axis=0) - origin + 1e-6
    cell = max(CELL, float(np.sqrt(extent.prod() / MAX_CELLS)))
    shape = np.maximum(np.ceil(extent / cell).astype(np.int64), 1)
    first = np.floor((low[:, :2] - origin) / cell).astype(np.int64).clip(0, shape - 1)
    last = np.floor((high[:, :2] - origin) / cell).astype(np.int64).clip(0, shape - 1)
    cell_start, cell_items = _fill_cells(first, last, shape)
    return origin, np.array([cell]), shape, cell_start, cell_items


@njit(cache=True)
def _fill_cells(first: np.ndarray, last: np.ndarray, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    counts = np.zeros(shape[0] * shape[1] + 1, np.int64)
    for k in range(first.shape[0]):
        for i in range(first[k, 0], last[k, 0] + 1):
            for j in range(first[k, 1], last[k, 1] + 1):
                counts[i * shape[1] + j + 1] += 1
    start = np.cumsum(counts)
    items = np.empty(start[-1], np.int64)
    fill = start[:-1].copy()
    for k in range(first.shape[0]):
        for i in range(first[k, 0], last[k, 0] + 1):
            for j in range(first[k, 1], last[k, 1] + 1):
                items[fill[i * shape[1] + j]] = k
                fill[i * shape[1] + j] += 1
    return start, items


@njit(cache=True)
def _leave_out_covered(packed: PackedTerrain, of_mesh: np.ndarray) -> None:
    """Unmarks the triangles in `body` that lie in a face of a mesh: one polygon is their body, not thousands."""
    for s in range(packed.num_surfaces):
        if not of_mesh[s]:
            continue
        n = packed.normal[s]
        rows, j0, j1 = cells_under(packed, packed.low[s, 0], packed.low[s, 1], packed.high[s, 0], packed.high[s, 1])
        for i in rows:
            for k in in_cells(packed, i, j0, j1):
                if k < packed.num_surfaces or not packed.body[k]:
                    continue
                t = packed.normal[k]
                if n[0] * t[0] + n[1] * t[1] + n[2] * t[2] > 0.999 and _holds(packed, s, packed.vertices[k]):
                    packed.body[k] = False


@njit(cache=True)
def _holds(packed: PackedTerrain, s: int, corners: np.ndarray) -> bool:
    """Whether the first three corners lie in polygon s."""
    n = packed.normal[s]
    for m in range(3):
        x, y, z = corners[m]
        if abs(n[0] * x + n[1] * y + n[2] * z - packed.offset[s]) > COVERED:
            return False
        if not over_polygon(packed, s, x, y, z, COVERED):
            return False
    return True


@njit(cache=True)
def cells_under(
    packed: PackedTerrain, x_low: float, y_low: float, x_high: float, y_high: float
) -> tuple[range, int, int]:
    """The grid's cells that a box in the plan view touches: rows i, first and last column j of each, see `in_cells`.

    Args:
        packed: the terrain.
        x_low: least x of the box in W [m].
        y_low: least y of the box in W [m].
        x_high: greatest x of the box in W [m].
        y_high: greatest y of the box in W [m].
    """
    cell = packed.cell[0]
    i0 = max(int(np.floor((x_low - packed.origin[0]) / cell)), 0)
    j0 = max(int(np.floor((y_low - packed.origin[1]) / cell)), 0)
    i1 = min(int(np.floor((x_high - packed.origin[0]) / cell)), packed.shape[0] - 1)
    j1 = min(int(np.floor((y_high - packed.origin[1]) / cell)), packed.shape[1] - 1)
    return range(i0, i1 + 1 if j0 <= j1 else i0), j0, j1


@njit(cache=True)
def in_cells(packed: PackedTerrain, i: int, j0: int, j1: int) -> np.ndarray:
    """(n,) polygons of the cells (i, j0) to (i, j1); one that lies in several cells comes several times.

    Args:
        packed: the terrain; it holds the polygons of cells of one row side by side.
        i: row, along x.
        j0: first column, along y.
        j1: last column.
    """
    row = i * packed.shape[1]
    return packed.cell_items[packed.cell_start[row + j0] : packed.cell_start[row + j1 + 1]]


@njit(cache=True)
def near(packed: PackedTerrain, x_low: float, y_low: float, x_high: float, y_high: float) -> np.ndarray:
    """(n,) polygons whose xy box touches this one, ascending, each once.

    Args:
        packed: the terrain.
        x_low: least x of the box in W [m].
        y_low: least y of the box in W [m].
        x_high: greatest x of the box in W [m].
        y_high: greatest y of the box in W [m].
    """
    rows, j0, j1 = cells_under(packed, x_low, y_low, x_high, y_high)
    total = 0
    for i in rows:
        total += len(in_cells(packed, i, j0, j1))
    found = np.empty(total, np.int64)
    n = 0
    for i in rows:
        for k in in_cells(packed, i, j0, j1):
            if (
                packed.low[k, 0] <= x_high
                and packed.high[k, 0] >= x_low
                and packed.low[k, 1] <= y_high
                and packed.high[k, 1] >= y_low
            ):
                found[n] = k
                n += 1
    found = np.sort(found[:n])
    unique = 0
    for q in range(n):
        if q == 0 or found[q] != found[q - 1]:
            found[unique] = found[q]
            unique += 1
    return found[:unique]


@njit(cache=True)
def polygon_meets_box(
    vertices: np.ndarray,
    count: int,
    R_WB: np.ndarray,
    p_WB: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    work: np.ndarray,
) -> bool:
    """Whether a planar polygon meets an oriented box (frame B, from `low` to `high` in B) by clipping.

    Args:
        vertices: (K, 3) corners of the polygon in W [m].
        count: how many of them are real.
        R_WB: (3, 3) axes of the box's frame B in W.
        p_WB: (3,) origin of B in W [m].
        low: (3,) lowest corner of the box in B [m].
        high: (3,) greatest corner of the box in B [m].
        work: (2, K + 6, 3) scratch.
    """
    seen_from(vertices, count, p_WB, R_WB, work[0])
    cur, m = 0, count
    for axis in range(3):
        cur, m = clip_between(work, cur, m, axis, low[axis], high[axis])
        if m == 0:
            return False
    return True


@njit(cache=True)
def over_polygon(packed: PackedTerrain, k: int, x: float, y: float, z: float, margin: float) -> bool:
    """Whether a point lies straight above or below a polygon, along its normal, or beside that by a margin at most.

    Args:
        packed: the terrain.
        k: number of the polygon.
        x: of the point in W [m].
        y: of the point in W [m].
        z: of the point in W [m].
        margin: how far beyond an edge the point may be [m].
    """
    for e in range(packed.count[k]):
        w = packed.edge_normal[k, e]
        if w[0] * x + w[1] * y + w[2] * z > packed.edge_offset[k, e] + margin:
            return False
    return True


@njit(cache=True)
def height_at(packed: PackedTerrain, k: int, x: float, y: float) -> float:
    """Height of a polygon's plane at a point of the plan view [m]; the plane must not be upright.

    Args:
        packed: the terrain.
        k: number of the polygon.
        x: of the point in W [m].
        y: of the point in W [m].
    """
    n = packed.normal[k]
    return (packed.offset[k] - n[0] * x - n[1] * y) / n[2]
