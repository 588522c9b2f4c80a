"""A planar region with notches and holes, covered by convex polygons as large as they can be."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon

from scenes.meshes.convex_faces import join_coplanar
from scenes.terrain.polygon import area

SMOOTHING = 5e-4  # [m] corners that stand out or in by less are dropped first; a modeller's arcs have thousands
REFLEX = 2e-5  # [m] a corner that dents the outline by less is straight
FEW = 40  # corners of an outline that is worth a cover; it takes 20 ms
LEAST = 1e-5  # [m^2] pieces smaller than this carry nothing
SLIVER = 1e-7  # [m^2] uncovered area that is only rounding


def convex_cover(region: Polygon) -> list[np.ndarray]:
    """Large convex polygons inside a region whose union is the region, to `SMOOTHING` along its outline; they overlap.

    A partition would put seams across level ground on which no sole may stand, because a sole has to lie inside one
    surface. So each piece starts from a triangle that no piece covers yet and keeps cutting the region at the reflex
    corner nearest to it, in the direction that leaves most, until what is left is convex.

    Args:
        region: without self-intersections, holes allowed [m].

    Returns:
        (K, 2) counter-clockwise corners of each piece [m].
    """
    region = shapely.orient_polygons(shapely.simplify(region, SMOOTHING))
    if region.is_empty or region.area < SLIVER:
        return []
    seeds = shapely.get_parts(shapely.constrained_delaunay_triangles(region))
    seeds = seeds[np.argsort(-shapely.area(seeds), kind="stable")]
    pieces: list[Polygon] = []
    missing = region
    for seed in seeds:
        if missing.intersection(seed).area < SLIVER:
            continue
        piece = _grow(region, seed)
        pieces.append(piece)
        missing = missing.difference(piece)
    return [corners for corners in map(_corners, pieces) if len(corners) >= 3]


def convex_pieces(region: Polygon, few: int = FEW) -> list[np.ndarray]:
    """(K, 2) counter-clockwise convex polygons that make up a region: a cover of few corners, else pieces side by side.

    A cover of an outline with many dents has many pieces and takes long. Pieces side by side are one floor all the same
    (`scenes.terrain.floors`).

    Args:
        region: without self-intersections, holes allowed [m].
        few: corners of an outline, holes included, that is covered.
    """
    if len(shapely.get_coordinates(region)) <= few:
        return convex_cover(region)
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(region))
    corners = np.array([shapely.get_coordinates(shapely.orient_polygons(t))[:3] for t in triangles])
    corners = corners[shapely.area(triangles) > LEAST]
    flat = np.concatenate([corners, np.zeros((*corners.shape[:2], 1))], axis=2)
    return [ring[:, :2] for ring in join_coplanar(flat) if area(ring[:, :2]) > LEAST]


def min_width(corners: np.ndarray) -> float:
    """Width of a (K, 2) convex polygon across its narrowest direction [m]; that direction is normal to an edge."""
    edges = np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(edges, axis=1)
    edges, start = edges[length > 1e-9] / length[length > 1e-9, None], corners[length > 1e-9]
    away = corners[None] - start[:, None]
    across = edges[:, None, 0] * away[..., 1] - edges[:, None, 1] * away[..., 0]
    return float(across.max(axis=1).min())


def _corners(piece: Polygon) -> np.ndarray:
    """(K, 2) counter-clockwise corners of a piece, without those that rounding has set beside or between others.

    Fewer than three are left of a needle.
    """
    corners = shapely.get_coordinates(shapely.orient_polygons(piece.convex_hull))[:-1]
    corners = corners[np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) > 2 * REFLEX]
    arm, chord = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - np.roll(corners, 1, axis=0)
    bulge = np.abs(arm[:, 0] * chord[:, 1] - arm[:, 1] * chord[:, 0])
    return corners[bulge > REFLEX / 10 * np.linalg.norm(chord, axis=1)]


def _grow(region: Polygon, seed: Polygon) -> Polygon:
    """A convex part of the region around a convex seed, cut from it by half-planes through its reflex corners."""
    inside = np.array(seed.exterior.coords)[:-1]
    anchor = seed.centroid
    piece = region
    for _ in range(10 * len(shapely.get_coordinates(region))):
        corners, before, after = _reflex_corners(piece)
        if len(corners) == 0:
            return piece
        nearest = int(np.argmin(shapely.distance(shapely.points(corners), seed)))
        best = None
        for cut in _cuts(piece, corners[nearest], before[nearest], after[nearest], inside):
            part = next((p for p in shapely.get_parts(cut) if p.distance(anchor) < 1e-12), None)
            if part is not None and (best is None or part.area > best.area):
                best = part
        if best is None or best.area >= piece.area - 1e-14:
            return seed  # rounding at a needle's point: the seed itself is convex
        piece = shapely.orient_polygons(best)
    return seed


def _reflex_corners(piece: Polygon) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(R, 2) corners at which the interior spans more than 180 deg, with the (R, 2) corners before and after them."""
    found: list[np.ndarray] = []
    for ring in (piece.exterior, *piece.interiors):
        corners = np.array(ring.coords)[:-1]
        before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
        chord, arm = after - before, corners - before
        # The interior is left of every ring, so a corner left of its chord dents the outline.
        dent = (chord[:, 0] * arm[:, 1] - chord[:, 1] * arm[:, 0]) / np.maximum(np.linalg.norm(chord, axis=1), 1e-12)
        found.append(np.stack([corners, before, after], axis=1)[dent > REFLEX])
    every = np.concatenate(found)
    return every[:, 0], every[:, 1], every[:, 2]


def _cuts(piece: Polygon, corner: np.ndarray, before: np.ndarray, after: np.ndarray, inside: np.ndarray) -> list:
    """What half-planes through this corner leave of the piece: along its edges and along tangents to the seed.

    Only half-planes that keep the whole seed (`inside`, (3, 2)) count.
    """
    low, high = np.array(piece.bounds[:2]), np.array(piece.bounds[2:])
    size = 4 * float(np.linalg.norm(high - low)) + 1.0
    cuts = []
    for i, toward in enumerate((corner - before, after - corner, *(inside - corner), *(corner - inside))):
        length = np.linalg.norm(toward)
        if length < 1e-9:
            continue
        if i >= 2 and cuts:
            break  # the tangents are there for corners whose own edges would cut the seed
        along = toward / length
        left = np.array([-along[1], along[0]])
        if ((inside - corner) @ left).min() < -1e-9:
            continue
        back, front = corner - size * along, corner + size * along
        half_plane = Polygon([back, front, front + size * left, back + size * left])
        cuts.append(piece.intersection(half_plane))
    return cuts
