"""A straight flight of stairs up to a landing."""

from __future__ import annotations

import numpy as np

from scenes.library.plates import FRICTION, GOAL_RADIUS, START, level_plate
from scenes.scene import Goal, Scene
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

TREADS = 5
RISE, GOING, WIDTH = 0.15, 0.30, 1.2  # [m]
FOOT_OF_FLIGHT = 0.6  # [m] x of the first riser
LANDING = 1.2  # [m] length of the landing behind the last riser


def named(seed: int = 0) -> Scene:
    """Five treads of 0.30 m with 0.15 m rise and a landing 0.9 m up (the same for every seed)."""
    side = (-WIDTH / 2, WIDTH / 2)
    top = (TREADS + 1) * RISE
    last_riser = FOOT_OF_FLIGHT + TREADS * GOING
    surfaces = [level_plate("ground", (-0.5, FOOT_OF_FLIGHT), side)]
    for i in range(TREADS):
        nosing = FOOT_OF_FLIGHT + i * GOING
        surfaces.append(_riser(f"riser_{i}", nosing, i * RISE))
        surfaces.append(level_plate(f"tread_{i}", (nosing, nosing + GOING), side, (i + 1) * RISE))
    surfaces.append(_riser(f"riser_{TREADS}", last_riser, TREADS * RISE))
    surfaces.append(level_plate("landing", (last_riser, last_riser + LANDING), side, top))
    goal = Goal((last_riser + LANDING / 2, 0.0, top), GOAL_RADIUS)
    return Scene("stairs", Terrain(tuple(surfaces)), START, goal)


def _riser(name: str, x: float, z: float) -> Surface:
    """The upright face under a nosing; a plate to keep out of, too low and too short for a palm."""
    half = WIDTH / 2
    corners = [[x, half, z], [x, -half, z], [x, -half, z + RISE], [x, half, z + RISE]]
    return Surface(name, np.array(corners), FRICTION, frozenset())


def flight(name: str, rise: float, going: float, treads: int, *, foot: float, half_width: float) -> Scene:
    """Treads without risers between the ground and a landing, up or down, with start and goal.

    Args:
        name: of the scene.
        rise: from tread to tread [m]; negative for stairs that lead down.
        going: depth of a tread [m].
        treads: how many.
        foot: x where the flight begins [m].
        half_width: of all of it [m].
    """
    side, end, top = (-half_width, half_width), foot + treads * going, (treads + 1) * rise
    surfaces = [level_plate("ground", (-0.6, foot), side)]
    for k in range(treads):
        begin = foot + k * going
        surfaces.append(level_plate(f"tread_{k}", (begin, begin + going), side, (k + 1) * rise))
    surfaces.append(level_plate("landing", (end, end + LANDING), side, top))
    return Scene(name, Terrain(tuple(surfaces)), START, Goal((end + LANDING / 2, 0.0, top), GOAL_RADIUS))
