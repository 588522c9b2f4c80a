"""Surfaces that shift: rigid, bounded, repeatable."""

from __future__ import annotations

import numpy as np
import pytest

from scenes.input_error import InputError
from scenes.library.rubble_corridor import named
from scenes.terrain.moved_terrain import MOST_SHIFT, MOST_TURN, move_surfaces
from scenes.terrain.terrain import Terrain


def test_every_surface_moves_as_a_rigid_body_within_the_limits() -> None:
    terrain = named(0).terrain
    shifts, turns = [], []
    for seed in range(20):
        for before, after in zip(
            terrain.surfaces, move_surfaces(terrain, np.random.default_rng(seed)).surfaces, strict=True
        ):
            assert (after.name, after.friction, after.effectors) == (before.name, before.friction, before.effectors)
            a, b = (s.vertices - s.centroid for s in (before, after))
            np.testing.assert_allclose(b @ b.T, a @ a.T, atol=1e-12)
            # With the normals the vertices span all of space, so the map between them is unique.
            whole_a, whole_b = np.vstack([a, before.normal]), np.vstack([b, after.normal])
            R = np.linalg.lstsq(whole_a, whole_b, rcond=None)[0]
            np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
            assert np.linalg.det(R) == pytest.approx(1.0)
            shifts.append(np.linalg.norm(after.centroid - before.centroid))
            turns.append(np.arccos(np.clip(0.5 * (np.trace(R) - 1.0), -1.0, 1.0)))
    assert 0.95 * MOST_SHIFT < max(shifts) <= MOST_SHIFT + 1e-12
    assert 0.8 * MOST_TURN < max(turns) <= MOST_TURN + 1e-9


def test_the_same_seed_gives_the_same_terrain_and_no_size_the_one_there_was() -> None:
    terrain = named(1).terrain
    once, again = (move_surfaces(terrain, np.random.default_rng(3)) for _ in range(2))
    assert once.surfaces == again.surfaces
    still = move_surfaces(terrain, np.random.default_rng(3), shift=0.0, turn=0.0)
    for before, after in zip(terrain.surfaces, still.surfaces, strict=True):
        np.testing.assert_allclose(after.vertices, before.vertices, atol=1e-12)


@pytest.mark.parametrize("size", [{"shift": -0.1}, {"turn": np.nan}])
def test_a_size_that_is_none_is_refused(size: dict[str, float]) -> None:
    with pytest.raises(InputError, match="must be finite and not negative"):
        move_surfaces(named(0).terrain, np.random.default_rng(0), **size)


def test_a_face_of_a_mesh_cannot_move_alone() -> None:
    surfaces = named(0).terrain.surfaces
    terrain = Terrain(surfaces, (), (False,) * (len(surfaces) - 1) + (True,))
    with pytest.raises(InputError, match="face of a mesh"):
        move_surfaces(terrain, np.random.default_rng(0))
