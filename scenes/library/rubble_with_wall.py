"""Tilted stones beside a wall that a straight walk does not reach, pushed towards it (Lin 2020 sec. 7.8.3)."""

from __future__ import annotations

import numpy as np

from scenes.library.plates import GOAL_RADIUS, START, level_plate, rubble, wall_plate
from scenes.library.wind import gusts
from scenes.scene import Goal, Scene
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ROWS, LANES = 4, 4
STONE_LENGTH, STONE_WIDTH = 0.35, 0.3  # [m]
RIGHT, LEFT = -0.3, 0.9  # [m] edges of the ground
NEAR, FAR, END = 0.2, 1.6, 2.0  # [m] where the stones begin and end, and where the far platform ends
WALL, WALL_HEIGHT = 1.1, (0.3, 2.1)  # [m]
GOAL_X = 1.8  # [m]
SPEEDS = (0.5, 0.6, 0.7, 0.8)  # [m/s]


def named(seed: int = 0) -> Scene:
    """Sixteen tilted stones with a wall on the left, pushed to the left, goal 1.8 m ahead (Lin 2020 sec. 7.8.3)."""
    rng = np.random.default_rng(seed)
    stones = rubble(rng, rows=ROWS, lanes=LANES, length=STONE_LENGTH, width=STONE_WIDTH, near_edge=NEAR)
    middle = np.array([0.0, (RIGHT + LEFT) / 2, 0.0])
    surfaces = (
        level_plate("start_platform", (-NEAR, NEAR), (RIGHT, LEFT)),
        *(Surface(stone.name, stone.vertices + middle, stone.friction) for stone in stones),
        level_plate("goal_platform", (FAR, END), (RIGHT, LEFT)),
        wall_plate("wall", (-NEAR, END), WALL, WALL_HEIGHT),
    )
    goal = Goal((GOAL_X, 0.0, 0.0), GOAL_RADIUS)
    return Scene("rubble_with_wall", Terrain(surfaces), START, goal, disturbances=(gusts((0.0, 1.0, 0.0), SPEEDS),))
