"""What a robot file changes of its model: shapes that are drawn collide, a frame becomes the base, links make way for names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
import pytest
import yaml
from pydrake.multibody.plant import MultibodyPlant

from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.robots.nominal_stance import check_nominal_stance
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import ROBOTS, load_robot, own_robot_names, own_robots_folder, robot_names, robot_path
from scenes.robots.touching_pairs import touching_pairs

ESCHER = ROBOTS / "escher" / "escher.urdf"
SAME = 1e-6  # [m] origins of an adapted model have nine digits


@pytest.fixture(autouse=True)
def folders(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda name: str(tmp_path / "cache" / name))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


@pytest.fixture
def changed(tmp_path):
    """Escher's robot file with `changes` and other keys, on its model with replaced words."""

    def write(changes: dict[str, Any], *words: tuple[str, str], **keys: Any) -> Path:
        text = ESCHER.read_text()
        for old, new in words:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "model.urdf").write_text(text)
        data = yaml.safe_load((ROBOTS / "escher" / "escher.yaml").read_text())
        for effector, entry in keys.pop("effectors", {}).items():
            data["effectors"][effector] |= entry
        path = tmp_path / "mine.yaml"
        path.write_text(yaml.safe_dump(data | {"name": "mine", "model": "model.urdf", "changes": changes} | keys))
        return path

    return write


def shapes(plant: MultibodyPlant, body: str) -> int:
    return len(plant.GetCollisionGeometriesForBody(plant.GetBodyByName(body)))


# ---- collide_as_drawn


def test_a_body_collides_as_it_is_drawn(changed) -> None:
    drawn = ESCHER.read_text().count('visual name="head_visual')
    before = shapes(build_plant(load_robot("escher")).plant, "head")
    robot = load_robot(changed({"collide_as_drawn": ["head", "left_hip_yaw_link"]}))
    plant = build_plant(robot).plant
    assert drawn > 0 and shapes(plant, "head") == before + drawn
    assert shapes(plant, "left_hip_yaw_link") == 1  # it has none of its own
    assert shapes(plant, "right_hip_yaw_link") == 0
    check_nominal_stance(robot)


def test_a_body_that_is_not_there_cannot_collide_as_drawn(changed) -> None:
    with pytest.raises(InputError, match=r"changes\.collide_as_drawn: the model has no link 'haed'"):
        load_robot(changed({"collide_as_drawn": ["haed"]}))


# ---- a frame becomes the base


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.0, 0.0, np.pi), (np.pi / 2, 0.0, 0.0), (0.3, -0.2, 0.1)])
def test_a_frame_becomes_the_base_and_the_robot_stands_as_it_lies_in_it(changed, rpy) -> None:
    front = {"body": "pelvis", "xyz": [0.1, -0.2, 0.3], "rpy": list(rpy)}
    robot, escher = load_robot(changed({"frames": {"front": front}}, base_body="front")), load_robot("escher")
    assert robot.base_body == "front" and robot.mass == pytest.approx(escher.mass)
    plant, other = build_plant(robot).plant, build_plant(escher).plant
    (base,) = plant.GetFloatingBaseBodies()
    assert plant.get_body(base).name() == "front"
    assert plant.num_positions() == other.num_positions()
    contexts = [p.CreateDefaultContext() for p in (plant, other)]
    for p, context, r in zip((plant, other), contexts, (robot, escher), strict=True):
        p.SetPositions(context, nominal_posture(r))
    np.testing.assert_allclose(
        nominal_posture(robot)[:4], [1, 0, 0, 0], atol=1e-12
    )  # the frame, not the pelvis, is upright
    for link in ("torso", "left_foot", "right_palm", "head"):
        X = [
            p.CalcRelativeTransform(c, p.GetFrameByName("pelvis"), p.GetFrameByName(link)).GetAsMatrix4()
            for p, c in zip((plant, other), contexts, strict=True)
        ]
        np.testing.assert_allclose(X[0], X[1], atol=SAME, err_msg=link)


# ---- names


def test_a_link_called_as_an_end_effector_makes_way_for_its_contact_frame(changed) -> None:
    sole = {"body": "left_foot", "xyz": [0.01, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]}
    path = changed(
        {
            "frames": {"left_sole": sole},
            "ignored_pairs": [["left_foot", "right_foot"]],
            "collide_as_drawn": ["left_foot"],
        },
        effectors={"left_foot": {"frame": "left_sole", "half_extent": [0.1, 0.05]}},
    )
    robot, escher = load_robot(path), load_robot("escher")
    plant = build_plant(robot).plant
    names = {
        plant.get_body(i).name() for i in plant.GetBodyIndices(build_plant(robot).effector_bodies[0].model_instance())
    }
    assert set(EFFECTORS) <= names and "left_foot_link" in names and "left_sole" not in names
    assert robot.mass == pytest.approx(escher.mass)
    assert shapes(plant, "left_foot") == 0 and shapes(plant, "left_foot_link") > shapes(plant, "right_foot")
    X = plant.CalcRelativeTransform(
        plant.CreateDefaultContext(), plant.GetFrameByName("left_foot_link"), plant.GetFrameByName("left_foot")
    )
    np.testing.assert_allclose(X.translation(), sole["xyz"], atol=SAME)
    check_nominal_stance(robot)


def test_a_second_link_of_the_new_name_keeps_its_own(changed) -> None:
    sole = {"body": "left_foot", "xyz": [0.0, 0.0, 0.0]}
    path = changed(
        {"frames": {"sole": sole}}, ('"head"', '"left_foot_link"'), effectors={"left_foot": {"frame": "sole"}}
    )  # fmt: skip
    plant = build_plant(load_robot(path)).plant
    assert plant.HasBodyNamed("left_foot_link") and plant.HasBodyNamed("left_foot_link_")
    assert shapes(plant, "left_foot") == 0


def test_a_frame_cannot_have_the_name_of_a_link(changed) -> None:
    with pytest.raises(InputError, match=r"changes\.frames\.head: the model has a link of that name"):
        load_robot(changed({"frames": {"head": {"body": "pelvis", "xyz": [0, 0, 0]}}}))


# ---- materials


@pytest.mark.parametrize(
    "material",
    ['<material name="shell"><color rgba="1 0 0 1"/></material>', '<material name="nowhere"/>'],
    ids=["a second colour of a name", "no colour of a name"],
)
def test_materials_that_ros_takes_do_not_stop_a_robot(changed, material) -> None:
    path = changed({}, ('<geometry><sphere radius="0.062"/></geometry><material name="shell"/>',
                        f'<geometry><sphere radius="0.062"/></geometry>{material}'))  # fmt: skip
    assert build_plant(load_robot(path)).plant.num_positions() == nominal_posture(load_robot("escher")).size


# ---- what touches


def test_bodies_nearer_than_asked_are_named_at_the_posture_that_is_asked(tmp_path) -> None:
    def link(name: str) -> str:
        inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
        return f'<link name="{name}">{inertial}<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>'

    def slide(child: str, at: float) -> str:
        return (
            f'<joint name="to_{child}" type="prismatic"><parent link="empty"/><child link="{child}"/><origin xyz="{at} 0 0"/>'
            '<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )

    gap = 0.004  # [m] between the boxes a and b; c is 6 mm from b
    bare = '<link name="empty"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    text = "".join(map(link, "abc")) + slide("a", 0.0) + slide("b", 0.1 + gap) + slide("c", 0.2 + gap + 0.006)
    (tmp_path / "boxes.urdf").write_text(f'<robot name="boxes">{bare}{text}</robot>')
    touching = [
        touching_pairs(tmp_path / "boxes.urdf", nominal, distance)
        for nominal, distance in (
            ({}, 0.005),
            ({}, 0.003),
            ({}, 0.007),
            ({"to_b": 0.003}, 0.005),
            ({"to_b": 0.5}, 0.007),
        )
    ]
    assert touching == [{("a", "b")}, set(), {("a", "b"), ("b", "c")}, {("b", "c")}, set()]


# ---- a user's own robots


def test_own_robots_lie_below_the_data_folder_and_hide_none_that_ships(tmp_path, changed) -> None:
    assert own_robots_folder() == tmp_path / "data" / "drakeplan" / "robots"
    assert own_robot_names() == set()
    for name in ("mine", "escher"):
        (own_robots_folder() / name).mkdir(parents=True)
        text = changed({}).read_text().replace("model.urdf", str(tmp_path / "model.urdf"))
        (own_robots_folder() / name / f"{name}.yaml").write_text(text)
    (own_robots_folder() / "other").mkdir()
    (own_robots_folder() / "other" / "mine.yaml").write_text("of another name than its folder")
    assert own_robot_names() == {"mine", "escher"}
    assert robot_names().count("escher") == 1 and robot_names()[-1] == "mine"
    assert load_robot("mine").given_by_path and robot_path("mine") == own_robots_folder() / "mine" / "mine.yaml"
    assert not load_robot("escher").given_by_path and load_robot("escher").name == "escher"
    before = load_robot("mine").hip[2]
    file = robot_path("mine")
    file.write_text(file.read_text().replace("hip:\n- -0.008\n- 0.1\n- 0.869", "hip:\n- -0.008\n- 0.1\n- 0.8"))
    assert before == 0.869 and load_robot("mine").hip[2] == 0.8  # what a user changes counts at once
