"""The torso's way to the goal and its straight pieces."""

from __future__ import annotations

import numpy as np
import pytest

from drakeplan.context import QueryContext
from drakeplan.experience.way import LONGEST, next_place, torso_way
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.library.plates import level_plate
from scenes.library.two_staircases import named as two_staircases
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.terrain import terrain_from

ESCHER = load_robot("escher")
IK = WholeBodyIK(ESCHER)


def context_of(scene: Scene) -> QueryContext:
    return QueryContext(scene, ESCHER, IK)


def test_on_a_floor_the_way_is_straight_and_one_piece() -> None:
    floor = terrain_from([level_plate("floor", (-1.0, 4.0), (-2.0, 2.0))])
    context = context_of(Scene("floor", floor, Start((0.0, 0.0, 0.0)), Goal((3.0, 0.5, 0.0), 0.2)))
    way = torso_way(context)
    place, is_last = next_place(context, way, way[0])
    assert is_last
    np.testing.assert_allclose(place, (3.0, 0.5, 0.0), atol=1e-9)


def test_round_a_corner_the_first_piece_ends_at_the_corner() -> None:
    arms = [level_plate("along", (-0.6, 3.0), (-0.6, 0.6)), level_plate("across", (1.8, 3.0), (0.6, 3.6))]
    context = context_of(Scene("corner", terrain_from(arms), Start((0.0, 0.0, 0.0)), Goal((2.4, 3.0, 0.0), 0.2)))
    way = torso_way(context)
    steps = np.linalg.norm(np.diff(way[:-1, :2], axis=0), axis=1)
    assert steps.max() < 0.8  # from cell to cell, and from beside the ground onto it
    place, is_last = next_place(context, way, way[0])
    assert not is_last
    assert place[0] > 1.2
    assert place[1] < 2.5
    second, is_last = next_place(context, way, place)
    assert is_last
    np.testing.assert_allclose(second, (2.4, 3.0, 0.0), atol=1e-9)


def test_a_piece_is_no_longer_than_stored_plans_lead() -> None:
    floor = terrain_from([level_plate("floor", (-1.0, 12.0), (-2.0, 2.0))])
    context = context_of(Scene("floor", floor, Start((0.0, 0.0, 0.0)), Goal((10.0, 0.0, 0.0), 0.2)))
    way, pieces, is_last = torso_way(context), [np.zeros(3)], False
    while not is_last:
        place, is_last = next_place(context, way, pieces[-1])
        assert np.hypot(*(place - pieces[-1])[:2]) <= LONGEST
        pieces.append(place)
    assert len(pieces) == 4


def test_a_way_up_the_stairs_climbs_with_them() -> None:
    scene = two_staircases(3)
    way = torso_way(context_of(scene))
    assert way[0, 2] == pytest.approx(0.0, abs=0.01)
    assert way[-1, 2] == pytest.approx(scene.goal.xyz[2])
    assert (np.abs(np.diff(way[:, 2])) < 0.5).all()


def test_where_the_grid_knows_no_way_it_is_the_straight_line() -> None:
    pads = [level_plate("here", (-0.6, 0.6), (-0.6, 0.6)), level_plate("there", (5.0, 6.0), (-0.6, 0.6))]
    scene = Scene("gap", terrain_from(pads), Start((0.0, 0.0, 0.0)), Goal((5.5, 0.0, 0.0), 0.2))
    way = torso_way(context_of(scene))
    assert len(way) == 2
