"""The embedded wheeled robot: its file is its generator's, both sides are mirror images, and its arms end in round palms."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.geometry import Cylinder
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from scenes.robots.bracer import make_bracer
from scenes.robots.bracer.make_bracer import ARM_JOINTS, FOREARM, HAND, PALM_RADIUS, UPPER_ARM, urdf
from scenes.robots.robot import ROBOTS

FILE = ROBOTS / "bracer" / "bracer.urdf"
MIRROR = np.diag([1.0, -1.0, 1.0])
ATOL = 1e-9  # rounding of forward kinematics


@pytest.fixture(scope="module")
def plant() -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(FILE))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant


def pose(plant: MultibodyPlant, q: np.ndarray, name: str) -> np.ndarray:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    return plant.GetFrameByName(name).CalcPoseInWorld(context).GetAsMatrix4()


def test_the_generator_writes_the_file_that_ships() -> None:
    assert urdf() == FILE.read_text(encoding="utf-8")
    assert make_bracer.__file__ == str(FILE.with_name("make_bracer.py"))


def test_a_torso_of_two_joints_carries_two_arms_of_seven(plant: MultibodyPlant) -> None:
    assert plant.num_positions() == 2 + 2 * len(ARM_JOINTS) == 16
    for side in ("left", "right"):
        for name, _, reach in ARM_JOINTS:
            joint = plant.GetJointByName(f"{side}_{name}")
            assert joint.position_lower_limits()[0] == -reach and joint.position_upper_limits()[0] == reach


def test_every_inertia_is_one_that_a_body_can_have(plant: MultibodyPlant) -> None:
    for index in plant.GetBodyIndices(plant.GetModelInstanceByName("bracer")):
        inertia = plant.get_body(index).default_spatial_inertia()
        assert inertia.IsPhysicallyValid() and inertia.get_mass() > 0.05


def test_arms_hang_down_with_palms_that_press_to_the_ground_at_zero(plant: MultibodyPlant) -> None:
    q = np.zeros(16)
    for side in ("left", "right"):
        shoulder, palm = (pose(plant, q, f"{side}_{name}") for name in ("shoulder_pitch_link", "palm"))
        drop = UPPER_ARM + FOREARM + HAND
        np.testing.assert_allclose(palm[:3, 3], shoulder[:3, 3] - [0.0, 0.0, drop], atol=ATOL)
        np.testing.assert_allclose(palm[:3, 2], [0.0, 0.0, -1.0], atol=1e-7)


def test_right_is_the_mirror_image_of_left(plant: MultibodyPlant) -> None:
    """Pitch turns alike on both sides, roll and yaw the other way."""
    rng, q, mirrored = np.random.default_rng(0), np.zeros(16), np.zeros(16)
    for side, twin in (("left", "right"), ("right", "left")):
        for name, axis, reach in ARM_JOINTS:
            angle = rng.uniform(-reach, reach)
            q[plant.GetJointByName(f"{side}_{name}").position_start()] = angle
            sign = 1.0 if axis == "0 1 0" else -1.0
            mirrored[plant.GetJointByName(f"{twin}_{name}").position_start()] = sign * angle
    for side, twin in (("left", "right"), ("right", "left")):
        for name in ("upper_arm", "forearm", "hand", "palm"):
            X, X_twin = pose(plant, q, f"{side}_{name}"), pose(plant, mirrored, f"{twin}_{name}")
            np.testing.assert_allclose(X_twin[:3, 3], MIRROR @ X[:3, 3], atol=1e-7)
            if name != "palm":  # that frame is turned over about x alone
                np.testing.assert_allclose(X_twin[:3, :3], MIRROR @ X[:3, :3] @ MIRROR, atol=1e-7)


def test_palms_are_discs_whose_face_is_the_contact() -> None:
    plant, graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
    Parser(plant).AddModels(str(FILE))
    plant.Finalize()
    inspector = graph.model_inspector()
    for side in ("left", "right"):
        (disc,) = plant.GetCollisionGeometriesForBody(plant.GetBodyByName(f"{side}_palm"))
        shape, X_PD = inspector.GetShape(disc), inspector.GetPoseInFrame(disc)
        assert isinstance(shape, Cylinder) and shape.radius() == PALM_RADIUS
        np.testing.assert_allclose(X_PD.translation(), [0.0, 0.0, -shape.length() / 2], atol=ATOL)
