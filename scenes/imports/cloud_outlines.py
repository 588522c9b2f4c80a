"""Outlines of the points of one plane: a raster, its small holes filled, lines fitted to its edges."""

from __future__ import annotations

import itertools

import numpy as np
import shapely
from scipy import ndimage
from shapely import Polygon

from scenes.imports.small_holes import small_holes
from scenes.meshes.mesh_import import NARROWEST

FULL = 4.0  # points that a cell of the raster holds on average, so that hardly any is empty by chance
RASTER = (0.008, 0.3)  # [m] least and greatest cell
RIM = 0.4  # cells that the outline is drawn in: those at the rim are partly full
BEND = 1.5  # cells that a straight edge may lie off the raster's steps
LEAST_BEND = 0.012  # [m] the same where cells are small: edges of real things are no straighter
SHARP = np.sin(np.deg2rad(15.0))  # two edges that meet at less have no corner to speak of


def outlines_of(flat: np.ndarray, density: float, close: float) -> tuple[list[Polygon], float]:
    """The regions that points of a plane cover, as polygons with holes, and the area of what was filled in them [m^2].

    Edges lie about half a cell of the raster from where points end; parts narrower than `NARROWEST` are left out.

    Args:
        flat: (N, 2) points in the plane's axes [m].
        density: points in a square metre.
        close: holes inside a region up to this width are filled [m].
    """
    cell = float(np.clip(np.sqrt(FULL / density), *RASTER))
    low = flat.min(axis=0) - 3 * cell
    place = np.floor((flat - low) / cell).astype(np.int64)
    held = np.zeros(place.max(axis=0) + 4, bool)
    held[tuple(place.T)] = True
    held = np.asarray(ndimage.binary_closing(held), bool)
    filled = held | small_holes(held, close / cell)
    found: list[Polygon] = []
    for part in shapely.get_parts(_area(filled, low, cell)):
        wide = part.buffer(-NARROWEST / 2, join_style="mitre").buffer(NARROWEST / 2 - RIM * cell, join_style="mitre")
        for shape in shapely.get_parts(wide):
            if isinstance(shape, Polygon) and not shape.buffer(-NARROWEST / 2).is_empty:
                found.append(_straightened(shape, cell))
    return found, float(filled.sum() - held.sum()) * cell**2


def _area(held: np.ndarray, low: np.ndarray, cell: float) -> shapely.Geometry:
    """The union of the cells that are held, from the edges between those and others."""
    edges = []
    for axis in (0, 1):
        i, j = np.nonzero(np.diff(held.view(np.int8), axis=axis))
        start = np.stack([i, j], axis=1) + np.eye(2, dtype=np.int64)[axis]
        edges.append(np.stack([start, start + np.eye(2, dtype=np.int64)[1 - axis]], axis=1))
    lines: np.ndarray = shapely.linestrings(low + cell * np.concatenate(edges))  # pyright: ignore[reportAssignmentType]
    return shapely.build_area(shapely.multilinestrings(lines))  # pyright: ignore[reportReturnType]


def _straightened(shape: Polygon, cell: float) -> Polygon:
    """The shape with a line fitted to each of its edges, as far as that stays what it was."""
    bend = max(BEND * cell, LEAST_BEND)
    plain = shapely.simplify(shape, bend)
    rings = [_fitted_ring(np.array(ring.coords), bend, cell) for ring in (shape.exterior, *shape.interiors)]
    if len(rings[0]) >= 3:
        fitted = Polygon(rings[0], [ring for ring in rings[1:] if len(ring) >= 3])
        if fitted.is_valid and shapely.hausdorff_distance(fitted, shape) <= 2.5 * bend:
            return fitted
    return plain if isinstance(plain, Polygon) and plain.is_valid else shape


def _fitted_ring(ring: np.ndarray, bend: float, cell: float) -> np.ndarray:
    """(K, 2) corners of lines fitted to the parts of a closed ring between its corners.

    Args:
        ring: (M, 2) coordinates, the last as the first [m].
        bend: greatest distance from an edge to what it stands for [m].
        cell: of the raster [m].
    """
    dense = shapely.get_coordinates(shapely.segmentize(shapely.linearrings(ring), cell))[:-1]
    # Starting at the point farthest from the middle, which is a corner, no edge is cut in two there.
    dense = np.roll(dense, -int(np.argmax(np.linalg.norm(dense - dense.mean(axis=0), axis=1))), axis=0)
    closed = np.concatenate([dense, dense[:1]])
    kept = shapely.get_coordinates(shapely.simplify(shapely.linestrings(closed), bend))
    start = 0
    marks = []
    for corner in kept[:-1]:  # simplification keeps points in order
        start += int(np.argmax((closed[start:] == corner).all(axis=1)))
        marks.append(start)
    marks.append(len(closed) - 1)
    lines = []
    for a, b in itertools.pairwise(marks):
        chain = closed[a : b + 1]
        if len(chain) >= 7:
            chain = chain[2:-2]  # corners of a raster are round
        middle = chain.mean(axis=0)
        lines.append((middle, np.linalg.svd(chain - middle)[2][0]))
    corners = []
    for k, (middle, along) in enumerate(lines):
        before, toward = lines[k - 1]
        old = closed[marks[k]]
        turn = toward[0] * along[1] - toward[1] * along[0]
        corner = 0.5 * (middle + along * ((old - middle) @ along) + before + toward * ((old - before) @ toward))
        if abs(turn) > SHARP:
            gap = middle - before
            met = before + toward * (gap[0] * along[1] - gap[1] * along[0]) / turn
            if np.linalg.norm(met - old) <= 2 * bend:
                corner = met
        corners.append(corner)
    return np.array(corners)
