"""Meshes of noisy height maps: planes fitted within a tolerance, and the mesh flattened onto them.

Facets of such meshes tilt this way and that, by 10 to 30 deg where cells of 2 cm have 1 cm of noise: no two lie in one
plane. Planes are fitted to vertices instead. A region grows over the mesh's edges from where the ground is flattest, takes
vertices near its plane, fits the plane to them and grows again until it takes no more. The mesh is then flattened there, so
that body and surface agree, and needs few triangles.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numba import njit
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from shapely import Polygon

from scenes.meshes.mesh_file import MIN_TRIANGLE
from scenes.meshes.mesh_orientation import Bodies, row_numbers
from scenes.meshes.planar_regions import Region, buried_part, plane_axes
from scenes.terrain.polygon import area_vectors

SOLE = 0.2  # [m] facets longer than a sole are no cells of a map
SMALL = 0.02  # [m^2] what is flat on less than a sole's area is rough
SHARE = 0.3  # of a body's usable area that has to be rough for it to be a rough body
CELLS = 300  # rough facets that a body has at least: a map has more, a modeller's curved part fewer
FITTED = 0.5  # share of that area that planes have to hold, or the mesh is left as it is
SMOOTH = np.cos(np.deg2rad(0.05))  # neighbouring facets of an exact plane differ by less, also in single precision
KERNEL = 0.05  # [m] standard deviation of the weights over which the ground is averaged to find its noise
MAX_PASSES = 30  # of averaging over neighbours
QUIET = 25  # [%] of the vertices are taken to lie in plain ground, away from edges
DEVIATIONS = 4.0  # tolerance in standard deviations of the noise: one vertex in 16 000 is farther off
TOLERANCE = (0.008, 0.04)  # [m] least and greatest tolerance
ROUNDS = 15  # of growing and fitting


@dataclass(frozen=True, eq=False)
class RoughGround:
    """What became of a mesh's rough bodies.

    Attributes:
        others: (K, 3, 3) the triangles of bodies that are not rough [m].
        body: (L, 3, 3) the rough bodies: fitted regions as flat polygons in few triangles, the other cells as they were [m].
        regions: the planes that were fitted, as far as they are wide enough and do not face down too much.
        tolerance: greatest distance of a vertex from its plane [m].
        rms: root mean square of the distances by which vertices were moved [m].
        greatest: the greatest of them [m].
        fitted: share of the rough bodies' usable area that lies in regions.
    """

    others: np.ndarray
    body: np.ndarray
    regions: tuple[Region, ...]
    tolerance: float
    rms: float
    greatest: float
    fitted: float


def fit_rough_ground(bodies: Bodies, *, min_width: float, max_tilt: float) -> RoughGround | None:
    """Fits planes to the rough bodies of a mesh; None where it has none, or none that planes fit.

    Args:
        bodies: of the mesh, counter-clockwise from outside, no triangle degenerate.
        min_width: regions in which no disc of this diameter fits are left out [m].
        max_tilt: regions whose normal is farther from the vertical are left out [rad].
    """
    triangles = bodies.triangles
    doubled = area_vectors(triangles)
    area = np.linalg.norm(doubled, axis=1) / 2
    normals = doubled / (2 * area[:, None])
    usable = normals[:, 2] >= np.cos(max_tilt) - 1e-9
    rough = _rough_bodies(bodies, normals, area, usable)[bodies.body]
    if not rough.any():
        return None
    _, first, corner = np.unique(bodies.corner[rough].ravel(), return_index=True, return_inverse=True)
    corner = corner.reshape(-1, 3)
    points = triangles[rough].reshape(-1, 3)[first]
    start, neighbour = _neighbours(corner, len(points))
    length = float(
        np.median(np.linalg.norm(points[neighbour] - points[np.repeat(np.arange(len(points)), np.diff(start))], axis=1))
    )
    middle, normal, noise = _local_planes(
        points,
        _facing(corner, doubled[rough], len(points)),
        start,
        neighbour,
        passes=int(np.clip(round((KERNEL / length) ** 2 / 0.57), 1, MAX_PASSES)),
    )
    tolerance = float(np.clip(DEVIATIONS * np.percentile(noise, QUIET), *TOLERANCE))
    share = area[rough].sum() / len(points)  # [m^2] of a vertex
    seeds, least = np.argsort(noise, kind="stable"), max(3, int(SMALL / share))
    region, planes = _grow(points, start, neighbour, seeds, middle, normal, tolerance, least)
    if not len(planes):
        return None
    _take_outliers(points, start, neighbour, region, planes, 2 * tolerance)
    owner = region[corner[:, 0]]
    owner = np.where((region[corner] == owner[:, None]).all(axis=1), owner, -1)
    others = triangles[~rough]
    regions: list[Region] = []
    kept = np.zeros(len(planes), bool)
    plates: list[np.ndarray] = []
    for number, outlines in _outlines(corner, owner, points, planes):
        origin, axes = planes[number, :3], plane_axes(planes[number, 3:])
        if axes[2, 2] < np.cos(max_tilt) - 1e-9:
            continue
        found = _wide_parts(outlines, length, others, normals[~rough], origin, axes, min_width)
        regions += found
        kept[number] = bool(found)
        if found:
            plates += [_facets(outline, origin, axes) for outline in outlines]
    held = (region >= 0) & kept[region]
    off = np.zeros(len(points))
    off[held] = ((points[held] - planes[region[held], :3]) * planes[region[held], 3:]).sum(axis=1)
    flat = points - off[:, None] * planes[np.maximum(region, 0), 3:]
    fitted = float(area[rough][(owner >= 0) & kept[owner] & usable[rough]].sum() / area[rough & usable].sum())
    if fitted < FITTED:
        return None
    cells = flat[corner[~((owner >= 0) & kept[owner])]]
    cells = cells[np.linalg.norm(area_vectors(cells), axis=1) > 2 * MIN_TRIANGLE]
    return RoughGround(
        others,
        np.concatenate([*plates, cells]),
        tuple(regions),
        tolerance,
        float(np.sqrt(np.mean(off[held] ** 2))) if held.any() else 0.0,
        float(np.abs(off).max()),
        fitted,
    )


def _facing(corner: np.ndarray, doubled: np.ndarray, count: int) -> np.ndarray:
    """(V, 3) sum of the normals of the facets at each vertex, each as long as twice the facet's area [m^2]."""
    facing = np.zeros((count, 3))
    for k in range(3):
        for axis in range(3):
            facing[:, axis] += np.bincount(corner[:, k], weights=doubled[:, axis], minlength=count)
    return facing


def _wide_parts(
    outlines: np.ndarray,
    cell: float,
    others: np.ndarray,
    normals: np.ndarray,
    origin: np.ndarray,
    axes: np.ndarray,
    min_width: float,
) -> list[Region]:
    """The parts of a fitted plane that are wide enough and under no other body.

    Args:
        outlines: polygons in the plane's axes, bounded by edges of cells [m].
        cell: length of an edge [m].
        others: (K, 3, 3) triangles of the other bodies [m].
        normals: (K, 3) their normals.
        origin: (3,) where the plane's axes start [m].
        axes: (3, 3) rows: the two axes of the plane and its normal.
        min_width: diameter of the disc that has to fit [m].
    """
    found = []
    for outline in outlines:
        shape = _plain(outline, cell)
        if len(others) and not shape.is_empty:
            shape = shape.difference(buried_part(shape, others, normals, origin, axes))
        for part in shapely.get_parts(shape):
            if isinstance(part, Polygon) and not part.buffer(-min_width / 2).is_empty:
                found.append(Region(part, origin, axes))
    return found


def _rough_bodies(bodies: Bodies, normals: np.ndarray, area: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """(B,) bool, the bodies most of whose usable area is in small facets that no exact plane of a sole's size holds."""
    triangles = bodies.triangles
    edge, _, _ = bodies.edges()
    face = np.repeat(np.arange(len(triangles)), 3)
    order = np.argsort(edge, kind="stable")
    same = edge[order][1:] == edge[order][:-1]
    a, b = face[order][:-1][same], face[order][1:][same]
    level = (normals[a] * normals[b]).sum(axis=1) >= SMOOTH
    links = coo_matrix((np.ones(int(level.sum())), (a[level], b[level])), shape=(len(triangles),) * 2)
    _, plane = connected_components(links, directed=False)
    small = np.bincount(plane, weights=area)[plane] < SMALL
    shortest = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2).min(axis=1)
    small &= usable & (shortest < SOLE / 2)
    whole = np.bincount(bodies.body, weights=area * usable)
    cells = np.bincount(bodies.body, weights=small, minlength=bodies.count)
    return (np.bincount(bodies.body, weights=area * small) > SHARE * whole) & (cells >= CELLS)


def _neighbours(corner: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(V + 1,) start and neighbours of each vertex along edges, in CSR form."""
    ends = np.concatenate([corner[:, [0, 1]], corner[:, [1, 2]], corner[:, [2, 0]]])
    graph = coo_matrix(
        (np.ones(2 * len(ends), np.int8), np.concatenate([ends, ends[:, ::-1]]).T), shape=(count, count)
    ).tocsr()
    return graph.indptr.astype(np.int64), graph.indices.astype(np.int64)


def _local_planes(
    points: np.ndarray, facing: np.ndarray, start: np.ndarray, neighbour: np.ndarray, passes: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(V, 3) mean, (V, 3) normal and (V,) standard deviation of a plane fitted around each vertex.

    Args:
        points: (V, 3) vertices [m].
        facing: (V, 3) sums of the normals of the facets there.
        start: (V + 1,) of each vertex's neighbours.
        neighbour: the neighbours.
        passes: how often moments are averaged over neighbours.
    """
    centre = points.mean(axis=0)
    p = points - centre
    pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    moments = np.concatenate([p, np.stack([p[:, i] * p[:, j] for i, j in pairs], axis=1), facing], axis=1)
    for _ in range(passes):
        moments = _averaged(moments, start, neighbour)
    mean = moments[:, :3]
    spread = np.empty((len(points), 3, 3))
    for column, (i, j) in enumerate(pairs):
        spread[:, i, j] = spread[:, j, i] = moments[:, 3 + column] - mean[:, i] * mean[:, j]
    value, vector = np.linalg.eigh(spread)
    normal = vector[:, :, 0]
    normal *= np.where((normal * moments[:, 9:]).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    return mean + centre, normal, np.sqrt(np.maximum(value[:, 0], 0.0))


@njit(cache=True)
def _averaged(values: np.ndarray, start: np.ndarray, neighbour: np.ndarray) -> np.ndarray:
    """(V, C) the mean of each vertex's values and its neighbours'."""
    out = values.copy()
    for v in range(values.shape[0]):
        for q in range(start[v], start[v + 1]):
            for c in range(values.shape[1]):
                out[v, c] += values[neighbour[q], c]
        for c in range(values.shape[1]):
            out[v, c] /= 1 + start[v + 1] - start[v]
    return out


@njit(cache=True)
def _grow(
    points: np.ndarray,
    start: np.ndarray,
    neighbour: np.ndarray,
    seeds: np.ndarray,
    middle: np.ndarray,
    normals: np.ndarray,
    tolerance: float,
    least: int,
) -> tuple[np.ndarray, np.ndarray]:
    """(V,) region of each vertex, -1 for none, and (R, 6) a point of each region's plane and its normal.

    Args:
        points: (V, 3) vertices [m].
        start: (V + 1,) of each vertex's neighbours.
        neighbour: the neighbours.
        seeds: (V,) vertices in the order in which regions start from them.
        middle: (V, 3) point of the plane to start with at each.
        normals: (V, 3) its normal.
        tolerance: greatest distance of a vertex from its region's plane [m].
        least: number of vertices that a region needs.
    """
    size = points.shape[0]
    region, seen = np.full(size, -1), np.full(size, -1)
    tried = np.zeros(size, np.bool_)
    planes = np.empty((size // least + 1, 6))
    queue = np.empty(size, np.int64)
    found, stamp = 0, 0
    for s in range(size):
        seed = seeds[s]
        if region[seed] >= 0 or tried[seed]:
            continue
        c, n = middle[seed].copy(), normals[seed].copy()
        count = 0
        for _ in range(ROUNDS):
            before = count
            count = _flood(points, start, neighbour, seed, c, n, tolerance, region, seen, stamp, queue)
            stamp += 1
            if count < 3 or count <= before:
                break
            _fit_plane(points, queue[:count], c, n)
        for q in range(min(count, 2 * least)):  # what is near a seed that failed fails too
            tried[queue[q]] = True
        if count < least:
            continue
        for q in range(count):
            region[queue[q]] = found
        for i in range(3):
            planes[found, i], planes[found, 3 + i] = c[i], n[i]
        found += 1
    return region, planes[:found].copy()


@njit(cache=True)
def _flood(
    points: np.ndarray,
    start: np.ndarray,
    neighbour: np.ndarray,
    seed: int,
    c: np.ndarray,
    n: np.ndarray,
    tolerance: float,
    region: np.ndarray,
    seen: np.ndarray,
    stamp: int,
    queue: np.ndarray,
) -> int:
    """Writes into `queue` the vertices of no region that edges join to a seed within the tolerance of a plane; how many."""
    queue[0], count, head = seed, 1, 0
    seen[seed] = stamp
    while head < count:
        v = queue[head]
        head += 1
        for q in range(start[v], start[v + 1]):
            w = neighbour[q]
            if seen[w] == stamp or region[w] >= 0:
                continue
            off = 0.0
            for i in range(3):
                off += n[i] * (points[w, i] - c[i])
            if abs(off) <= tolerance:
                seen[w] = stamp
                queue[count] = w
                count += 1
    return count


@njit(cache=True)
def _fit_plane(points: np.ndarray, vertices: np.ndarray, c: np.ndarray, n: np.ndarray) -> None:
    """Moves a plane (point c, normal n) to the best one through some vertices, facing the same way."""
    total, square = np.zeros(3), np.zeros((3, 3))
    seed, count = vertices[0], vertices.shape[0]
    for v in vertices:
        for i in range(3):
            for j in range(3):
                square[i, j] += (points[v, i] - points[seed, i]) * (points[v, j] - points[seed, j])
            total[i] += points[v, i] - points[seed, i]
    mean = total / count
    spread = square / count
    for i in range(3):
        for j in range(3):
            spread[i, j] -= mean[i] * mean[j]
    axis = np.linalg.eigh(spread)[1][:, 0]
    sign = -1.0 if axis[0] * n[0] + axis[1] * n[1] + axis[2] * n[2] < 0 else 1.0
    for i in range(3):
        c[i], n[i] = mean[i] + points[seed, i], sign * axis[i]


@njit(cache=True)
def _take_outliers(
    points: np.ndarray, start: np.ndarray, neighbour: np.ndarray, region: np.ndarray, planes: np.ndarray, most: float
) -> None:
    """Gives single vertices to the region that is all around them, up to a distance `most` from its plane [m]."""
    for v in range(points.shape[0]):
        if region[v] >= 0 or start[v + 1] == start[v]:
            continue
        around = region[neighbour[start[v]]]
        for q in range(start[v], start[v + 1]):
            if region[neighbour[q]] != around:
                around = -1
        if around < 0:
            continue
        off = 0.0
        for i in range(3):
            off += planes[around, 3 + i] * (points[v, i] - planes[around, i])
        if abs(off) <= most:
            region[v] = around


def _outlines(
    corner: np.ndarray, owner: np.ndarray, points: np.ndarray, planes: np.ndarray
) -> list[tuple[int, np.ndarray]]:
    """Number and outlines of each region that has facets: polygons of its plane's axes, bounded by edges of one facet only."""
    own = np.flatnonzero(owner >= 0)
    tail, head = corner[own].ravel(), np.roll(corner[own], -1, axis=1).ravel()
    edge = row_numbers(np.sort(np.stack([tail, head], axis=1), axis=1))
    rim = np.bincount(edge)[edge] == 1  # regions share no vertex, so an edge belongs to one of them
    number = np.repeat(owner[own], 3)[rim]
    tail, head = tail[rim], head[rim]
    order = np.argsort(number, kind="stable")
    bounds = np.searchsorted(number[order], np.arange(len(planes) + 1))
    outlines = []
    for k in range(len(planes)):
        edges = order[bounds[k] : bounds[k + 1]]
        if len(edges) < 3:
            continue
        axes = plane_axes(planes[k, 3:])[:2]
        segments = (points[np.stack([tail[edges], head[edges]], axis=1)] - planes[k, :3]) @ axes.T
        lines: np.ndarray = shapely.linestrings(segments)  # pyright: ignore[reportAssignmentType]
        shape = shapely.build_area(shapely.multilinestrings(lines))
        outlines.append((k, shapely.get_parts(shape)))
    return outlines


def _facets(outline: Polygon, origin: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(K, 3, 3) triangles that fill an outline of a plane, with its corners and no others [m].

    Args:
        outline: in the plane's axes [m].
        origin: (3,) where those start [m].
        axes: (3, 3) rows: the two axes of the plane and its normal.
    """
    parts = shapely.orient_polygons(shapely.get_parts(shapely.constrained_delaunay_triangles(outline)))
    corners = np.array([shapely.get_coordinates(part)[:3] for part in parts[shapely.area(parts) > MIN_TRIANGLE]])
    return origin + corners.reshape(-1, 3, 2) @ axes[:2]


def _plain(outline: Polygon, cell: float) -> shapely.geometry.base.BaseGeometry:
    """An outline without the steps of the cells that a map is made of, inside the one given where it has some.

    Args:
        outline: bounded by edges of cells [m].
        cell: length of an edge [m].
    """
    straight = outline.simplify(cell / 10)
    if len(shapely.get_coordinates(straight)) <= 12:
        return straight
    plain = outline.buffer(-cell / 2, join_style="mitre").simplify(cell / 2)
    if len(shapely.get_coordinates(plain)) <= 40:
        return plain
    return outline.buffer(-cell, join_style="mitre").simplify(cell)
