"""Neighbouring triangles of one plane joined into convex polygons: fewer bodies to collide with, the same faces."""

from __future__ import annotations

import numpy as np

from scenes.terrain.polygon import area_vectors

SAME_CORNER = 1e-6  # [m] corners nearer than this are one
SAME_PLANE = 1e-4  # [m] how far a corner may lie off the plane of what it is joined to
STRAIGHT = 1e-9  # [m^2] a corner that turns right by less is straight


def join_coplanar(triangles: np.ndarray) -> list[np.ndarray]:
    """Joins triangles across shared edges while the result stays flat and convex (Hertel & Mehlhorn 1983's idea).

    Args:
        triangles: (K, 3, 3) counter-clockwise from outside, none degenerate [m].

    Returns:
        (V, 3) counter-clockwise convex polygons that cover what the triangles cover, each point once.
    """
    if len(triangles) == 0:
        return []
    keys = np.round(triangles.reshape(-1, 3) / SAME_CORNER).astype(np.int64)
    _, first, corner = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    points = triangles.reshape(-1, 3)[first]
    polygons: dict[int, list[int]] = dict(enumerate(corner.reshape(-1, 3).tolist()))
    owner = list(range(len(triangles)))  # polygon that each triangle has gone into, followed to its end
    doubled = area_vectors(triangles)
    normals = doubled / np.linalg.norm(doubled, axis=1, keepdims=True)
    for a, b, left, right in _shared_edges(polygons, points):
        one, two = _follow(owner, left), _follow(owner, right)
        if one == two:
            continue
        joined = _join(polygons[one], polygons[two], a, b, points, normals[one])
        if joined is not None:
            polygons[one] = joined
            del polygons[two]
            owner[two] = one
    return [points[ring] for ring in polygons.values()]


def _shared_edges(polygons: dict[int, list[int]], points: np.ndarray) -> list[tuple[int, int, int, int]]:
    """(a, b, left, right): edges that one triangle runs from a to b and exactly one other back, longest first."""
    runs: dict[tuple[int, int], list[int]] = {}
    for index, ring in polygons.items():
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True):
            runs.setdefault((a, b), []).append(index)
    shared = [
        (a, b, left[0], runs[b, a][0])
        for (a, b), left in runs.items()
        if a < b and len(left) == 1 and len(runs.get((b, a), ())) == 1
    ]
    return sorted(shared, key=lambda edge: -float(np.linalg.norm(points[edge[0]] - points[edge[1]])))


def _follow(owner: list[int], index: int) -> int:
    while owner[index] != index:
        owner[index] = owner[owner[index]]
        index = owner[index]
    return index


def _join(one: list[int], two: list[int], a: int, b: int, points: np.ndarray, normal: np.ndarray) -> list[int] | None:
    """The ring of both polygons without the edge a-b between them; None where it would bend or be dented."""
    if (a, b) not in _edges(one) or (b, a) not in _edges(two):
        return None  # an earlier join has taken the edge away
    start, back = one.index(b), two.index(a)
    ring = one[start:] + one[:start]  # b ... a
    ring += (two[back:] + two[:back])[1:-1]  # what lies between a and b on the other side
    if len(set(ring)) < len(ring):
        return None  # they share more than this edge
    corners = points[ring]
    if np.abs((corners - corners[0]) @ normal).max() > SAME_PLANE:
        return None
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    turns = np.cross(before, after) @ normal
    return ring if turns.min() > -STRAIGHT else None


def _edges(ring: list[int]) -> set[tuple[int, int]]:
    return set(zip(ring, ring[1:] + ring[:1], strict=True))
