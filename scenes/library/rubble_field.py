"""Tilted stones between two level platforms (Lin et al. 2019 sec. VII; Lin 2020 sec. 6.7.3), small and very large."""

from __future__ import annotations

import numpy as np

from scenes.library.plates import GOAL_RADIUS, START, level_plate, rubble
from scenes.scene import Goal, Scene
from scenes.terrain.terrain import Terrain

STONE = 0.4  # [m] edge of a square stone
ROWS, LANES = 3, 4
NEAR_EDGE = 1.11  # [m] where the start platform ends and the stones begin
PLATFORM = 1.61  # [m] length of either platform
GOAL_FROM_END = 0.5  # [m] the goal lies this far from the far edge of the far platform


def named(seed: int = 0) -> Scene:
    """Twelve 0.4 m stones tilted up to 20 deg between two platforms, goal 3.4 m ahead (Lin 2020 sec. 6.7.3)."""
    return _field("rubble_field", seed, rows=ROWS, lanes=LANES, goal=None)


def wide(num_surfaces: int, seed: int = 0) -> Scene:
    """The same crossing in a wider field: start, goal and rows stay, lanes are added on both sides.

    Args:
        num_surfaces: platforms and stones together; rounded down to whole lanes of three stones. 14, 140, 1400
            and 14000 are met exactly, and 14 is the published field.
        seed: of the draws.
    """
    lanes = (num_surfaces - 2) // ROWS
    if lanes < 1:
        raise ValueError(f"a field has at least {ROWS + 2} surfaces, got {num_surfaces}")
    return _field(f"rubble_field_{2 + ROWS * lanes}", seed, rows=ROWS, lanes=lanes, goal=None)


def long(length: float, seed: int = 0) -> Scene:
    """A longer crossing of the same width: `length` from the start to the goal [m], stones all the way between.

    Args:
        length: distance from the start to the goal [m], 2 m or more.
        seed: of the draws.
    """
    goal = START.xyz[0] + length
    rows = int((goal - GOAL_FROM_END - NEAR_EDGE) / STONE + 1e-9)
    if rows < 1:
        raise ValueError(f"no stone fits between start and goal over {length} m")
    return _field(f"rubble_field_{length:g}m", seed, rows=rows, lanes=LANES, goal=goal)


def _field(name: str, seed: int, *, rows: int, lanes: int, goal: float | None) -> Scene:
    far_edge = NEAR_EDGE + rows * STONE
    end = far_edge + PLATFORM if goal is None else goal + GOAL_FROM_END
    side = (-lanes * STONE / 2, lanes * STONE / 2)
    surfaces = (
        level_plate("start_platform", (NEAR_EDGE - PLATFORM, NEAR_EDGE), side),
        *rubble(np.random.default_rng(seed), rows=rows, lanes=lanes, length=STONE, width=STONE, near_edge=NEAR_EDGE),
        level_plate("goal_platform", (far_edge, end), side),
    )
    return Scene(name, Terrain(surfaces), START, Goal((end - GOAL_FROM_END, 0.0, 0.0), GOAL_RADIUS))
