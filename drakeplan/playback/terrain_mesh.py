"""Triangles, colours and outlines of the things that do not move: plates, obstacles, tubes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenes.terrain.polygon import area_vectors
from scenes.terrain.surface import Surface

PLATE = 0.02  # [m] thickness of a surface's plate, behind its face
LIFT = 0.0015  # [m] faces stand this far before the mesh that they may be a facet of, so that they show
MANY_SURFACES = 2000  # from here on plates are drawn without their edges, to keep pages small
STEEP = np.deg2rad(60.0)  # surfaces steeper than this are walls, drawn from their outside alone: one can look in

# sandstone, limestone, slate, clay: tints that leave red, green, cyan and magenta to the contacts
STONES = np.array([[0.80, 0.72, 0.60], [0.74, 0.73, 0.70], [0.62, 0.66, 0.71], [0.78, 0.66, 0.56], [0.70, 0.68, 0.60]])
WALL = np.array([0.80, 0.83, 0.88])
ROCK = np.array([0.66, 0.63, 0.59])
OUTLINE = np.array([0.27, 0.27, 0.30])


@dataclass(frozen=True, eq=False)
class ColouredMesh:
    """Triangles that share no vertices, so that every face is shaded flat.

    Attributes:
        triangles: (K, 3, 3) in W [m], counter-clockwise from outside.
        colours: (K, 3) red, green, blue in [0, 1].
    """

    triangles: np.ndarray
    colours: np.ndarray

    def __len__(self) -> int:
        return len(self.triangles)


def is_wall(surface: Surface) -> bool:
    """Whether the surface is drawn as a wall."""
    return surface.tilt > STEEP


def plate_mesh(surfaces: Sequence[Surface], indices: Sequence[int]) -> ColouredMesh:
    """Thin plates behind the faces of some surfaces, each in its own colour.

    Args:
        surfaces: all of the terrain.
        indices: which of them to draw.
    """
    edges = len(surfaces) < MANY_SURFACES
    parts = [_plate(surfaces[index], edges) for index in indices]
    return _joined(parts, [np.broadcast_to(_stone(i), (len(p), 3)) for i, p in zip(indices, parts, strict=True)])


def facet_mesh(surfaces: Sequence[Surface], indices: Sequence[int]) -> ColouredMesh:
    """Bare faces on the mesh that some surfaces belong to; those in one plane, which may overlap, in one colour.

    Args:
        surfaces: all of the terrain.
        indices: which of them to draw.
    """
    parts, colours = [], []
    planes: dict[tuple[float, ...], int] = {}
    for index in indices:
        surface = surfaces[index]
        plane = (*np.round(surface.normal, 2) + 0.0, round(float(surface.normal @ surface.centroid), 2))
        parts.append(_fan(surface.vertices + LIFT * surface.normal))
        stone = _stone(planes.setdefault(plane, len(planes)))
        colours.append(np.broadcast_to(stone, (len(parts[-1]), 3)))
    return _joined(parts, colours)


def wall_mesh(surfaces: Sequence[Surface], indices: Sequence[int]) -> ColouredMesh:
    """The bare faces of some surfaces, in the colour of walls.

    Args:
        surfaces: all of the terrain.
        indices: which of them to draw.
    """
    parts = [_fan(surfaces[index].vertices + LIFT * surfaces[index].normal) for index in indices]
    return _joined(parts, [np.broadcast_to(WALL, (len(p), 3)) for p in parts])


def rock_mesh(triangles: np.ndarray) -> ColouredMesh:
    """Obstacles: one colour, a little darker where a face looks down or aside."""
    normals = area_vectors(triangles)
    upward = normals[:, 2] / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    return ColouredMesh(triangles, ROCK * (0.86 + 0.14 * np.clip(upward, -1.0, 1.0))[:, None])


def outlines(surfaces: Sequence[Surface]) -> tuple[np.ndarray, np.ndarray]:
    """((n, 3), (n, 3)) both ends of every edge of every surface [m]."""
    starts = [s.vertices + 2 * LIFT * s.normal for s in surfaces]
    return np.concatenate(starts), np.concatenate([np.roll(v, -1, axis=0) for v in starts])


def tube(path: np.ndarray, radius: float, sides: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """((n, 3) vertices, (m, 3) faces) of a tube around a polyline; lines of WebGL are only one pixel wide.

    Args:
        path: (N, 3) points of the polyline in W [m].
        radius: of the tube [m].
        sides: of its cross-section.
    """
    ahead = np.gradient(path, axis=0)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)
    aside = np.cross(ahead, [0.0, 0.0, 1.0])
    vertical = np.linalg.norm(aside, axis=1) < 1e-6
    aside[vertical] = [1.0, 0.0, 0.0]
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    above = np.cross(aside, ahead)
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    ring = np.cos(angles)[None, :, None] * aside[:, None] + np.sin(angles)[None, :, None] * above[:, None]
    vertices = (path[:, None] + radius * ring).reshape(-1, 3)
    i, k = np.meshgrid(np.arange(len(path) - 1), np.arange(sides), indexing="ij")
    a, b = (i * sides + k).ravel(), (i * sides + (k + 1) % sides).ravel()
    c, d = a + sides, b + sides
    return vertices, np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])


def _joined(parts: list[np.ndarray], colours: list[np.ndarray]) -> ColouredMesh:
    if not parts:
        return ColouredMesh(np.zeros((0, 3, 3)), np.zeros((0, 3)))
    return ColouredMesh(np.concatenate(parts), np.concatenate(colours))


def _fan(vertices: np.ndarray) -> np.ndarray:
    count = len(vertices)
    return np.stack([np.stack([vertices[0], vertices[k], vertices[k + 1]]) for k in range(1, count - 1)])


def _plate(surface: Surface, edges: bool) -> np.ndarray:
    face = surface.vertices + LIFT * surface.normal
    if not edges:
        return _fan(face)
    back = surface.vertices - PLATE * surface.normal
    sides = []
    for k in range(len(face)):
        n = (k + 1) % len(face)
        sides += [[face[k], back[k], back[n]], [face[k], back[n], face[n]]]
    return np.concatenate([_fan(face), _fan(back[::-1]), np.array(sides)])


def _stone(index: int) -> np.ndarray:
    golden = (index * 0.6180339887) % 1.0  # evenly spread without a random generator
    return np.clip(STONES[index % len(STONES)] * (0.92 + 0.14 * golden), 0.0, 1.0)
