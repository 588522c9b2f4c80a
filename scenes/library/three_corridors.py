"""Three parallel corridors of randomly tilted stones between two level rooms (Lin & Berenson 2017 fig. 6)."""

from __future__ import annotations

import numpy as np

from scenes.library.plates import GOAL_RADIUS, MAX_RISE, MAX_TILT, level_plate, tilted_plate
from scenes.library.random_surfaces import quadrilateral
from scenes.library.rooms import PATCH, WALL_GAP, side_wall, start_at, walled_patches
from scenes.scene import Goal, Scene
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ROOM = 1.2  # [m] length of a room
HALF_WIDTH = 2.0 * PATCH  # [m] of the rooms
CORRIDOR = 2  # patches
MIDDLES = (-1.25 * PATCH, 0.0, 1.25 * PATCH)  # [m] y of the corridors; the middle one is the shortest way
END = 0.5  # [m] of start and goal from the outer ends of their rooms
SPREAD = (0.5, 1.5)  # density of a corridor of quadrilaterals, in shares of the mean


def named(seed: int = 0) -> Scene:
    """Three parallel walled corridors of tilted stones, 3 m long, between two level rooms (Lin & Berenson 2017 fig. 6)."""
    rng = np.random.default_rng(seed)
    corridors = [walled_patches(rng, f"corridor_{k}", ROOM, y, CORRIDOR, rough=1.0) for k, y in enumerate(MIDDLES)]
    return _between_rooms(corridors)


def sparse(rng: np.random.Generator, density: float) -> Scene:
    """The same with corridors of quadrilaterals that cover each other and leave gaps, so that one may lead nowhere.

    Args:
        rng: source of the draws.
        density: quadrilaterals per square metre, the mean of the three corridors.
    """
    corridors = []
    for k, middle in enumerate(MIDDLES):
        count = round(density * float(rng.uniform(*SPREAD)) * CORRIDOR * PATCH * PATCH)
        surfaces = []
        for i in range(count):
            # One stratum of the length each, so that no seed leaves a hole by clustering.
            x = ROOM + CORRIDOR * PATCH * (i + rng.uniform()) / count
            y = middle + PATCH * rng.uniform(-0.5, 0.5)
            roll, pitch = rng.uniform(-MAX_TILT, MAX_TILT, 2)
            centre = (x, y, float(rng.uniform(-MAX_RISE, MAX_RISE)))
            turn = float(rng.uniform(-np.pi, np.pi))
            surfaces.append(tilted_plate(f"corridor_{k}_quad_{i}", centre, quadrilateral(rng), roll, pitch, turn))
        for side, sign in (("right", 1.0), ("left", -1.0)):
            y = middle - sign * (PATCH / 2 + WALL_GAP)
            surfaces += side_wall(rng, f"corridor_{k}_{side}", (ROOM, ROOM + CORRIDOR * PATCH), y, sign, 0.0, False)
        corridors.append(surfaces)
    return _between_rooms(corridors)


def _between_rooms(corridors: list[list[Surface]]) -> Scene:
    """The corridors with their rooms, a start in the one and a goal in the other."""
    far_room = ROOM + CORRIDOR * PATCH
    side = (-HALF_WIDTH, HALF_WIDTH)
    surfaces = (
        level_plate("near_room", (0.0, ROOM), side),
        *(surface for corridor in corridors for surface in corridor),
        level_plate("far_room", (far_room, far_room + ROOM), side),
    )
    goal = Goal((far_room + ROOM - END, 0.0, 0.0), GOAL_RADIUS)
    return Scene("three_corridors", Terrain(surfaces), start_at((END, 0.0)), goal)
