"""Capture poses: steps of the planning model about the standing foot in closed form, palms where rays meet a wall."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drakeplan.contact_planning.contact_pool import CELL, ContactPool
from drakeplan.robustness.capture_poses import ARM_SLACK, FOOT, OPPOSITE_PALM, SAME_PALM, CapturePoses
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS, LEFT_FOOT, LEFT_PALM, RIGHT_FOOT, RIGHT_PALM
from scenes.library.plates import level_plate, wall_plate
from scenes.robots.robot import load_robot
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.terrain import Terrain
from scenes.transition_model import transition_model

ROBOT = load_robot("escher")
FLOOR = level_plate("floor", (-5.0, 5.0), (-5.0, 5.0))
LEFT_WALL, RIGHT_WALL = (wall_plate(f"wall_{y}", (-5.0, 5.0), y, (0.3, 2.1)) for y in (0.7, -0.7))
UP = np.array([0.0, 0.0, 1.0])
FEET = (LEFT_FOOT, RIGHT_FOOT)


def standing(foot: int, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, z: float = 0.0) -> Contact:
    return Contact(EFFECTORS[foot], 0, contact_pose(EFFECTORS[foot], np.array([x, y, z]), UP, yaw), 0.5, yaw)


def made(*surfaces: object, palms: bool = True) -> CapturePoses:
    packed = pack_terrain(Terrain((FLOOR, *surfaces)))  # type: ignore[arg-type]
    return CapturePoses(packed, ROBOT, ContactPool(packed), palms=palms)


def twin(foot: int, x: float, y: float, yaw: float) -> np.ndarray:
    """(M, 3) the steps by hand: those of the left foot about the right one, mirrored where the left one stands."""
    side = 1.0 if foot == RIGHT_FOOT else -1.0
    rows = []
    for ahead, aside, turn in transition_model("planning").steps:
        aside = side * aside
        rows.append(
            (
                x + np.cos(yaw) * ahead - np.sin(yaw) * aside,
                y + np.sin(yaw) * ahead + np.cos(yaw) * aside,
                yaw + side * turn,
            )
        )
    return np.array(rows)


def same_rows(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two sets of rows are the same, in whatever order."""
    apart = np.abs(a[:, None] - b[None]).max(axis=2)
    return len(a) == len(b) and bool((apart.min(axis=0) < 1e-6).all() and (apart.min(axis=1) < 1e-6).all())


@given(st.sampled_from(FEET), st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3))
def test_on_level_ground_every_step_of_the_planning_model_is_a_foothold(
    foot: int, x: float, y: float, yaw: float
) -> None:
    poses = made(palms=False)
    around = poses.about(poses.pool.add_contact(standing(foot, x, y, yaw)))
    pool, n = poses.pool, around.numbers
    assert (pool.effector[n] == 1 - foot).all() and (around.motion == FOOT).all()
    np.testing.assert_allclose(pool.p[n, 2], 0.0, atol=1e-9)
    found = np.column_stack([pool.p[n, :2], pool.yaw[n]])
    assert same_rows(found, twin(foot, x, y, yaw))
    for number in n.tolist():
        np.testing.assert_allclose(
            pool.R[number], contact_pose("left_foot", np.zeros(3), UP, pool.yaw[number])[:3, :3], atol=1e-9
        )


def test_steps_about_the_left_foot_are_the_mirror_image_of_those_about_the_right() -> None:
    poses = made(palms=False)
    seen = []
    for foot in FEET:
        n = poses.about(poses.pool.add_contact(standing(foot))).numbers
        seen.append(np.column_stack([poses.pool.p[n, :2], poses.pool.yaw[n]]))
    assert same_rows(seen[0], seen[1] * [1.0, -1.0, -1.0])


@pytest.mark.parametrize("foot", FEET)
@pytest.mark.parametrize(("rise", "found"), [(0.02, True), (0.3, True), (0.4, False), (-0.3, True), (-0.4, False)])
def test_steps_rise_and_fall_as_far_as_feet_may_stand_apart_in_height(foot: int, rise: float, found: bool) -> None:
    """`max_step_height` is 0.35 m; the foot stands in the air over a floor `rise` higher."""
    poses = made(palms=False)
    around = poses.about(poses.pool.add_contact(standing(foot, z=-rise)))
    assert bool(len(around.numbers)) == found
    np.testing.assert_allclose(poses.pool.p[around.numbers, 2], 0.0, atol=1e-9)


def test_footholds_are_where_the_ground_takes_the_whole_sole() -> None:
    packed = pack_terrain(Terrain((level_plate("strip", (-0.12, 5.0), (-5.0, 5.0)),)))
    poses = CapturePoses(packed, ROBOT, ContactPool(packed), palms=False)
    n = poses.about(poses.pool.add_contact(standing(LEFT_FOOT))).numbers
    half_length, half_width = ROBOT.half_extents[RIGHT_FOOT]
    yaw = poses.pool.yaw[n]
    heel = poses.pool.p[n, 0] - half_length * np.abs(np.cos(yaw)) - half_width * np.abs(np.sin(yaw))
    assert heel.min() >= -0.12
    wanted = twin(LEFT_FOOT, 0.0, 0.0, 0.0)
    fits = wanted[:, 0] - half_length * np.abs(np.cos(wanted[:, 2])) - half_width * np.abs(np.sin(wanted[:, 2])) > -0.12
    assert 0 < fits.sum() < len(wanted)
    assert same_rows(np.column_stack([poses.pool.p[n, :2], yaw]), wanted[fits])


# ---- palms


def shoulder(foot: int, palm: int) -> np.ndarray:
    """(3,) of a robot that stands with this foot at the origin, heading along x, the other foot beside it."""
    middle = -ROBOT.foot_separation[1] / 2 if foot == LEFT_FOOT else ROBOT.foot_separation[1] / 2
    return ROBOT.shoulder * [1.0, 1.0 if palm == LEFT_PALM else -1.0, 1.0] + [0.0, middle, 0.0]


@pytest.mark.parametrize("foot", FEET)
@pytest.mark.parametrize("palm", [LEFT_PALM, RIGHT_PALM])
def test_palms_are_found_on_a_wall_where_rays_from_the_shoulder_meet_it(foot: int, palm: int) -> None:
    wall = LEFT_WALL if palm == LEFT_PALM else RIGHT_WALL
    poses = made(wall)
    around = poses.about(poses.pool.add_contact(standing(foot)))
    n = around.numbers[poses.pool.effector[around.numbers] == palm]
    assert len(n) > 10
    p = poses.pool.p[n]
    np.testing.assert_allclose(p[:, 1], wall.vertices[0, 1], atol=1e-9)
    out = (p - shoulder(foot, palm)) * [1.0, 1.0 if palm == LEFT_PALM else -1.0, 1.0]
    distance = np.linalg.norm(out, axis=1)
    assert distance.min() >= ROBOT.arm_reach[0] and distance.max() <= ARM_SLACK * ROBOT.arm_reach[1]
    azimuth, elevation = np.rad2deg(np.arctan2(out[:, 1], out[:, 0])), np.rad2deg(np.arcsin(out[:, 2] / distance))
    np.testing.assert_allclose(azimuth, 5 * np.round(azimuth / 5), atol=1e-6)
    np.testing.assert_allclose(elevation, 10 * np.round(elevation / 10), atol=1e-6)
    assert np.abs(azimuth - 90).max() < 20.001 and np.abs(elevation).max() < 40.001


@pytest.mark.parametrize("foot", FEET)
@pytest.mark.parametrize("palm", [LEFT_PALM, RIGHT_PALM])
def test_a_palm_over_the_standing_foot_is_the_same_one_and_the_other_the_opposite(foot: int, palm: int) -> None:
    poses = made(LEFT_WALL, RIGHT_WALL)
    around = poses.about(poses.pool.add_contact(standing(foot)))
    its = around.motion[poses.pool.effector[around.numbers] == palm]
    same = EFFECTORS[palm].split("_")[0] == EFFECTORS[foot].split("_")[0]
    assert len(its) and (its == (SAME_PALM if same else OPPOSITE_PALM)).all()


@pytest.mark.parametrize("foot", FEET)
def test_without_palms_none_is_found_and_without_a_wall_neither(foot: int) -> None:
    for poses in (made(LEFT_WALL, RIGHT_WALL, palms=False), made()):
        around = poses.about(poses.pool.add_contact(standing(foot)))
        assert (around.motion == FOOT).all() and (poses.pool.effector[around.numbers] == 1 - foot).all()


def test_a_robot_turned_about_touches_the_wall_with_its_other_palm() -> None:
    poses = made(LEFT_WALL)
    for yaw, palm in ((0.0, LEFT_PALM), (np.pi, RIGHT_PALM)):
        around = poses.about(poses.pool.add_contact(standing(LEFT_FOOT, yaw=yaw)))
        assert set(poses.pool.effector[around.numbers].tolist()) == {RIGHT_FOOT, palm}


def test_answers_depend_on_the_foot_alone() -> None:
    poses, again = made(LEFT_WALL, RIGHT_WALL), made(LEFT_WALL, RIGHT_WALL)
    feet = [standing(LEFT_FOOT), standing(RIGHT_FOOT, 0.31, -0.2), standing(LEFT_FOOT, 0.6, 0.1, 0.3)]
    seen = [poses.about(poses.pool.add_contact(foot)) for foot in feet]
    numbers = [again.pool.add_contact(foot) for foot in feet[::-1]][::-1]
    for one, number in zip(seen, numbers, strict=True):
        other = again.about(number)
        assert again.about(number) is other, "projected once"
        a, b = poses.pool.p[one.numbers], again.pool.p[other.numbers]
        gap = np.linalg.norm(a[:, None] - b[None], axis=2).min(axis=1)
        assert gap.max() < np.sqrt(3) * CELL, "but for near duplicates, of which the pool keeps the first"
        assert set(one.motion.tolist()) == set(other.motion.tolist())
