"""Randomly tilted quadrilaterals that cover and cut each other (Lin 2020 sec. 4.6.1)."""

from __future__ import annotations

import numpy as np

from scenes.library.plates import GOAL_RADIUS, MAX_RISE, MAX_TILT, START, level_plate, tilted_plate
from scenes.scene import Goal, Scene
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

# The paper gives the length (2 to 4 m), quadrilaterals, random tilts and that they cover and intersect each other.
# Its sizes, density and walls are only in figure 4.4: what stands here is ours.
LENGTH = (2.0, 4.0)  # [m] of the rubble between the platforms
HALF_WIDTH = 0.6  # [m] of the rubble and of the platforms
NEAR_EDGE = 0.4  # [m]
PLATFORM = 0.8  # [m] length of either platform
EDGE = (0.3, 0.6)  # [m] of a quadrilateral before its corners are moved
CORNER_SHIFT = 0.15  # of an edge: how far a corner moves; below 1/4 a quadrilateral stays convex
GROUND_DENSITY = 9.0  # quadrilaterals per m^2 of ground: about 1.7 layers
WALL_DENSITY = 3.0  # quadrilaterals per metre of wall
WALL_DISTANCE, PALM_HEIGHT = 0.75, (1.1, 1.6)  # [m]


def named(seed: int = 0) -> Scene:
    """2 to 4 m of tilted quadrilaterals that cover and cut each other, between two such walls (Lin 2020 sec. 4.6.1)."""
    rng = np.random.default_rng(seed)
    return crossing(rng, float(rng.uniform(*LENGTH)))


def crossing(
    rng: np.random.Generator,
    length: float,
    *,
    density: float = GROUND_DENSITY,
    slope: float = 0.0,
    walls: tuple[str, ...] = ("right", "left"),
) -> Scene:
    """A draw of this family.

    Args:
        rng: source of the draws.
        length: of the rubble between the platforms [m].
        density: quadrilaterals per square metre of ground.
        slope: how much the ground rises per metre, as stairs do.
        walls: which there are, of "right" and "left".
    """
    far_edge = NEAR_EDGE + length
    side = (-HALF_WIDTH, HALF_WIDTH)
    surfaces = (
        level_plate("start_platform", (NEAR_EDGE - PLATFORM, NEAR_EDGE), side),
        *_ground(rng, length, density, slope),
        *(panel for wall in walls for panel in _wall(rng, wall, 1.0 if wall == "left" else -1.0, length, slope)),
        level_plate("goal_platform", (far_edge, far_edge + PLATFORM), side, z=slope * length),
    )
    goal = Goal((far_edge + PLATFORM / 2, 0.0, slope * length), GOAL_RADIUS)
    return Scene("random_surfaces", Terrain(surfaces), START, goal)


def quadrilateral(rng: np.random.Generator) -> np.ndarray:
    """(4, 2) corners of a convex quadrilateral: a rectangle whose corners have moved a little [m]."""
    length, width = rng.uniform(*EDGE, 2)
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    return (corners + rng.uniform(-CORNER_SHIFT, CORNER_SHIFT, (4, 2))) * (length, width)


def _ground(rng: np.random.Generator, length: float, density: float, slope: float) -> list[Surface]:
    """Quadrilaterals whose centres are spread evenly over the rubble, turned to any yaw."""
    count = round(density * 2 * HALF_WIDTH * length)
    quads = []
    for i in range(count):
        # One stratum of the length each, so that no seed leaves a hole by clustering.
        x = NEAR_EDGE + length * (i + rng.uniform()) / count
        centre = (x, rng.uniform(-HALF_WIDTH, HALF_WIDTH), rng.uniform(-MAX_RISE, MAX_RISE) + slope * (x - NEAR_EDGE))
        roll, pitch = rng.uniform(-MAX_TILT, MAX_TILT, 2)
        quads.append(tilted_plate(f"quad_{i}", centre, quadrilateral(rng), roll, pitch, rng.uniform(-np.pi, np.pi)))
    return quads


def _wall(rng: np.random.Generator, side: str, sign: float, length: float, slope: float) -> list[Surface]:
    """Quadrilaterals turned to the rubble, at heights that palms reach."""
    count = round(WALL_DENSITY * length)
    panels = []
    for i in range(count):
        x = NEAR_EDGE + length * (i + rng.uniform()) / count
        centre = (
            x,
            sign * (WALL_DISTANCE + rng.uniform(-MAX_RISE, MAX_RISE)),
            rng.uniform(*PALM_HEIGHT) + slope * (x - NEAR_EDGE),
        )
        roll, pitch = rng.uniform(-MAX_TILT, MAX_TILT, 2)
        upright = sign * np.pi / 2 + roll
        panels.append(tilted_plate(f"{side}_panel_{i}", centre, quadrilateral(rng), upright, pitch))
    return panels
