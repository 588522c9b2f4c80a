"""Level ground with nothing on it: the scene that has to work first."""

from __future__ import annotations

from scenes.library.plates import GOAL_RADIUS, START, level_plate
from scenes.scene import Goal, Scene
from scenes.terrain.terrain import Terrain


def named(seed: int = 0) -> Scene:
    """Level ground, 3 x 2 m, goal 2 m ahead (the same for every seed)."""
    ground = level_plate("ground", (-0.5, 2.5), (-1.0, 1.0))
    return Scene("flat", Terrain((ground,)), START, Goal((2.0, 0.0, 0.0), GOAL_RADIUS))
