"""Tilted stones between two walls of tilted panels (Lin et al. 2019 sec. VII; Lin 2020 sec. 6.7.4)."""

from __future__ import annotations

import numpy as np

from scenes.library.plates import GOAL_RADIUS, MAX_TILT, START, level_plate, rectangle, rubble, tilted_plate
from scenes.scene import Goal, Scene
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ROWS, LANES = 5, 3
STONE_LENGTH, STONE_WIDTH = 0.4, 0.3  # [m]
NEAR_EDGE = 0.41  # [m] where the stones begin
HALF_WIDTH = 0.5  # [m] of the platforms
FAR_END, GOAL_X = 3.82, 3.62  # [m]
PANEL = 0.4  # [m] edge of a square panel
PANELS = 4  # on each wall
FIRST_PANEL, PANEL_SPACING = 0.66, 0.5  # [m] x of the first panel's centre, from one centre to the next
WALL_DISTANCE, PANEL_HEIGHT = 0.7, 1.5  # [m] of the panels' centres from y = 0 and from the ground


def named(seed: int = 0) -> Scene:
    """Fifteen tilted stones between two walls of four tilted panels, goal 3.6 m ahead (Lin 2020 sec. 6.7.4)."""
    rng = np.random.default_rng(seed)
    far_edge = NEAR_EDGE + ROWS * STONE_LENGTH
    surfaces = (
        level_plate("start_platform", (-NEAR_EDGE, NEAR_EDGE), (-HALF_WIDTH, HALF_WIDTH)),
        *rubble(rng, rows=ROWS, lanes=LANES, length=STONE_LENGTH, width=STONE_WIDTH, near_edge=NEAR_EDGE),
        *_wall(rng, "right", -1.0),
        *_wall(rng, "left", 1.0),
        level_plate("goal_platform", (far_edge, FAR_END), (-HALF_WIDTH, HALF_WIDTH)),
    )
    return Scene("rubble_corridor", Terrain(surfaces), START, Goal((GOAL_X, 0.0, 0.0), GOAL_RADIUS))


def _wall(rng: np.random.Generator, side: str, sign: float) -> list[Surface]:
    """Panels turned to the corridor: roll within `MAX_TILT` of upright, pitch within `MAX_TILT` of none."""
    tilts = rng.uniform(-MAX_TILT, MAX_TILT, (PANELS, 2))
    panels = []
    for i, (roll, pitch) in enumerate(tilts):
        centre = (FIRST_PANEL + i * PANEL_SPACING, sign * WALL_DISTANCE, PANEL_HEIGHT)
        upright = sign * np.pi / 2 + roll
        panels.append(tilted_plate(f"{side}_panel_{i}", centre, rectangle(PANEL, PANEL), upright, pitch))
    return panels
