"""Random terrain of several kinds, scaled to the robot: what data sets of motions are planned on."""

from __future__ import annotations

import numpy as np

from scenes.library.plates import FRICTION, GOAL_RADIUS, START, level_plate, rectangle, tilted_plate
from scenes.library.random_surfaces import crossing
from scenes.library.stairs import flight
from scenes.scene import Goal, Scene
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

KINDS = ("level", "stairs_up", "stairs_down", "stones", "slope", "random_surfaces", "walls")
DISTANCE, TURN = (0.8, 2.5), np.deg2rad(100.0)  # [m], [rad] of the goal on level ground, from the start's heading
RISE, GOING = (0.3, 0.6), (0.27, 0.36)  # of the robot's highest step; [m]
TREADS = (2, 5)
STONE, TILT, GAP = (0.35, 0.55), np.deg2rad(12.0), 0.02  # [m], [rad], [m]
SLOPE = np.deg2rad(12.0)  # [rad] at most
LENGTH = (0.8, 2.0)  # [m] of rubble


def draw_terrain(rng: np.random.Generator, kind: str, step: float) -> Scene:
    """A draw of this kind, with start and goal.

    Args:
        rng: source of the draws.
        kind: one of `KINDS`.
        step: the robot's highest step [m].
    """
    if kind == "level":
        return _level(rng)
    if kind.startswith("stairs"):
        return _stairs(rng, step if kind == "stairs_up" else -step)
    if kind == "stones":
        return _stones(rng, step)
    if kind == "slope":
        return _slope(rng)
    walls = ("left", "right") if kind == "walls" else ()
    return crossing(rng, float(rng.uniform(*LENGTH)), walls=walls)


def _level(rng: np.random.Generator) -> Scene:
    angle, far = rng.uniform(-TURN, TURN), rng.uniform(*DISTANCE)
    goal = Goal((float(far * np.cos(angle)), float(far * np.sin(angle)), 0.0), GOAL_RADIUS)
    return Scene("level", Terrain((level_plate("ground", (-3.5, 3.5), (-3.5, 3.5)),)), START, goal)


def _stairs(rng: np.random.Generator, step: float) -> Scene:
    rise, going = step * rng.uniform(*RISE), rng.uniform(*GOING)
    count, first = int(rng.integers(TREADS[0], TREADS[1] + 1)), float(rng.uniform(0.4, 0.7))
    return flight("stairs", float(rise), float(going), count, foot=first, half_width=0.6)


def _stones(rng: np.random.Generator, step: float) -> Scene:
    """Rows of stones of random heights and tilts between two platforms."""
    edge, rows, lanes = float(rng.uniform(*STONE)), int(rng.integers(2, 5)), 3
    near, width = 0.5, 3 * float(edge)
    surfaces = [level_plate("start_platform", (-0.6, near), (-width / 2, width / 2))]
    for i in range(rows):
        for j in range(lanes):
            x, y = near + (i + 0.5) * edge, (j - 0.5 * (lanes - 1)) * edge
            z = float(rng.uniform(-0.25, 0.25)) * step
            roll, pitch = rng.uniform(-TILT, TILT, 2)
            surfaces.append(tilted_plate(f"stone_{i}_{j}", (x, y, z), rectangle(edge - GAP, edge - GAP), roll, pitch))
    far = near + rows * edge
    surfaces.append(level_plate("goal_platform", (far, far + 1.2), (-width / 2, width / 2)))
    return Scene("stones", Terrain(tuple(surfaces)), START, Goal((far + 0.6, 0.0, 0.0), GOAL_RADIUS))


def _slope(rng: np.random.Generator) -> Scene:
    """A ramp up or down between two platforms."""
    angle, length, side = float(rng.uniform(-SLOPE, SLOPE)), float(rng.uniform(*LENGTH)), (-0.7, 0.7)
    near, rise = 0.5, float(length * np.tan(angle))
    ramp = np.array(
        [[near, -0.7, 0.0], [near + length, -0.7, rise], [near + length, 0.7, rise], [near, 0.7, 0.0]], float
    )
    surfaces = (
        level_plate("start_platform", (-0.6, near), side),
        Surface("ramp", ramp, FRICTION),
        level_plate("goal_platform", (near + length, near + length + 1.2), side, rise),
    )
    return Scene("slope", Terrain(surfaces), START, Goal((near + length + 0.6, 0.0, rise), GOAL_RADIUS))
