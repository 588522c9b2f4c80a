"""Which obstacles have an inside: boxes, and those bodies of a mesh that are closed."""

from __future__ import annotations

import numpy as np

from scenes.meshes.mesh_orientation import Bodies
from scenes.terrain.terrain import Box, Terrain


def solid_of_triangles(terrain: Terrain) -> np.ndarray:
    """(K,) for each of a terrain's triangles the number of the obstacle whose closed body it bounds, else -1."""
    parts = []
    for number, obstacle in enumerate(terrain.obstacles):
        triangles = obstacle.triangles()
        if isinstance(obstacle, Box):
            closed = np.ones(len(triangles), bool)
        elif len(triangles):
            bodies = Bodies(triangles)
            closed = bodies.closed()[bodies.body]
        else:
            closed = np.zeros(0, bool)
        parts.append(np.where(closed, number, -1))
    return np.concatenate(parts) if parts else np.zeros(0, np.int64)
