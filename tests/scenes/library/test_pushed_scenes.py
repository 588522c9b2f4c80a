"""The pushed scenes against the figures of Lin 2020 sec. 7.8: impulses, probabilities, and where the wind does not blow."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from scenes.disturbance import PERIOD, Disturbance, pushes_at
from scenes.effector import EFFECTORS
from scenes.files.scene_file import scene_from_yaml, scene_to_yaml, write_scene
from scenes.files.scene_source import load_scene
from scenes.library import oil_platform, rubble_with_wall
from scenes.library.oil_platform import WALKS
from scenes.library.plates import MAX_TILT
from scenes.library.wind import gusts
from scenes.scene import Scene

MASS = 63.47  # [kg] of the robot in Lin 2020 ch. VII
LIKELY = 0.01  # that some push happens within 0.1 s
PUSHED = {
    "rubble_with_wall": rubble_with_wall.named,
    "oil_platform": oil_platform.named,
    "oil_platform_y": oil_platform.with_wind_to_y,
}
SPEEDS = {
    "rubble_with_wall": ((0.0, 1.0, 0.0), (0.5, 0.6, 0.7, 0.8)),
    "oil_platform": ((-1.0, 0.0, 0.0), (0.6, 0.7, 0.8)),
    "oil_platform_y": ((0.0, 1.0, 0.0), (0.6, 0.7, 0.8)),
}
IN_THE_LEE = (0.9, (-1.9, -0.4))  # [m] x below this, y between these


def points_of_walkways(rng: np.random.Generator, n: int) -> np.ndarray:
    """(n, 3) points over the walkways, as high as a CoM is [m]."""
    edges = np.array(list(WALKS.values()))[rng.integers(len(WALKS), size=n)]  # (n, 2, 2)
    return np.column_stack([rng.uniform(edges[:, :, 0], edges[:, :, 1]), rng.uniform(0.6, 1.1, n)])


def sheltered(points: np.ndarray) -> np.ndarray:
    x, (south, north) = IN_THE_LEE
    return (points[:, 0] < x) & (south < points[:, 1]) & (points[:, 1] < north)


@pytest.mark.parametrize("name", PUSHED)
def test_impulses_are_the_published_mass_times_the_published_speeds(name: str) -> None:
    direction, speeds = SPEEDS[name]
    for disturbance in PUSHED[name](0).disturbances:
        np.testing.assert_allclose(disturbance.impulses, [[MASS * v * d for d in direction] for v in speeds])
        assert disturbance.probability == LIKELY


@pytest.mark.parametrize("name", PUSHED)
def test_where_wind_blows_some_push_comes_once_in_a_hundred_periods_and_each_as_often_as_the_others(name: str) -> None:
    here = pushes_at(PUSHED[name](0).disturbances, np.array([1.2, 0.1, 0.9]))
    assert here.any_within(PERIOD) == pytest.approx(LIKELY)
    np.testing.assert_allclose(here.probability, LIKELY / len(SPEEDS[name][1]))


@given(st.floats(-3, 3), st.floats(0.1, 2), st.floats(-3, 3), st.floats(0.1, 2), st.floats(-1, 2), st.floats(-1, 2))
def test_gusts_blow_in_their_rectangle_and_nowhere_else(
    x0: float, length: float, y0: float, width: float, u: float, v: float
) -> None:
    assume(min(abs(u), abs(u - 1), abs(v), abs(v - 1)) > 1e-6)
    wind = gusts((0.0, 1.0, 0.0), (0.5,), ((x0, x0 + length), (y0, y0 + width)))
    acts = wind.acts_at(np.array([[x0 + u * length, y0 + v * width, 0.9]]))[0]
    assert acts == (0 < u < 1 and 0 < v < 1)


@pytest.mark.parametrize("seed", range(10))
def test_stones_lie_between_the_platforms_and_differ_with_the_seed(seed: int) -> None:
    one, other = rubble_with_wall.named(seed), rubble_with_wall.named(seed + 1)
    stones = [s for s in one.terrain.surfaces if s.name.startswith("stone")]
    corners = np.concatenate([s.vertices for s in stones])
    centres = np.array([s.centroid for s in stones])
    assert len(stones) == 16
    assert (corners[:, 0] > 0.2).all() and (corners[:, 0] < 1.6).all()
    over = np.hypot(0.15, 0.175 * np.sin(MAX_TILT)) - 0.15  # a corner swings out, max of 0.15 cos(roll) + ... sin(roll)
    assert (corners[:, 1] > -0.3 - over).all() and (corners[:, 1] < 0.9 + over).all()
    np.testing.assert_allclose(np.unique(np.round(centres[:, 0], 9)), 0.2 + 0.35 * (np.arange(4) + 0.5))
    np.testing.assert_allclose(np.unique(np.round(centres[:, 1], 9)), -0.3 + 0.3 * (np.arange(4) + 0.5))
    pairs = zip(one.terrain.surfaces, other.terrain.surfaces, strict=True)
    assert [a.name for a, b in pairs if a == b] == ["start_platform", "goal_platform", "wall"]


def test_only_palms_may_use_the_wall_which_faces_the_stones() -> None:
    (wall,) = [s for s in rubble_with_wall.named(0).terrain.surfaces if s.name == "wall"]
    np.testing.assert_allclose(wall.vertices[:, 1], 1.1)
    np.testing.assert_allclose(wall.normal, [0.0, -1.0, 0.0], atol=1e-12)
    assert [e for e in EFFECTORS if wall.allows(e)] == ["left_palm", "right_palm"]


def test_behind_the_machines_there_is_no_wind_from_the_east_and_elsewhere_exactly_one_set_blows() -> None:
    points = points_of_walkways(np.random.default_rng(0), 400)
    lee = sheltered(points)
    assert 20 < lee.sum() < 380
    sets = np.array([len(pushes_at(oil_platform.named(0).disturbances, p).impulses) for p in points])
    np.testing.assert_array_equal(sets, np.where(lee, 0, len(SPEEDS["oil_platform"][1])))


def test_the_other_wind_blows_everywhere() -> None:
    points = points_of_walkways(np.random.default_rng(1), 50)
    for p in points:
        here = pushes_at(oil_platform.with_wind_to_y(0).disturbances, p)
        assert len(here.impulses) == 3 and (here.impulses[:, 1] > 0).all() and not here.impulses[:, [0, 2]].any()


def test_both_platforms_have_the_same_ground_and_goal() -> None:
    one, other = oil_platform.named(0), oil_platform.with_wind_to_y(0)
    assert one.terrain.surfaces == other.terrain.surfaces
    np.testing.assert_array_equal(one.terrain.triangles, other.terrain.triangles)
    assert (one.start, one.goal) == (other.start, other.goal)


def test_the_machines_stand_between_the_walkways_and_no_palm_may_touch_them() -> None:
    scene = oil_platform.named(0)
    assert not scene.terrain.surfaces_for("left_palm")
    corners = scene.terrain.triangles.reshape(-1, 3)
    for (x0, x1), (y0, y1) in WALKS.values():
        over = (corners[:, 0] > x0) & (corners[:, 0] < x1) & (corners[:, 1] > y0) & (corners[:, 1] < y1)
        assert not over.any()


def same_pushes(a: tuple[Disturbance, ...], b: tuple[Disturbance, ...]) -> None:
    assert len(a) == len(b)
    for one, other in zip(a, b, strict=True):
        np.testing.assert_allclose(one.impulses, other.impulses, rtol=1e-9)
        assert one.probability == other.probability
        assert one.box_size == pytest.approx(other.box_size)
        if one.X_WR is not None:
            np.testing.assert_allclose(one.X_WR, other.X_WR, atol=1e-9)


@pytest.mark.parametrize("name", PUSHED)
def test_a_pushed_scene_comes_back_from_its_file_with_its_pushes(name: str, tmp_path: Path) -> None:
    scene = load_scene(name, seed=2)
    assert isinstance(scene, Scene) and scene.name == name
    write_scene(scene, tmp_path / "pushed.yaml")
    back = load_scene(str(tmp_path / "pushed.yaml"))
    same_pushes(back.disturbances, scene.disturbances)
    assert scene_to_yaml(back) == scene_to_yaml(scene)
    same_pushes(scene_from_yaml(scene_to_yaml(scene), "text").disturbances, scene.disturbances)
