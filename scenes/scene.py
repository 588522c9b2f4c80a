"""A terrain, a robot's name, where it starts and where it should go."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.contact import Contact
from scenes.disturbance import Disturbance
from scenes.terrain.terrain import Terrain

GOAL_HEIGHT = (
    0.5  # [m] the mean of the feet may end this far above or below the goal: ground is uneven, floors are further
)


@dataclass(frozen=True, eq=False)
class Start:
    """Where the robot begins.

    Attributes:
        xyz: (3,) mean of the feet [m]; z names the floor that the feet are set down on, NaN leaves it open.
        yaw: heading [rad].
        stance: contacts given one by one instead; empty means "set the feet down at xyz".
    """

    xyz: tuple[float, float, float]
    yaw: float = 0.0
    stance: tuple[Contact, ...] = ()


@dataclass(frozen=True)
class Goal:
    """Where the mean of the feet should end.

    Attributes:
        xyz: (3,) [m]; z names the floor, NaN leaves it open.
        radius: horizontal distance that counts as there [m].
        yaw: heading to end with [rad], None for any.
    """

    xyz: tuple[float, float, float]
    radius: float = 0.2
    yaw: float | None = None

    def height_off(self, z: np.ndarray | float) -> np.ndarray | float:
        """How far heights [m] lie beyond those of the goal's floor [m]: 0 within `GOAL_HEIGHT`, or where z is open."""
        if not np.isfinite(self.xyz[2]):
            return 0.0 * z
        return np.maximum(np.abs(z - self.xyz[2]) - GOAL_HEIGHT, 0.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything a query needs but the options of the planner.

    Attributes:
        name: what plans are labelled with.
        terrain: surfaces and obstacles.
        start: None when the caller must give one.
        goal: None when the caller must give one.
        robot: name of a robot, None for the caller's choice.
        disturbances: pushes by region.
        transition_model: name of the foot transition model that it was made for, None for the usual one.
        origin_offset: what was subtracted from the coordinates of a georeferenced map [m], None where nothing was.
        notes: what was changed while reading it (flipped polygons and the like), one line each.
    """

    name: str
    terrain: Terrain
    start: Start | None = None
    goal: Goal | None = None
    robot: str | None = None
    disturbances: tuple[Disturbance, ...] = ()
    transition_model: str | None = None
    origin_offset: tuple[float, float, float] | None = None
    notes: tuple[str, ...] = ()
