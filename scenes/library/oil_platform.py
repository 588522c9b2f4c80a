"""A part of an oil platform round a block of machines, with wind from one of two sides (Lin 2020 sec. 7.8.4)."""

from __future__ import annotations

import numpy as np

from scenes.disturbance import Disturbance
from scenes.library.plates import GOAL_RADIUS, START, level_plate
from scenes.library.wind import gusts
from scenes.scene import Goal, Scene
from scenes.terrain.terrain import Box, Terrain

WEST, EAST, SOUTH, NORTH = -0.4, 3.3, -3.1, 0.3  # [m] outer edges
WALKS = {  # x and y of the four walkways [m]
    "west": ((WEST, 0.8), (SOUTH, NORTH)),
    "south": ((WEST, EAST), (SOUTH, -2.0)),
    "north": ((WEST, EAST), (-0.3, NORTH)),
    "east": ((1.6, EAST), (SOUTH, NORTH)),
}
BLOCK, BLOCK_CENTRE = (0.6, 1.5, 1.5), (1.2, -1.15, 0.75)  # [m] the machines, which no palm may touch
LEE_X, LEE_Y = 0.9, (-1.9, -0.4)  # [m] behind the block there is no wind from the east
GOAL = (2.9, -2.5, 0.0)
SPEEDS = (0.6, 0.7, 0.8)  # [m/s]
BEYOND = 1.0  # [m] that the regions reach past the walkways


def named(seed: int = 0) -> Scene:
    """Walkways round a block that shelters its west side from gusts towards -x (Lin 2020 sec. 7.8.4; no draws)."""
    west, east, south, north = WEST - BEYOND, EAST + BEYOND, SOUTH - BEYOND, NORTH + BEYOND
    exposed = (
        ((LEE_X, east), (south, north)),
        ((west, LEE_X), (LEE_Y[1], north)),
        ((west, LEE_X), (south, LEE_Y[0])),
    )
    return _scene("oil_platform", tuple(gusts((-1.0, 0.0, 0.0), SPEEDS, region) for region in exposed))


def with_wind_to_y(seed: int = 0) -> Scene:
    """The same walkways, gusts towards +y everywhere (Lin 2020 sec. 7.8.4; no draws)."""
    return _scene("oil_platform_y", (gusts((0.0, 1.0, 0.0), SPEEDS),))


def _scene(name: str, disturbances: tuple[Disturbance, ...]) -> Scene:
    surfaces = tuple(level_plate(f"{side}_walkway", x, y) for side, (x, y) in WALKS.items())
    X_WB = np.eye(4)
    X_WB[:3, 3] = BLOCK_CENTRE
    block = Box("machines", np.array(BLOCK), X_WB)
    return Scene(name, Terrain(surfaces, (block,)), START, Goal(GOAL, GOAL_RADIUS), disturbances=disturbances)
