"""Two wide rooms joined by two parallel corridors; half of the patches are rubble (Lin 2020 sec. 5.11.1)."""

from __future__ import annotations

import numpy as np

from scenes.library.plates import GOAL_RADIUS
from scenes.library.rooms import PATCH, draw_place, room, start_at, walled_patches
from scenes.scene import Goal, Scene
from scenes.terrain.terrain import Terrain

ROOM_ROWS, ROOM_LANES = 2, 4  # patches
CORRIDOR = 3  # patches
MIDDLES = (-1.5 * PATCH, 1.5 * PATCH)  # [m] y of the corridors


def named(seed: int = 0) -> Scene:
    """Two rooms of 3 m x 6 m, two walled corridors of 4.5 m between; half of all is rubble (Lin 2020 sec. 5.11.1)."""
    rng = np.random.default_rng(seed)
    far_room = (ROOM_ROWS + CORRIDOR) * PATCH
    start = draw_place(rng, 0.0, ROOM_ROWS, ROOM_LANES)
    goal = draw_place(rng, far_room, ROOM_ROWS, ROOM_LANES)
    surfaces = (
        *room(rng, "near_room", 0.0, ROOM_ROWS, ROOM_LANES, 0.0, start),
        *(
            s
            for k, y in enumerate(MIDDLES)
            for s in walled_patches(rng, f"corridor_{k}", ROOM_ROWS * PATCH, y, CORRIDOR)
        ),
        *room(rng, "far_room", far_room, ROOM_ROWS, ROOM_LANES, 0.0, goal),
    )
    return Scene("two_corridors", Terrain(surfaces), start_at(start), Goal((*goal, 0.0), GOAL_RADIUS))
