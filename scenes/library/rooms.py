"""Two rooms joined by passages, made of patches that are level or rubble (Lin & Berenson 2017 fig. 6; Lin 2020 sec. 5.11).

The documents give the edge of a patch, the shares, the tilts and the heights; the sizes of rooms and walls are ours.
"""

from __future__ import annotations

import numpy as np

from scenes.library.plates import FRICTION, MAX_RISE, MAX_TILT, level_plate, rectangle, tilted_plate
from scenes.scene import Start
from scenes.terrain.surface import Surface

PATCH = 1.5  # [m] edge of a patch, Lin 2020 sec. 5.11.1
RUBBLE_SHARE = 0.5  # of patches, ibid.
STONE = 0.3  # [m] greatest edge of a stone of rubble
PANEL_HEIGHT = (1.0, 1.6)  # [m] of a wall over its ground: where palms reach
WALL_GAP = 0.1  # [m] between the edge of the ground and its wall
EDGE_ROOM = 0.45  # [m] that start and goal keep from the edges of their patches


def patch(
    rng: np.random.Generator, name: str, x: tuple[float, float], y: tuple[float, float], z: float, level: bool
) -> list[Surface]:
    """One rectangle of ground: a level plate, or stones whose roll and pitch are uniform within `MAX_TILT`.

    Args:
        rng: source of the draws.
        name: of the patch.
        x: from and to [m].
        y: from and to [m].
        z: its height [m].
        level: whether it is level.
    """
    if level:
        return [level_plate(name, x, y, z)]
    rows, lanes = (int(np.ceil((b - a) / STONE - 1e-9)) for a, b in (x, y))
    length, width = (x[1] - x[0]) / rows, (y[1] - y[0]) / lanes
    stones = []
    for row in range(rows):
        for lane in range(lanes):
            centre = (
                x[0] + (row + 0.5) * length,
                y[0] + (lane + 0.5) * width,
                z + float(rng.uniform(-1, 1)) * MAX_RISE,
            )
            roll, pitch = rng.uniform(-MAX_TILT, MAX_TILT, 2)
            stones.append(tilted_plate(f"{name}_stone_{row}_{lane}", centre, rectangle(length, width), roll, pitch))
    return stones


def room(
    rng: np.random.Generator, name: str, x: float, rows: int, lanes: int, z: float, place: tuple[float, float]
) -> list[Surface]:
    """A room of patches about y = 0; the patch in which a place lies is level.

    Args:
        rng: source of the draws.
        name: of the room.
        x: where it begins [m].
        rows: patches along x.
        lanes: patches along y.
        z: its height [m].
        place: (x, y) of the start or the goal [m].
    """
    surfaces = []
    for row in range(rows):
        for lane in range(lanes):
            x0, y0 = x + row * PATCH, (lane - lanes / 2) * PATCH
            rough = rng.uniform() < RUBBLE_SHARE
            here = x0 <= place[0] < x0 + PATCH and y0 <= place[1] < y0 + PATCH
            corners = (x0, x0 + PATCH), (y0, y0 + PATCH)
            surfaces += patch(rng, f"{name}_{row}_{lane}", *corners, z, here or not rough)
    return surfaces


def draw_place(rng: np.random.Generator, x: float, rows: int, lanes: int) -> tuple[float, float]:
    """(x, y) a random place in a room, away from the edges of the patch that it is in [m].

    Args:
        rng: source of the draws.
        x: where the room begins [m].
        rows: patches along x.
        lanes: patches along y.
    """
    row, lane = int(rng.integers(rows)), int(rng.integers(lanes))
    within = rng.uniform(EDGE_ROOM, PATCH - EDGE_ROOM, 2)
    return float(x + row * PATCH + within[0]), float((lane - lanes / 2) * PATCH + within[1])


def side_wall(
    rng: np.random.Generator, name: str, x: tuple[float, float], y: float, inward: float, z: float, level: bool
) -> list[Surface]:
    """A wall beside a stretch of a passage: one upright plate, or panels tilted within `MAX_TILT`.

    Args:
        rng: source of the draws.
        name: of the wall.
        x: from and to [m].
        y: where it stands [m].
        inward: +1 where it faces +y, -1 where it faces -y.
        z: height of the ground before it [m].
        level: whether it is one upright plate.
    """
    low, high = z + PANEL_HEIGHT[0], z + PANEL_HEIGHT[1]
    if level:
        corners = np.array([[x[0], y, low], [x[1], y, low], [x[1], y, high], [x[0], y, high]])
        return [Surface(name, corners if inward < 0 else corners[::-1], FRICTION)]
    count = int(np.ceil((x[1] - x[0]) / (2 * STONE) - 1e-9))
    length = (x[1] - x[0]) / count
    panels = []
    for i in range(count):
        roll, pitch = rng.uniform(-MAX_TILT, MAX_TILT, 2)
        centre = (x[0] + (i + 0.5) * length, y, (low + high) / 2)
        upright = -inward * np.pi / 2 + roll
        outline = rectangle(length, high - low)
        panels.append(tilted_plate(f"{name}_panel_{i}", centre, outline, upright, pitch))
    return panels


def walled_patches(
    rng: np.random.Generator, name: str, x: float, middle: float, patches: int, rough: float = RUBBLE_SHARE
) -> list[Surface]:
    """A level corridor along x, a patch wide, with a wall on either side; ground and walls are drawn patch by patch.

    Args:
        rng: source of the draws.
        name: of the corridor.
        x: where it begins [m].
        middle: y of its middle line [m].
        patches: how long it is.
        rough: share of patches and walls that are rubble.
    """
    surfaces = []
    half = PATCH / 2
    for k in range(patches):
        along = (x + k * PATCH, x + (k + 1) * PATCH)
        ground, right, left = rng.uniform(size=3) >= rough
        surfaces += patch(rng, f"{name}_{k}", along, (middle - half, middle + half), 0.0, bool(ground))
        for side, sign, level in (("right", 1.0, right), ("left", -1.0, left)):
            y = middle - sign * (half + WALL_GAP)
            surfaces += side_wall(rng, f"{name}_{side}_{k}", along, y, sign, 0.0, bool(level))
    return surfaces


def start_at(place: tuple[float, float]) -> Start:
    """A start there, on the level, turned along x."""
    return Start((*place, 0.0))
