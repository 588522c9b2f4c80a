"""Steps of the mean of the palms are those of a palm halved, and distances on a wall go round what is missing."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from drakeplan.bracing.wall_frame import STEPS, robot_on_wall, to_wall, wall_as_ground
from drakeplan.bracing.wall_traversability import palm_steps, wall_distances
from drakeplan.contact_planning.torso_grid import TorsoGrid
from drakeplan.guide.torso_steps import CELL
from drakeplan.guide.traversability_grid import TraversabilityGrid
from scenes.library.braced_ramp import BracedRamp, braced_ramp
from scenes.scene import Goal
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.terrain import Terrain

ROBOT = robot_on_wall(96.0)
TOUCH = 1e-9  # shifts on the border of two cells


def distances(ramp: BracedRamp) -> TraversabilityGrid | TorsoGrid:
    goal = to_wall(ramp.goal)
    at = Goal((float(goal[0]), float(goal[1]), 0.0), ramp.radius, 0.0)
    made = wall_distances(pack_terrain(wall_as_ground(ramp.wall)), ROBOT, at, to_wall(ramp.start))
    assert isinstance(made, TraversabilityGrid | TorsoGrid)
    return made


def from_start(ramp: BracedRamp, *x: float) -> np.ndarray:
    """Distances from the height of the start at these x [m]."""
    n = len(x)
    return distances(ramp).distance(np.array(x), np.full(n, ramp.start[2]), np.zeros(n), np.zeros(n))


def test_translations_of_the_mean_are_the_cells_of_half_of_what_a_palm_moves() -> None:
    """Slow twin: one palm d ahead of the other goes e ahead of it, or the one behind goes e ahead of that in front."""
    shifts = []
    for (d, a), (e, b) in itertools.product(itertools.product(*STEPS), repeat=2):
        for travel in (np.array([e + d, b + a]), np.array([e - d, b - a])):
            if np.linalg.norm(travel) <= ROBOT.max_foot_translation:
                shifts.append(0.5 * travel / CELL)
    off = np.abs(np.array(shifts)[:, None] - palm_steps(ROBOT).translations[None]).max(axis=2)
    assert off.min(axis=1).max() <= 0.5 + TOUCH, "every shift has its translation"
    assert off.min(axis=0).max() <= 0.5 + TOUCH, "and every translation a shift"


def test_pairs_are_one_step_apart_with_their_mean_between_them() -> None:
    pairs = palm_steps(ROBOT).pairs
    np.testing.assert_allclose(pairs[:, 0] + pairs[:, 1], 0.0, atol=1e-12)
    apart = {tuple(p) for p in np.round(np.abs(pairs[:, 0, :2] - pairs[:, 1, :2]), 9).tolist()}
    assert apart == set(itertools.product(STEPS[0], (0.0, 0.1, 0.2)))
    assert len(pairs) == 2 * len(STEPS[0]) * len(STEPS[1]), "either palm ahead"


def test_distances_shrink_along_the_wall_and_are_no_shorter_than_the_plain_ones() -> None:
    ramp = braced_ramp(0)
    found = from_start(ramp, 0.25, 2.45, 2.65)  # before the window, and behind it
    assert np.isfinite(found).all() and (np.diff(found) < 0.0).all()
    assert found[0] >= np.linalg.norm(ramp.goal - ramp.start) - ramp.radius


def test_where_no_way_is_known_plain_distances_stand_in() -> None:
    ramp = braced_ramp(0)
    assert isinstance(distances(ramp), TraversabilityGrid)
    ends = dataclasses.replace(ramp, wall=Terrain(ramp.wall.surfaces[:1], ramp.wall.obstacles))
    assert isinstance(distances(ends), TorsoGrid)
