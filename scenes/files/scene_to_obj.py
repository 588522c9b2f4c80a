"""A scene as an OBJ file: one object a surface and an obstacle, under their names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenes.scene import Scene


def scene_to_obj(scene: Scene) -> str:
    """The text of an OBJ file [m], z up: a surface is one polygon, an obstacle its triangles.

    Names lose blanks and what no line holds. Surfaces that were cut out of a mesh, and sides of boxes, lie on the faces of
    those. Coordinates of a georeferenced scene stay local; a comment has the offset.

    Args:
        scene: to be written.
    """
    lines = [f"# {_word(scene.name)}, metres, z up"]
    if scene.origin_offset is not None:
        lines.append(f"# origin_offset {' '.join(f'{x:.12g}' for x in scene.origin_offset)} was subtracted")
    count = 0
    for surface in scene.terrain.surfaces:
        lines.append(f"# friction {surface.friction:g}")
        count = _object(lines, surface.name, surface.vertices, [range(len(surface.vertices))], count)
    for obstacle in scene.terrain.obstacles:
        triangles = obstacle.triangles()
        points, corner = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
        count = _object(lines, obstacle.name, points, corner.reshape(-1, 3).tolist(), count)
    return "\n".join(lines) + "\n"


def _object(lines: list[str], name: str, points: np.ndarray, faces: Sequence[Sequence[int]], count: int) -> int:
    """Adds an object to the lines; how many vertices the file has then.

    Args:
        lines: of the file.
        name: of the object.
        points: (N, 3) its vertices [m].
        faces: the vertices of each of its faces.
        count: vertices that the file has already.
    """
    lines.append(f"o {_word(name)}")
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points.tolist()]
    lines += [f"f {' '.join(str(count + k + 1) for k in face)}" for face in faces]
    return count + len(points)


def _word(name: str) -> str:
    return "_".join("".join(c if c.isprintable() else " " for c in name).split()) or "unnamed"
