"""A long way down a slope on which nobody can stand still (Lin et al. 2019 sec. VII; Lin 2020 sec. 6.7.2)."""

from __future__ import annotations

import math

import numpy as np

from scenes.library.plates import FRICTION, GOAL_RADIUS, START, level_plate
from scenes.scene import Goal, Scene
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

LENGTH = 3.0  # [m] along the slope
TILT = math.radians(30.0)
HALF_WIDTH = 0.5  # [m]
NEAR_EDGE = 0.5  # [m]
RUN_OUT = 3.0  # [m] level ground below


def named(seed: int = 0, tilt: float = TILT, length: float = LENGTH) -> Scene:
    """Down a 3 m slope of 30 deg, steeper than friction 0.5 holds (Lin 2020 sec. 6.7.2; no draws).

    Args:
        seed: unused, nothing is drawn.
        tilt: of the slope [rad].
        length: along it [m].
    """
    side = (-HALF_WIDTH, HALF_WIDTH)
    foot, depth = NEAR_EDGE + length * math.cos(tilt), -length * math.sin(tilt)
    corners = [
        [NEAR_EDGE, side[0], 0.0],
        [foot, side[0], depth],
        [foot, side[1], depth],
        [NEAR_EDGE, side[1], 0.0],
    ]
    surfaces = (
        level_plate("start_platform", (-0.5, NEAR_EDGE), side),
        Surface("slope", np.array(corners), FRICTION),
        level_plate("goal_platform", (foot, foot + RUN_OUT), side, depth),
    )
    goal = Goal((foot + RUN_OUT - 0.4, 0.0, depth), GOAL_RADIUS)
    return Scene("steep_slope", Terrain(surfaces), START, goal)
