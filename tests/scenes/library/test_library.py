"""The named scenes against the figures they were published with."""

import json
import os
import time
from pathlib import Path

import numpy as np
import pytest

from scenes.files.scene_file import scene_from_yaml, scene_to_yaml
from scenes.files.scene_source import list_scenes, load_scene
from scenes.library import NAMED_SCENES, rubble_corridor, rubble_field, three_corridors, tilted_slab, wide_gap
from scenes.library.plates import MAX_RISE, MAX_TILT, tilt_rotation

SEEDS = range(50)
ROOMS = ("three_corridors", "two_corridors", "two_staircases")
RANDOM = ("rubble_field", "rubble_corridor", "rubble_with_wall", "random_surfaces", *ROOMS)


def roll_and_pitch(normal):
    """The angles of R = Rx(roll) Ry(pitch), whose third column is the normal (sin p, -sin r cos p, cos r cos p)."""
    return np.arctan2(-normal[1], normal[2]), np.arcsin(normal[0])


def stones(scene, prefix):
    return [s for s in scene.terrain.surfaces if s.name.startswith(prefix)]


def edge_lengths(surface):
    return np.linalg.norm(np.roll(surface.vertices, -1, axis=0) - surface.vertices, axis=1)


@pytest.mark.parametrize("name", NAMED_SCENES)
def test_every_scene_has_ground_to_stand_on_at_its_start_and_its_goal(name):
    for seed in range(10):
        scene = load_scene(name, seed=seed)
        assert scene.name == name
        assert scene.goal.radius == 0.2
        assert name in ROOMS or scene.start.xyz == (0.025, 0.0, 0.0)
        assert all(s.friction == 0.5 for s in scene.terrain.surfaces)
        for point in (scene.start.xyz, scene.goal.xyz):
            under = [
                s
                for s in scene.terrain.surfaces
                if s.tilt < 1e-9
                and s.vertices[:, 0].min() + 0.1 < point[0] < s.vertices[:, 0].max() - 0.1
                and s.vertices[:, 1].min() + 0.2 < point[1] < s.vertices[:, 1].max() - 0.2
                and abs(s.vertices[0, 2] - point[2]) < 1e-12
            ]
            assert under, f"{name} has nothing level under {point}"


@pytest.mark.parametrize("name", NAMED_SCENES)
def test_a_seed_gives_the_same_scene_again_and_another_seed_another_one_where_something_is_drawn(name):
    assert load_scene(name, seed=3).terrain.surfaces == load_scene(name, seed=3).terrain.surfaces
    differs = load_scene(name, seed=3).terrain.surfaces != load_scene(name, seed=4).terrain.surfaces
    assert differs == (name in RANDOM)


def test_the_tilt_is_roll_about_x_then_pitch_about_the_new_y_then_yaw_about_the_new_z():
    roll, pitch, yaw = 0.3, -0.2, 0.7
    Rx = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    Ry = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    Rz = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    np.testing.assert_allclose(tilt_rotation(roll, pitch, yaw), Rx @ Ry @ Rz, atol=1e-15)


def test_a_rubble_field_is_twelve_square_stones_between_two_platforms():
    """Lin 2020 sec. 6.7.3: 14 convex surfaces, goal about 3.4 m away."""
    for seed in SEEDS:
        scene = load_scene("rubble_field", seed=seed)
        assert len(scene.terrain.surfaces) == 14
        assert scene.goal.xyz[0] - scene.start.xyz[0] == pytest.approx(3.395)
        for i, stone in enumerate(stones(scene, "stone")):
            row, lane = divmod(i, 4)
            np.testing.assert_allclose(edge_lengths(stone), 0.4, atol=1e-12)
            np.testing.assert_allclose(stone.centroid[:2], [1.31 + 0.4 * row, -0.6 + 0.4 * lane], atol=1e-12)
            assert abs(stone.centroid[2]) <= MAX_RISE
            assert stone.allows("left_foot")


def test_a_rubble_corridor_is_fifteen_stones_and_two_walls_of_four_panels_turned_inward():
    for seed in SEEDS:
        scene = load_scene("rubble_corridor", seed=seed)
        assert len(scene.terrain.surfaces) == 25
        assert scene.goal.xyz[:2] == (3.62, 0.0)
        for i, stone in enumerate(stones(scene, "stone")):
            row, lane = divmod(i, 3)
            np.testing.assert_allclose(sorted(edge_lengths(stone)), [0.3, 0.3, 0.4, 0.4], atol=1e-12)
            np.testing.assert_allclose(stone.centroid[:2], [0.61 + 0.4 * row, -0.3 + 0.3 * lane], atol=1e-12)
            assert abs(stone.centroid[2]) <= MAX_RISE
        for side, sign in (("right", -1.0), ("left", 1.0)):
            for i, panel in enumerate(stones(scene, side)):
                np.testing.assert_allclose(panel.centroid, [0.66 + 0.5 * i, 0.7 * sign, 1.5], atol=1e-12)
                np.testing.assert_allclose(edge_lengths(panel), 0.4, atol=1e-12)
                assert panel.normal[1] * sign < -0.85, "a panel faces the corridor"
                assert panel.allows("left_palm")
                assert not panel.allows("left_foot")


@pytest.mark.parametrize("name", ["rubble_field", "rubble_corridor"])
def test_rubble_tilts_are_uniform_over_twenty_degrees_about_either_axis(name):
    angles = np.array([roll_and_pitch(s.normal) for k in range(200) for s in stones(load_scene(name, seed=k), "stone")])
    assert np.abs(angles).max() <= MAX_TILT + 1e-12
    assert np.abs(angles).max() > 0.98 * MAX_TILT
    count = len(angles)
    # A uniform draw on [-a, a] has mean 0 with deviation a/sqrt(3 n), and a mean square of a^2/3.
    assert np.all(np.abs(angles.mean(axis=0)) < 4 * MAX_TILT / np.sqrt(3 * count))
    np.testing.assert_allclose((angles**2).mean(axis=0), MAX_TILT**2 / 3, rtol=0.08)
    assert abs(np.corrcoef(angles.T)[0, 1]) < 4 / np.sqrt(count)


def test_rubble_heights_are_uniform_over_five_centimetres_up_or_down():
    rises = np.array([s.centroid[2] for k in range(200) for s in stones(load_scene("rubble_field", seed=k), "stone")])
    assert 0.98 * MAX_RISE < np.abs(rises).max() <= MAX_RISE
    np.testing.assert_allclose((rises**2).mean(), MAX_RISE**2 / 3, rtol=0.08)


def test_a_wide_gap_leaves_half_a_metre_of_nothing():
    near, far = load_scene("wide_gap").terrain.surfaces
    assert far.vertices[:, 0].min() - near.vertices[:, 0].max() == pytest.approx(0.5)
    assert wide_gap.named(gap=0.3).terrain.surfaces[1].vertices[:, 0].min() == pytest.approx(1.41)


def test_a_steep_slope_goes_down_three_metres_at_thirty_degrees():
    scene = load_scene("steep_slope")
    slope = scene.terrain.surfaces[1]
    assert np.rad2deg(slope.tilt) == pytest.approx(30.0)
    assert slope.normal[0] > 0, "downhill is ahead"
    assert edge_lengths(slope).max() == pytest.approx(3.0)
    assert scene.goal.xyz[2] == pytest.approx(-1.5)
    assert np.tan(slope.tilt) > slope.friction, "nobody can stand still on it"


def test_a_tilted_slab_tips_towards_its_wall():
    scene = load_scene("tilted_slab")
    slab, wall = scene.terrain.surfaces[1:3]
    assert np.rad2deg(slab.tilt) == pytest.approx(30.0)
    assert slab.normal[1] > 0
    np.testing.assert_allclose(wall.normal, [0, -1, 0], atol=1e-15)
    assert wall.vertices[0, 1] == 0.8
    assert np.rad2deg(tilted_slab.named(tilt=np.deg2rad(20)).terrain.surfaces[1].tilt) == pytest.approx(20.0)


def test_stairs_rise_evenly_and_end_on_a_landing():
    surfaces = {s.name: s for s in load_scene("stairs").terrain.surfaces}
    heights = [surfaces[f"tread_{i}"].vertices[0, 2] for i in range(5)] + [surfaces["landing"].vertices[0, 2]]
    np.testing.assert_allclose(np.diff([0.0, *heights]), 0.15)
    for i in range(5):
        np.testing.assert_allclose(np.ptp(surfaces[f"tread_{i}"].vertices[:, 0]), 0.30)
        np.testing.assert_allclose(surfaces[f"riser_{i}"].normal, [-1, 0, 0], atol=1e-15)
        assert not surfaces[f"riser_{i}"].allows("left_palm")


def test_random_surfaces_cover_and_cut_each_other_over_two_to_four_metres():
    """Lin 2020 sec. 4.6.1."""
    import shapely

    lengths = []
    for seed in SEEDS:
        scene = load_scene("random_surfaces", seed=seed)
        start, goal = scene.terrain.surfaces[0], scene.terrain.surfaces[-1]
        lengths.append(goal.vertices[:, 0].min() - start.vertices[:, 0].max())
        quads = stones(scene, "quad")
        assert all(len(q.vertices) == 4 for q in quads)
        assert all(q.tilt < np.deg2rad(28.1) for q in quads), "cos(tilt) is cos 20 deg twice at most"
        plan = [shapely.Polygon(q.vertices[:, :2]) for q in quads]
        over = sum(a.intersects(b) for i, a in enumerate(plan) for b in plan[:i])
        assert over > len(quads)
        strip = shapely.box(0.4, -0.6, 0.4 + lengths[-1], 0.6)
        assert shapely.union_all(plan).intersection(strip).area > 0.6 * strip.area
    assert min(lengths) >= 2.0
    assert max(lengths) <= 4.0
    assert max(lengths) - min(lengths) > 1.5


@pytest.mark.parametrize("count", [14, 140, 1400, 14000])
def test_a_wide_field_keeps_start_goal_and_rows_and_grows_sideways(count):
    scene = rubble_field.wide(count, seed=1)
    small = rubble_field.named(1)
    assert len(scene.terrain.surfaces) == count
    assert (scene.start.xyz, scene.goal.xyz) == (small.start.xyz, small.goal.xyz)
    low, high = scene.terrain.extent
    assert high[1] - low[1] == pytest.approx((count - 2) / 3 * 0.4, abs=0.05)


@pytest.mark.parametrize("length", [3.0, 10.0, 30.0, 100.0])
def test_a_long_field_puts_its_goal_at_that_distance_on_the_far_platform(length):
    scene = rubble_field.long(length, seed=1)
    assert scene.goal.xyz[0] - scene.start.xyz[0] == pytest.approx(length)
    far = scene.terrain.surfaces[-1].vertices[:, 0]
    assert far.min() + 0.5 - 1e-9 <= scene.goal.xyz[0] <= far.max() - 0.5 + 1e-9
    assert scene.goal.xyz[0] - far.min() < 0.91, "stones fill the way between"


def test_a_field_without_room_for_stones_is_refused():
    with pytest.raises(ValueError, match="at least 5"):
        rubble_field.wide(4)
    with pytest.raises(ValueError, match="no stone fits"):
        rubble_field.long(1.0)


def test_a_scene_is_made_by_name_faster_than_it_is_read_from_its_file():
    text = scene_to_yaml(load_scene("rubble_corridor", seed=3))

    def once(make):
        begin = time.perf_counter()
        make()
        return time.perf_counter() - begin

    made, read = [], []
    for _ in range(10):  # in turn, so that whatever else the machine does falls on both
        made.append(once(lambda: load_scene("rubble_corridor", seed=3)))
        read.append(once(lambda: scene_from_yaml(text, "it")))
    assert min(made) < min(read)


@pytest.mark.parametrize("name", ["two_corridors", "two_staircases"])
def test_half_of_the_patches_of_two_rooms_are_rubble_of_twenty_degrees(name):
    """Lin 2020 sec. 5.11: patches of 1.5 m, level or rubble with 50 % probability each."""
    level = rough = 0
    for seed in SEEDS:
        scene = load_scene(name, seed=seed)
        rooms = [s for s in scene.terrain.surfaces if "room" in s.name]
        for patch in {s.name.split("_stone")[0] for s in rooms}:
            own = [s for s in rooms if s.name.split("_stone")[0] == patch]
            corners = np.concatenate([s.vertices for s in own])
            assert np.ptp(corners[:, 0]) == pytest.approx(1.5, abs=0.12)  # tilted stones reach a little less far
            level, rough = level + (len(own) == 1), rough + (len(own) > 1)
            for stone in own if len(own) > 1 else []:
                assert max(np.abs(roll_and_pitch(stone.normal))) <= MAX_TILT + 1e-9
    places = 2 * len(SEEDS)  # patches under start and goal are level
    assert rough / (level + rough - places) == pytest.approx(0.5, abs=0.04)


def test_a_staircase_has_nine_stairs_of_equal_rise():
    """Lin 2020 sec. 5.11.2: the upper room is 1 to 1.5 m up, equally distributed over nine stairs."""
    rises = []
    for seed in SEEDS:
        scene = load_scene("two_staircases", seed=seed)
        rise = scene.goal.xyz[2]
        rises.append(rise)
        for k in range(2):
            for stair in range(9):
                name = f"staircase_{k}_{stair}"
                own = [s for s in scene.terrain.surfaces if s.name == name or s.name.startswith(f"{name}_stone")]
                height = np.mean([s.centroid[2] for s in own])
                assert height == pytest.approx(rise * (stair + 1) / 9, abs=0.0 if len(own) == 1 else MAX_RISE)
    assert 1.0 <= min(rises) < 1.1
    assert 1.4 < max(rises) <= 1.5


def test_of_three_corridors_the_middle_one_is_the_shortest_way_and_all_are_rubble():
    """Lin & Berenson 2017 fig. 6."""
    for seed in range(10):
        scene = load_scene("three_corridors", seed=seed)
        assert scene.start.xyz[1] == scene.goal.xyz[1] == 0.0
        for k, middle in enumerate((-1.875, 0.0, 1.875)):
            ground = stones(scene, f"corridor_{k}_0_stone") + stones(scene, f"corridor_{k}_1_stone")
            assert len(ground) == 50
            assert np.mean([s.centroid[1] for s in ground]) == pytest.approx(middle)


@pytest.mark.parametrize("name", ROOMS)
def test_walls_face_the_way_between_them(name):
    for seed in range(10):
        scene = load_scene(name, seed=seed)
        walls = [s for s in scene.terrain.surfaces if "_right_" in s.name or "_left_" in s.name]
        assert walls
        for wall in walls:
            assert wall.normal[1] * (1.0 if "_right_" in wall.name else -1.0) > np.cos(2 * MAX_TILT)


def test_every_scene_has_a_description_of_one_line():
    described = list_scenes()
    assert list(described) == list(NAMED_SCENES)
    for line in described.values():
        assert 20 < len(line) < 120
        assert line.endswith(".")


PUBLISHED = {
    "dynopt_test_env_1": "rubble_field",
    "dynopt_test_env_2": "wide_gap",
    "dynopt_test_env_4": "tilted_slab",
    "dynopt_test_env_7": "steep_slope",
    "dynopt_test_env_8": "rubble_corridor",
    "capture_test_env_3": "narrow_flat",
}


@pytest.mark.parametrize(("published", "name"), PUBLISHED.items())
def test_our_scenes_have_the_counts_sizes_places_and_ranges_of_the_published_draws(published, name):
    folder = os.environ.get("DRAKEPLAN_CASES")
    if folder is None:
        pytest.skip("DRAKEPLAN_CASES does not name a folder with the published scenes")
    scenes = [s for f in Path(folder).glob("lin_*.json") for s in json.loads(f.read_text())["scenes"]]
    draws = next(s for s in scenes if s["name"] == published)["instances"]
    ours = load_scene(name, seed=0)
    for draw in draws:
        assert len(draw["surfaces"]) == len(ours.terrain.surfaces)
        np.testing.assert_allclose(draw["goal_xy"], ours.goal.xyz[:2], atol=1e-5)
        left = list(ours.terrain.surfaces)
        for theirs in draw["surfaces"]:
            vertices, normal = np.array(theirs["vertices"]), np.array(theirs["normal"])
            twin = min(left, key=lambda s: np.linalg.norm((s.centroid - vertices.mean(axis=0))[:2]))
            left.remove(twin)
            np.testing.assert_allclose(twin.centroid[:2], vertices.mean(axis=0)[:2], atol=1e-5)
            assert abs(twin.centroid[2] - vertices[:, 2].mean()) < 2 * MAX_RISE + 1e-9
            lengths = np.linalg.norm(np.roll(vertices, -1, axis=0) - vertices, axis=1)
            np.testing.assert_allclose(sorted(edge_lengths(twin)), sorted(lengths), atol=1e-5)
            assert twin.allows("left_foot" if theirs["type"] == "ground" else "left_palm")
            for a, b in zip(roll_and_pitch(twin.normal), roll_and_pitch(normal), strict=True):
                assert abs(a - b) < (2 * MAX_TILT if name in RANDOM else 1e-5) + 1e-9
    assert rubble_corridor.ROWS * rubble_corridor.LANES == 15


def test_sparse_corridors_differ_in_how_many_quadrilaterals_they_have_and_all_lie_in_their_own():
    counts = []
    for seed in range(20):
        scene = three_corridors.sparse(np.random.default_rng(seed), 6.0)
        for k, middle in enumerate(three_corridors.MIDDLES):
            quads = stones(scene, f"corridor_{k}_quad")
            area = three_corridors.CORRIDOR * 1.5 * 1.5
            low, high = three_corridors.SPREAD
            assert round(6.0 * low * area) <= len(quads) <= round(6.0 * high * area)
            counts.append(len(quads))
            for quad in quads:
                x, y, z = quad.vertices.mean(axis=0)
                assert abs(y - middle) < 0.75 + 0.2 and 1.0 < x < 4.4 and abs(z) < MAX_RISE + 0.1
                assert quad.allows("left_foot")
            walls = [s for s in stones(scene, f"corridor_{k}") if "quad" not in s.name]
            assert {np.sign(s.normal[1]) for s in walls} == {-1.0, 1.0}
            assert all(s.allows("left_palm") and s.normal[1] * (s.centroid[1] - middle) < 0 for s in walls)
        rooms = [s for s in scene.terrain.surfaces if s.name.endswith("room")]
        assert len(rooms) == 2 and scene.start.xyz == (0.5, 0.0, 0.0)
        assert rooms[1].vertices[:, 0].min() < scene.goal.xyz[0] < rooms[1].vertices[:, 0].max()
    assert len(set(counts)) > 20
    mean = 6.0 * three_corridors.CORRIDOR * 1.5 * 1.5
    assert abs(np.mean(counts) - mean) < 4 * mean / np.sqrt(12 * len(counts))  # uniform shares of width 1


def test_sparse_corridors_are_the_same_for_the_same_draws():
    one, two, other = (three_corridors.sparse(np.random.default_rng(k), 4.0) for k in (5, 5, 6))
    assert one.terrain.surfaces == two.terrain.surfaces != other.terrain.surfaces
