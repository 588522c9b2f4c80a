"""Walls that end where the ground above them begins: the noise of a riser's upper edge is no curb for a sole."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

RIM = 0.03  # [m] a wall that ends less than this above the ground beside it ends at the ground
BESIDE = 0.04  # [m] ground this near a wall's plane is beside it
GRID = 1e-6  # [m] corners are snapped to this: without it GEOS cannot tell some outlines' insides
STEEPNESS = np.sin(np.deg2rad(25.0))  # planes that meet at less have no edge that is worth it

Interval = tuple[float, float]


def trimmed_wall(
    wall: BaseGeometry,
    wall_plane: tuple[np.ndarray, np.ndarray],
    ground: BaseGeometry,
    ground_plane: tuple[np.ndarray, np.ndarray],
) -> BaseGeometry:
    """The outline of a wall without the strip that stands up to `RIM` above the ground beside it and has nothing on it.

    Args:
        wall: its outline in its own axes [m].
        wall_plane: origin (3,) and axes (3, 3) of the wall, its normal last [m].
        ground: its outline in its own axes [m].
        ground_plane: origin and axes of the ground [m].
    """
    (p_W, R_W), (p_G, R_G) = wall_plane, ground_plane
    slope = R_W[:2] @ R_G[2]  # rise over the ground's plane along the wall's axes
    steep = float(np.linalg.norm(slope))
    if steep < STEEPNESS:
        return wall
    up = slope / steep
    turn = np.stack([[up[1], -up[0]], up])  # rows: along the line where the planes meet, and up from it
    start = float((p_W - p_G) @ R_G[2]) / steep

    def seen(xy: np.ndarray) -> np.ndarray:
        return xy @ turn.T + [0.0, start]

    outline = shapely.set_precision(shapely.transform(wall, seen), GRID)
    if outline.is_empty:
        return wall
    left, low, right, high = outline.bounds
    if low >= RIM or high <= 0:
        return wall
    strip = shapely.intersection(outline, shapely.box(left, 0.0, right, RIM), grid_size=GRID)
    above = shapely.intersection(outline, shapely.box(left, RIM, right, RIM + BESIDE), grid_size=GRID)
    beside = _beside(ground, R_W, p_W, R_G, p_G, turn)
    if strip.is_empty or not beside:
        return wall
    free = _without(_common(_intervals(strip), beside), _intervals(above))
    if not free:
        return wall
    cut = shapely.union_all([shapely.box(a, 0.0, b, RIM) for a, b in free], grid_size=GRID)
    kept = shapely.difference(outline, cut, grid_size=GRID)
    return shapely.transform(kept, lambda sd: (sd - [0.0, start]) @ turn)


def _beside(
    ground: BaseGeometry, R_W: np.ndarray, p_W: np.ndarray, R_G: np.ndarray, p_G: np.ndarray, turn: np.ndarray
) -> list[Interval]:
    """Where along a wall there is ground within `BESIDE` of its plane.

    Args:
        ground: outline in its own axes [m].
        R_W: (3, 3) axes of the wall.
        p_W: (3,) its origin [m].
        R_G: (3, 3) axes of the ground.
        p_G: (3,) its origin [m].
        turn: (2, 2) from the wall's axes to those along and across the line where the planes meet.
    """
    normal = R_G[:2] @ R_W[2]
    length = float(np.linalg.norm(normal))
    away = float((p_G - p_W) @ R_W[2])
    across = normal / length
    frame = np.stack([[across[1], -across[0]], across])
    local = shapely.transform(ground, lambda xy: xy @ frame.T + [0.0, away / length])
    local = shapely.set_precision(local, GRID)
    if local.is_empty:
        return []
    left, _, right, _ = local.bounds
    near = shapely.intersection(local, shapely.box(left, -BESIDE / length, right, BESIDE / length), grid_size=GRID)
    if near.is_empty:
        return []
    corners = shapely.transform(near, lambda sd: (sd - [0.0, away / length]) @ frame)

    def along(xy: np.ndarray) -> np.ndarray:
        flat = (p_G + xy @ R_G[:2] - p_W) @ R_W[:2].T @ turn.T
        return np.stack([flat[:, 0], np.zeros(len(flat))], axis=1)

    return _merged(
        [(float(x.min()), float(x.max())) for x in (along(_points(part))[:, 0] for part in shapely.get_parts(corners))]
    )


def _points(shape: BaseGeometry) -> np.ndarray:
    return shapely.get_coordinates(shape)


def _intervals(shape: BaseGeometry) -> list[Interval]:
    """The first coordinates that a shape reaches over."""
    parts = shapely.get_parts(shape)
    return _merged([(part.bounds[0], part.bounds[2]) for part in parts if part.area > 0])


def _merged(intervals: list[Interval]) -> list[Interval]:
    out: list[Interval] = []
    for low, high in sorted(intervals):
        if out and low <= out[-1][1]:
            out[-1] = (out[-1][0], max(high, out[-1][1]))
        else:
            out.append((low, high))
    return out


def _common(one: list[Interval], two: list[Interval]) -> list[Interval]:
    pairs = ((max(a, c), min(b, d)) for a, b in one for c, d in two)
    return [(low, high) for low, high in pairs if high > low]


def _without(intervals: list[Interval], taken: list[Interval]) -> list[Interval]:
    for low, high in taken:
        parts = [((a, min(b, low)), (max(a, high), b)) for a, b in intervals]
        intervals = [part for pair in parts for part in pair if part[1] > part[0]]
    return intervals
