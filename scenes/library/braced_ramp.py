"""A fallen ceiling for a ramp, so steep that a wheeled robot tips unless it braces itself on the wall (Lin 2020 sec. 5.10).

The wall has four cracked and tilted surfaces about a window; a pipe in front of the one above the window leaves a gap. The document
gives the picture; all sizes are ours. The ramp falls towards the wall and rises a little along it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.library.plates import rectangle, tilted_plate
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

ROLL, PITCH = np.deg2rad(40.0), np.deg2rad(4.0)  # of the ramp: falls towards the wall, rises along x
WALL_Y = 1.1  # [m]
CRACK_TILT = np.deg2rad(6.0)  # of each surface, either way
RAMP = (-1.5, 5.0, -1.0)  # [m] from x, to x, from y; it ends at the wall
PARTS = {  # x from, to, z from, to [m]
    "before_the_window": (-0.4, 0.8, 0.55, 1.35),
    "above_the_window": (0.85, 2.15, 1.15, 1.5),
    "below_the_window": (0.85, 2.15, 0.45, 0.85),
    "behind_the_window": (2.2, 3.4, 0.7, 1.55),
}
PIPE = (1.5, 0.28, 0.12)  # [m] x of its middle, width, depth in front of the wall
BEHIND = 0.05  # [m] that the pipe reaches behind the wall, so that no tilt parts them
START, GOAL = (0.25, 1.0), (2.95, 1.2)  # [m] x and z of the mean of the palms
RADIUS = 0.2  # [m] of the goal


@dataclass(frozen=True, eq=False)
class BracedRamp:
    """The scene.

    Attributes:
        wall: surfaces for palms, and the pipe.
        ramp: (3, 3) axes of the ramp in W: along it, towards the wall, its normal.
        start: (3,) mean of the palms at the start in W [m].
        goal: (3,) where it shall end in W [m].
        radius: of the goal [m].
    """

    wall: Terrain
    ramp: np.ndarray
    start: np.ndarray
    goal: np.ndarray
    radius: float

    def base(self, x: float) -> np.ndarray:
        """(4, 4) pose of a robot on the ramp, its origin on the ground at this x [m]."""
        X_WB = np.eye(4)
        X_WB[:3, :3], X_WB[:3, 3] = self.ramp, (x, 0.0, x * np.tan(PITCH))
        return X_WB

    @property
    def ground(self) -> Surface:
        """The ramp as a surface, for pictures."""
        x0, x1, y0 = RAMP
        corners = np.array([[x0, y0], [x1, y0], [x1, WALL_Y + 0.3], [x0, WALL_Y + 0.3]])
        height = corners[:, 0] * np.tan(PITCH) - corners[:, 1] * np.tan(ROLL)
        return Surface("ramp", np.column_stack([corners, height]), FRICTION_OF_WHEELS)


FRICTION_OF_WHEELS, FRICTION_OF_PALMS = 0.9, 0.7  # rubber; foam covers


def braced_ramp(seed: int = 0) -> BracedRamp:
    """A draw of the scene: the tilts of the four surfaces.

    Args:
        seed: of the tilts.
    """
    rng = np.random.default_rng(seed)
    surfaces = [wall_plate(rng, name, *sides) for name, sides in PARTS.items()]
    x, width, depth = PIPE
    X_WO = np.eye(4)
    X_WO[:3, 3] = x, WALL_Y - (depth - BEHIND) / 2, 1.3
    pipe = Box("pipe", np.array([width, depth + BEHIND, 0.7]), X_WO)
    along = np.array([np.cos(PITCH), 0.0, np.sin(PITCH)])
    normal = np.array([-np.tan(PITCH), np.tan(ROLL), 1.0])
    normal /= np.linalg.norm(normal)
    ramp = np.column_stack([along, np.cross(normal, along), normal])
    start, goal = (np.array([place[0], WALL_Y, place[1]]) for place in (START, GOAL))
    return BracedRamp(Terrain(tuple(surfaces), (pipe,)), ramp, start, goal, RADIUS)


def wall_plate(rng: np.random.Generator, name: str, x0: float, x1: float, z0: float, z1: float) -> Surface:
    """A piece of wall between two x and two z, tilted at random about its middle and facing -y [m].

    Args:
        rng: source of the tilt.
        name: of the surface.
        x0: least x [m].
        x1: greatest x [m].
        z0: least z [m].
        z1: greatest z [m].
    """
    roll, pitch = rng.uniform(-CRACK_TILT, CRACK_TILT, 2)
    middle = (0.5 * (x0 + x1), WALL_Y, 0.5 * (z0 + z1))
    plate = tilted_plate(name, middle, rectangle(x1 - x0, z1 - z0), np.pi / 2 + roll, pitch)
    return Surface(plate.name, plate.vertices, FRICTION_OF_PALMS)
