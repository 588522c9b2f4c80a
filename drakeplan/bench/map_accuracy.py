"""How true the surfaces of an imported point cloud are: normals and edges on made-up ground, three ways of finding planes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from drakeplan.bench.table import BenchOptions, BenchTable
from scenes.footholds.convex_cover import convex_pieces, min_width
from scenes.imports.cloud_outlines import outlines_of
from scenes.imports.cloud_terrain import cloud_terrain
from scenes.meshes.mesh_import import NARROWEST, surfaces_of_mesh
from scenes.meshes.mesh_orientation import Bodies
from scenes.meshes.planar_regions import plane_axes
from scenes.pose import rpy_rotation
from scenes.terrain.surface import Surface

COLUMNS = (
    "noise mm", "points", "method", "level plates found", "walls found", "normal deg, median", "normal deg, worst",
    "edge mm, median", "edge mm, 95 %", "edges within 2 cm %", "s",
)  # fmt: skip
NOISES = (0.001, 0.003, 0.005)  # [m]
POINTS = 300_000
MOST_SEEDS = 3
NEAR_NORMAL, NEAR_PLANE = np.cos(np.deg2rad(5.0)), 0.02  # a surface that is farther off is not of the plate
FOUND = 0.5  # share of a plate that surfaces cover at least
APART = 0.01  # [m] between places on an edge that are measured
GOOD = 0.02  # [m]
CELL = 0.02  # [m] of the height map
THINNED, NEIGHBOURS, BESIDE = 100_000, 30, 12  # points of plain region growing: in all, for a normal, to grow to
SMOOTH, LEAST = np.cos(np.deg2rad(3.0)), 0.01  # of plain region growing: angle between neighbours, [m^2]
CLOSE = 0.05  # [m] holes up to this width are filled

Method = Callable[[np.ndarray], list[Surface]]


@dataclass(frozen=True, eq=False)
class Ground:
    """Made-up ground whose truth is known.

    Attributes:
        plates: (4, 3) corners of the flat parts that are judged, by name [m].
        others: (4, 3) those that only are there [m].
    """

    plates: dict[str, np.ndarray]
    others: dict[str, np.ndarray]


@dataclass(frozen=True)
class Errors:
    """Of surfaces against plates: how many were found, angles between normals [deg], distances of edges [m]."""

    level: tuple[int, int]
    walls: tuple[int, int]
    angles: tuple[float, ...]
    edges: tuple[float, ...]


def accuracy_table(options: BenchOptions) -> BenchTable:
    """Each method on stairs, a field of tilted blocks and a wall, with noise of 1, 3 and 5 mm."""
    rows = []
    for noise in NOISES:
        for name, method in METHODS.items():
            level, walls = np.zeros(2, int), np.zeros(2, int)
            angles: list[float] = []
            edges: list[float] = []
            seconds = []
            for seed in range(min(options.seeds, MOST_SEEDS)):
                ground = made_up_ground(seed)
                points = cloud_of(ground, POINTS, noise, seed)
                began = time.process_time()
                surfaces = method(points)
                seconds.append(time.process_time() - began)
                errors = errors_of(surfaces, ground)
                level, walls = level + errors.level, walls + errors.walls
                angles += errors.angles
                edges += errors.edges
            off = [1e3 * edge for edge in edges]
            row = (
                1e3 * noise, POINTS, name, f"{level[0]} of {level[1]}", f"{walls[0]} of {walls[1]}",
                *_spread(angles, 50, 100), *_spread(off, 50, 95), *_share(off), float(np.median(seconds)),
            )  # fmt: skip
            rows.append(row)
            options.tell(f"noise {1e3 * noise:g} mm, {name}: {row[3]}, {row[4]}, {row[6]:.2f} deg, {row[8]:.1f} mm")
    notes = (
        "Floor, three steps, 16 blocks tilted by up to 11 deg, and a wall of 2 m; holes of 2 to 4 cm in it all; processor time.",
        "A plate is found where surfaces within 5 deg and 2 cm of it cover half of it; its edges are measured every centimetre.",
        "Region growing: 100 000 of the points, normals of 30 neighbours (5 cm), 3 deg from each to the next.",
        "Height map: means of 2 cm cells.",
    )
    title = "Surfaces of point clouds against the truth"
    return BenchTable("maps_accuracy", title, COLUMNS, tuple(rows), notes, "maps", most_seeds=MOST_SEEDS)


def _spread(values: list[float], *percent: float) -> list[float]:
    return [float(np.percentile(values, p)) if values else float("nan") for p in percent]


def _share(off: list[float]) -> list[float]:
    return [100.0 * float(np.mean(np.array(off) <= 1e3 * GOOD)) if off else float("nan")]


def made_up_ground(seed: int) -> Ground:
    """Stairs of three steps, a field of tilted blocks on the landing, a wall along them."""
    rng = np.random.default_rng(seed)

    def plate(corner: tuple, along: tuple, across: tuple) -> np.ndarray:
        o, u, v = np.array(corner, float), np.array(along, float), np.array(across, float)
        return np.array([o, o + u, o + u + v, o + v])

    plates = {"floor": plate((-0.6, -1, 0), (1.2, 0, 0), (0, 2, 0))}
    for k in range(3):
        plates[f"riser {k}"] = plate((0.6 + 0.3 * k, -1, 0.15 * k), (0, 0, 0.15), (0, 2, 0))
        if k < 2:
            plates[f"tread {k}"] = plate((0.6 + 0.3 * k, -1, 0.15 * (k + 1)), (0.3, 0, 0), (0, 2, 0))
    plates["wall"] = plate((-0.6, 1.1, 0), (4.2, 0, 0), (0, 0, 2))
    others = {"landing": plate((1.2, -1, 0.45), (2.4, 0, 0), (0, 2, 0))}
    for k in range(16):
        size = np.array([0.34, 0.34, rng.uniform(0.1, 0.2)])
        R = rpy_rotation((*rng.uniform(-0.2, 0.2, 2), rng.uniform(-0.2, 0.2)))
        centre = np.array([1.75 + 0.48 * (k // 4), -0.74 + 0.48 * (k % 4), 0.5])
        for axis in range(3):
            u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            for sign in (1, -1) if axis < 2 else (1,):
                ring = np.array([u + v, v - u, -u - v, u - v])[::sign] + sign * np.eye(3)[axis]
                face = (ring * size / 2) @ R.T + centre
                (plates if axis == 2 else others)[f"block {k}" if axis == 2 else f"side {k} {axis} {sign}"] = face
    return Ground(plates, others)


def cloud_of(ground: Ground, count: int, noise: float, seed: int) -> np.ndarray:
    """(N, 3) points spread evenly over the ground, with noise and small holes; what lies under blocks is not seen.

    Args:
        ground: to be measured.
        count: of the points before some are hidden.
        noise: standard deviation along each axis [m].
        seed: of all that is drawn.
    """
    rng = np.random.default_rng(seed)
    faces = {**ground.plates, **ground.others}
    areas = np.array([np.linalg.norm(np.cross(f[1] - f[0], f[3] - f[0])) for f in faces.values()])
    parts = []
    for (name, face), number in zip(faces.items(), rng.multinomial(count, areas / areas.sum()), strict=True):
        share = rng.random((number, 2))
        points = face[0] + share[:, :1] * (face[1] - face[0]) + share[:, 1:] * (face[3] - face[0])
        if name.startswith("side"):
            points = points[points[:, 2] > 0.45]
        if name == "landing":
            for block, top in ground.plates.items():
                if block.startswith("block"):
                    points = points[~shapely.contains_xy(shapely.Polygon(top[:, :2]), points[:, :2])]
        parts.append(points)
    points = np.concatenate(parts)
    points = points + noise * rng.standard_normal(points.shape)
    gone = KDTree(points).query_ball_point(points[rng.integers(len(points), size=40)], rng.uniform(0.01, 0.02, 40))
    return np.delete(points, np.unique(np.concatenate(gone).astype(np.int64)), axis=0)


def errors_of(surfaces: list[Surface], ground: Ground) -> Errors:
    """Compares surfaces with the plates that are judged; their side does not matter.

    Args:
        surfaces: that were found.
        ground: that was measured.
    """
    found = {"level": [0, 0], "wall": [0, 0]}
    angles: list[float] = []
    edges: list[float] = []
    for plate in ground.plates.values():
        normal = np.cross(plate[1] - plate[0], plate[3] - plate[0])
        normal /= np.linalg.norm(normal)
        axes, origin = plane_axes(normal), plate.mean(axis=0)
        true = shapely.Polygon((plate - origin) @ axes[:2].T)
        shapes, covers, tilts = [], [], []
        for surface in surfaces:
            along = abs(float(surface.normal @ normal))
            if along < NEAR_NORMAL:
                continue
            flat = (surface.vertices - origin) @ axes.T
            shape = shapely.Polygon(flat[:, :2])
            cover = shape.intersection(true).area
            if cover > 0 and np.abs(flat[:, 2] * _inside(flat, true)).max() <= NEAR_PLANE:
                shapes.append(shape)
                covers.append(cover)
                tilts.append(np.rad2deg(np.arccos(min(along, 1.0))))
        kind = found["level" if abs(normal[2]) > 0.7 else "wall"]
        kind[1] += 1
        whole = shapely.union_all(shapes)
        if not shapes or whole.intersection(true).area < FOUND * true.area:
            continue
        kind[0] += 1
        angles.append(float(tilts[int(np.argmax(covers))]))
        places = shapely.points(shapely.get_coordinates(shapely.segmentize(true.exterior, APART)))
        edges += np.asarray(shapely.distance(places, whole.boundary)).tolist()
    level, wall = found["level"], found["wall"]
    return Errors((level[0], level[1]), (wall[0], wall[1]), tuple(angles), tuple(edges))


def _inside(flat: np.ndarray, true: shapely.Polygon) -> np.ndarray:
    """(K,) 1 for corners near a plate, else 0: a floor that goes on beyond it may be anywhere there."""
    return shapely.contains_xy(true.buffer(0.05), flat[:, :2]).astype(float)


def by_distance(points: np.ndarray) -> list[Surface]:
    """The importer's own way."""
    return list(cloud_terrain(points, friction=0.5, close=CLOSE).surfaces)


def by_normals(points: np.ndarray) -> list[Surface]:
    """Plain region growing: neighbours whose normals are nearly the same are of one plane."""
    points = points[np.random.default_rng(0).permutation(len(points))[:THINNED]]
    tree = KDTree(points)
    near = np.asarray(tree.query(points, k=NEIGHBOURS)[1])
    spread = points[near] - points[near].mean(axis=1, keepdims=True)
    normal = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))[1][:, :, 0]
    row, column = np.repeat(np.arange(len(points)), BESIDE), near[:, 1 : 1 + BESIDE].ravel()
    like = np.abs((normal[row] * normal[column]).sum(axis=1)) >= SMOOTH
    graph = coo_array((np.ones(int(like.sum())), (row[like], column[like])), shape=(len(points),) * 2)
    label = connected_components(graph, directed=False)[1]
    density = NEIGHBOURS / (np.pi * np.median(tree.query(points[::50], k=NEIGHBOURS)[0][:, -1]) ** 2)
    surfaces: list[Surface] = []
    for k in np.flatnonzero(np.bincount(label) >= LEAST * density):
        own = points[label == k]
        middle = own.mean(axis=0)
        axes = plane_axes(np.linalg.svd(own - middle, full_matrices=False)[2][2])
        for outline in outlines_of((own - middle) @ axes[:2].T, density, CLOSE)[0]:
            pieces = [p for p in convex_pieces(outline) if min_width(p) >= NARROWEST]
            surfaces += [Surface(f"{k}/{n}", middle + p @ axes[:2]) for n, p in enumerate(pieces)]
    return surfaces


def by_height_map(points: np.ndarray) -> list[Surface]:
    """Mean heights over a grid, as a mesh whose flat parts are cut out: ground only, one height a place."""
    low = points.min(axis=0)
    place = np.floor((points[:, :2] - low[:2]) / CELL).astype(np.int64)
    columns, rows = (int(n) + 1 for n in place.max(axis=0))
    cell = place[:, 1] * columns + place[:, 0]
    count = np.bincount(cell, minlength=rows * columns)
    with np.errstate(invalid="ignore"):
        height = (np.bincount(cell, points[:, 2], len(count)) / count).reshape(rows, columns)
    x, y = low[0] + CELL * (0.5 + np.arange(columns)), low[1] + CELL * (0.5 + np.arange(rows))
    grid = np.stack([*np.meshgrid(x, y), height], axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    triangles = np.concatenate([np.stack([a, b, c], axis=-2), np.stack([a, c, d], axis=-2)]).reshape(-1, 3, 3)
    return list(surfaces_of_mesh(Bodies(triangles[np.isfinite(triangles).all(axis=(1, 2))]), "map", 0.5)[1])


METHODS: dict[str, Method] = {
    "by distance (drakeplan)": by_distance,
    "region growing by normals": by_normals,
    "height map": by_height_map,
}
