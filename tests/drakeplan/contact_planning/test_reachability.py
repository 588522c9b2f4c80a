"""Proofs that a goal cannot be reached: right where they are given, silent where a way might exist."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from drakeplan.contact_planning.reachability import SLACK, _connected, unreachable, walled_off
from scenes.footholds.start_stance import check_goal, start_stance
from scenes.pose import pose_matrix
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain
from scenes.transition_model import transition_model

ROBOT = load_robot("escher")
MODEL = transition_model("experiments")
REACH = float(np.hypot(*MODEL.steps[:, :2].T).max())


def slab(name: str, x: tuple[float, float], z: float = 0.0, y: tuple[float, float] = (-1, 1)) -> Surface:
    return Surface(name, np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]], float))


def box(name: str, size: tuple[float, float, float], xyz: tuple[float, float, float]) -> Box:
    return Box(name, np.array(size), pose_matrix(xyz, (0.0, 0.0, 0.0)))


def proofs(terrain: Terrain, goal: tuple[float, float, float]) -> tuple[str, str]:
    scene, packed = Scene("s", terrain, Start((0.0, 0.0, 0.0)), Goal(goal)), pack_terrain(terrain)
    start = start_stance(scene, packed, ROBOT)
    taken = check_goal(scene, packed, ROBOT, 0.0)
    return unreachable(terrain, ROBOT, REACH, start, taken), walled_off(terrain, packed, ROBOT, REACH, start, taken)


@pytest.mark.parametrize("gap", [0.1, REACH - 0.01, REACH + 0.01, 0.75, 2.0])
def test_a_gap_is_a_proof_only_if_it_is_wider_than_a_step(gap: float) -> None:
    why, _ = proofs(Terrain((slab("near", (-1, 1)), slab("far", (1 + gap, 4 + gap)))), (2.5 + gap, 0, 0))
    assert bool(why) == (gap > REACH)
    if why:
        assert f"from 'near' to 'far' it is {gap:.2f} m across and 0.00 m up or down" in why
        assert f"reaches {REACH:.2f} m across" in why


@pytest.mark.parametrize("rise", [0.2, 0.34, 0.36, 1.0, -0.34, -0.36, -2.0])
def test_a_ledge_is_a_proof_only_if_it_is_higher_than_a_step(rise: float) -> None:
    why, _ = proofs(Terrain((slab("low", (-1, 1)), slab("high", (1, 4), rise))), (2.5, 0, rise))
    assert bool(why) == (abs(rise) > ROBOT.max_step_height)
    if why:
        assert f"it is 0.00 m across and {abs(rise):.2f} m up or down" in why


@pytest.mark.parametrize("rise", [0.51, 0.6, 0.67])
def test_the_ground_beside_a_high_block_is_not_its_top(rise: float) -> None:
    """A foot on the ground is within half a step of a goal on the block, but the other foot finds nothing in between."""
    terrain = Terrain((slab("ground", (-1, 4)), slab("block", (2, 3.2), rise, (-0.3, 0.3))))
    assert f"{rise:.2f} m up or down" in proofs(terrain, (2.5, 0, rise))[0]
    between = slab("stool", (2.5, 2.9), 0.5 * rise, (0.4, 0.7))
    assert proofs(Terrain((*terrain.surfaces, between)), (2.5, 0, rise))[0] == ""


def test_stones_that_take_no_whole_sole_join_nothing_where_soles_have_to_be_whole() -> None:
    half = ROBOT.effectors[0].half_extent
    for more, joined in ((-1e-3, False), (1e-3, True)):
        stone = slab("stone", (1.5 - half[0] - more, 1.5 + half[0] + more), 0.0, (-half[1] - more, half[1] + more))
        terrain = Terrain((slab("near", (-1, 1.1)), stone, slab("far", (1.9, 4))))
        scene, packed = Scene("s", terrain, Start((0.0, 0.0, 0.0)), Goal((3.0, 0.0, 0.0))), pack_terrain(terrain)
        start, goal = start_stance(scene, packed, ROBOT), check_goal(scene, packed, ROBOT, 0.0)
        whole = unreachable(terrain, ROBOT, REACH, start, goal, full_soles=True, packed=packed)
        assert (not whole) == joined
        assert joined or "'stone' takes no whole sole of 22 x 10 cm" in whole
        assert not unreachable(terrain, ROBOT, REACH, start, goal, full_soles=False, packed=packed)


def test_stepping_stones_join_what_is_too_far_apart() -> None:
    banks = (slab("near", (-1, 1)), slab("far", (2, 4)))
    stone = slab("stone", (1.4, 1.6), 0.2, (-0.1, 0.1))
    assert proofs(Terrain(banks), (3, 0, 0))[0]
    assert not proofs(Terrain((*banks, stone)), (3, 0, 0))[0]


def test_a_bridge_without_stairs_is_out_of_reach_and_the_floor_under_it_is_not() -> None:
    terrain = Terrain((slab("floor", (-1, 4)), slab("bridge", (1, 2.2), 2.3)))
    assert "2.30 m up or down" in proofs(terrain, (1.6, 0, 2.3))[0]
    assert proofs(terrain, (1.6, 0, 0.0)) == ("", "")


def test_a_platform_for_palms_alone_joins_nothing() -> None:
    rail = Surface("rail", slab("", (1.0, 2.0)).vertices, effectors=frozenset({"left_palm", "right_palm"}))
    assert proofs(Terrain((slab("near", (-1, 1)), slab("far", (2, 4)), rail)), (3, 0, 0))[0]


FLOOR = slab("floor", (-2, 6))


@pytest.mark.parametrize(
    ("wall", "closed"),
    [
        (((0.2, 9.0, 2.0), (2.0, 0.0, 1.0)), True),  # from side to side
        (((0.2, 9.0, 2.0), (2.0, 4.5, 1.0)), False),  # one half of the floor is open
        (((0.2, 9.0, 0.5), (2.0, 0.0, 0.25)), False),  # over it might be a way
        (((0.2, 9.0, 2.0), (2.0, 0.0, 2.0)), False),  # under it might be a way: 1 m is open
        (((0.2, 3.0, 2.0), (2.0, 0.0, 1.0)), False),  # round its ends over the floor's edge
        (((0.02, 9.0, 2.0), (2.0, 0.0, 1.0)), False),  # thinner than a cell: nothing is proved
    ],
)
def test_a_wall_is_a_proof_only_if_it_closes_all_that_the_pelvis_could_use(wall: tuple, closed: bool) -> None:
    why = proofs(Terrain((FLOOR,), (box("wall", *wall),)), (4.5, 0, 0))
    assert why[0] == ""
    assert bool(why[1]) == closed
    if closed:
        assert why[1].startswith("goal unreachable: box 'wall' is between")


@pytest.mark.parametrize("door", [0.0, 0.3, 0.6])
def test_a_door_of_any_width_is_no_proof(door: float) -> None:
    halves = [box(f"half {s}", (0.2, 6.0, 2.5), (2.0, s * (3.0 + door / 2), 1.25)) for s in (1, -1)]
    assert bool(proofs(Terrain((FLOOR,), tuple(halves)), (4.5, 0, 0))[1]) == (door == 0.0)


def test_a_goal_in_a_closed_cell_is_walled_off() -> None:
    sides = [((3.0, 0.2, 2.5), (4.0, s * 1.4, 1.25)) for s in (1, -1)]
    sides += [((0.2, 3.0, 2.5), (4.0 + s * 1.4, 0.0, 1.25)) for s in (1, -1)]
    cell = [box(f"side {k}", *side) for k, side in enumerate(sides)]
    wide = Terrain((slab("floor", (-2, 8), y=(-4, 4)),), tuple(cell))
    assert "box 'side 3'" in proofs(wide, (4.0, 0, 0))[1]
    assert proofs(Terrain(wide.surfaces, tuple(cell[1:])), (4.0, 0, 0))[1] == ""


def test_groups_of_surfaces_are_those_of_all_pairs_of_outlines() -> None:
    rng = np.random.default_rng(3)
    for _ in range(30):
        middle = rng.uniform(0.0, 4.0, (40, 2))
        plans = np.array([shapely.MultiPoint(c + rng.uniform(-0.3, 0.3, (5, 2))).convex_hull for c in middle])
        heights = np.sort(rng.uniform(0.0, 0.6, (40, 2)), axis=1)
        reach, rise = rng.uniform(0.05, 0.4), rng.uniform(0.0, 0.3)
        joined = shapely.distance(plans[:, None], plans[None]) <= reach + SLACK
        gap = heights[:, None, 0] - heights[None, :, 1]
        joined &= np.maximum(gap, gap.T) <= rise + SLACK
        reached = np.arange(40) == 0
        for _ in range(40):
            reached = joined[reached].any(axis=0)
        np.testing.assert_array_equal(_connected(plans, heights, reach, rise, [0]), reached)
