"""Robots of packages: what comes out loads in Drake alone, and what is wrong with a package is said."""

import importlib.metadata
import multiprocessing
import shutil
from pathlib import Path

import numpy as np
import platformdirs
import pytest
import trimesh
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from scenes.input_error import InputError
from scenes.robots.adapter import adapted_model
from scenes.robots.meshes import HULL_ERROR, HULL_VERTICES, hull_obj
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import load_robot
from scenes.robots.schema import PackageEntry
from scenes.robots.touching_pairs import touching_pairs

URDF = """<?xml version="1.0"?>
<robot name="toy">
  <gazebo reference="trunk"/>
  <link name="trunk"><inertial><mass value="5"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://toy/meshes/block.stl"/></geometry></visual>
    <collision><geometry><mesh filename="package://toy/meshes/block.stl" scale="2 1 1"/></geometry></collision></link>
  <link name="arm"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.05"/><geometry><mesh filename="../meshes/block.stl"/></geometry></collision></link>
  <link name="finger"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><mesh filename="package://toy/meshes/block.stl"/></geometry></collision></link>
  <link name="far"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <joint name="shoulder" type="revolute"><parent link="trunk"/><child link="arm"/><origin xyz="0 0 0.5"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="7" velocity="3"/></joint>
  <joint name="knuckle" type="revolute"><parent link="arm"/><child link="finger"/><origin xyz="0 0 0.3" rpy="0 0 0.5"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="7" velocity="3"/><mimic joint="shoulder"/></joint>
  <joint name="hip" type="revolute"><parent link="finger"/><child link="far"/><origin xyz="0 0 0.2"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="7" velocity="3"/></joint>
</robot>
"""
FRAMES = {"left_foot": {"body": "arm", "xyz": [0.0, 0.0, 0.4], "rpy": [0.0, np.pi / 2, 0.0]}}


@pytest.fixture
def cache(tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda name: str(folder / name))
    return folder / "drakeplan" / "robots"


@pytest.fixture
def toy(tmp_path, monkeypatch, cache):
    """A package that is "installed" in tmp_path; returns adapt(urdf=..., **package keys) -> model path."""
    site = tmp_path / "site"
    (site / "toy" / "meshes").mkdir(parents=True)
    (site / "toy" / "urdf").mkdir()
    trimesh.creation.box((0.2, 0.2, 0.2)).export(site / "toy" / "meshes" / "block.stl")

    class Distribution:
        def locate_file(self, path):
            return site / path

    monkeypatch.setattr(importlib.metadata, "distribution", lambda name: Distribution())

    def adapt(urdf=URDF, nominal=None, **package):
        (site / "toy" / "urdf" / "toy.urdf").write_text(urdf)
        entry = {"distribution": "toy", "folders": {"toy": "toy"}, "urdf": "package://toy/urdf/toy.urdf"} | package
        return adapted_model("toy", PackageEntry(**entry), "trunk", nominal or {}, source="toy.yaml")

    adapt.site = site
    return adapt


def drake(model):
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    Parser(plant).AddModels(str(model))
    plant.Finalize()
    return plant, scene_graph, builder.Build()


def test_drake_loads_the_model_from_anywhere(toy, monkeypatch, tmp_path):
    model = toy(frames=FRAMES)
    monkeypatch.chdir(tmp_path)
    plant, _, _ = drake(model)
    assert model.is_absolute()
    assert (plant.num_positions(), plant.num_actuators()) == (7 + 2, 2)  # the joint that mimics is welded
    assert plant.GetJointActuatorByName("shoulder").effort_limit() == 7.0
    assert plant.GetJointByName("shoulder").velocity_upper_limits()[0] == 3.0


def test_a_moved_cache_still_loads(toy, tmp_path):
    model = toy(frames=FRAMES)
    shutil.move(model.parent, tmp_path / "elsewhere")
    plant, scene_graph, _ = drake(tmp_path / "elsewhere" / "model.urdf")
    assert plant.num_positions() == 7 + 2
    assert scene_graph.model_inspector().num_geometries() > 0  # the meshes beside the model were found


def test_frames_sit_where_the_robot_file_puts_them(toy):
    plant, _, _ = drake(toy(frames=FRAMES))
    context = plant.CreateDefaultContext()
    X_AF = plant.GetBodyByName("left_foot").body_frame().CalcPose(context, plant.GetFrameByName("arm"))
    np.testing.assert_allclose(X_AF.translation(), [0, 0, 0.4], atol=1e-9)
    np.testing.assert_allclose(X_AF.rotation().matrix() @ [0, 0, 1], [1, 0, 0], atol=1e-8)


def test_a_fixed_joint_stands_at_its_angle(toy):
    plant, _, _ = drake(toy(fixed={"shoulder": 0.7}))
    assert plant.num_positions() == 7 + 1
    X = plant.GetBodyByName("arm").body_frame().CalcPose(plant.CreateDefaultContext(), plant.GetFrameByName("trunk"))
    np.testing.assert_allclose(X.translation(), [0, 0, 0.5], atol=1e-9)
    np.testing.assert_allclose(X.rotation().matrix() @ [0, 0, 1], [np.sin(0.7), 0, np.cos(0.7)], atol=1e-8)


def test_scale_and_origin_of_collision_meshes_are_kept(toy):
    model = toy()
    hull = trimesh.load(model.parent / "trunk_hull0.obj")
    np.testing.assert_allclose(hull.extents, [0.4, 0.2, 0.2], atol=1e-6)
    arm = trimesh.load(model.parent / "arm_hull0.obj")
    np.testing.assert_allclose(arm.bounds.mean(axis=0), [0, 0, 0.05], atol=1e-6)


def test_welded_bodies_can_share_one_hull(toy):
    model = toy(one_hull=[["arm", "finger"]], fixed={"knuckle": 0.0})
    hull = trimesh.load(model.parent / "arm_hull0.obj")
    assert hull.bounds[0, 2] == pytest.approx(-0.05, abs=1e-6)
    assert hull.bounds[1, 2] == pytest.approx(0.40, abs=1e-6)  # the finger's block stands 0.3 up
    assert not list(model.parent.glob("finger_hull*"))
    with pytest.raises(InputError, match=r"one_hull.*far is not welded to arm"):
        toy(one_hull=[["arm", "far"]])


def test_bodies_that_touch_in_the_nominal_posture_may_touch(toy):
    # finger and trunk are apart; finger and far overlap but are neighbours; arm's block reaches far's sphere.
    close = URDF.replace('<origin xyz="0 0 0.2"/>', '<origin xyz="0 0 -0.1"/>')
    model = toy(close)
    assert touching_pairs(model, {}, 0.0) == set()
    assert "arm_far" in model.read_text()
    assert "arm_far" not in toy().read_text()


def test_the_same_content_is_adapted_once(toy, cache):
    first = toy(frames=FRAMES)
    stamp = first.stat().st_mtime_ns
    assert toy(frames=FRAMES) == first
    assert first.stat().st_mtime_ns == stamp
    assert [p.name for p in cache.iterdir()] == [first.parent.name]


def test_other_content_makes_another_folder(toy):
    first = toy(frames=FRAMES)
    assert toy(frames=FRAMES, fixed={"shoulder": 0.1}) != first
    trimesh.creation.box((0.1, 0.1, 0.1)).export(toy.site / "toy" / "meshes" / "block.stl")
    assert toy(frames=FRAMES) != first


def test_a_failure_leaves_nothing_behind(toy, cache):
    with pytest.raises(InputError, match=r"none\.stl"):
        toy(URDF.replace("meshes/block.stl", "meshes/none.stl"))
    assert not list(cache.glob("*"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("package://toy/meshes/block.stl", "package://toy/../../secret.stl", "leads out"),
        ("package://toy/meshes/block.stl", "/etc/passwd", "leads out"),
        ("package://toy/meshes/block.stl", "file:///etc/passwd", "leads out"),
        ("../meshes/block.stl", "../../../cache/x.stl", "leads out"),
        ("package://toy/meshes/block.stl", "package://other/block.stl", "does not name 'other'"),
        ("package://toy/meshes/block.stl", "package://toy/meshes/none.stl", "no file"),
        ('mass value="5"', 'mass value="-5"', "mass.value"),
        ('mass value="5"', 'mass value="nan"', "mass.value"),
        ('xyz="0 0 0.5"', 'xyz="0 0 inf"', "origin.xyz"),
        ('lower="-1"', 'lower="low"', "limit.lower"),
        ("</robot>", "", "not XML"),
    ],
)
def test_what_is_wrong_with_a_model_is_said(toy, old, new, message):
    with pytest.raises(InputError, match=message) as error:
        toy(URDF.replace(old, new))
    assert "\n" not in str(error.value)


def test_a_link_in_the_package_cannot_lead_out_of_it(toy, tmp_path):
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "outside.stl")
    (toy.site / "toy" / "meshes" / "sly.stl").symlink_to(tmp_path / "outside.stl")
    with pytest.raises(InputError, match="leads out"):
        toy(URDF.replace("package://toy/meshes/block.stl", "package://toy/meshes/sly.stl"))


def test_folders_stay_inside_site_packages(toy):
    for folder in ("..", ".", "toy/../.."):
        with pytest.raises(InputError, match=r"folders\.toy"):
            toy(folders={"toy": folder})


@pytest.mark.parametrize(
    ("package", "nominal", "message"),
    [
        ({"frames": {"left_foot": {"body": "leg", "xyz": [0, 0, 0]}}}, {}, "package.frames.*'leg'"),
        ({"frames": {"arm": {"body": "arm", "xyz": [0, 0, 0]}}}, {}, "package.frames.arm"),
        ({"fixed": {"neck": 0.0}}, {}, "package.fixed.*'neck'"),
        ({"ignored_pairs": [["arm", "leg"]]}, {}, "ignored_pairs.*'leg'"),
        ({}, {"neck": 0.3}, "nominal.*'neck'"),
    ],
)
def test_names_that_the_model_lacks_are_said(toy, package, nominal, message):
    with pytest.raises(InputError, match=message):
        toy(nominal=nominal, **package)


def test_a_missing_package_says_how_to_get_it(cache):
    entry = PackageEntry(distribution="no-such-robot-at-all", folders={}, urdf="package://x/y.urdf")
    with pytest.raises(InputError, match=r"pip install 'drakeplan\[robots\]'"):
        adapted_model("toy", entry, "trunk", {}, source="toy.yaml")


def test_a_document_type_is_refused(toy, tmp_path):
    (tmp_path / "secret").write_text("5")
    sly = URDF.replace("<robot", f'<!DOCTYPE robot [<!ENTITY m SYSTEM "file://{tmp_path}/secret">]>\n<robot', 1)
    with pytest.raises(InputError, match="document type"):
        toy(sly.replace('<mass value="5"/>', "<mass value='5'/>&m;"))


def test_a_large_hull_loses_few_corners_and_little_depth():
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    lines = hull_obj(sphere.vertices).splitlines()
    vertices = np.array([[float(v) for v in line.split()[1:]] for line in lines if line.startswith("v ")])
    assert HULL_VERTICES < len(vertices) < 200 < len(sphere.vertices)
    hull = trimesh.convex.convex_hull(vertices)
    depth = np.einsum("fk,fk->f", hull.face_normals, hull.triangles[:, 0])
    assert depth.min() > 0.1 - HULL_ERROR
    assert np.linalg.norm(vertices, axis=1).max() < 0.1 + 1e-6


def _adapt_jvrc(folder):
    platformdirs.user_cache_dir = lambda name: str(Path(folder) / name)
    return str(load_robot("jvrc1").model)


@pytest.fixture(scope="module")
def jvrc1():
    try:
        importlib.metadata.distribution("jvrc-description")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("jvrc-description is not installed: pip install 'drakeplan[robots]'")
    return build_plant(load_robot("jvrc1"))


@pytest.mark.slow
def test_processes_that_adapt_at_once_agree(jvrc1, tmp_path):
    with multiprocessing.get_context("spawn").Pool(3) as pool:
        models = pool.map(_adapt_jvrc, [tmp_path] * 3)
    assert len(set(models)) == 1
    assert len(list((tmp_path / "drakeplan" / "robots").iterdir())) == 1
    drake(models[0])


def test_jvrc1_stands_on_its_soles_and_balances(jvrc1):
    context = jvrc1.new_context()
    plant_context = jvrc1.plant.GetMyContextFromRoot(context)
    jvrc1.plant.SetPositions(plant_context, nominal_posture(jvrc1.robot))
    for foot, side in zip(jvrc1.effector_bodies[:2], (1, -1), strict=True):
        X_WF = foot.EvalPoseInWorld(plant_context)
        np.testing.assert_allclose(X_WF.rotation().matrix(), np.eye(3), atol=1e-6)
        np.testing.assert_allclose(X_WF.translation(), [0, side * 0.096, 0], atol=1e-6)
    com = jvrc1.plant.CalcCenterOfMassPositionInWorld(plant_context)
    np.testing.assert_allclose(com[:2], 0.0, atol=0.015)
    assert com[2] == pytest.approx(jvrc1.robot.com_height[1], abs=2e-3)
    assert jvrc1.robot.mass == pytest.approx(jvrc1.plant.CalcTotalMass(plant_context))


def test_jvrc1_has_its_limits_and_motors(jvrc1):
    assert jvrc1.plant.num_actuators() == jvrc1.plant.num_velocities() - 6 == 29
    assert np.isfinite(jvrc1.plant.GetVelocityUpperLimits()[6:]).all()
    q = nominal_posture(jvrc1.robot)
    assert (q >= jvrc1.plant.GetPositionLowerLimits()).all()
    assert (q <= jvrc1.plant.GetPositionUpperLimits()).all()


def test_the_lowest_points_of_jvrc1_are_its_soles(jvrc1):
    inspector = jvrc1.scene_graph.model_inspector()
    for ids in jvrc1.effector_geometry:
        (geometry,) = ids
        hull = inspector.GetConvexHull(geometry)
        X_BG = inspector.GetPoseInFrame(geometry)
        body = jvrc1.plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
        frame = next(b for b in jvrc1.effector_bodies if body in jvrc1.plant.GetBodiesWeldedTo(b))
        X_FB = frame.body_frame().CalcPose(jvrc1.plant.CreateDefaultContext(), body.body_frame()).inverse()
        points = [(X_FB @ X_BG).multiply(np.array(hull.vertex(i))) for i in range(hull.num_vertices())]
        assert min(p[2] for p in points) == pytest.approx(0.0, abs=1e-3)


def test_jvrc1_does_not_touch_itself_standing_or_crouching(jvrc1):
    context = jvrc1.new_context()
    plant_context = jvrc1.plant.GetMyContextFromRoot(context)
    for bend in (0.0, 0.3, 0.6):
        jvrc1.plant.SetPositions(plant_context, nominal_posture(jvrc1.robot))
        for side in "LR":
            for joint, share in (("HIP_P", -1.0), ("KNEE", 2.0), ("ANKLE_P", -1.0)):
                angle = jvrc1.plant.GetJointByName(f"{side}_{joint}")
                angle.set_angle(plant_context, angle.get_angle(plant_context) + share * bend)
        scene = jvrc1.plant.get_geometry_query_input_port().Eval(plant_context)
        assert scene.ComputeSignedDistancePairwiseClosestPoints(0.01) == []


def test_legs_of_jvrc1_that_cross_are_a_collision(jvrc1):
    context = jvrc1.new_context()
    plant_context = jvrc1.plant.GetMyContextFromRoot(context)
    jvrc1.plant.SetPositions(plant_context, nominal_posture(jvrc1.robot))
    jvrc1.plant.GetJointByName("L_HIP_R").set_angle(plant_context, -0.3)
    scene = jvrc1.plant.get_geometry_query_input_port().Eval(plant_context)
    assert scene.ComputeSignedDistancePairwiseClosestPoints(0.0)


@pytest.mark.parametrize("effector", range(4))
def test_patches_of_jvrc1_lie_on_its_body(jvrc1, effector):
    context = jvrc1.new_context()
    plant_context = jvrc1.plant.GetMyContextFromRoot(context)
    jvrc1.plant.SetPositions(plant_context, nominal_posture(jvrc1.robot))
    X_WE = jvrc1.effector_bodies[effector].EvalPoseInWorld(plant_context)
    hx, hy = jvrc1.robot.half_extents[effector]
    scene = jvrc1.plant.get_geometry_query_input_port().Eval(plant_context)
    for corner in ([hx, hy, 0], [hx, -hy, 0], [-hx, hy, 0], [-hx, -hy, 0]):
        found = scene.ComputeSignedDistanceToPoint(X_WE.multiply(np.array(corner, float)))
        assert min(abs(d.distance) for d in found if d.id_G in jvrc1.effector_geometry[effector]) < 5e-3


def test_feet_of_jvrc1_reach_no_further_beyond_their_patches_than_is_said(jvrc1):
    inspector = jvrc1.scene_graph.model_inspector()
    context = jvrc1.plant.CreateDefaultContext()
    for effector, foot, ids in zip(jvrc1.robot.effectors, jvrc1.effector_bodies, jvrc1.effector_geometry, strict=True):
        if effector.name.endswith("palm"):
            continue
        (geometry,) = ids
        body = jvrc1.plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
        X_FG = body.body_frame().CalcPose(context, foot.body_frame()) @ inspector.GetPoseInFrame(geometry)
        hull = inspector.GetConvexHull(geometry)
        points = np.array([X_FG.multiply(np.array(hull.vertex(i))) for i in range(hull.num_vertices())])
        (hx, hy), (front, back, side) = effector.half_extent, effector.overhang
        assert points[:, 0].max() <= hx + front <= points[:, 0].max() + 5e-3
        assert points[:, 0].min() >= -hx - back >= points[:, 0].min() - 5e-3
        assert np.abs(points[:, 1]).max() <= hy + side <= np.abs(points[:, 1]).max() + 5e-3
