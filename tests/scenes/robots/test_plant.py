"""Terrain around a robot: where its faces are, how thick they are, what is left out."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from scenes.robots.plant import NEAR, THICKNESS, build_plant, nominal_posture, prism
from scenes.robots.robot import load_robot
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain, TriangleMesh

ATOL = 2e-6  # FCL's distance of boxes and convex bodies


@pytest.fixture(scope="module")
def escher():
    return load_robot("escher")


def square(name, size, X_WS):
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * size / 2
    return Surface(name, corners @ X_WS.rotation().matrix().T + X_WS.translation())


def foot_distances(built, X_WF):
    """Terrain piece -> distance of the left foot, when the left sole's frame is put at X_WF [m]."""
    context = built.new_context()
    plant, plant_context = built.plant, built.plant.GetMyContextFromRoot(context)
    plant.SetPositions(plant_context, nominal_posture(built.robot))
    base = plant.GetBodyByName("pelvis")
    X_FB = built.effector_bodies[0].EvalPoseInWorld(plant_context).inverse() @ base.EvalPoseInWorld(plant_context)
    plant.SetFreeBodyPose(plant_context, base, X_WF @ X_FB)
    scene = plant.get_geometry_query_input_port().Eval(plant_context)
    found = {}
    for pair in scene.ComputeSignedDistancePairwiseClosestPoints(0.2):
        names = {built.body_of(pair.id_A), built.body_of(pair.id_B)}
        if "left_foot" in names and len(names & set(built.terrain_geometry.values())) == 1:
            (piece,) = names - {"left_foot"}
            found[piece] = min(found.get(piece, np.inf), pair.distance)
    return found


TILTS = [(0.0, 0.0, 0.0), (0.3, 0.0, 0.5), (-0.2, 0.3, -1.0)]


@pytest.mark.parametrize("rpy", TILTS)
@pytest.mark.parametrize("height", [0.1, 0.01, 0.0, -0.005])
def test_a_sole_is_as_far_from_a_plate_as_it_was_lifted(escher, rpy, height):
    X_WS = RigidTransform(RollPitchYaw(*rpy), [0.4, -0.2, 0.3])
    built = build_plant(escher, Terrain((square("stone", 1.5, X_WS),)))
    distances = foot_distances(built, X_WS @ RigidTransform([0.1, 0.05, height]))
    assert distances["stone"] == pytest.approx(height, abs=ATOL)


@pytest.mark.parametrize("rpy", TILTS)
def test_a_plate_ends_two_centimetres_behind_its_face(escher, rpy):
    X_WS = RigidTransform(RollPitchYaw(*rpy), [0.0, 0.0, 0.0])
    built = build_plant(escher, Terrain((square("stone", 0.4, X_WS),)))
    # A foot hung upside down below the plate: its sole looks up at the plate's back.
    X_SF = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, -THICKNESS - 0.03])
    assert foot_distances(built, X_WS @ X_SF)["stone"] == pytest.approx(0.03, abs=ATOL)


def test_faces_of_a_mesh_reach_behind_themselves_only(escher):
    step = Box("step", np.array([1.0, 1.0, 0.3]), np.eye(4))
    mesh = TriangleMesh("mesh", step.triangles())
    built = build_plant(escher, Terrain((square("far", 1.0, RigidTransform([0, 0, -5.0])),), (mesh,)))
    above = foot_distances(built, RigidTransform([0.1, 0.1, 0.15 + 0.004]))
    beside = foot_distances(built, RigidTransform([0.5 + 0.11 + 0.02, 0.0, 0.0]))
    assert above["mesh"] == pytest.approx(0.004, abs=ATOL)
    assert beside["mesh"] == pytest.approx(0.02 + 1e-3, abs=ATOL)  # the foot's box stays 1 mm inside its patch
    assert len([g for g, name in built.terrain_geometry.items() if name == "mesh"]) == 6  # two triangles a side


def test_a_box_is_a_box_wherever_it_stands(escher):
    X_WO = RigidTransform(RollPitchYaw(0.1, -0.2, 0.7), [0.3, 0.1, 0.2])
    box = Box("pillar", np.array([0.6, 0.5, 0.4]), X_WO.GetAsMatrix4())
    built = build_plant(escher, Terrain((square("far", 1.0, RigidTransform([0, 0, -5.0])),), (box,)))
    assert foot_distances(built, X_WO @ RigidTransform([0, 0, 0.2 + 0.05]))["pillar"] == pytest.approx(0.05, abs=ATOL)


def test_a_face_of_a_mesh_is_not_added_twice(escher):
    face = square("top", 1.0, RigidTransform([0, 0, 0.15]))
    mesh = TriangleMesh("mesh", Box("m", np.array([1.0, 1.0, 0.3]), np.eye(4)).triangles())
    built = build_plant(escher, Terrain((face,), (mesh,), (True,)))
    assert built.surface_geometry == (None,)
    assert set(built.terrain_geometry.values()) == {"mesh"}


def test_terrain_never_collides_with_terrain(escher):
    ground = square("ground", 2.0, RigidTransform())
    stone = square("stone", 0.4, RigidTransform(RollPitchYaw(0.2, 0.1, 0.0), [0.0, 0.0, 0.0]))
    box = Box("box", np.array([0.3, 0.3, 0.3]), np.eye(4))
    built = build_plant(escher, Terrain((ground, stone), (box,)))
    candidates = built.scene_graph.model_inspector().GetCollisionCandidates()
    assert candidates
    assert not any({a, b} <= built.terrain_geometry.keys() for a, b in candidates)


def test_positions_are_the_same_with_and_without_terrain(escher):
    alone, around = build_plant(escher), build_plant(escher, Terrain((square("ground", 2.0, RigidTransform()),)))
    assert alone.plant.GetPositionNames() == around.plant.GetPositionNames()
    np.testing.assert_array_equal(alone.nominal_positions(), around.nominal_positions())


def test_a_robot_without_terrain_is_built_once(escher):
    assert build_plant(escher) is build_plant(escher)
    assert build_plant(load_robot("escher")) is build_plant(escher)


def test_far_terrain_is_left_out_on_request(escher):
    # Half a metre across: its nearest edge is 0.25 m nearer than its middle.
    stones = [square(f"stone {x}", 0.5, RigidTransform([x, 0.0, 0.0])) for x in (0.0, NEAR + 0.2, NEAR + 0.3, 10.0)]
    built = build_plant(escher, Terrain(tuple(stones)), near=np.array([[0.0, 0.0, 0.0]]))
    assert [g is not None for g in built.surface_geometry] == [True, True, False, False]
    assert set(built.terrain_geometry.values()) == {"stone 0.0", f"stone {NEAR + 0.2}"}


def test_friction_of_a_plate_is_that_of_its_surface(escher):
    slippery = Surface("ice", square("s", 1.0, RigidTransform()).vertices, friction=0.07)
    built = build_plant(escher, Terrain((slippery,)))
    properties = built.scene_graph.model_inspector().GetProximityProperties(built.surface_geometry[0])
    assert properties.GetProperty("material", "coulomb_friction").static_friction() == pytest.approx(0.07)


def test_everything_that_collides_is_also_drawn(escher):
    mesh = TriangleMesh("mesh", Box("m", np.array([1.0, 1.0, 0.3]), np.eye(4)).triangles())
    box = Box("box", np.array([0.3, 0.3, 0.3]), np.eye(4))
    built = build_plant(escher, Terrain((square("ground", 2.0, RigidTransform()),), (mesh, box)))
    drawn = built.plant.GetVisualGeometriesForBody(built.plant.world_body())
    inspector = built.scene_graph.model_inspector()
    names = {inspector.GetName(g).split("::")[-1] for g in drawn}
    assert names == {"ground", "mesh", "box"}


def test_needles_of_a_mesh_are_no_bodies(escher):
    needle = np.array([[[0, 0, 0], [1, 0, 0], [0.5, 1e-6, 0]]], float)
    solid = Box("m", np.array([1.0, 1.0, 0.3]), np.eye(4)).triangles()
    built = build_plant(
        escher,
        Terrain((square("far", 1.0, RigidTransform()),), (TriangleMesh("mesh", np.concatenate([needle, solid])),)),
    )
    assert sum(name == "mesh" for name in built.terrain_geometry.values()) == 6


def test_a_prism_has_its_face_in_front():
    face = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    corners = prism(face, np.array([0.0, 0.0, 1.0]), 0.5)
    np.testing.assert_array_equal(corners[:3], face)
    np.testing.assert_array_equal(corners[3:], face - [0, 0, 0.5])


def test_a_welded_effector_owns_the_geometry_that_moves_with_it(escher):
    built = build_plant(escher)
    names = [sorted(built.body_of(g) for g in ids) for ids in built.effector_geometry]
    assert names == [["left_foot"], ["right_foot"], ["left_hand", "left_palm"], ["right_hand", "right_palm"]]
