"""The ways to stand along a motion: the nominal one where nothing is near, else one for all postures in a row."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drakeplan.motion.ways_to_stand import AHEAD, ways_to_stand
from optimization.inverse_kinematics.standing_postures import NOMINAL, standing_postures
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from scenes.pose import pose_matrix
from scenes.robots.robot import load_robot
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

STANDING = standing_postures(WholeBodyIK(load_robot("escher")))
FLOOR = Surface("floor", np.array([[-3.0, -3, 0], [9, -3, 0], [9, 3, 0], [-3, 3, 0]]))
STEP = 0.2  # [m] from one posture to the next


def ceilings(*beams: tuple[float, float, float]) -> PackedTerrain:
    """A floor under beams from x to x at a height."""
    boxes = [
        Box(f"beam {k}", np.array([b - a, 4.0, 0.3]), pose_matrix((0.5 * (a + b), 0, z + 0.15), (0, 0, 0)))
        for k, (a, b, z) in enumerate(beams)
    ]
    return pack_terrain(Terrain((FLOOR,), tuple(boxes)))


def along(packed: PackedTerrain | None, count: int = 25) -> list[tuple[int, int]]:
    places = np.column_stack([STEP * np.arange(count), np.zeros((count, 2))])
    return ways_to_stand(STANDING, packed, places, np.zeros(count))


def test_without_terrain_or_under_an_open_sky_the_robot_stands_as_it_always_does() -> None:
    assert along(None) == along(ceilings()) == [NOMINAL] * 25


@settings(max_examples=15, deadline=None)
@given(height=st.floats(1.25, 1.66), first=st.floats(1.5, 2.5), depth=st.floats(0.1, 1.0))
def test_one_way_serves_a_whole_ceiling_and_begins_and_ends_about_it(height: float, first: float, depth: float) -> None:
    packed = ceilings((first, first + depth, height))
    ways = along(packed)
    low = np.flatnonzero([drop > 0 for drop, _ in ways])
    assert len({ways[k] for k in low}) == 1
    assert (np.diff(low) == 1).all()
    reach = (AHEAD + 1.5) * STEP + 0.35  # a hand or head is at most 0.35 m before or behind the CoM
    assert first - reach < STEP * low[0] < first
    assert first + depth < STEP * low[-1] < first + depth + reach
    for k in low:
        q = STANDING.over(ways[k], np.array([STEP * k, 0.0, 0.0]), 0.0)
        assert not STANDING.is_inside(packed, q)


def test_ceilings_apart_are_ducked_under_apart_and_near_ones_in_one_go() -> None:
    drops = [drop for drop, _ in along(ceilings((1.0, 1.3, 1.5), (3.6, 3.9, 1.4)))]
    assert drops[12] == 0
    assert 0 < drops[6] < drops[19]
    near = [drop for drop, _ in along(ceilings((1.0, 1.3, 1.5), (2.0, 2.3, 1.4)))]
    assert near[6] == near[8] == near[10] > 0


@pytest.mark.parametrize("turn", [0.0, np.pi / 2, 3.0])
def test_halfway_between_two_postures_there_is_room_too(turn: float) -> None:
    post = Box("post", np.array([0.04, 0.04, 2.0]), pose_matrix((0.5, 0.36, 1.0), (0, 0, 0)))
    packed = pack_terrain(Terrain((FLOOR,), (post,)))
    places, headings = np.array([[0.0, 0, 0], [1.0, 0, 0], [9.0, 0, 0]]), np.array([0.0, 0.0, turn])
    free = [STANDING.is_free(packed, STANDING.over(NOMINAL, place, 0.0)) for place in places[:2]]
    assert free == [True, True]
    assert not STANDING.is_free(packed, STANDING.over(NOMINAL, np.array([0.5, 0.0, 0.0]), 0.0))
    assert ways_to_stand(STANDING, packed, places, headings)[0] != NOMINAL
