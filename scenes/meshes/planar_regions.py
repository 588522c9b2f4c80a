"""Triangles merged into the largest flat regions, less the parts that lie inside a solid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
import shapely
from numba import njit
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from scenes.meshes.mesh_orientation import Bodies, row_numbers
from scenes.terrain.polygon import area_vectors

OFF_PLANE = 1e-3  # [m] corners of one region lie about this near its plane
NORMAL_CELL = 0.04  # grid of unit normals, coarser than twice the degree below
REFITS = 8  # how often a plane is fitted to its faces at most
OFF_NORMAL = np.cos(np.deg2rad(1.0))  # normals of one region lie within a degree
GRID = 1e-5  # [m] corners are snapped to this, so that what should touch touches
MANY = 500  # triangles, from which on they are joined by their edges: a union of polygons takes 0.2 ms for each
CRACK = 2e-4  # [m] gaps between faces up to this width are closed
BURIED = 1.5e-3  # [m] height over a region at which what is solid hides it; more than OFF_PLANE


@dataclass(frozen=True, eq=False)
class Region:
    """A connected flat region, with holes where it has them.

    Attributes:
        outline: in the region's own axes [m].
        origin: (3,) where those axes start [m].
        axes: (3, 3) rows: the two axes of the plane and the outward normal.
    """

    outline: Polygon
    origin: np.ndarray
    axes: np.ndarray

    def lift(self, corners: np.ndarray) -> np.ndarray:
        """(K, 3) points of W from (K, 2) points of the region's own axes [m]."""
        return self.origin + corners @ self.axes[:2]


def planar_regions(bodies: Bodies, *, min_width: float, max_tilt: float) -> Iterator[Region]:
    """The flat regions of a mesh that are wide enough and do not face down too much, their buried parts cut away.

    Faces belong together when they lie in one plane (`OFF_PLANE`, `OFF_NORMAL`) and touch; that they share no edge in
    the file, overlap, or come from two blocks side by side makes no difference.

    Args:
        bodies: of the mesh, counter-clockwise from outside, no triangle degenerate.
        min_width: regions in which no disc of this diameter fits are left out [m].
        max_tilt: regions whose normal is farther from the vertical are left out [rad].
    """
    triangles = bodies.triangles
    doubled = area_vectors(triangles)
    area = np.linalg.norm(doubled, axis=1) / 2
    normals = doubled / (2 * area[:, None])
    wanted = normals[:, 2] >= np.cos(max_tilt) - 1e-9
    least = np.pi / 4 * min_width**2
    for members, origin, normal in _coplanar_groups(triangles, normals, area, wanted):
        if area[members].sum() < least:
            continue
        axes = plane_axes(normal)
        flat = (triangles[members] - origin) @ axes[:2].T
        outline = _merged(flat)
        if outline.buffer(-min_width / 2).is_empty:
            continue
        # A closed body does not wind round a point outside its box: a section needs only the bodies near it.
        low, high = triangles[members].min(axis=(0, 1)), triangles[members].max(axis=(0, 1))
        near = bodies.near(low - 2 * BURIED, high + 2 * BURIED)
        around = (triangles, normals) if near.all() else (triangles[near], normals[near])
        outline = outline.difference(buried_part(outline, *around, origin, axes))
        for part in shapely.get_parts(outline):
            if isinstance(part, Polygon) and not part.buffer(-min_width / 2).is_empty:
                yield Region(part, origin, axes)


def _coplanar_groups(
    triangles: np.ndarray, normals: np.ndarray, area: np.ndarray, wanted: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """(indices, point, normal) of the triangles in one plane with each seed, the largest triangle not yet taken.

    The plane is fitted to what it has gathered and gathers again, so that a rough floor does not fall apart because its
    largest triangle lies a little askew.
    """
    free = wanted.copy()
    # Normals within two degrees differ by less than a cell, so they lie in the seed's cell or one next to it.
    cells = np.floor(np.nan_to_num(normals) / NORMAL_CELL).astype(np.int64)
    order = np.lexsort(cells.T[::-1])
    keys, starts = np.unique(cells[order], axis=0, return_index=True)
    members = dict(zip(map(tuple, keys.tolist()), np.split(order, starts[1:]), strict=True))
    centres = triangles.mean(axis=1)
    for seed in np.argsort(-area, kind="stable"):
        if not free[seed]:
            continue
        i, j, k = cells[seed].tolist()
        around = product((i - 1, i, i + 1), (j - 1, j, j + 1), (k - 1, k, k + 1))
        near = np.concatenate([members[cell] for cell in around if cell in members])
        near = near[free[near]]
        point, normal = centres[seed], normals[seed]
        taken = np.array([seed])
        for _ in range(REFITS):
            like = near[normals[near] @ normal >= OFF_NORMAL]
            off = np.abs((triangles[like] - point) @ normal).max(axis=1)
            gathered = like[off <= OFF_PLANE]
            if len(gathered) <= len(taken) or seed not in gathered:
                break
            taken = gathered
            weights = area[taken] / area[taken].sum()
            point, normal = weights @ centres[taken], weights @ normals[taken]
            normal /= np.linalg.norm(normal)
        free[taken] = False
        yield taken, point, normal


def plane_axes(normal: np.ndarray) -> np.ndarray:
    """(3, 3) rows: two axes of the plane, the first one level, and its normal."""
    level = np.array([-normal[1], normal[0], 0.0])
    if np.linalg.norm(level) < 1e-6:
        level = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    level /= np.linalg.norm(level)
    return np.stack([level, np.cross(normal, level), normal])


def _merged(flat: np.ndarray) -> BaseGeometry:
    """The union of (K, 3, 2) triangles, cracks closed."""
    union = _inside_rim(flat) if len(flat) > MANY else None
    if union is None:
        union = shapely.union_all(shapely.polygons(flat), grid_size=GRID)
    return union.buffer(CRACK, join_style="mitre").buffer(-CRACK, join_style="mitre")


def _inside_rim(flat: np.ndarray) -> BaseGeometry | None:
    """The union of many (K, 3, 2) triangles from the edges that only one of them has; None where some overlap."""
    corners = np.round(flat.reshape(-1, 2) / GRID).astype(np.int64)
    corner = row_numbers(corners).reshape(-1, 3)
    tail, head = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    edge = row_numbers(np.sort(np.stack([tail, head], axis=1), axis=1))
    count, forward = np.bincount(edge), np.bincount(edge, weights=np.where(tail < head, 1, -1))
    if count.max() > 2 or (forward[count == 2] != 0).any():
        return None
    points = (corners * GRID).reshape(-1, 3, 2)
    sides = np.stack([points, np.roll(points, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    lines: np.ndarray = shapely.linestrings(sides[count[edge] == 1])  # pyright: ignore[reportAssignmentType]
    shape: BaseGeometry = shapely.build_area(shapely.multilinestrings(lines))  # pyright: ignore[reportAssignmentType]
    one, two = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    area = float((one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]).sum()) / 2
    return shape if shape.is_valid and abs(shape.area - area) < 1e-9 * area + GRID**2 else None


def buried_part(
    outline: BaseGeometry, triangles: np.ndarray, normals: np.ndarray, origin: np.ndarray, axes: np.ndarray
) -> BaseGeometry:
    """The part of a region that has solid on top, found in a section parallel to it and `BURIED` above.

    Args:
        outline: of the region, in its own axes [m].
        triangles: (K, 3, 3) what may be solid, counter-clockwise from outside [m].
        normals: (K, 3) outward unit normals.
        origin: (3,) where the region's axes start [m].
        axes: (3, 3) rows: the two axes of the plane and the outward normal.

    A sole set down there would stand inside a block. The section's cells are solid where the faces around them wind
    once or more: that faces are doubled, interpenetrate or belong to no closed body does not matter, and what a body
    with missing faces fails to enclose is kept.
    """
    height = (triangles.reshape(-1, 3) @ axes[2]).reshape(-1, 3) - (origin @ axes[2] + BURIED)
    below = (height < 0).view(np.int8)
    corners = below[:, 0] + below[:, 1] + below[:, 2]
    crossing = np.flatnonzero((corners > 0) & (corners < 3))
    segments = _section(triangles[crossing], height[crossing], normals[crossing], origin, axes)
    if len(segments) == 0:
        return Polygon()
    # The cells are needed over the outline only: a frame closes them there.
    frame = shapely.box(*outline.buffer(10 * GRID).bounds)
    low, high = np.array(frame.bounds[:2]), np.array(frame.bounds[2:])
    here = ((segments.min(axis=1) <= high) & (segments.max(axis=1) >= low)).all(axis=1)
    lines: np.ndarray = shapely.linestrings(segments[here])  # pyright: ignore[reportAssignmentType]
    inner = outline.buffer(-10 * GRID)
    shapely.prepare(inner)
    if not inner.is_empty and not shapely.intersects(inner, lines).any():  # most regions of a rough mesh: one cell
        parts = shapely.get_parts(inner)
        inside = shapely.get_coordinates(shapely.point_on_surface(parts))
        within = parts[[_winds_round(point[None], segments) for point in inside]]
        return (
            outline if len(within) == shapely.get_num_geometries(inner) else shapely.union_all(within).buffer(20 * GRID)
        )
    lines = shapely.set_precision(lines, GRID)
    noded = shapely.union_all([*lines[~shapely.is_empty(lines)], frame.exterior], grid_size=GRID)
    cells = shapely.get_parts(shapely.polygonize([noded]))
    cells = cells[shapely.intersects(cells, outline) & shapely.contains(frame.buffer(10 * GRID), cells)]
    # Where a body has a hole in it, segments wind round a part of a cell only: all of its parts are looked at.
    triangles, cell = shapely.get_parts(shapely.constrained_delaunay_triangles(cells), return_index=True)
    samples = np.split(
        shapely.get_coordinates(shapely.centroid(triangles)), np.searchsorted(cell, np.arange(1, len(cells)))
    )
    solid = [c for c, points in zip(cells, samples, strict=True) if len(points) and _winds_round(points, segments)]
    return shapely.union_all(solid, grid_size=GRID)


def _section(
    triangles: np.ndarray, height: np.ndarray, normals: np.ndarray, origin: np.ndarray, axes: np.ndarray
) -> np.ndarray:
    """(S, 2, 2) segments in which triangles cut the plane of height zero, the solid on their left [m]."""
    rolled, rolled_height = np.roll(triangles, -1, axis=1), np.roll(height, -1, axis=1)
    cuts = (height < 0) != (rolled_height < 0)
    # Every triangle here has corners on both sides, so exactly two of its edges are cut.
    share = (height / np.where(cuts, height - rolled_height, 1.0))[cuts].reshape(-1, 2, 1)
    ends = triangles[cuts].reshape(-1, 2, 3) + share * (rolled[cuts] - triangles[cuts]).reshape(-1, 2, 3)
    segments = (ends - origin) @ axes[:2].T
    along = segments[:, 1] - segments[:, 0]
    outward = normals @ axes[:2].T
    wrong = outward[:, 0] * along[:, 1] - outward[:, 1] * along[:, 0] < 0
    segments[wrong] = segments[wrong, ::-1]
    return segments


@njit(cache=True)
def _winds_round(points: np.ndarray, segments: np.ndarray) -> bool:
    """Whether (S, 2, 2) segments wind more than half a turn round each of the points (P, 2), counter-clockwise.

    The angles at which a point sees the segments add up to whole turns where these close, and to less where they do not.
    The complex numbers of those angles are multiplied; a turn is full where the product passes the negative axis.
    """
    for point in points:
        x, y, turns = 1.0, 0.0, 0
        for k in range(segments.shape[0]):
            ax, ay = segments[k, 0, 0] - point[0], segments[k, 0, 1] - point[1]
            bx, by = segments[k, 1, 0] - point[0], segments[k, 1, 1] - point[1]
            real, imaginary = ax * bx + ay * by, ax * by - ay * bx
            before = y
            x, y = x * real - y * imaginary, x * imaginary + y * real
            scale = max(abs(x), abs(y))
            if scale == 0.0:
                return False  # on a segment
            x, y = x / scale, y / scale
            if imaginary > 0.0 and before > 0.0 and y < 0.0:
                turns += 1
            elif imaginary < 0.0 and before < 0.0 and y > 0.0:
                turns -= 1
        if turns + np.arctan2(y, x) / (2.0 * np.pi) <= 0.5:
            return False
    return True
