"""Three parallel corridors of randomly tilted stones between two level rooms (Lin & Berenson 2017 fig. 6)."""

from __future__ import annotations

import numpy as np

from scenes.library.plates import GOAL_RADIUS, level_plate
from scenes.library.rooms import PATCH, start_at, walled_patches
from scenes.scene import Goal, Scene
from scenes.terrain.terrain import Terrain

ROOM = 1.2  # [m] length of a room
HALF_WIDTH = 2.0 * PATCH  # [m] of the rooms
CORRIDOR = 2  # patches
MIDDLES = (-1.25 * PATCH, 0.0, 1.25 * PATCH)  # [m] y of the corridors; the middle one is the shortest way
END = 0.5  # [m] of start and goal from the outer ends of their rooms


def named(seed: int = 0) -> Scene:
    """Three parallel walled corridors of tilted stones, 3 m long, between two level rooms (Lin & Berenson 2017 fig. 6)."""
    rng = np.random.default_rng(seed)
    far_room = ROOM + CORRIDOR * PATCH
    side = (-HALF_WIDTH, HALF_WIDTH)
    surfaces = (
        level_plate("near_room", (0.0, ROOM), side),
        *(s for k, y in enumerate(MIDDLES) for s in walled_patches(rng, f"corridor_{k}", ROOM, y, CORRIDOR, rough=1.0)),
        level_plate("far_room", (far_room, far_room + ROOM), side),
    )
    goal = Goal((far_room + ROOM - END, 0.0, 0.0), GOAL_RADIUS)
    return Scene("three_corridors", Terrain(surfaces), start_at((END, 0.0)), goal)
