"""Boxes of scene files that carry contacts."""

from __future__ import annotations

import numpy as np
import pytest

from scenes.files.box_sides import box_sides
from scenes.files.scene_file import scene_from_yaml
from scenes.files.scene_writer import scene_to_yaml
from scenes.footholds.projection import set_down
from scenes.input_error import InputError
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.terrain import Box

FEET = ["left_foot", "right_foot"]
TEXT = """
format: drakeplan-scene
version: 1
obstacles:
  - {name: ground, box: [40, 40, 1], pose: {xyz: [0, 0, -0.5]}, contact: [left_foot, right_foot]}
  - {name: wall, box: [2, 0.2, 2], pose: {xyz: [0, 1, 1]}, friction: 0.7, contact: [left_palm, right_palm]}
"""


def test_sides_are_the_faces_of_the_box_and_look_outwards() -> None:
    X_WO = np.eye(4)
    X_WO[:3, 3] = [1.0, 2.0, 3.0]
    box = Box("b", np.array([0.4, 0.6, 0.8]), X_WO)
    sides = {s.name: s for s in box_sides(box, [*FEET, "left_palm"], 0.5)}
    assert set(sides) == {f"b/{side}" for side in ("top", "front", "back", "left", "right")}
    for side in sides.values():
        away = side.centroid - X_WO[:3, 3]
        assert away @ side.normal == pytest.approx(np.linalg.norm(away))
        assert np.abs(side.vertices - X_WO[:3, 3]).max(axis=0) == pytest.approx(box.size / 2)
    assert sides["b/top"].allows("left_foot") and not sides["b/left"].allows("left_foot")
    assert sides["b/left"].allows("left_palm")


def test_a_box_as_ground_takes_soles_and_a_wall_takes_palms() -> None:
    scene = scene_from_yaml(TEXT, "text")
    foot = set_down(pack_terrain(scene.terrain), "left_foot", 3.0, 0.3, 0.0, (0.11, 0.05))
    assert foot is not None and foot.p_WC[2] == pytest.approx(0.0)
    wall = [s for s in scene.terrain.surfaces if s.name.startswith("wall/")]
    assert {s.friction for s in wall} == {0.7} and all(s.allows("left_palm") for s in wall)


def test_what_is_written_of_a_box_with_contacts_is_read_as_the_same_surfaces() -> None:
    scene = scene_from_yaml(TEXT, "text")
    again = scene_from_yaml(scene_to_yaml(scene), "again")
    assert [s.name for s in again.terrain.surfaces] == [s.name for s in scene.terrain.surfaces]
    assert len(again.terrain.obstacles) == 2


def test_an_unknown_end_effector_is_named() -> None:
    with pytest.raises(InputError, match=r"obstacles\[0\].contact"):
        scene_from_yaml(TEXT.replace("left_foot", "left_toe"), "text")


def test_a_georeferenced_start_may_leave_its_height_open() -> None:
    text = TEXT.replace("xyz: [0, 0, -0.5]", "xyz: [431250, 5411000, -0.5]").replace(
        "xyz: [0, 1, 1]", "xyz: [431250, 5411001, 1]"
    )
    scene = scene_from_yaml(text + "start: {xyz: [431250, 5411000]}\ngoal: {xyz: [431252, 5411000, null]}\n", "text")
    assert scene.origin_offset is not None and scene.start is not None and scene.goal is not None
    assert np.isnan(scene.start.xyz[2]) and np.isnan(scene.goal.xyz[2])
    assert scene.goal.xyz[0] - scene.start.xyz[0] == pytest.approx(2.0)
