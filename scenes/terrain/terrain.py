"""Surfaces to touch and obstacles to avoid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from scenes.input_error import InputError
from scenes.terrain.surface import Surface


@dataclass(frozen=True, eq=False)
class Box:
    """A box that the robot must not hit.

    Attributes:
        name: unique in its terrain.
        size: (3,) full edge lengths [m].
        X_WO: (4, 4) pose of the box's centre in W.
    """

    kind: ClassVar[str] = "box"
    name: str
    size: np.ndarray
    X_WO: np.ndarray

    def triangles(self) -> np.ndarray:
        """(12, 3, 3) outward triangles of the box in W [m]."""
        half = np.asarray(self.size, float) / 2
        corners = np.array([[sx, sy, sz] for sx in (-1, 1) for sy in (-1, 1) for sz in (-1, 1)]) * half
        corners = corners @ self.X_WO[:3, :3].T + self.X_WO[:3, 3]
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        return np.array([[corners[a], corners[b], corners[c]] for q in quads for a, b, c in (q[:3], (q[0], *q[2:]))])


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A triangle soup that the robot must not hit, already in W.

    Attributes:
        name: unique in its terrain.
        faces: (K, 3, 3) [m] in W, counter-clockwise from outside.
    """

    kind: ClassVar[str] = "mesh"
    name: str
    faces: np.ndarray

    def triangles(self) -> np.ndarray:
        """(K, 3, 3) the faces in W [m]."""
        return self.faces


@dataclass(frozen=True, eq=False)
class Terrain:
    """Surfaces to touch and obstacles to avoid.

    A surface is a plate with one touchable face: whatever else the robot does, it may not pass through it.
    A surface flagged in `surfaces_of_meshes` is a face of an obstacle mesh, which is its collision body.

    Attributes:
        surfaces: in the order that contacts refer to.
        obstacles: boxes and meshes.
        surfaces_of_meshes: (S,) bool, True where the surface is a facet of an obstacle mesh.
    """

    surfaces: tuple[Surface, ...]
    obstacles: tuple[Box | TriangleMesh, ...] = ()
    surfaces_of_meshes: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "surfaces", tuple(self.surfaces))
        object.__setattr__(self, "obstacles", tuple(self.obstacles))
        flags = tuple(self.surfaces_of_meshes) or (False,) * len(self.surfaces)
        object.__setattr__(self, "surfaces_of_meshes", flags)
        if len(flags) != len(self.surfaces):
            raise ValueError("surfaces_of_meshes must have one entry per surface")
        names = [s.name for s in self.surfaces]
        twice = sorted({n for n in names if names.count(n) > 1}) if len(set(names)) != len(names) else []
        if twice:
            raise InputError(f"surfaces: the name {twice[0]!r} is used twice")
        if not self.surfaces:
            raise InputError("surfaces: a terrain needs at least one")

    @cached_property
    def triangles(self) -> np.ndarray:
        """(K, 3, 3) [m] every obstacle and mesh in W, for collision; surfaces that stand alone are not in it."""
        parts = [o.triangles() for o in self.obstacles]
        return np.concatenate(parts) if parts else np.zeros((0, 3, 3))

    def surfaces_for(self, *effectors: str) -> list[int]:
        """Numbers of the surfaces that one of these end effectors may touch.

        Args:
            *effectors: their names.
        """
        return [k for k, surface in enumerate(self.surfaces) if any(surface.allows(e) for e in effectors)]

    @cached_property
    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        """((3,), (3,)) lowest and highest corner of everything in W [m]."""
        points = np.concatenate([*(s.vertices for s in self.surfaces), self.triangles.reshape(-1, 3)])
        return points.min(axis=0), points.max(axis=0)


def terrain_from(surfaces: Sequence[Surface]) -> Terrain:
    """A terrain of plates alone."""
    return Terrain(tuple(surfaces))
