"""A terrain whose surfaces have shifted: what an aftershock leaves of a scene that a plan was made for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scenes.input_error import InputError
from scenes.terrain.terrain import Terrain

MOST_SHIFT, MOST_TURN = 0.10, np.deg2rad(15.0)  # [m, rad]


def move_surfaces(
    terrain: Terrain, rng: np.random.Generator, *, shift: float = MOST_SHIFT, turn: float = MOST_TURN
) -> Terrain:
    """Moves every surface by a rigid motion of its own: a shift, and a turn about its centroid.

    Direction of the shift and axis of the turn are uniform over the sphere, their sizes uniform from none to the most.
    Surfaces may come to overlap, as they may in any scene. Obstacles stay.

    Args:
        terrain: of plates; the faces of meshes cannot move alone.
        rng: of the draws, six numbers and two for each surface in order.
        shift: greatest distance that a centroid moves [m].
        turn: greatest angle [rad].

    Raises:
        InputError: a surface that is the face of a mesh, or a size that is negative or not finite.
    """
    for name, value in (("shift", shift), ("turn", turn)):
        if not (np.isfinite(value) and value >= 0.0):
            raise InputError(f"moved surfaces: {name} must be finite and not negative, got {value}")
    if any(terrain.surfaces_of_meshes):
        face = terrain.surfaces[terrain.surfaces_of_meshes.index(True)].name
        raise InputError(f"moved surfaces: {face!r} is the face of a mesh and cannot move alone")
    moved = []
    for surface in terrain.surfaces:
        R, p = _turn(rng, turn), shift * rng.uniform() * _direction(rng)
        moved.append(replace(surface, vertices=(surface.vertices - surface.centroid) @ R.T + surface.centroid + p))
    return replace(terrain, surfaces=tuple(moved))


def _direction(rng: np.random.Generator) -> np.ndarray:
    """(3,) unit vector, uniform over the sphere."""
    x = rng.normal(size=3)
    return x / max(float(np.linalg.norm(x)), 1e-300)


def _turn(rng: np.random.Generator, most: float) -> np.ndarray:
    """(3, 3) rotation about a uniform axis by up to `most` [rad] (Rodrigues)."""
    angle, w = most * rng.uniform(), _direction(rng)
    W = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    return np.eye(3) + np.sin(angle) * W + (1.0 - np.cos(angle)) * W @ W
