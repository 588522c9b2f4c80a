"""Two wide rooms, the far one 1 to 1.5 m up, joined by two staircases of nine stairs (Lin 2020 sec. 5.11.2)."""

from __future__ import annotations

import numpy as np

from scenes.library.plates import GOAL_RADIUS
from scenes.library.rooms import PATCH, RUBBLE_SHARE, WALL_GAP, draw_place, patch, room, side_wall, start_at
from scenes.scene import Goal, Scene
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ROOM_ROWS, ROOM_LANES = 2, 4  # patches
STAIRS = 9
RISE = (1.0, 1.5)  # [m] of a whole staircase
TREAD = 0.5  # [m] length of a stair, ours
MIDDLES = (-1.5 * PATCH, 1.5 * PATCH)  # [m] y of the staircases


def named(seed: int = 0) -> Scene:
    """Two rooms of 3 m x 6 m, two walled staircases of nine stairs, 1 to 1.5 m up; half is rubble (Lin 2020 sec. 5.11.2)."""
    rng = np.random.default_rng(seed)
    foot, rise = ROOM_ROWS * PATCH, float(rng.uniform(*RISE))
    far_room = foot + STAIRS * TREAD
    start = draw_place(rng, 0.0, ROOM_ROWS, ROOM_LANES)
    goal = draw_place(rng, far_room, ROOM_ROWS, ROOM_LANES)
    surfaces = (
        *room(rng, "near_room", 0.0, ROOM_ROWS, ROOM_LANES, 0.0, start),
        *(s for k, y in enumerate(MIDDLES) for s in _staircase(rng, f"staircase_{k}", foot, y, rise)),
        *room(rng, "far_room", far_room, ROOM_ROWS, ROOM_LANES, rise, goal),
    )
    return Scene("two_staircases", Terrain(surfaces), start_at(start), Goal((*goal, rise), GOAL_RADIUS))


def _staircase(rng: np.random.Generator, name: str, foot: float, middle: float, rise: float) -> list[Surface]:
    """Nine stairs, each level or rubble, with a wall on either side; the last is at the height of the far room."""
    surfaces = []
    half = PATCH / 2
    for k in range(STAIRS):
        x, z = (foot + k * TREAD, foot + (k + 1) * TREAD), rise * (k + 1) / STAIRS
        ground, right, left = rng.uniform(size=3) >= RUBBLE_SHARE
        surfaces += patch(rng, f"{name}_{k}", x, (middle - half, middle + half), z, bool(ground))
        for side, sign, level in (("right", 1.0, right), ("left", -1.0, left)):
            surfaces += side_wall(rng, f"{name}_{side}_{k}", x, middle - sign * (half + WALL_GAP), sign, z, bool(level))
    return surfaces
