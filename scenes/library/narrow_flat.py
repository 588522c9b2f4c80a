"""A narrow strip of level ground with pushes from both sides (Lin 2020 sec. 7.8.2)."""

from __future__ import annotations

import numpy as np

from scenes.disturbance import Disturbance
from scenes.library.plates import GOAL_RADIUS, START, level_plate
from scenes.library.wind import PROBABILITY, PUBLISHED_MASS
from scenes.scene import Goal, Scene
from scenes.terrain.terrain import Terrain

HALF_WIDTH = 0.35  # [m]
PUSH = 0.6 * PUBLISHED_MASS  # [kg m/s]


def named(seed: int = 0) -> Scene:
    """A level strip 0.7 m wide, pushed from both sides, goal 1.8 m ahead (Lin 2020 sec. 7.8.2; no draws)."""
    strip = level_plate("ground", (-0.2, 2.2), (-HALF_WIDTH, HALF_WIDTH))
    pushes = Disturbance(np.array([[0.0, PUSH, 0.0], [0.0, -PUSH, 0.0]]), probability=PROBABILITY)
    goal = Goal((1.8, 0.0, 0.0), GOAL_RADIUS)
    return Scene("narrow_flat", Terrain((strip,)), START, goal, disturbances=(pushes,))
