"""Random terrain to collect labels on: tilted surfaces under the feet, tilted panels at the sides (Lin 2020 fig. 6.4 right).

Lin 2020 draws tilts, wall orientation and wall distance at random and gives no numbers: the ranges here are chosen wide
enough to contain the published scenes. Not every scene has both walls, so that the data also has motions of feet alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.library.plates import rectangle, tilt_rotation, tilted_plate
from scenes.scene import Goal, Scene, Start
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

GROUNDS = {"rubble": 0.4, "slope": 0.3, "gaps": 0.15, "steps": 0.15}  # how often each is drawn
WALLS = {"none": 0.06, "left": 0.07, "right": 0.07, "both": 0.8}
STEP_MODELS = {"training": 0.5, "planning": 0.5}  # foot transition models, where there are no gaps

LENGTH, HALF_WIDTH = (-0.8, 3.2), 0.8  # [m] of the ground
STONE = (0.3, 0.5)  # [m] edge
RUBBLE_TILT, RUBBLE_RISE = np.deg2rad(38.0), 0.1  # [m]
SLOPE, SLOPE_ROLL, SLOPE_TILT = np.deg2rad(36.0), np.deg2rad(20.0), np.deg2rad(8.0)
GAP, SLAB, GAP_TILT = (0.15, 0.6), (0.35, 0.9), np.deg2rad(12.0)  # [m], [m]
STEP_RISE, STEP_TILT = 0.15, np.deg2rad(3.0)  # [m]
WALL_DISTANCE, WALL_YAW, WALL_LEAN = (0.45, 0.95), np.deg2rad(12.0), np.deg2rad(20.0)  # [m]
PANEL, PANEL_HEIGHT, PANEL_TILT = (0.35, 0.6), (1.0, 1.6), np.deg2rad(20.0)  # [m], [m]
PANEL_PRESENT = 0.85  # probability
START_DRAWS = 30  # places tried for the first stance


@dataclass(frozen=True)
class TiltedEnvironment:
    """A terrain and how to walk on it.

    Attributes:
        terrain: of surfaces.
        ground: one of `GROUNDS`.
        walls: one of `WALLS`.
        steps: name of the foot transition model.
        starts: places to begin at, in the order in which they are to be tried.
        goal: far ahead.
    """

    terrain: Terrain
    ground: str
    walls: str
    steps: str
    starts: tuple[Start, ...]
    goal: Goal

    def scene(self, start: Start) -> Scene:
        """As a scene that begins here."""
        return Scene(f"{self.ground}_{self.walls}", self.terrain, start, self.goal)


def draw_environment(rng: np.random.Generator, friction: float) -> TiltedEnvironment:
    """A random environment.

    Args:
        rng: source of all random choices.
        friction: Coulomb coefficient of every surface [-].
    """
    ground, walls = _pick(rng, GROUNDS), _pick(rng, WALLS)
    surfaces = _GROUND[ground](rng)
    pitch, roll = (
        (rng.uniform(-SLOPE, SLOPE), rng.uniform(-SLOPE_ROLL, SLOPE_ROLL)) if ground == "slope" else (0.0, 0.0)
    )
    R = tilt_rotation(roll, pitch)
    surfaces = [Surface(s.name, s.vertices @ R.T, friction) for s in surfaces]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        if walls in (side, "both"):
            surfaces += _wall(rng, side, sign, -np.tan(pitch), friction)
    starts = tuple(
        Start((rng.uniform(-0.4, 1.5), rng.uniform(-0.2, 0.2), float("nan")), rng.uniform(-0.4, 0.4))
        for _ in range(START_DRAWS)
    )
    steps = "long_stride" if ground == "gaps" else _pick(rng, STEP_MODELS)
    return TiltedEnvironment(Terrain(tuple(surfaces)), ground, walls, steps, starts, Goal((LENGTH[1], 0.0, np.nan)))


def _pick(rng: np.random.Generator, weights: dict[str, float]) -> str:
    return str(rng.choice(list(weights), p=list(weights.values())))


def _stones(rng: np.random.Generator, tilt: float, rise: float) -> list[Surface]:
    """Stones edge to edge, tilted within `tilt` and raised within `rise`, both drawn once for the scene."""
    length, width = rng.uniform(*STONE, 2)
    tilt, rise = tilt * np.sqrt(rng.uniform()), rise * rng.uniform()
    stones = []
    for x in np.arange(LENGTH[0], LENGTH[1], length):
        for y in np.arange(-HALF_WIDTH, HALF_WIDTH, width):
            roll, pitch = rng.uniform(-tilt, tilt, 2)
            centre = (x + length / 2, y + width / 2, rng.uniform(-rise, rise))
            stones.append(tilted_plate(f"stone_{len(stones)}", centre, rectangle(length, width), roll, pitch))
    return stones


def _rubble(rng: np.random.Generator) -> list[Surface]:
    return _stones(rng, RUBBLE_TILT, RUBBLE_RISE)


def _slope(rng: np.random.Generator) -> list[Surface]:
    return _stones(rng, SLOPE_TILT, 0.02)


def _steps(rng: np.random.Generator) -> list[Surface]:
    return _stones(rng, STEP_TILT, STEP_RISE)


def _gaps(rng: np.random.Generator) -> list[Surface]:
    """Slabs across the way with gaps between them."""
    tilt, x, slabs = GAP_TILT * rng.uniform(), LENGTH[0], []
    while x < LENGTH[1]:
        length = rng.uniform(*SLAB)
        roll, pitch = rng.uniform(-tilt, tilt, 2)
        centre = (x + length / 2, 0.0, rng.uniform(-0.05, 0.05))
        slabs.append(tilted_plate(f"slab_{len(slabs)}", centre, rectangle(length, 2 * HALF_WIDTH), roll, pitch))
        x += length + rng.uniform(*GAP)
    return slabs


_GROUND = {"rubble": _rubble, "slope": _slope, "gaps": _gaps, "steps": _steps}


def _wall(rng: np.random.Generator, side: str, sign: float, grade: float, friction: float) -> list[Surface]:
    """Panels along one side, turned to the walker; they rise with the ground (`grade`: its height over x)."""
    distance, yaw = rng.uniform(*WALL_DISTANCE), rng.uniform(-WALL_YAW, WALL_YAW)
    lean, tilt, length = rng.uniform(-WALL_LEAN, WALL_LEAN), PANEL_TILT * rng.uniform(), rng.uniform(*PANEL)
    middle, panels = 0.5 * (LENGTH[0] + LENGTH[1]), []
    for x in np.arange(LENGTH[0], LENGTH[1], length + 0.02):
        if rng.uniform() > PANEL_PRESENT:
            continue
        roll, pitch = rng.uniform(-tilt, tilt, 2)
        y = sign * distance + np.tan(yaw) * (x + length / 2 - middle)
        centre = (x + length / 2, y, rng.uniform(*PANEL_HEIGHT) + grade * x)
        R = tilt_rotation(0.0, 0.0, yaw) @ tilt_rotation(sign * (np.pi / 2 + lean) + roll, pitch)
        outline = rectangle(length, rng.uniform(*PANEL))
        panels.append(Surface(f"{side}_{len(panels)}", outline @ R[:, :2].T + np.array(centre), friction))
    return panels
