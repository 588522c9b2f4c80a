"""Models of users: whatever Drake parses becomes a robot that loads alone, or one line says what to do."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
import platformdirs
import pytest
import trimesh
import yaml
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from scenes.effector import EFFECTORS
from scenes.input_error import InputError
from scenes.robots.addresses import read_packages
from scenes.robots.nominal_distances import NominalDistances, nominal_distances
from scenes.robots.nominal_stance import check_nominal_stance
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import load_robot

TOLERANCE = 1e-9


def link(name: str, mass: float, shape: str = "", z: float = 0.0) -> str:
    collision = f'<collision><origin xyz="0 0 {z}"/><geometry>{shape}</geometry></collision>' if shape else ""
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 {z}"/><mass value="{mass}"/>'
        f'<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>{collision}</link>'
    )


def joint(name: str, parent: str, child: str, xyz: str, kind: str = "revolute", axis: str = "0 1 0") -> str:
    limit = '<limit lower="-1.5" upper="1.5" effort="100" velocity="8"/>' if kind in ("revolute", "prismatic") else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
        f'<axis xyz="{axis}"/>{limit}</joint>'
    )


SHANK = '<box size="0.06 0.06 0.3"/>'


def walker(pelvis: str = '<box size="0.2 0.3 0.2"/>', sole: str = '<box size="0.2 0.1 0.02"/>', more: str = "") -> str:
    """A trunk on two legs of one joint each at hip, knee and ankle."""
    parts = [link("pelvis", 20.0, pelvis)]
    for side, y in (("left", 0.1), ("right", -0.1)):
        parts += [
            link(f"{side}_thigh", 3.0, SHANK, -0.2),
            link(f"{side}_shank", 2.0, SHANK, -0.2),
            link(f"{side}_sole_body", 1.0, sole, -0.04),
            joint(f"{side}_hip", "pelvis", f"{side}_thigh", f"0 {y} -0.15"),
            joint(f"{side}_knee", f"{side}_thigh", f"{side}_shank", "0 0 -0.4"),
            joint(f"{side}_ankle", f"{side}_shank", f"{side}_sole_body", "0 0 -0.4"),
        ]
    return f'<robot name="walker">{"".join(parts)}{more}</robot>'


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda name: str(tmp_path / "cache" / name))


@pytest.fixture
def described(tmp_path):
    """Writes a model and its robot file without palms; returns the robot file."""

    def write(model: str, name: str = "walker.urdf", **keys: object) -> Path:
        (tmp_path / name).write_text(textwrap.dedent(model))
        entry: dict[str, object] = {
            "format": "drakeplan-robot",
            "version": 1,
            "name": "walker",
            "model": name,
            "changes": {
                "frames": {
                    f"{side}_sole": {"body": f"{side}_sole_body", "xyz": [0.0, 0.0, -0.05]}
                    for side in ("left", "right")
                }
            },
            "base_body": "pelvis",
            "torso_body": "pelvis",
            "effectors": {
                f"{side}_foot": {
                    "frame": f"{side}_sole",
                    "half_extent": [0.1, 0.05],
                    "force_limit": 2.0,
                    "com_reach": 1.0,
                }
                for side in ("left", "right")
            },
            "nominal": {},
            "hip": [0.0, 0.1, 0.85],
            "leg_reach": [0.3, 0.85],
            "com_height": [0.4, 0.8, 1.0],
            "torso_box": {"centre": [0, 0, 1.0], "size": [0.2, 0.3, 0.3]},
            "max_foot_translation": 0.5,
            "max_step_height": 0.3,
            "foot_separation": [0.15, 0.2],
        }
        entry |= keys
        path = tmp_path / "walker.yaml"
        path.write_text(yaml.safe_dump({k: v for k, v in entry.items() if v is not None}))
        return path

    return write


def loaded_alone(model: Path) -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(model))
    plant.Finalize()
    return plant


def one_line(path: Path, message: str, packages=None) -> None:
    with pytest.raises(InputError, match=message) as caught:
        check_nominal_stance(load_robot(path, packages))
    assert "\n" not in str(caught.value)


def test_a_robot_without_palms_has_soles_where_its_file_says_and_no_palms(described):
    robot = load_robot(described(walker()))
    check_nominal_stance(robot)
    assert robot.palms == () and robot.half_extents[2:].tolist() == [[0, 0], [0, 0]]
    plant = loaded_alone(robot.model)
    assert all(plant.HasFrameNamed(name) for name in EFFECTORS)  # the file's four slots stay
    assert plant.num_actuators() == 6
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(robot.mass) == pytest.approx(32.0)
    q = nominal_posture(robot)
    assert q[6] == pytest.approx(1.0)  # 0.15 + 0.4 + 0.4 + 0.05


@pytest.mark.parametrize("suffix", ["stl", "dae", "obj"])
@pytest.mark.parametrize("address", ["part.{}", "package://toy/part.{}", "file://{{}}/part.{}"])
def test_meshes_of_any_format_and_address_collide(described, tmp_path, suffix, address):
    trimesh.creation.box((0.2, 0.3, 0.2)).export(tmp_path / f"part.{suffix}")
    mesh = f'<mesh filename="{address.format(suffix).format(tmp_path)}"/>'
    robot = load_robot(described(walker(pelvis=mesh)), {"toy": tmp_path})
    box = load_robot(described(walker()), {"toy": tmp_path})
    lifted = [sorted(nominal_distances(r).distance.items()) for r in (robot, box)]
    assert [k for k, _ in lifted[0]] == [k for k, _ in lifted[1]]
    np.testing.assert_allclose([d for _, d in lifted[0]], [d for _, d in lifted[1]], atol=1e-4)


def test_an_unknown_package_names_the_option(described):
    mesh = '<mesh filename="package://my_robot/meshes/part.stl"/>'
    one_line(described(walker(pelvis=mesh)), r"package 'my_robot' is not known: add --package my_robot=DIR")


def test_a_ros_package_that_the_model_lies_in_is_found(described, tmp_path):
    (tmp_path / "package.xml").write_text("<package><name>my_robot</name></package>")
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.2, 0.3, 0.2)).export(tmp_path / "meshes" / "part.stl")
    mesh = '<mesh filename="package://my_robot/meshes/part.stl"/>'
    assert load_robot(described(walker(pelvis=mesh))).mass == pytest.approx(32.0)


@pytest.mark.parametrize(
    "above",
    [
        '<link name="base_link"/>' + joint("float", "base_link", "pelvis", "0 0 1", "fixed"),
        '<link name="world"/>' + joint("float", "world", "pelvis", "0 0 1", "fixed"),
        joint("float", "world", "pelvis", "0 0 1", "fixed"),
        '<link name="world"/>' + joint("float", "world", "pelvis", "0 0 1", "floating"),
        '<link name="floor"/><link name="base_link"/>'
        + joint("a", "floor", "base_link", "0 0 1", "floating")
        + joint("b", "base_link", "pelvis", "0 0.1 0", "fixed"),
    ],
)
def test_empty_links_above_the_base_go(described, above):
    robot = load_robot(described(walker(more=above)))
    plant = loaded_alone(robot.model)
    (base,) = plant.GetFloatingBaseBodies()
    assert plant.get_body(base).name() == "pelvis"
    assert nominal_posture(robot)[6] == pytest.approx(1.0)


def test_a_link_with_mass_above_the_base_hangs_below_it_in_its_place(described):
    above = link("backpack", 4.0) + joint("strap", "backpack", "pelvis", "0.1 0.2 0.3", "fixed")
    robot = load_robot(described(walker(more=above)))
    plant = loaded_alone(robot.model)
    assert robot.mass == pytest.approx(36.0)
    context = plant.CreateDefaultContext()
    X_WP, X_WB = (plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(n)) for n in ("pelvis", "backpack"))
    np.testing.assert_allclose((X_WB.inverse() @ X_WP).translation(), [0.1, 0.2, 0.3], atol=TOLERANCE)


@pytest.mark.parametrize(
    ("more", "keys", "message"),
    [
        (
            link("cart", 9.0) + joint("crane", "cart", "pelvis", "0 0 1", "prismatic"),
            {},
            r"base_body: 'pelvis' hangs on link 'cart' by the prismatic joint 'crane'",
        ),
        (
            joint("float", "world", "pelvis", "0 0 1", "fixed") + '<link name="world"/>',
            {"base_body": "world"},
            r"'world' stands",
        ),
        ("", {"base_body": "hips"}, r"base_body: the model has no link 'hips'"),
        (
            '<link name="empty"/>' + joint("slide", "empty", "pelvis", "0 0 1"),
            {"base_body": "empty"},
            r"base_body: 'empty' has no mass",
        ),
        (link("loose", 1.0), {}, r"hang on nothing"),
        (link("ball", 1.0) + joint("socket", "pelvis", "ball", "0 0 1", "planar"), {}, r"'socket' is planar, expected"),
        ("", {"nominal": {"left_kne": 0.1}}, r"nominal: the model has no joint 'left_kne'"),
        ("", {"nominal": {"left_knee": 2.0}}, r"nominal\.left_knee: 2 is outside the joint's limits -1\.5 to 1\.5"),
        ("", {"torso_body": "chest"}, r"torso_body: the model has no link 'chest'"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(described, more, keys, message):
    one_line(described(walker(more=more), **keys), message)


def soles(**frame: list[float]) -> dict[str, object]:
    sides = ("left", "right")
    return {
        "changes": {"frames": {f"{s}_sole": {"body": f"{s}_sole_body", "xyz": [0, 0, -0.05], **frame} for s in sides}}
    }


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (soles(rpy=[np.pi, 0, 0]), r"effectors\.left_foot\.frame: its z axis points down"),
        (soles(rpy=[np.pi / 2, 0, 0]), r"effectors\.left_foot\.frame: its z axis points 90 deg off the vertical"),
        (soles(rpy=[0, 0, np.pi]), r"effectors\.left_foot\.frame: its x axis points backwards"),
        (soles(rpy=[0, 0, np.pi / 2]), r"effectors\.left_foot\.frame: its x axis points sideways"),
    ],
)
def test_a_sole_that_faces_the_wrong_way_is_named(described, keys, message):
    one_line(described(walker(), **keys), message)


def test_soles_that_overlap_are_named_with_the_overlap(described):
    feet = {
        f"{s}_foot": {"frame": f"{s}_sole", "half_extent": [0.1, 0.108], "force_limit": 2.0, "com_reach": 1.0}
        for s in ("left", "right")
    }
    one_line(described(walker(), effectors=feet), r"the soles overlap by 16 mm in the nominal posture")


def test_exchanged_feet_are_named(described):
    feet = {
        f"{s}_foot": {"frame": f"{o}_sole", "half_extent": [0.1, 0.05], "force_limit": 2.0, "com_reach": 1.0}
        for s, o in (("left", "right"), ("right", "left"))
    }
    one_line(described(walker(), effectors=feet), r"left_foot stands 20 cm to the right of right_foot")


def test_a_patch_larger_than_its_foot_is_named(described):
    feet = {
        f"{s}_foot": {"frame": f"{s}_sole", "half_extent": [0.15, 0.05], "force_limit": 2.0, "com_reach": 1.0}
        for s in ("left", "right")
    }
    one_line(
        described(walker(), effectors=feet), r"left_foot\.half_extent: a corner of the patch is 50 mm off the body"
    )


def test_a_xacro_file_and_other_files_are_refused_with_the_remedy(described):
    xacro = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="leg"/></robot>'
    one_line(described(xacro), r"expand it first")
    one_line(described("<sdf/>"), r"root element is <robot>, got <sdf>")
    one_line(described("<robot", "walker.urdf"), r"not XML")
    one_line(described(walker(), "walker.blend"), r"expected a file that ends in one of \.urdf")


def test_packages_are_words_of_one_form(tmp_path):
    assert read_packages((f"a={tmp_path}", f"b={tmp_path}")) == {"a": tmp_path.resolve(), "b": tmp_path.resolve()}
    for word in ("a", "=x", "a="):
        with pytest.raises(InputError, match="expected NAME=DIR"):
            read_packages((word,))
    with pytest.raises(InputError, match="there is no folder"):
        read_packages((f"a={tmp_path}/none",))


def test_a_model_is_no_robot_file(tmp_path):
    with pytest.raises(InputError, match=r"a model, expected a robot's name or its YAML file"):
        load_robot(tmp_path / "walker.urdf")


SDF_LINK = (
    '<link name="{0}"><pose>{1}</pose><inertial><pose>0 0 {3} 0 0 0</pose><mass>{2}</mass><inertia><ixx>0.1</ixx><iyy>0.1</iyy>'
    '<izz>0.1</izz></inertia></inertial><collision name="c"><pose>0 0 {3} 0 0 0</pose><geometry>{4}</geometry></collision></link>'
)


def sdf_walker(pelvis: str) -> str:
    """The same walker; each joint's frame is 2 cm above its child's, as SDF allows."""
    shank, sole = (f"<box><size>{s}</size></box>" for s in ("0.06 0.06 0.3", "0.2 0.1 0.02"))
    parts = [SDF_LINK.format("pelvis", "0 0 1 0 0 0", 20.0, 0.0, pelvis)]
    for side, y in (("left", 0.1), ("right", -0.1)):
        places = (
            ("thigh", 0.85, 3.0, -0.2, shank),
            ("shank", 0.45, 2.0, -0.2, shank),
            ("sole_body", 0.05, 1.0, -0.04, sole),
        )
        parent = "pelvis"
        for (name, z, mass, below, shape), turn in zip(places, ("hip", "knee", "ankle"), strict=True):
            parts.append(SDF_LINK.format(f"{side}_{name}", f"0 {y} {z} 0 0 0", mass, below, shape))
            parts.append(
                f'<joint name="{side}_{turn}" type="revolute"><pose>0 0 0.02 0 0 0</pose><parent>{parent}</parent>'
                f"<child>{side}_{name}</child><axis><xyz>0 1 0</xyz><limit><lower>-1.5</lower><upper>1.5</upper>"
                "<effort>100</effort><velocity>8</velocity></limit></axis></joint>"
            )
            parent = f"{side}_{name}"
    return f'<?xml version="1.0"?><sdf version="1.9"><model name="walker">{"".join(parts)}</model></sdf>'


def test_an_sdf_model_is_the_robot_that_it_describes(described, tmp_path):
    trimesh.creation.box((0.2, 0.3, 0.2)).export(tmp_path / "part.stl")
    robot = load_robot(described(sdf_walker("<mesh><uri>part.stl</uri></mesh>"), "walker.sdf"))
    plant = loaded_alone(robot.model)
    check_nominal_stance(robot)
    assert robot.mass == pytest.approx(32.0) and plant.num_actuators() == 6
    context = plant.CreateDefaultContext()
    p_PS = plant.CalcRelativeTransform(
        context, plant.GetFrameByName("pelvis"), plant.GetFrameByName("left_foot")
    ).translation()
    np.testing.assert_allclose(p_PS, [0, 0.1, -1.0], atol=1e-9)
    plant.GetJointByName("left_hip").set_angle(context, 0.5)  # turns about a point 2 cm above the thigh's origin
    X_PT = plant.CalcRelativeTransform(context, plant.GetFrameByName("pelvis"), plant.GetFrameByName("left_thigh"))
    np.testing.assert_allclose(X_PT.translation(), [-0.02 * np.sin(0.5), 0.1, -0.13 - 0.02 * np.cos(0.5)], atol=1e-9)


def mjcf_walker() -> str:
    legs = ""
    for side, y in (("left", 0.1), ("right", -0.1)):
        legs += f"""
        <body name="{side}_thigh" pos="0 {y} -0.15"><joint name="{side}_hip" axis="0 1 0" range="-1.5 1.5"/>
          <geom type="box" size="0.03 0.03 0.15" pos="0 0 -0.2" mass="3"/>
          <body name="{side}_shank" pos="0 0 -0.4"><joint name="{side}_knee" axis="0 1 0" range="-1.5 1.5"/>
            <geom type="box" size="0.03 0.03 0.15" pos="0 0 -0.2" mass="2"/>
            <body name="{side}_sole_body" pos="0 0 -0.4"><joint name="{side}_ankle" axis="0 1 0" range="-1.5 1.5"/>
              <geom type="box" size="0.1 0.05 0.01" pos="0 0 -0.04" mass="1"/></body></body></body>"""
    return f"""<mujoco model="walker"><compiler angle="radian" meshdir="."/><asset><mesh file="part.stl"/></asset><worldbody>
      <body name="pelvis" pos="0 0 1"><freejoint/><geom type="mesh" mesh="part" mass="20"/>{legs}</body></worldbody>
      <actuator><motor joint="left_hip" ctrlrange="-50 50"/></actuator></mujoco>"""


def test_a_mujoco_model_is_the_robot_that_it_describes(described, tmp_path):
    trimesh.creation.box((0.2, 0.3, 0.2)).export(tmp_path / "part.stl")
    robot = load_robot(described(mjcf_walker(), "walker.xml"))
    check_nominal_stance(robot)
    plant = loaded_alone(robot.model)
    assert robot.mass == pytest.approx(32.0, rel=1e-6) and plant.num_actuators() == 6
    assert nominal_posture(robot)[6] == pytest.approx(1.0)
    limits = {
        plant.get_joint_actuator(a).name(): plant.get_joint_actuator(a).effort_limit()
        for a in plant.GetJointActuatorIndices()
    }
    assert limits["left_hip"] == pytest.approx(50.0)


def test_a_joint_that_no_humanoid_has_is_named_in_an_sdf(described):
    text = sdf_walker("<sphere><radius>0.1</radius></sphere>").replace(
        'name="left_hip" type="revolute"', 'name="left_hip" type="ball"'
    )
    one_line(described(text, "walker.sdf"), r"joint 'left_hip' is ball")


@pytest.mark.parametrize(
    ("nominal", "asked", "limit"),
    [(0.05, 0.02, 0.02), (0.01, 0.02, 0.009), (0.0, 0.02, -0.001), (-0.004, 0.02, -0.005)],
)
def test_no_pair_is_asked_for_more_than_it_has(nominal, asked, limit):
    distances = NominalDistances({("elbow", "wrist"): nominal})
    pairs = [("wrist", "elbow"), ("elbow", "wrist"), ("elbow", "knee")]
    np.testing.assert_allclose(distances.at_most(pairs, np.full(3, asked)), [limit, limit, asked], atol=1e-12)
    assert distances.limit(("elbow", "wrist")) < nominal + 1e-12  # the nominal posture keeps what is asked


def test_nominal_distances_are_those_of_the_shapes(described):
    distances = nominal_distances(load_robot(described(walker(sole='<box size="0.2 0.15 0.02"/>'))))
    assert distances.distance["left_sole_body", "right_sole_body"] == pytest.approx(0.05, abs=1e-6)
    assert build_plant(load_robot(described(walker()))).robot.palms == ()
