"""The motions of a data set: rows that fit their schema and obey the physics that their columns name."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest
import shapely
from scipy.spatial.transform import Rotation

from drakeplan.campaigns.motions import RATE, SCHEMA, MotionsCampaign
from scenes.library.motion_terrains import KINDS, draw_terrain
from scenes.robots.robot import load_robot
from scenes.terrain.surface import Surface

GRAVITY = 9.81
ESCHER = load_robot("escher")


@pytest.fixture(scope="module")
def row() -> dict:
    """The row of one task, on level ground."""
    (row,) = MotionsCampaign().rows(np.random.SeedSequence(0, spawn_key=(0, 0)), 0)
    assert row["status"] == "complete", row["reason"]
    return dict(row)


def column(row: dict, name: str) -> np.ndarray:
    return np.array(row[name])


def test_a_row_fits_the_schema_and_comes_back_as_it_was(row: dict):
    (back,) = pa.Table.from_pylist([row], schema=SCHEMA).to_pylist()
    assert back["task"] == row["task"]
    np.testing.assert_allclose(column(back, "joints"), column(row, "joints"), atol=1e-6)


def test_all_samples_are_there_at_the_rate(row: dict):
    count = int(row["duration"] * RATE + 1e-9) + 1
    for name in ("base_position", "base_quaternion", "joints", "joint_velocities", "com", "forces", "contacts"):
        assert len(row[name]) == count, name
    assert column(row, "joints").shape[1] == len(MotionsCampaign().parameters["joint_names"])


def test_quaternions_are_unit_and_contact_frames_point_up_on_level_ground(row: dict):
    np.testing.assert_allclose(np.linalg.norm(column(row, "base_quaternion"), axis=1), 1.0, atol=1e-4)
    poses = column(row, "contact_poses")
    up = Rotation.from_quat(poses[:, 3:], scalar_first=True).as_matrix()[:, 2, 2]
    np.testing.assert_allclose(up, 1.0, atol=1e-6)
    np.testing.assert_allclose(poses[:, 2], 0.0, atol=1e-4)


def test_forces_carry_the_weight_on_average_and_only_through_contacts(row: dict):
    forces = column(row, "forces").reshape(-1, 4, 3)
    weight = ESCHER.mass * GRAVITY
    assert np.mean(forces.sum(axis=1)[:, 2]) == pytest.approx(weight, rel=0.03)
    free = column(row, "contacts") < 0
    np.testing.assert_allclose(forces[free], 0.0, atol=1e-6)


def test_velocities_are_the_derivative_of_the_joints(row: dict):
    q, v = column(row, "joints"), column(row, "joint_velocities")
    middle = 0.5 * RATE * (q[2:] - q[:-2])
    assert np.abs(middle - v[1:-1]).mean() < 0.05


def test_the_motion_ends_at_the_goal_of_its_scene(row: dict):
    import yaml

    goal = yaml.safe_load(row["scene_yaml"])["goal"]
    feet = column(row, "contact_poses")[column(row, "contacts")[-1, :2], :2].mean(axis=0)
    assert np.linalg.norm(feet - goal["xyz"][:2]) <= goal["radius"] + 1e-6


def is_on(surface: Surface, xyz: tuple[float, ...]) -> bool:
    """Whether a point is on a surface, by its plan view and its plane."""
    x, y, z = xyz
    n = surface.normal
    if abs(n[2]) < 0.5 or abs((np.array([x, y, z]) - surface.vertices[0]) @ n) > 1e-6:
        return False
    return bool(shapely.Polygon(surface.vertices[:, :2]).contains(shapely.Point(x, y)))


@pytest.mark.parametrize("kind", KINDS)
def test_terrains_have_ground_under_start_and_goal_and_come_again(kind: str):
    for seed in range(5):
        scene = draw_terrain(np.random.default_rng(seed), kind, 0.3)
        again = draw_terrain(np.random.default_rng(seed), kind, 0.3)
        assert scene.goal == again.goal
        for a, b in zip(scene.terrain.surfaces, again.terrain.surfaces, strict=True):
            np.testing.assert_array_equal(a.vertices, b.vertices)
        for place in (scene.start, scene.goal):
            assert place is not None
            assert any(is_on(surface, place.xyz) for surface in scene.terrain.surfaces)


def test_a_robot_with_lower_steps_gets_lower_stairs():
    low, high = (draw_terrain(np.random.default_rng(3), "stairs_up", step) for step in (0.1, 0.3))
    assert low.goal is not None
    assert high.goal is not None
    assert 0.0 < low.goal.xyz[2] == pytest.approx(high.goal.xyz[2] / 3.0)
