"""Outer faces of everything solid in the scene, and those near a place.

Surfaces are plates, boxes have six faces, meshes are taken triangle by triangle: Drake would take a whole mesh for its
convex hull. A triangle that lies in a surface is left out, the surface is its body.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .geometry import clip
from .limits import COVERED, PLATE_THICKNESS, TRIANGLE_DEPTH
from .plan_file import PlanFile
from .scene import Plate, Scene

CELL = 0.5  # [m] faces no larger than this are found by the cell of their lowest corner, larger ones one by one


@dataclass(frozen=True, eq=False)
class Face:
    """One outer face of something solid: a convex polygon (K, 3), its outward normal, and what to call it.

    A tapered one leans inwards behind the face, so that its solid does not poke out of the next face of a mesh where
    the ridge between them is 45 deg or blunter.
    """

    name: str
    polygon: np.ndarray
    normal: np.ndarray
    tapered: bool

    def solid(self, low: np.ndarray, high: np.ndarray) -> np.ndarray | None:
        """(n, 3) corners of the convex solid behind the part of the face between two corners of a box; None for slivers.

        Args:
            low: (3,) lowest corner of the box in W [m].
            high: (3,) highest corner of the box in W [m].
        """
        polygon = clip(self.polygon, low, high)
        if len(polygon) < 3:
            return None
        edges = np.roll(polygon, -1, axis=0) - polygon
        long = np.linalg.norm(edges, axis=1) > 1e-6
        inward = np.cross(self.normal, edges[long])
        inward /= np.linalg.norm(inward, axis=1, keepdims=True)
        middle = polygon.mean(axis=0)
        radius = (inward * (middle - polygon[long])).sum(axis=1).min(initial=np.inf)
        if not 1e-4 < radius < np.inf:
            return None  # too thin to matter: the faces beside it are solid too
        if not self.tapered:
            return np.concatenate([polygon, polygon - PLATE_THICKNESS * self.normal])
        depth = min(TRIANGLE_DEPTH, 0.9 * radius)
        return np.concatenate([polygon, middle + (polygon - middle) * (1 - depth / radius) - depth * self.normal])


class Faces:
    """The faces of a scene within a box.

    Attributes:
        corners: (F, K, 3) in W [m]; polygons of fewer corners repeat their first.
        normal: (F, 3) outward unit normals in W.
        low, high: (F, 3) axis-aligned bounds [m].
    """

    def __init__(self, plan: PlanFile, scene: Scene, low: np.ndarray, high: np.ndarray) -> None:
        """Gathers the faces whose bounds meet the box.

        Args:
            plan: holds the triangles.
            scene: the plan's scene.
            low: (3,) lowest corner of the box in W [m].
            high: (3,) highest corner of the box in W [m].
        """
        triangles, normals = upright(plan["scene/triangles"])
        ground = NearBoxes(triangles.min(axis=1), triangles.max(axis=1))
        plates: list[Face] = []
        free = np.ones(len(triangles), dtype=bool)
        for plate in scene.plates:
            if (plate.low > high).any() or (plate.high < low).any():
                continue
            near = ground.near(plate.vertices.min(axis=0) - COVERED, plate.vertices.max(axis=0) + COVERED)
            mesh = on_mesh(plate, triangles[near], normals[near])
            plates.append(Face(plate.name, plate.vertices, plate.normal, tapered=mesh))
            free[near[_inside(plate, triangles[near], normals[near])]] = False
        self._named = [*plates, *box_faces(scene)]
        free &= ((triangles.min(axis=1) <= high) & (triangles.max(axis=1) >= low)).all(axis=1)
        triangles, normals = triangles[free], normals[free]
        width = max((len(face.polygon) for face in self._named), default=3)
        self.corners = np.empty((len(self._named) + len(triangles), max(width, 3), 3))
        for k, face in enumerate(self._named):
            self.corners[k, : len(face.polygon)] = face.polygon
            self.corners[k, len(face.polygon) :] = face.polygon[0]
        self.corners[len(self._named) :, :3] = triangles
        self.corners[len(self._named) :, 3:] = triangles[:, :1]
        self.normal = np.concatenate([np.array([f.normal for f in self._named]).reshape(-1, 3), normals])
        self.low, self.high = self.corners.min(axis=1), self.corners.max(axis=1)
        self._index = NearBoxes(self.low, self.high)

    def __getitem__(self, k: int) -> Face:
        if k < len(self._named):
            return self._named[k]
        return Face("an obstacle's triangle", self.corners[k, :3], self.normal[k], tapered=True)

    def near(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """(n,) indices of the faces whose bounds meet a box, ascending.

        Args:
            low: (3,) lowest corner of the box in W [m].
            high: (3,) highest corner of the box in W [m].
        """
        return self._index.near(low, high)


class NearBoxes:
    """Finds boxes by place."""

    def __init__(self, low: np.ndarray, high: np.ndarray) -> None:
        """Sorts F boxes.

        Args:
            low: (F, 3) their lowest corners [m].
            high: (F, 3) their highest corners [m].
        """
        self._low, self._high = low, high
        small = (high - low)[:, :2].max(axis=1, initial=0.0) <= CELL
        self._large = np.flatnonzero(~small)
        index = np.flatnonzero(small)
        self._origin = low[index, :2].min(axis=0) if len(index) else np.zeros(2)
        cell = np.floor((low[index, :2] - self._origin) / CELL).astype(np.int64)
        self._shape = cell.max(axis=0) + 1 if len(index) else np.ones(2, np.int64)
        key = cell[:, 0] * self._shape[1] + cell[:, 1]
        order = np.argsort(key, kind="stable")
        self._small, self._key = index[order], key[order]

    def near(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """(n,) indices of the boxes that meet another, ascending.

        Args:
            low: (3,) its lowest corner [m].
            high: (3,) its highest corner [m].
        """
        # A small box reaches at most one cell beyond that of its lowest corner.
        first = np.maximum(np.floor((low[:2] - self._origin) / CELL) - 1, 0).astype(np.int64)
        last = np.minimum(np.floor((high[:2] - self._origin) / CELL), self._shape - 1).astype(np.int64)
        found = [self._large]
        for i in range(first[0], last[0] + 1):
            row = i * self._shape[1]
            a, b = np.searchsorted(self._key, [row + first[1], row + last[1] + 1])
            found.append(self._small[a : max(a, b)])
        k = np.concatenate(found)
        return np.sort(k[((self._low[k] <= high) & (self._high[k] >= low)).all(axis=1)])


def upright(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The (n, 3, 3) triangles that enclose an area, and (n, 3) their outward normals."""
    doubled = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(doubled, axis=1)
    keep = length > 1e-10
    return triangles[keep], doubled[keep] / length[keep, None]


def on_mesh(plate: Plate, triangles: np.ndarray, normals: np.ndarray) -> bool:
    """Whether a surface's corners and middle all lie on triangles that face the same way.

    Args:
        plate: the surface.
        triangles: (K, 3, 3) near it [m].
        normals: (K, 3) their outward normals.
    """
    facing = normals @ plate.normal > 0.999
    triangles, normals = triangles[facing], normals[facing]
    if not len(triangles):
        return False
    middle = plate.vertices.mean(axis=0)
    for point in [middle, *(middle + 0.98 * (plate.vertices - middle))]:
        from_corner = point - triangles
        outward = np.cross(np.roll(triangles, -1, axis=1) - triangles, normals[:, None])
        outward /= np.linalg.norm(outward, axis=2, keepdims=True)
        beside = (outward * from_corner).sum(axis=2).max(axis=1)
        height = np.abs((normals * from_corner[:, 0]).sum(axis=1))
        if not np.any((beside < COVERED) & (height < COVERED)):
            return False
    return True


def _inside(plate: Plate, triangles: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(K,) whether each triangle lies in the plate, within a tenth of a millimetre, and faces the same way."""
    edges = np.roll(plate.vertices, -1, axis=0) - plate.vertices
    outward = np.cross(edges, plate.normal)
    length = np.linalg.norm(outward, axis=1)
    outward, level = outward[length > 1e-9] / length[length > 1e-9, None], plate.vertices[length > 1e-9]
    beyond = np.einsum("kvi,ei->kve", triangles, outward) - (outward * level).sum(axis=1)
    height = np.abs((triangles - plate.vertices[0]) @ plate.normal)
    return (normals @ plate.normal > 0.999) & (beyond.max(axis=(1, 2)) < 1e-4) & (height.max(axis=1) < 1e-4)


def box_faces(scene: Scene) -> Iterator[Face]:
    """The six faces of every box."""
    for k, (X_WO, size) in enumerate(scene.boxes):
        for axis, sign in itertools.product(range(3), (1, -1)):
            R = sign * np.roll(X_WO[:3, :3], 2 - axis, axis=1)  # the outward axis comes last
            half = np.roll(size, 2 - axis) / 2
            corners = np.array([[1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1]]) * half
            polygon = X_WO[:3, 3] + corners @ R.T
            yield Face(f"box {k}", polygon[::sign], R[:, 2], tapered=True)
