"""Labels of palms on random walls: the same at every time, counts that fit each other, walls that face the robot."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from drakeplan.bracing.wall_frame import robot_on_wall
from drakeplan.bracing.wall_traversability import palm_steps
from drakeplan.campaigns.braced_wall import HEIGHT, LENGTH, PANEL, PRESENT, TILT, BracedWallCampaign, draw_wall
from drakeplan.campaigns.campaign import rows_table
from learning.traversability_labels import SCHEMA
from scenes.library.braced_ramp import FRICTION_OF_PALMS, WALL_Y
from scenes.terrain.surface import Surface

SMALL = BracedWallCampaign(poses=3)
STEPS = palm_steps(robot_on_wall(96.0))
V = len(STEPS.translations)
TASKS = 3


def seed(k: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(11, spawn_key=(0, k))


@pytest.fixture(scope="module")
def rows() -> list[dict[str, object]]:
    """The labels of some walls."""
    return [dict(row) for k in range(TASKS) for row in SMALL.rows(seed(k), k)]


@pytest.fixture(scope="module")
def columns(rows) -> dict[str, np.ndarray]:
    return {name: np.array([row[name] for row in rows]) for name in SCHEMA.names}


def test_rows_fit_the_schema_and_hold_every_translation_of_every_pose_in_turn(rows, columns) -> None:
    table = rows_table(SMALL.schema, rows)  # raises where a column is missing, null or not finite
    assert SMALL.schema is SCHEMA
    assert table.num_rows == TASKS * SMALL.poses * V
    np.testing.assert_array_equal(columns["translation"], np.tile(np.arange(V), TASKS * SMALL.poses))
    np.testing.assert_array_equal(columns["pose"], np.tile(np.repeat(np.arange(SMALL.poses), V), TASKS))
    assert not columns["mode"].any(), "palms are feet here"
    assert not columns["palm_scores"].any() and not columns["palms_fit"].any(), "and there are no others"


def test_the_rows_of_a_task_depend_on_its_seed_alone(rows) -> None:
    for k in (TASKS - 1, 0):
        again = rows_table(SCHEMA, SMALL.rows(seed(k), k)).to_pydict()
        kept = rows_table(SCHEMA, [row for row in rows if row["scene"] == k]).to_pydict()
        assert pickle.dumps(again) == pickle.dumps(kept)
    other = SMALL.rows(np.random.SeedSequence(12, spawn_key=(0, 0)), 0)
    assert not {tuple(row["torso"]) for row in other} & {tuple(row["torso"]) for row in rows}


def test_no_more_pairs_are_useful_than_fit_and_some_are(columns) -> None:
    useful, pairs = columns["useful"], columns["pairs"]
    assert (useful >= 0).all() and (useful <= pairs).all() and pairs.max() <= len(STEPS.pairs)
    assert (useful > 0).any() and (useful == 0).any()
    by_pose = pairs.reshape(-1, V)
    np.testing.assert_array_equal(by_pose, by_pose[:, :1].repeat(V, axis=1))


def test_pairs_score_no_more_than_there_are_and_those_that_fit_are_counted(columns) -> None:
    most = np.bincount(STEPS.translation, minlength=V)[columns["translation"]]
    assert (columns["foot_scores"] >= 0).all() and (columns["foot_scores"] <= most + 1e-9).all()
    assert (columns["pair_scores"] <= len(STEPS.pairs) + 1e-9).all() and (columns["pair_scores"] > 0).any()
    assert (columns["feet_fit"] == np.round(columns["feet_fit"])).all()
    (stay,) = np.flatnonzero(STEPS.direction_of_translation < 0)
    staying = columns["translation"] == stay
    np.testing.assert_array_equal(columns["feet_fit"][staying], columns["pairs"][staying])


def test_parameters_name_the_robot_its_steps_and_the_poses_of_a_wall() -> None:
    base = SMALL.parameters
    assert base["translations"] == STEPS.translations.tolist()
    assert base["robot_model_sha256"] == robot_on_wall(1.0).model_sha256
    assert BracedWallCampaign(poses=4).parameters != base
    assert (base["robot"], base["footholds"], base["poses"]) == ("bracer", "fixed", 3)


def test_walls_are_panels_that_face_the_robot_beside_and_above_each_other() -> None:
    for k in range(20):
        wall = draw_wall(np.random.default_rng(k))
        assert wall.surfaces == draw_wall(np.random.default_rng(k)).surfaces
        for panel in wall.surfaces:
            assert panel.friction == FRICTION_OF_PALMS and panel.allows("left_palm")
            assert panel.normal[1] <= -(np.cos(TILT) ** 2) + 1e-12
            assert panel.centroid[1] == pytest.approx(WALL_Y)
            edges = np.linalg.norm(np.roll(panel.vertices, -1, axis=0) - panel.vertices, axis=1)
            assert PANEL[0] - 1e-9 <= edges.min() and edges.max() <= PANEL[1] + 1e-9
        # each panel in its own upright rectangle, whatever its tilt: none covers another
        boxes = np.array([[*p.centroid[[0, 2]], *_size(p)] for p in wall.surfaces])
        for i, a in enumerate(boxes):
            for b in boxes[:i]:
                assert (np.abs(a[:2] - b[:2]) >= 0.5 * (a[2:] + b[2:]) - 1e-9).any()


def test_seven_tenths_of_a_wall_are_there() -> None:
    area = 0.0
    walls = [draw_wall(np.random.default_rng(k)) for k in range(100)]
    for wall in walls:
        for panel in wall.surfaces:
            (x0, z0), (x1, z1) = (f(panel.vertices[:, [0, 2]], axis=0) for f in (np.min, np.max))
            x0, x1, z0, z1 = max(x0, 0.0), min(x1, LENGTH), max(z0, HEIGHT[0]), min(z1, HEIGHT[1])
            area += max(x1 - x0, 0.0) * max(z1 - z0, 0.0)
    # joints of 2 cm, and tilts that shorten what one sees, take a few hundredths
    assert area / (len(walls) * LENGTH * (HEIGHT[1] - HEIGHT[0])) == pytest.approx(0.94 * PRESENT, abs=0.05)


def _size(panel: Surface) -> np.ndarray:
    """(2,) edges of a panel along x and z [m]."""
    v = panel.vertices
    a, b = v[1] - v[0], v[2] - v[1]
    along, up = (a, b) if abs(a[0]) > abs(b[0]) else (b, a)
    return np.array([np.linalg.norm(along), np.linalg.norm(up)])
