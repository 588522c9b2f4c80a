"""Planes in a point cloud: grown over surfels by distance, then fitted to the points themselves.

Normals of neighbours, by which plain region growing decides, tilt near every edge. A region here takes what lies near its
plane, however it faces there (as `scenes.meshes.rough_ground` does for maps). A strip along each edge then lies near two
planes: such points go to the nearer one and count in neither fit, so that no plane is tilted by its neighbour.
"""

# SciPy's stubs lose the types of sparse arrays.
# pyright: reportOptionalSubscript=false, reportAttributeAccessIssue=false, reportReturnType=false, reportOperatorIssue=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from scenes.imports.surfels import Surfels, local_planes, surfels_of
from scenes.meshes.planar_regions import plane_axes
from scenes.meshes.rough_ground import _grow as grow_planes

SMALL = 0.01  # [m^2] planes smaller than this are left over
REACH = 0.05  # [m] standard deviation of the weights over which local planes are fitted
DEVIATIONS = 4.0  # tolerance in standard deviations of the noise: one point in 16 000 is farther off
TOLERANCE = (0.008, 0.04)  # [m] least and greatest tolerance of surfels
QUIET = 25  # [%] of the surfels are taken to lie in plain ground, away from edges
CANDIDATES = 6  # planes that are looked at for a point
FACING = np.cos(
    np.deg2rad(45.0)
)  # most surfels of a plane face along its normal; a belt round a low block faces across
AROUND = 4  # cells around a surfel in which its points look for planes
ENOUGH = 200_000  # points to fit planes to
TURNS = 4  # of fitting planes to points and giving points to planes
SHALLOW = np.cos(np.deg2rad(30.0))  # planes that cross at a smaller angle share a wide strip
SAME_NORMAL = np.cos(np.deg2rad(4.0))  # of two parts of one plane
LOOSER = 1.2  # noise of two parts taken together, over that of the noisier one, up to which they are one plane


@dataclass(frozen=True, eq=False)
class CloudPlanes:
    """The planes of a cloud.

    Attributes:
        plane: (N,) plane of each point, -1 for none.
        origin: (R, 3) a point of each plane [m].
        axes: (R, 3, 3) rows: the two axes of each plane and its normal.
        noise: (R,) standard deviation of each plane's points from it [m].
        tolerance: greatest distance of a point from its plane [m].
    """

    plane: np.ndarray
    origin: np.ndarray
    axes: np.ndarray
    noise: np.ndarray
    tolerance: float


@dataclass(frozen=True, eq=False)
class _Fit:
    """Planes by the moments of their points: (R,) count, (R, 3) mean [m], (R, 3, 3) spread [m^2], normal, deviation [m]."""

    count: np.ndarray
    origin: np.ndarray
    spread: np.ndarray
    normal: np.ndarray
    deviation: np.ndarray


@dataclass(frozen=True, eq=False)
class _Near:
    """(V, `CANDIDATES`) the planes in a surfel and next to it, and in a larger neighbourhood; -1 for none."""

    beside: np.ndarray
    around: np.ndarray

    @staticmethod
    def of(average: csr_array, region: np.ndarray, planes: int) -> _Near:
        """By the plane of each surfel (V,), -1 for none."""
        held = np.flatnonzero(region >= 0)
        return _Near(*(_strongest(_spread(average, held, region[held], planes, reach)) for reach in (1, AROUND)))


def planes_of(points: np.ndarray, cell: float) -> CloudPlanes:
    """The planes of a cloud; normals look up, those of upright planes along the larger of x and y.

    Args:
        points: (N, 3) finite [m].
        cell: of the surfels [m].
    """
    surfels = surfels_of(points, cell)
    region, grown, tolerance = _grown(surfels)
    if not len(grown):
        none = np.zeros((0, 3))
        return CloudPlanes(np.full(len(points), -1), none, np.zeros((0, 3, 3)), np.zeros(0), tolerance)
    average = surfels.average()
    average = surfels.average()
    # Planes are fitted to some of the points; evenly drawn, for neighbours in a file are neighbours in space.
    some = np.argsort(surfels.of_point, kind="stable")[:: max(1, len(points) // ENOUGH)]
    origin, normal, deviation = grown[:, :3], grown[:, 3:], np.zeros(len(grown))
    for turn in range(TURNS):
        last = turn == TURNS - 1
        used = slice(None) if last else some
        drawn, of_point = points[used], surfels.of_point[used]
        near = _Near.of(average, region, len(origin))
        plane, alone, off = _assigned(drawn, of_point, near, origin, normal, tolerance)
        plane = _outvoted(plane, alone, off, near.around[of_point], of_point, average, normal, tolerance)
        if last:
            break
        fit = _fit(drawn, np.where(alone, plane, -1), origin, normal)
        origin, normal, deviation = fit.origin, fit.normal, fit.deviation
        median = float(np.median(deviation[fit.count > 0])) if fit.count.any() else tolerance / DEVIATIONS
        tolerance = float(np.clip(DEVIATIONS * median, TOLERANCE[0] / 2, TOLERANCE[1]))
        if turn == 0:
            whole, first = _merged(near.around, fit)
            plane = np.where(plane >= 0, whole[plane], -1)
            origin, normal, deviation = origin[first], normal[first], deviation[first]
        region = _owners(of_point, plane, len(surfels.points), len(origin))
    normal = np.where((_upward(normal) < 0)[:, None], -normal, normal)
    return CloudPlanes(plane, origin, np.array([plane_axes(n) for n in normal]), deviation, tolerance)


def _grown(surfels: Surfels) -> tuple[np.ndarray, np.ndarray, float]:
    """(V,) region of each surfel or -1, (R, 6) a point and the normal of each region's plane, and the tolerance [m].

    Regions that surfels face across are given up, and what is free grows once more.
    """
    middle, normal, noise = local_planes(surfels.points, surfels.average(), passes=surfels.passes(REACH))
    _, facing, _ = local_planes(surfels.points, surfels.average(), passes=1)
    tolerance = float(np.clip(DEVIATIONS * np.percentile(noise, QUIET), *TOLERANCE))
    least = max(3, int(SMALL / surfels.cell**2))
    region, planes = np.full(len(noise), -1), np.zeros((0, 6))
    graph = surfels.graph()
    for _ in range(2):
        free = np.flatnonzero(region < 0)
        if len(free) < least:
            break
        among = graph[free][:, free]
        start, neighbour = among.indptr.astype(np.int64), among.indices.astype(np.int64)
        seeds = np.argsort(noise[free], kind="stable")
        found, fitted = grow_planes(
            surfels.points[free], start, neighbour, seeds, middle[free], normal[free], tolerance, least
        )
        own = found >= 0
        along = np.abs((facing[free[own]] * fitted[found[own], 3:]).sum(axis=1)) > FACING
        size = np.bincount(found[own], minlength=len(fitted))
        true = np.bincount(found[own], weights=along, minlength=len(fitted)) > 0.5 * size
        number = np.where(true, len(planes) + np.cumsum(true) - 1, -1)
        region[free[own]] = number[found[own]]
        planes = np.concatenate([planes, fitted[true]])
    return region, planes, tolerance


def _upward(normal: np.ndarray) -> np.ndarray:
    """(R,) the component of each normal that is to be positive."""
    largest = np.argmax(np.abs(normal[:, :2]), axis=1)
    return np.where(np.abs(normal[:, 2]) > 1e-6, normal[:, 2], normal[np.arange(len(normal)), largest])


def _spread(average: csr_array, surfel: np.ndarray, plane: np.ndarray, planes: int, reach: int) -> csr_array:
    """(V, R) how much of each plane there is around each surfel.

    Args:
        average: (V, V) means over a surfel and its neighbours.
        surfel: (n,) surfels that hold a bit of a plane.
        plane: (n,) which.
        planes: how many there are.
        reach: how many cells away a bit counts.
    """
    weights = coo_array((np.ones(len(plane)), (surfel, plane)), shape=(average.shape[0], planes)).tocsr()
    for _ in range(reach):
        weights = average @ weights
    return weights.tocsr()


def _strongest(near: csr_array) -> np.ndarray:
    """(V, `CANDIDATES`) the planes of which there is most around each surfel; -1 for none."""
    row = np.repeat(np.arange(near.shape[0]), np.diff(near.indptr))
    order = np.lexsort((-near.data, row))
    rank = np.arange(len(row)) - near.indptr[row]  # rows are in order already
    keep = rank < CANDIDATES
    found = np.full((near.shape[0], CANDIDATES), -1)
    found[row[keep], rank[keep]] = near.indices[order][keep]
    return found


def _owners(of_point: np.ndarray, plane: np.ndarray, surfels: int, planes: int) -> np.ndarray:
    """(V,) the plane that most points of each surfel have, -1 for none.

    Args:
        of_point: (N,) surfel of each point.
        plane: (N,) its plane, -1 for none.
        surfels: how many there are.
        planes: how many there are.
    """
    held = plane >= 0
    pair, votes = np.unique(of_point[held] * planes + plane[held], return_counts=True)
    surfel = pair // planes
    order = np.lexsort((-votes, surfel))
    first = order[np.unique(surfel[order], return_index=True)[1]]
    owner = np.full(surfels, -1)
    owner[surfel[first]] = pair[first] % planes
    return owner


def _assigned(
    points: np.ndarray,
    of_point: np.ndarray,
    near: _Near,
    origin: np.ndarray,
    normal: np.ndarray,
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N,) nearest plane beside each point or -1, (N,) whether no other around is near, and (N, C) distances of those [m].

    Args:
        points: (N, 3) [m].
        of_point: (N,) surfel of each.
        near: planes that may be meant.
        origin: (R, 3) [m].
        normal: (R, 3).
        tolerance: greatest distance of a point from its plane [m].
    """
    row = np.arange(len(points))
    level = (origin * normal).sum(axis=1)

    def distances(planes: np.ndarray) -> np.ndarray:
        off = np.full(planes.shape, np.inf)
        for k in range(planes.shape[1]):
            there = np.flatnonzero(planes[:, k] >= 0)
            own = planes[there, k]
            off[there, k] = np.abs((points[there] * normal[own]).sum(axis=1) - level[own])
        return off

    planes = near.beside[of_point]
    off = distances(planes)
    best = np.argmin(off, axis=1)
    plane = np.where(off[row, best] <= tolerance, planes[row, best], -1)
    planes = near.around[of_point]
    off = distances(planes)
    return plane, ~((off <= tolerance) & (planes != plane[:, None])).any(axis=1), off


def _fit(points: np.ndarray, plane: np.ndarray, origin: np.ndarray, normal: np.ndarray) -> _Fit:
    """The best plane through each plane's points.

    Args:
        points: (N, 3) [m].
        plane: (N,) plane of each, -1 for none.
        origin: (R, 3) of the planes now, for those that have too few points [m].
        normal: (R, 3) of the planes now.
    """
    plane, points, size = plane[plane >= 0], points[plane >= 0], len(origin)
    count = np.bincount(plane, minlength=size)
    enough, share = count >= 10, 1 / np.maximum(count, 1)
    centred = points - origin[plane]
    mean = np.stack([np.bincount(plane, centred[:, k], size) for k in range(3)], axis=1) * share[:, None]
    centred -= mean[plane]
    spread = np.empty((size, 3, 3))
    for i in range(3):
        for j in range(i, 3):
            spread[:, i, j] = spread[:, j, i] = np.bincount(plane, centred[:, i] * centred[:, j], size) * share
    value, vector = np.linalg.eigh(spread)
    fitted = vector[:, :, 0] * np.where((vector[:, :, 0] * normal).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    return _Fit(
        np.where(enough, count, 0),
        np.where(enough[:, None], origin + mean, origin),
        spread,
        np.where(enough[:, None], fitted, normal),
        np.sqrt(np.maximum(value[:, 0], 0.0)),
    )


def _outvoted(
    plane: np.ndarray,
    alone: np.ndarray,
    off: np.ndarray,
    around: np.ndarray,
    of_point: np.ndarray,
    average: csr_array,
    normal: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    """(N,) planes of the points, where those near two planes that cross at a small angle go with their neighbours.

    Of two such planes each is the nearer one for half of the points in a strip about the line where they cross, however
    far from its own ground that is.

    Args:
        plane: (N,) nearest plane of each point, -1 for none.
        alone: (N,) whether no other is near.
        off: (N, C) distances from the planes around each [m].
        around: (N, C) those planes, -1 for none.
        of_point: (N,) surfel of each point.
        average: (V, V) means over surfels and their neighbours.
        normal: (R, 3) of the planes.
        tolerance: [m].
    """
    doubtful = np.flatnonzero(~alone & (plane >= 0))
    if not len(doubtful):
        return plane
    sure = alone & (plane >= 0)
    votes = _spread(average, of_point[sure], plane[sure], len(normal), AROUND)
    votes.sort_indices()
    held = np.repeat(np.arange(votes.shape[0]), np.diff(votes.indptr)) * len(normal) + votes.indices
    own = around[doubtful]
    steep = np.abs((normal[own] * normal[plane[doubtful]][:, None]).sum(axis=2)) < SHALLOW
    excluded = (off[doubtful] > tolerance) | steep
    row, column = np.nonzero(~excluded)
    given = np.full(own.shape, -1.0)
    wanted = of_point[doubtful[row]] * len(normal) + own[row, column]
    found = np.minimum(np.searchsorted(held, wanted), max(len(held) - 1, 0))
    if len(held):
        given[row, column] = np.where(held[found] == wanted, votes.data[found], 0.0)
    best = np.argmax(given, axis=1)
    at = np.arange(len(own))
    result = plane.copy()
    result[doubtful] = np.where(given[at, best] > 0, own[at, best], plane[doubtful])
    return result


def _merged(candidates: np.ndarray, fit: _Fit) -> tuple[np.ndarray, np.ndarray]:
    """(R,) which plane each becomes, where parts near each other are as flat together as alone; and one part of each.

    Args:
        candidates: (V, C) planes around each surfel.
        fit: the planes.
    """
    size, columns = len(fit.origin), candidates.shape[1]
    pairs = np.concatenate([candidates[:, [i, j]] for i in range(columns) for j in range(i + 1, columns)])
    pairs = np.sort(pairs[(pairs >= 0).all(axis=1)], axis=1)
    pairs = np.unique(pairs, axis=0)
    a, b = pairs[(fit.count[pairs] > 0).all(axis=1)].T
    like = np.abs((fit.normal[a] * fit.normal[b]).sum(axis=1)) >= SAME_NORMAL
    a, b = a[like], b[like]
    m, n = fit.count[a][:, None, None], fit.count[b][:, None, None]
    apart = fit.origin[a] - fit.origin[b]
    spread = (m * fit.spread[a] + n * fit.spread[b]) / np.maximum(m + n, 1)
    spread = spread + (m * n / np.maximum(m + n, 1) ** 2) * apart[:, :, None] * apart[:, None, :]
    together = np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, 0], 0.0)) if len(a) else np.zeros(0)
    # The smaller part must lie in the larger one's plane, too: of few points the noise of both together says little.
    larger, smaller = np.where(fit.count[a] >= fit.count[b], (a, b), (b, a))
    step = np.abs(((fit.origin[smaller] - fit.origin[larger]) * fit.normal[larger]).sum(axis=1))
    noisier = np.maximum(fit.deviation[a], fit.deviation[b])
    one = (together <= LOOSER * noisier) & (step <= 2 * noisier)
    graph = coo_array((np.ones(int(one.sum())), (a[one], b[one])), shape=(size, size))
    whole = connected_components(graph, directed=False)[1]
    order = np.lexsort((-fit.count, whole))
    return whole, order[np.unique(whole[order], return_index=True)[1]]
