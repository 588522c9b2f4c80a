"""The embedded humanoid: its figures, its symmetry, the directions of its frames."""

import runpy

import numpy as np
import pytest
from pydrake.multibody.tree import RevoluteJoint

from scenes.effector import EFFECTORS
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import ROBOTS, load_robot

ATOL = 1e-12  # rounding of forward kinematics
MIRROR = np.diag([1.0, -1.0, 1.0])


@pytest.fixture(scope="module")
def escher():
    return build_plant(load_robot("escher"))


def poses(built, q):
    """Body name -> (4, 4) pose in W."""
    context = built.plant.CreateDefaultContext()
    built.plant.SetPositions(context, q)
    bodies = (built.plant.get_body(i) for i in built.plant.GetBodyIndices(built.plant.GetModelInstanceByName("escher")))
    return {b.name(): built.plant.EvalBodyPoseInWorld(context, b).GetAsMatrix4() for b in bodies}


def test_the_generator_writes_the_file_that_ships():
    module = runpy.run_path(str(ROBOTS / "escher" / "make_escher.py"))
    assert module["urdf"]() == (ROBOTS / "escher" / "escher.urdf").read_text(encoding="utf-8")


def test_it_has_33_degrees_of_freedom_and_a_motor_at_each_joint(escher):
    plant = escher.plant
    assert (plant.num_positions(), plant.num_velocities(), plant.num_actuators()) == (34, 33, 27)
    assert plant.GetUniqueFloatingBaseBodyOrThrow(plant.GetModelInstanceByName("escher")).name() == "pelvis"


def test_it_weighs_76_kg_and_the_description_says_so(escher):
    context = escher.plant.CreateDefaultContext()
    assert escher.plant.CalcTotalMass(context) == pytest.approx(76.0, abs=1e-9)
    assert escher.robot.mass == pytest.approx(76.0, abs=1e-9)


def test_it_is_1_7_m_tall_when_it_stands_straight(escher):
    q = nominal_posture(escher.robot).copy()
    q[7:] = 0.0
    straight = poses(escher, q)
    top_of_head = straight["head"][2, 3] + 0.195
    assert top_of_head - straight["left_foot"][2, 3] == pytest.approx(1.70, abs=0.01)


def test_every_inertia_is_one_that_a_body_can_have(escher):
    for index in escher.plant.GetBodyIndices(escher.plant.GetModelInstanceByName("escher")):
        inertia = escher.plant.get_body(index).default_spatial_inertia()
        assert inertia.IsPhysicallyValid()
        assert inertia.get_mass() > 0.1  # every link weighs something: no needle in the mass matrix


def test_soles_stand_level_at_the_origin_with_toes_forward(escher):
    nominal = poses(escher, nominal_posture(escher.robot))
    for foot, side in (("left_foot", 1.0), ("right_foot", -1.0)):
        np.testing.assert_allclose(nominal[foot][:3, :3], np.eye(3), atol=ATOL)
        np.testing.assert_allclose(nominal[foot][:3, 3], [0.0, side * 0.10, 0.0], atol=ATOL)
    np.testing.assert_allclose(nominal["pelvis"][:3, :3], np.eye(3), atol=ATOL)


def test_an_arm_stretched_forward_pushes_with_fingers_up(escher):
    # The wall ahead has the outward normal -x; a palm on it has z along that normal and its fingers up.
    context = escher.plant.CreateDefaultContext()
    escher.plant.SetPositions(context, nominal_posture(escher.robot))
    for side in ("left", "right"):
        angles = {"shoulder_pitch": -np.pi / 2, "shoulder_roll": 0.0, "elbow": 0.0}
        for joint, angle in angles.items():
            escher.plant.GetJointByName(f"{side}_{joint}").set_angle(context, angle)
        palm = escher.plant.EvalBodyPoseInWorld(context, escher.plant.GetBodyByName(f"{side}_palm")).rotation().matrix()
        np.testing.assert_allclose(palm[:, 2], [-1.0, 0.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(palm[:, 0], [0.0, 0.0, 1.0], atol=1e-9)


def test_the_centre_of_mass_stands_over_the_middle_of_the_feet(escher):
    context = escher.plant.CreateDefaultContext()
    escher.plant.SetPositions(context, nominal_posture(escher.robot))
    com = escher.plant.CalcCenterOfMassPositionInWorld(context)
    np.testing.assert_allclose(com[:2], [0.0, 0.0], atol=0.01)
    assert com[2] == pytest.approx(escher.robot.com_height[1], abs=2e-3)


def test_right_is_the_mirror_image_of_left(escher):
    plant, rng = escher.plant, np.random.default_rng(3)
    q = nominal_posture(escher.robot).copy()
    mirrored = q.copy()
    for joint in map(plant.get_joint, plant.GetJointIndices()):
        if not isinstance(joint, RevoluteJoint):
            continue
        name, sign = joint.name(), 1.0 if abs(joint.revolute_axis()[1]) > 0.5 else -1.0
        twin = plant.GetJointByName(_other_side(name))
        limits = sorted(sign * v for v in (joint.position_lower_limits()[0], joint.position_upper_limits()[0]))
        assert limits == [twin.position_lower_limits()[0], twin.position_upper_limits()[0]]
        assert joint.velocity_upper_limits() == twin.velocity_upper_limits()
        assert plant.GetJointActuatorByName(name).effort_limit() == (
            plant.GetJointActuatorByName(twin.name()).effort_limit()
        )
        q[joint.position_start()] = rng.uniform(joint.position_lower_limits()[0], joint.position_upper_limits()[0])
        mirrored[twin.position_start()] = sign * q[joint.position_start()]
    here, there = poses(escher, q), poses(escher, mirrored)
    base = MIRROR @ here["pelvis"][:3, 3]
    for name, X in here.items():
        twin = there[_other_side(name)]
        p_mirrored = MIRROR @ X[:3, 3] - base + there["pelvis"][:3, 3]
        np.testing.assert_allclose(twin[:3, 3], p_mirrored, atol=1e-9)
        np.testing.assert_allclose(twin[:3, :3], MIRROR @ X[:3, :3] @ MIRROR, atol=1e-9)


def test_mirrored_bodies_weigh_and_turn_alike(escher):
    for e in ("thigh", "shin", "foot", "upper_arm", "forearm", "hand", "palm"):
        left, right = (escher.plant.GetBodyByName(f"{s}_{e}").default_spatial_inertia() for s in ("left", "right"))
        np.testing.assert_allclose(MIRROR @ left.get_com(), right.get_com(), atol=1e-9)
        I_left, I_right = (i.CalcRotationalInertia().CopyToFullMatrix3() for i in (left, right))
        np.testing.assert_allclose(MIRROR @ I_left @ MIRROR, I_right, atol=1e-9)


def test_the_nominal_posture_keeps_its_limits_and_touches_nothing(escher):
    q = nominal_posture(escher.robot)
    assert (q >= escher.plant.GetPositionLowerLimits()).all()
    assert (q <= escher.plant.GetPositionUpperLimits()).all()
    context = escher.new_context()
    plant_context = escher.plant.GetMyContextFromRoot(context)
    escher.plant.SetPositions(plant_context, q)
    scene = escher.plant.get_geometry_query_input_port().Eval(plant_context)
    assert scene.ComputeSignedDistancePairwiseClosestPoints(0.05) == []


def test_arms_across_the_chest_are_a_collision(escher):
    # The filters leave out neighbours only: a collision that is real still counts.
    context = escher.new_context()
    plant_context = escher.plant.GetMyContextFromRoot(context)
    escher.plant.SetPositions(plant_context, nominal_posture(escher.robot))
    for joint, angle in {"shoulder_pitch": -0.6, "shoulder_yaw": -1.6, "elbow": -2.0}.items():
        escher.plant.GetJointByName(f"left_{joint}").set_angle(plant_context, angle)
    scene = escher.plant.get_geometry_query_input_port().Eval(plant_context)
    hits = scene.ComputeSignedDistancePairwiseClosestPoints(0.0)
    assert any("torso" in (escher.body_of(h.id_A), escher.body_of(h.id_B)) for h in hits)


def test_ankles_follow_stones_tilted_by_20_degrees_both_ways(escher):
    for side in ("left", "right"):
        roll, pitch = (escher.plant.GetJointByName(f"{side}_ankle_{axis}") for axis in ("roll", "pitch"))
        assert roll.position_lower_limits()[0] <= -0.5
        assert roll.position_upper_limits()[0] >= 0.5
        assert pitch.position_lower_limits()[0] <= -1.0
        assert pitch.position_upper_limits()[0] >= 0.8


def test_collision_shapes_of_soles_and_palms_end_at_their_patches(escher):
    inspector = escher.scene_graph.model_inspector()
    for effector in escher.robot.effectors:
        (geometry,) = escher.plant.GetCollisionGeometriesForBody(escher.plant.GetBodyByName(effector.frame))
        size, X_EG = inspector.GetShape(geometry).size(), inspector.GetPoseInFrame(geometry)
        np.testing.assert_allclose(X_EG.translation()[:2], 0.0, atol=ATOL)
        assert X_EG.translation()[2] == pytest.approx(size[2] / 2)  # the shape's face is the patch
        half = np.array(effector.half_extent)
        assert (size[:2] / 2 <= half).all()
        assert (size[:2] / 2 >= half - 2e-3).all()


def test_shoulder_and_hip_are_where_the_model_has_them(escher):
    nominal = poses(escher, nominal_posture(escher.robot))
    np.testing.assert_allclose(nominal["left_shoulder_pitch_link"][:3, 3], escher.robot.shoulder, atol=1e-3)
    np.testing.assert_allclose(nominal["left_hip_yaw_link"][:3, 3], escher.robot.hip, atol=1e-3)


def test_the_torso_box_covers_the_trunk(escher):
    nominal = poses(escher, nominal_posture(escher.robot))
    low = escher.robot.torso_box_centre - escher.robot.torso_box_size / 2
    high = escher.robot.torso_box_centre + escher.robot.torso_box_size / 2
    for body in ("pelvis", "torso", "head", "left_upper_arm", "right_upper_arm"):
        assert (nominal[body][:3, 3] >= low).all()
        assert (nominal[body][:3, 3] <= high).all()


def test_effectors_come_in_the_one_order(escher):
    assert tuple(e.name for e in escher.robot.effectors) == EFFECTORS
    assert tuple(b.name() for b in escher.effector_bodies) == EFFECTORS


def _other_side(name):
    if name.startswith("left_"):
        return "right_" + name.removeprefix("left_")
    return "left_" + name.removeprefix("right_") if name.startswith("right_") else name
