"""Which polygons of a packed terrain are bodies, and how deep they are."""

from __future__ import annotations

import itertools

import numpy as np

from scenes.terrain.packed_terrain import THICKNESS, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain, TriangleMesh

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def grid(n: int) -> np.ndarray:
    """(2 n^2, 3, 3) triangles of the unit square."""
    edge = np.linspace(0, 1, n + 1)
    cells = [
        [[a, c, 0], [b, c, 0], [b, d, 0], [a, d, 0]]
        for a, b in itertools.pairwise(edge)
        for c, d in itertools.pairwise(edge)
    ]
    return np.array([[cell[i] for i in corner] for cell in cells for corner in ((0, 1, 2), (0, 2, 3))], float)


def test_one_face_stands_for_the_triangles_that_lie_in_it() -> None:
    wall = np.array([[[0.5, 0.2, 0], [0.5, 0.4, 0], [0.5, 0.3, 0.5]]])
    sunk = grid(2) * 0.3 + [0.1, 0.1, -0.01]
    mesh = TriangleMesh("m", np.concatenate([grid(8), wall, sunk]))
    packed = pack_terrain(Terrain((Surface("face", SQUARE),), (mesh,), (True,)))
    assert packed.body[0] and packed.depth[0] == 0.0
    assert not packed.body[1:129].any()
    assert packed.body[129:].all()


def test_a_face_covers_no_triangle_that_reaches_beyond_it_or_looks_the_other_way() -> None:
    beyond = np.array([[[0.5, 0.5, 0], [1.2, 0.5, 0], [0.5, 0.9, 0]]])
    below = grid(1)[:, ::-1]
    packed = pack_terrain(
        Terrain((Surface("face", SQUARE),), (TriangleMesh("m", np.concatenate([beyond, below])),), (True,))
    )
    assert packed.body.all()


def test_a_surface_that_stands_alone_is_a_plate() -> None:
    packed = pack_terrain(Terrain((Surface("plate", SQUARE),), (TriangleMesh("m", grid(1) + np.array([0, 0, 1])),)))
    assert packed.body.all()
    np.testing.assert_array_equal(packed.depth, [THICKNESS, 0.0, 0.0])
