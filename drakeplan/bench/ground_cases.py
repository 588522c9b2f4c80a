"""Ground that people report: long floors, tiles, planks, stones of a sole, bars, doors, low ceilings, bridges, spiral stairs."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np

from scenes.files.scene_file import scene_from_yaml
from scenes.scene import Scene

Corners = list[list[float]]
SOLE = (0.22, 0.10)  # [m] of escher


def ground_cases() -> dict[str, Callable[[], Scene]]:
    """Name and maker of each."""
    return {
        **{f"floor, {far:g} m of way": lambda far=far: _floor(far) for far in (20.0, 60.0, 100.0)},
        "tiles of 30 cm": _tiles,
        "planks of 10 cm": _planks,
        "stones of a sole": _stones,
        "two bars": _bars,
        "door of 0.5 m": _door,
        "ceiling of 1.5 m": _ceiling,
        "under a bridge": _bridge,
        "spiral stairs": _spiral,
    }


def _scene(
    name: str, surfaces: list[Corners], goal: list[float], boxes: list[tuple[list[float], list[float]]] | None = None
) -> Scene:
    """The scene that a file with these surfaces and boxes (size, middle) gives, start at the origin."""
    data = {
        "format": "drakeplan-scene",
        "version": 1,
        "name": name,
        "surfaces": [{"name": f"s{k}", "vertices": corners} for k, corners in enumerate(surfaces)],
        "obstacles": [
            {"name": f"b{k}", "box": size, "pose": {"xyz": middle}} for k, (size, middle) in enumerate(boxes or [])
        ],
        "start": {"xyz": [0.0, 0.0, 0.0]},
        "goal": {"xyz": goal},
    }
    return scene_from_yaml(json.dumps(data), name)  # JSON is YAML


def _level(x: tuple[float, float], y: tuple[float, float], z: float = 0.0) -> Corners:
    return [[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]]


def _floor(far: float) -> Scene:
    return _scene(f"floor_{far:g}m", [_level((-1.0, far + 1.0), (-1.5, 1.5))], [far, 0.0, 0.0])


def _tiles() -> Scene:
    edges = np.arange(-0.6, 2.7, 0.3)
    tiles = [_level((x, x + 0.3), (y, y + 0.3)) for x in edges for y in np.arange(-0.75, 0.75, 0.3)]
    return _scene("tiles", tiles, [2.0, 0.0, 0.0])


def _planks() -> Scene:
    planks = [_level((x, x + 0.1), (-0.8, 0.8)) for x in np.arange(-0.6, 2.7, 0.12)]
    return _scene("planks", planks, [2.0, 0.0, 0.0])


def _stones() -> Scene:
    length, width = SOLE
    surfaces = [_level((-0.6, 0.3), (-0.6, 0.6)), _level((1.6, 2.6), (-0.6, 0.6))]
    for k in range(6):
        x, y = 0.35 + 0.2 * k, 0.1 if k % 2 else -0.1
        surfaces.append(_level((x, x + length), (y - width / 2, y + width / 2)))
    return _scene("stones", surfaces, [2.0, 0.0, 0.0])


def _bars() -> Scene:
    floors = [_level((-0.6, 0.3), (-0.6, 0.6)), _level((1.5, 2.6), (-0.6, 0.6))]
    bars = [_level((0.3, 1.5), (y - 0.03, y + 0.03)) for y in (-0.14, -0.06, 0.06, 0.14)]
    return _scene("bars", floors + bars, [2.0, 0.0, 0.0])


def _door() -> Scene:
    sides = [([0.15, 1.25, 2.2], [1.0, side * 0.875, 1.1]) for side in (1.0, -1.0)]
    return _scene("door", [_level((-0.8, 3.0), (-1.5, 1.5))], [2.2, 0.0, 0.0], sides)


def _ceiling() -> Scene:
    beam = ([0.6, 1.6, 0.3], [1.1, 0.0, 1.65])
    return _scene("ceiling", [_level((-0.8, 3.0), (-0.8, 0.8))], [2.2, 0.0, 0.0], [beam])


def _bridge() -> Scene:
    deck = ([1.2, 2.4, 0.1], [1.2, 0.0, 2.15])
    return _scene("bridge", [_level((-0.8, 3.2), (-1.2, 1.2))], [2.4, 0.0, 0.0], [deck])


def _spiral() -> Scene:
    """Steps of 15 deg and 12 cm round a pole, 0.5 to 1.5 m from it; the start stands before the first."""
    surfaces, rise, turn = [_level((-0.6, 0.5), (-0.9, 0.9))], 0.12, np.deg2rad(15.0)
    pole = np.array([0.5, 1.0])
    for k in range(12):
        angles = -np.pi / 2 + turn * np.array([k, k + 1])
        ray = np.column_stack([np.cos(angles), np.sin(angles)])
        corners = [pole + 0.5 * ray[0], pole + 1.5 * ray[0], pole + 1.5 * ray[1], pole + 0.5 * ray[1]]
        surfaces.append([[*corner.tolist(), rise * (k + 1)] for corner in corners])
    last = -np.pi / 2 + turn * 11.5
    end = pole + np.array([np.cos(last), np.sin(last)])
    return _scene("spiral", surfaces, [*end.tolist(), 12 * rise])
