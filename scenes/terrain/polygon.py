"""Polygons and triangles: area, normal, clipping, hull. Polygons are (K, 2) or (K, 3) corners in order [m]."""

from __future__ import annotations

import numpy as np

SHORT = 1e-9  # [m] an edge shorter than this has no direction
STRAIGHT = 1e-15  # [m^2] twice the area of a triangle whose corners count as in line


def area_vectors(triangles: np.ndarray) -> np.ndarray:
    """(K, 3) normals of (K, 3, 3) triangles, each as long as twice the triangle's area [m^2]."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def polygon_normal(vertices: np.ndarray) -> np.ndarray:
    """(3,) unit normal of a (K, 3) polygon by Newell's method; its length is meaningless if it has no area."""
    rolled = np.roll(vertices, -1, axis=0)
    doubled = np.cross(vertices - vertices[0], rolled - vertices[0]).sum(axis=0)
    return doubled / max(np.linalg.norm(doubled), 1e-300)


def flattened(vertices: np.ndarray) -> tuple[np.ndarray, float]:
    """(K, 3) the corners of a polygon moved onto their best plane, and how far the farthest was moved [m].

    The plane is that of least squares: a self-crossing outline can have any Newell normal.
    """
    middle = vertices.mean(axis=0)
    normal = np.linalg.svd(vertices - middle, full_matrices=True)[2][2]
    off = (vertices - middle) @ normal
    return vertices - off[:, None] * normal, float(np.abs(off).max())


def area(polygon: np.ndarray) -> float:
    """Area of a (K, 2) polygon, whichever way round its corners go [m^2]."""
    x, y = polygon.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def edge_normals(polygon: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, 2) outward unit normals of the edges of a (K, 2) counter-clockwise polygon, and the corner that starts each.

    Edges shorter than `SHORT` are left out.
    """
    edges = np.roll(polygon, -1, axis=0) - polygon
    start = np.flatnonzero(np.linalg.norm(edges, axis=1) > SHORT)
    outward = np.stack([edges[start, 1], -edges[start, 0]], axis=1)
    return outward / np.linalg.norm(outward, axis=1, keepdims=True), start


def clip(polygon: np.ndarray, height: np.ndarray, level: float = 0.0) -> np.ndarray:
    """(m, D) the part of a convex polygon where a height is at most a level; (0, D) where that is nothing.

    Args:
        polygon: (K, D) corners [m].
        height: (K,) at the corners, affine in the point.
        level: greatest height that stays.
    """
    kept = []
    for k in range(len(polygon)):
        j = (k + 1) % len(polygon)
        if height[k] <= level:
            kept.append(polygon[k])
        if (height[k] <= level) != (height[j] <= level):
            kept.append(polygon[k] + (level - height[k]) / (height[j] - height[k]) * (polygon[j] - polygon[k]))
    return np.array(kept).reshape(-1, polygon.shape[1])


def convex_hull(points: np.ndarray) -> np.ndarray:
    """(m, 2) corners of the convex hull, counter-clockwise; two for a segment, one for a point (Andrew 1979)."""
    order = np.unique(points, axis=0)
    chains = []
    for run in (order, order[::-1]):
        chain: list[np.ndarray] = []
        for p in run:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= STRAIGHT:
                chain.pop()
            chain.append(p)
        chains.append(chain[:-1])
    return np.array([*chains[0], *chains[1]]) if len(order) > 1 else order


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Twice the area of the triangle, positive where a, b, c turn to the left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
