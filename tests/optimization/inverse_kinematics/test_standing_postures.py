"""Ways to stand: each holds the soles and its CoM, is clear of itself, and the one chosen has room and lowers no more than needed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from optimization.inverse_kinematics.drake_posture import PostureOptions, PostureSolver
from optimization.inverse_kinematics.standing_postures import DROP, NEARLY, NOMINAL, StandingPostures, standing_postures
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from optimization.multibody.inside_solids import inside_solids
from scenes.pose import pose_matrix
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

IK = WholeBodyIK(load_robot("escher"))
STANDING = standing_postures(IK)
TOUCH = 0.02  # [m] that the capsules of the inverse kinematics leave out of a shape's corners
HERE = (np.zeros(3), 0.0)
FLOOR = Surface("floor", np.array([[-3.0, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]]))


def among(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> PackedTerrain:
    """A floor with boxes, each of a size at a place."""
    solids = [Box(f"box {k}", np.array(size), pose_matrix(at, (0, 0, 0))) for k, (size, at) in enumerate(boxes)]
    return pack_terrain(Terrain((FLOOR,), tuple(solids)))


def under(height: float) -> PackedTerrain:
    return among(((2.0, 2.0, 0.4), (0.0, 0.0, height + 0.2)))


def top(q: np.ndarray) -> float:
    """Greatest height of a capsule [m]."""
    R, p = IK.kinematics.link_poses(q)
    capsules = IK.model.capsules
    link = np.repeat(capsules.link, np.diff(capsules.first))
    ends = [p[link] + np.einsum("kij,kj->ki", R[link], local) for local in (capsules.p_LA, capsules.p_LB)]
    return float(max((end[:, 2] + capsules.radius).max() for end in ends))


@pytest.mark.parametrize("name", ["escher", "g1"])
def test_every_way_to_stand_holds_soles_and_com_and_is_clear_of_itself(name: str) -> None:
    ik = WholeBodyIK(load_robot(name))
    standing, plant = StandingPostures(ik), build_plant(ik.robot)
    nominal = ik.model.q_nominal
    soles, com = ik.kinematics.effector_poses(nominal)[:2], ik.kinematics.com(nominal)
    drake = PostureSolver(plant, PostureOptions(min_distance=0.0, position_tolerance=2e-3, distance_tolerance=TOUCH))
    assert {drop for drop, _ in standing.postures} == set(range(standing.drops))
    for (drop, arms), q in standing.postures.items():
        assert not drake.violations(q, [*soles, None, None], None), (drop, arms)
        np.testing.assert_allclose(ik.kinematics.com(q), com - [0, 0, drop * DROP], atol=3e-3)


def test_where_nothing_is_near_the_robot_stands_as_it_always_does() -> None:
    assert STANDING.way_at(among(), [HERE]) == NOMINAL
    assert STANDING.way_at(under(1.75), [HERE]) == NOMINAL


@settings(max_examples=30, deadline=None)
@given(height=st.floats(1.2, 1.9), x=st.floats(-0.4, 0.4), heading=st.floats(-3.1, 3.1))
def test_under_a_ceiling_the_robot_lowers_itself_as_far_as_it_has_to(height: float, x: float, heading: float) -> None:
    packed, place = under(height), (np.array([x, 0.0, 0.0]), heading)
    drop, arms = way = STANDING.way_at(packed, [place])
    assert top(STANDING.over(way, *place)) < height
    if drop:  # one step higher it would touch the ceiling, or nearly
        assert top(STANDING.over((drop - 1, 0), *place)) > height - 0.03
    else:
        assert way == NOMINAL or arms


def test_several_places_are_served_by_the_lowest_that_one_of_them_asks_for() -> None:
    packed = among(((0.8, 2.0, 0.4), (1.0, 0.0, 1.7)), ((0.8, 2.0, 0.4), (-1.0, 0.0, 1.6)))
    places = [(np.array([x, 0.0, 0.0]), 0.0) for x in (-1.0, 0.0, 1.0)]
    alone = [STANDING.way_at(packed, [place])[0] for place in places]
    assert alone[1] == 0 < alone[2] < alone[0]
    assert STANDING.way_at(packed, places)[0] == alone[0]


@pytest.mark.parametrize("beside", [0.36, 0.4, 0.43])
def test_between_walls_the_arms_come_in_and_nobody_crouches(beside: float) -> None:
    walls = [((2.0, 0.2, 2.0), (0.0, side * (beside + 0.1), 1.0)) for side in (-1.0, 1.0)]
    packed = among(*walls)
    drop, arms = way = STANDING.way_at(packed, [HERE])
    assert (drop, arms > 0) == (0, True)
    assert STANDING.is_free(packed, STANDING.over(way, *HERE))


def test_where_nothing_has_room_the_robot_does_not_crouch_for_nothing() -> None:
    tight = among(*[((2.0, 0.2, 2.0), (0.0, side * 0.24, 1.0)) for side in (-1.0, 1.0)])
    assert STANDING.way_at(tight, [HERE])[0] == 0


def test_a_head_wholly_inside_a_box_is_inside_though_it_touches_no_face() -> None:
    q, counted = IK.model.q_nominal, np.ones(len(IK.model.capsules.link), bool)
    for size, expected in ((0.8, True), (0.1, True)):
        around = among(((size, size, size), (0.0, 0.0, 1.55)))
        assert inside_solids(IK.model.tree, IK.model.capsules, counted, around, q) == expected
        assert STANDING.is_inside(around, q) == expected
        assert not STANDING.is_free(around, q)
    beside = among(((0.8, 0.8, 0.8), (0.0, 1.2, 1.55)))
    assert not inside_solids(IK.model.tree, IK.model.capsules, counted, beside, q)


def test_room_that_the_trunk_nearly_has_is_enough() -> None:
    head = top(STANDING.over(NOMINAL, *HERE))
    lacking = under(head + 0.03 - 0.9 * NEARLY)
    assert STANDING.way_at(lacking, [HERE])[0] == 0
