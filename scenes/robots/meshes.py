"""A robot's meshes in forms that Drake takes: convex hulls for collision, OBJ files for display."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from lxml import etree  # type: ignore[attr-defined]

from scenes.input_error import InputError
from scenes.meshes.mesh_file import read_mesh
from scenes.robots.solid_points import solid_points
from scenes.robots.urdf_pose import numbers

HULL_VERTICES = 64  # collision hulls keep about this many; distance queries slow down with them
HULL_ERROR = 0.003  # [m] how far a hull with fewer vertices may fall short of the whole one
GREY = (0.7, 0.7, 0.72, 1.0)


@np.errstate(invalid="ignore", divide="ignore")  # trimesh divides by the volume, which a flat shape has not
def hull_obj(points: np.ndarray) -> str:
    """The convex hull of points (N, 3) [m] as OBJ text; a large one is cut down to its extreme points.

    Cutting corners makes the hull smaller: by at most `HULL_ERROR`, else all of it is kept.
    """
    import trimesh

    whole = trimesh.convex.convex_hull(points)
    hull = whole
    if len(whole.vertices) > HULL_VERTICES:
        directions = trimesh.creation.icosphere(subdivisions=2).vertices
        support = np.unique(np.argmax(whole.vertices @ directions.T, axis=0))
        smaller = trimesh.convex.convex_hull(whole.vertices[support])
        outside = np.max(
            np.einsum("fk,vk->vf", smaller.face_normals, whole.vertices)
            - np.einsum("fk,fk->f", smaller.face_normals, smaller.triangles[:, 0])
        )
        hull = smaller if outside <= HULL_ERROR else whole
    return obj_text(hull.vertices, hull.faces)


def visual_obj(path: Path, scale: np.ndarray) -> tuple[str, tuple[float, ...]]:
    """A mesh file as OBJ text with `scale` (3,) applied, and one colour for all of it (RGBA).

    Args:
        path: of the mesh file.
        scale: (3,) factors along the mesh's axes.
    """
    triangles = read_mesh(path) * scale
    vertices, faces = np.unique(np.round(triangles.reshape(-1, 3), 6), axis=0, return_inverse=True)
    faces = faces.reshape(-1, 3)
    if np.prod(scale) < 0:
        faces = faces[:, ::-1]
    return obj_text(vertices, faces), mean_colour(path)


def mean_colour(path: Path) -> tuple[float, ...]:
    """What a mesh looks like from far away: the mean of its materials by number of faces, textures averaged."""
    import trimesh

    try:
        parts = list(trimesh.load_scene(path).geometry.values())
        colours = [(len(p.faces), _part_colour(p)) for p in parts if hasattr(p, "faces")]
    except Exception:  # a missing texture is no reason to refuse a robot
        return GREY
    weights = np.array([n for n, _ in colours], float)
    if not weights.sum() > 0:
        return GREY
    rgb = np.average([c for _, c in colours], axis=0, weights=weights)
    return (*(float(v) for v in np.round(rgb, 3)), 1.0)


def points_of(path: Path, scale: np.ndarray) -> np.ndarray:
    """(N, 3) vertices of a mesh file [m].

    Args:
        path: of the mesh file.
        scale: (3,) factors along the mesh's axes.
    """
    points = read_mesh(path).reshape(-1, 3) * scale
    if np.ptp(points, axis=0).max() > 10.0:
        raise InputError(f"{path}: a part of a robot that is more than 10 m long; is it in millimetres?")
    return np.unique(np.round(points, 6), axis=0)


def points_of_solid(geometry: etree._Element) -> np.ndarray:
    """(N, 3) points whose hull is a URDF's box, sphere, cylinder, capsule or ellipsoid, or nearly so where it is round [m]."""
    solid = next(e for e in geometry if isinstance(e.tag, str))
    kind = etree.QName(solid).localname
    if kind == "box":
        return solid_points(kind, numbers(solid.get("size"), "0 0 0"))
    keys = {"sphere": ("radius",), "ellipsoid": ("a", "b", "c")}.get(kind, ("radius", "length"))
    return solid_points(kind, [float(solid.get(key, "0")) for key in keys])


def obj_text(vertices: np.ndarray, faces: Sequence[Sequence[int]] | np.ndarray) -> str:
    """Vertices (N, 3) and triangles (F, 3) as OBJ text.

    Args:
        vertices: (N, 3) [m].
        faces: (F, 3) indices of vertices, from 0.
    """
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    return "\n".join(lines) + "\n"


def _part_colour(part) -> np.ndarray:  # noqa: ANN001  (trimesh ships no types)
    material = getattr(part.visual, "material", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is not None:
        return np.asarray(image.convert("RGB"), float).reshape(-1, 3).mean(axis=0) / 255
    colour = getattr(material, "main_color", None)
    return np.asarray(GREY[:3] if colour is None else np.asarray(colour[:3], float) / 255)
