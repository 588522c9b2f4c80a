"""A slab that tips sideways beside a wall: palms hold what feet alone cannot (after Lin et al. 2019)."""

from __future__ import annotations

import numpy as np

from scenes.library.plates import GOAL_RADIUS, START, level_plate, rectangle, tilted_plate, wall_plate
from scenes.scene import Goal, Scene
from scenes.terrain.terrain import Terrain

TILT = np.deg2rad(30.0)  # about the walking direction, down towards the wall
SLAB_LENGTH, SLAB_WIDTH, SLAB_Y = 1.2, 0.6, 0.1  # [m]
NEAR_EDGE = 1.11  # [m]
PLATFORM = 2.22  # [m] length of either platform
WALL_DISTANCE, WALL_HEIGHT = 0.8, (0.8, 1.8)  # [m]


def named(seed: int = 0, tilt: float = TILT) -> Scene:
    """A 1.2 m slab tipped sideways by 30 deg beside a wall, steeper than friction 0.5 holds (no draws).

    Args:
        seed: unused, nothing is drawn.
        tilt: of the slab [rad], down towards the wall.
    """
    side = (-0.3, 0.5)
    far_edge = NEAR_EDGE + SLAB_LENGTH
    centre = (NEAR_EDGE + SLAB_LENGTH / 2, SLAB_Y, 0.0)
    surfaces = (
        level_plate("start_platform", (NEAR_EDGE - PLATFORM, NEAR_EDGE), side),
        tilted_plate("slab", centre, rectangle(SLAB_LENGTH, SLAB_WIDTH), -tilt, 0.0),
        wall_plate("wall", (NEAR_EDGE, far_edge), WALL_DISTANCE, WALL_HEIGHT),
        level_plate("goal_platform", (far_edge, far_edge + PLATFORM), side),
    )
    goal = Goal((far_edge + PLATFORM / 2, 0.0, 0.0), GOAL_RADIUS)
    return Scene("tilted_slab", Terrain(surfaces), START, goal)
