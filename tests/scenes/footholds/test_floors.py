"""Which floors there are over a point, and which one a start or goal means."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from scenes.contact import Contact, contact_pose
from scenes.files.scene_file import read_scene, scene_to_yaml
from scenes.files.scene_source import load_scene
from scenes.footholds.floors import Z_WINDOW, by_preference, floors_at, has_head_room
from scenes.footholds.goal_footholds import nobody_fits
from scenes.footholds.projection import LEG_CLEARANCE, set_down
from scenes.footholds.start_stance import check_goal, floor_notes, start_stance
from scenes.input_error import InputError
from scenes.pose import pose_matrix
from scenes.robots.robot import load_robot
from scenes.scene import Goal, Scene, Start
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

ROBOT = load_robot("escher")
KNEE, TOP = 0.75, 1.65  # [m] of escher's torso box
OPEN = np.nan


def slab(name: str, z: float, x: tuple[float, float] = (-2, 3), y: tuple[float, float] = (-2, 2)) -> Surface:
    return Surface(name, np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]], float))


def box(name: str, size: tuple[float, float, float], xyz: tuple[float, float, float]) -> Box:
    return Box(name, np.array(size), pose_matrix(xyz, (0.0, 0.0, 0.0)))


Place = tuple[float, float, float]


def ends(terrain: Terrain, start: Place, goal: Place, radius: float = 0.2) -> tuple[float, float, list[str]]:
    """Height of the start and of the goal, and the notes."""
    scene, packed = Scene("s", terrain, Start(start), Goal(goal, radius)), pack_terrain(terrain)
    stance = start_stance(scene, packed, ROBOT)
    z = float(stance.feet_mean()[2])
    taken = check_goal(scene, packed, ROBOT, z)
    return z, taken.xyz[2], floor_notes(scene, packed, ROBOT, stance, taken)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0.1, 3.0), min_size=0, max_size=5))
@example([0.5, 0.125, 0.15])  # nobody stands on the two in the middle
def test_floors_are_the_levels_that_no_torso_s_height_joins_to_a_higher_one(gaps: list[float]) -> None:
    heights = np.concatenate([[0.0], np.cumsum(gaps)])
    over = np.array([*gaps, np.inf])  # [m] free over each surface
    takes_a_sole = over > LEG_CLEARANCE
    levels, over = heights[takes_a_sole], over[takes_a_sole]
    apart = np.diff(levels, append=np.inf)
    assume(all(np.abs(np.concatenate([over, apart]) - limit).min() > 1e-3 for limit in (LEG_CLEARANCE, KNEE, TOP)))
    packed = pack_terrain(Terrain(tuple(slab(f"s{k}", z) for k, z in enumerate(heights))))
    floors = floors_at(packed, ROBOT, 0.0, 0.0, 0.0)
    expected = [(z, room > TOP) for z, room, gap in zip(levels, over, apart, strict=True) if gap >= KNEE]
    assert [f.z for f in floors] == pytest.approx([z for z, _ in expected])
    assert [f.head_room for f in floors] == [room for _, room in expected]
    assert all(a.high == b.low for a, b in itertools.pairwise(floors))
    assert all(f.low < f.z < f.high for f in floors)


def test_under_a_beam_of_a_box_there_is_head_room_only_if_it_is_high_enough() -> None:
    for bottom, room in ((1.6, False), (1.7, True)):
        packed = pack_terrain(Terrain((slab("floor", 0.0),), (box("beam", (1, 1, 0.2), (0, 0, bottom + 0.1)),)))
        assert has_head_room(packed, ROBOT, 0.0, 0.0, 0.0) == room


STOREYS = Terrain((slab("ground", 0.0), slab("first", 2.4), slab("second", 4.8)))


def test_without_heights_the_lowest_floor_with_head_room_and_a_note() -> None:
    start, goal, notes = ends(STOREYS, (0, 0, OPEN), (1, 0, OPEN))
    assert (start, goal) == (0.0, 0.0)
    assert len(notes) == 2
    for key, note in zip(("start", "goal"), notes, strict=True):
        assert note.startswith(f"{key}: there are floors at z 0.00, 2.40 and 4.80 m: took 0.00")
        assert f"--{key}-z" in note


def test_a_goal_without_a_height_is_on_the_floor_of_the_start() -> None:
    start, goal, notes = ends(STOREYS, (0, 0, 2.5), (1, 0, OPEN))
    assert (start, goal) == (2.4, 2.4)
    assert len(notes) == 1 and notes[0].startswith("goal")


@pytest.mark.parametrize(("z", "taken"), [(0.0, 0.0), (0.49, 0.0), (2.0, 2.4), (2.8, 2.4), (5.2, 4.8)])
def test_a_height_picks_the_nearest_floor_and_there_is_nothing_to_note(z: float, taken: float) -> None:
    assert ends(STOREYS, (0, 0, z), (1, 0, z)) == (taken, taken, [])


@pytest.mark.parametrize("key", ["start", "goal"])
@pytest.mark.parametrize("z", [-0.6, 1.2, 5.5])
def test_a_height_that_no_floor_is_near_is_bad_input_that_shows_the_floors(key: str, z: float) -> None:
    start, goal = ((0, 0, z), (1, 0, 0)) if key == "start" else ((0, 0, 0), (1, 0, z))
    with pytest.raises(InputError, match=rf"{key}: no floor within {Z_WINDOW} m of z {z:g}; .* 0.00, 2.40 and 4.80 m"):
        ends(STOREYS, start, goal)


def test_a_roof_that_is_too_low_makes_its_top_the_only_floor() -> None:
    attic = Terrain((slab("ground", 0.0), slab("roof", 1.4)))
    assert ends(attic, (0, 0, OPEN), (1, 0, OPEN)) == (1.4, 1.4, [])


def test_slabs_one_over_the_other_are_stood_on_at_the_top() -> None:
    stack = Terrain(tuple(slab(f"s{k}", 0.3 * k) for k in range(3)))
    assert ends(stack, (0, 0, OPEN), (1, 0, OPEN)) == (0.6, 0.6, [])
    assert ends(stack, (0, 0, 0.3), (1, 0, 0.7)) == (0.6, 0.6, [])


def test_a_balcony_that_does_not_reach_over_the_start_is_no_choice_and_a_mezzanine_over_the_goal_is_one() -> None:
    balcony = Terrain((slab("ground", 0.0), slab("balcony", 2.4, y=(0.4, 2.0))))
    assert ends(balcony, (0, 0, OPEN), (1, 0, OPEN)) == (0.0, 0.0, [])
    mezzanine = Terrain((slab("ground", 0.0), slab("mezzanine", 2.4, x=(0.5, 3.0))))
    start, goal, notes = ends(mezzanine, (0, 0, OPEN), (1.5, 0, OPEN))
    assert (start, goal) == (0.0, 0.0)
    assert len(notes) == 1 and notes[0].startswith("goal")
    assert ends(mezzanine, (0, 0, OPEN), (1.5, 0, 2.4))[:2] == (0.0, 2.4)


def test_a_bench_over_the_goal_is_where_the_goal_is() -> None:
    bench = Terrain((slab("ground", 0.0), slab("bench", 0.5, x=(0.7, 1.3))))
    assert ends(bench, (0, 0, OPEN), (1, 0, OPEN))[1] == 0.5


def test_a_tunnel_through_a_hill_has_two_floors() -> None:
    hill = box("hill", (2.0, 4.0, 1.0), (1.0, 0.0, 2.5))  # from 2 to 3 m over the ground
    tunnel = Terrain((slab("ground", 0.0), slab("hill top", 3.0, x=(0, 2))), (hill,))
    assert ends(tunnel, (1, 0, OPEN), (1, 0, 3.0))[:2] == (0.0, 3.0)


def test_preference_puts_head_room_before_nearness() -> None:
    low = Terrain((slab("a", 0.0), slab("b", 0.9), slab("c", 3.0)))
    floors = floors_at(pack_terrain(low), ROBOT, 0.0, 0.0, 0.0)
    assert [f.z for f in by_preference(floors, OPEN, 0.0)] == [0.9, 3.0, 0.0]
    assert [f.z for f in by_preference(floors, 0.45, OPEN)] == [0.9, 0.0]
    assert by_preference(floors, 2.0, OPEN) == []


def test_a_room_from_a_mesh_file_is_entered_and_not_climbed(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    parts = [((6.0, 4.0, 0.2), (1.5, 0.0, -0.1)), ((6.0, 4.0, 0.2), (1.5, 0.0, 2.6))]
    room = trimesh.util.concatenate(
        [trimesh.creation.box(size, trimesh.transformations.translation_matrix(xyz)) for size, xyz in parts]
    )
    room.export(tmp_path / "room.stl")
    terrain = load_scene(str(tmp_path / "room.stl")).terrain
    start, goal, notes = ends(terrain, (0, 0, OPEN), (3, 0, OPEN))
    assert (start, goal) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert len(notes) == 2 and all("0.00 and 2.70" in note for note in notes)
    assert ends(terrain, (0, 0, OPEN), (3, 0, 2.7))[1] == pytest.approx(2.7, abs=1e-6)


# What is in the way ----------------------------------------------------------------------------------------------


def test_a_crate_on_the_goal_is_named() -> None:
    terrain = Terrain((slab("floor", 0.0),), (box("crate", (0.9, 0.9, 0.6), (2, 0, 0.3)),))
    with pytest.raises(InputError, match="goal: no foothold within the radius: box 'crate' stands there"):
        ends(terrain, (0, 0, 0), (2, 0, 0))


@pytest.mark.parametrize("z", [0.0, OPEN])
def test_a_start_in_a_block_is_bad_input_that_names_it(z: float) -> None:
    standing = Terrain((slab("floor", 0.0),), (box("block", (1, 1, 2), (0, 0, 1)),))
    with pytest.raises(InputError, match=r"start: .*: box 'block' stands there"):
        ends(standing, (0, 0, z), (2, 0, 0))
    hanging = Terrain((slab("floor", 0.0),), (box("block", (1, 1, 1.2), (0, 0, 1)),))
    with pytest.raises(InputError, match="start: the robot would stand inside box 'block'"):
        ends(hanging, (0, 0, z), (2, 0, 0))


@pytest.mark.parametrize(
    ("size", "fits"), [((0.9, 0.9, 0.1), False), ((0.7, 0.6, 0.1), False), ((0.2, 0.2, 0.1), True)]
)
def test_a_low_box_leaves_room_for_two_soles_or_is_named(size: tuple[float, float, float], fits: bool) -> None:
    terrain = Terrain((slab("floor", 0.0),), (box("sill", size, (2, 0, 0.05)),))
    why = nobody_fits(terrain, pack_terrain(terrain), ROBOT, Goal((2, 0, 0)), 0.5)
    assert why == ("" if fits else "no foothold within the radius: box 'sill' stands there")


def test_a_proof_that_nobody_fits_agrees_with_where_soles_do_fit() -> None:
    """On small stones: wherever two soles are found at random with their mean at the goal, there is no proof against."""
    rng = np.random.default_rng(4)
    found = 0
    for _ in range(12):
        stones = []
        for k in range(4):
            x, y = rng.uniform(-0.25, 0.25, 2)
            a, b = rng.uniform(0.08, 0.22), rng.uniform(0.05, 0.14)
            stones.append(slab(f"stone {k}", 0.1 * k, (x - a, x + a), (y - b, y + b)))
        packed = pack_terrain(Terrain(tuple(stones)))
        goal = Goal((0.0, 0.0, 0.0), 0.1)
        why = nobody_fits(Terrain(tuple(stones)), packed, ROBOT, goal, 0.3)
        feet = []
        for side in ("left_foot", "right_foot"):
            draws = np.column_stack([rng.uniform(-0.3, 0.3, (1000, 2)), rng.uniform(0, np.pi, 1000)])
            feet.append(np.array([d[:2] for d in draws if _fits(packed, side, *d)]).reshape(-1, 2))
        pairs = (feet[0][:, None] + feet[1][None]) / 2
        apart = np.linalg.norm(feet[0][:, None] - feet[1][None], axis=2)
        stands = bool(((np.linalg.norm(pairs, axis=2) <= goal.radius) & (apart <= 0.3)).any())
        assert not (stands and why)
        found += stands
    assert 0 < found < 12


def _fits(packed: PackedTerrain, side: str, x: float, y: float, yaw: float) -> bool:
    return set_down(packed, side, x, y, yaw, ROBOT.effectors[0].half_extent) is not None


# A stance that is given -------------------------------------------------------------------------------------------


def given_stance(left: tuple[float, float], right: tuple[float, float]) -> Start:
    up = np.array([0.0, 0.0, 1.0])
    places = {"left_foot": left, "right_foot": right}
    contacts = [Contact(e, 0, contact_pose(e, np.array([*p, 0.0]), up, 0.0), 0.5) for e, p in places.items()]
    return Start((0.0, 0.0, 0.0), 0.0, tuple(contacts))


@pytest.mark.parametrize(("x", "off"), [(-2.0, 0.11), (-1.95, 0.06), (-1.892, 0.002), (-1.889, 0.0), (0.0, 0.0)])
def test_a_given_sole_off_its_surface_is_refused_with_the_distance(x: float, off: float) -> None:
    scene = Scene("s", Terrain((slab("floor", 0.0),)), given_stance((x, 0.1), (x, -0.1)), Goal((1, 0, 0)))
    if off:
        with pytest.raises(InputError, match=f"left_foot: .* reaches {off:.3f} m beyond it"):
            start_stance(scene, pack_terrain(scene.terrain), ROBOT)
    else:
        assert start_stance(scene, pack_terrain(scene.terrain), ROBOT).contacts[0] is not None


def test_a_given_sole_over_a_seam_of_one_floor_is_not_off_it() -> None:
    for z, refused in ((0.0, False), (0.05, True)):
        halves = Terrain((slab("near", 0.0, x=(-2, 0.03)), slab("far", z, x=(0.03, 3))))
        scene = Scene("s", halves, given_stance((0.0, 0.1), (0.0, -0.1)), Goal((1, 0, 0)))
        if refused:
            with pytest.raises(InputError, match=r"reaches 0\.080 m beyond it"):
                start_stance(scene, pack_terrain(halves), ROBOT)
        else:
            start_stance(scene, pack_terrain(halves), ROBOT)


# Files -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("xyz", ["[0.5, 0]", "[0.5, 0, null]"])
def test_a_scene_file_may_leave_the_height_open(xyz: str, tmp_path: Path) -> None:
    corners = "[[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]"
    text = f"format: drakeplan-scene\nversion: 1\nsurfaces:\n  - {{vertices: {corners}}}\n"
    file = tmp_path / "open.yaml"
    file.write_text(text + f"start: {{xyz: {xyz}}}\ngoal: {{xyz: {xyz}}}\n")
    scene = read_scene(file)
    assert scene.start is not None and scene.goal is not None
    for place in (scene.start.xyz, scene.goal.xyz):
        assert place[:2] == (0.5, 0.0) and np.isnan(place[2])
    file.write_text(scene_to_yaml(scene))
    again = read_scene(file)
    assert again.goal is not None and np.isnan(again.goal.xyz[2])
