"""Capsules against Drake's distances, and the geometry of segments against brute force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import Box, Capsule, Cylinder, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder

from optimization.multibody.body_capsules import (
    close_pairs,
    closest_on_segments,
    distance_row,
    make_rows,
    read_capsules,
)
from optimization.multibody.kinematics import Kinematics
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot

DRAKE = 1e-5  # [m] how well Drake's iterative distances are known
SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def escher():
    built = build_plant(load_robot("escher"))
    kinematics = Kinematics.from_plant(built.plant, ["left_foot"])
    q_nominal = built.nominal_positions()
    return built, kinematics, read_capsules(kinematics, built.plant, built.scene_graph, q_nominal, 0.01), q_nominal


def drake_clearance(built, q):
    context = built.new_context()
    built.plant.SetPositions(built.plant.GetMyContextFromRoot(context), q)
    query = built.scene_graph.get_query_output_port().Eval(built.scene_graph.GetMyContextFromRoot(context))
    return min([s.distance for s in query.ComputeSignedDistancePairwiseClosestPoints(0.1)] + [0.1])


def posture_near(rng, kinematics, q_nominal, spread):
    q = q_nominal.copy()
    q[7:] = np.clip(q[7:] + rng.normal(0, spread, len(q) - 7), kinematics.tree.lower, kinematics.tree.upper)
    return q


@settings(max_examples=200, deadline=None)
@given(seed=SEEDS, parallel=st.booleans(), points=st.integers(0, 3))
def test_closest_points_of_segments_beat_every_pair_on_a_grid(seed, parallel, points):
    rng = np.random.default_rng(seed)
    a0, a1, b0, b1 = rng.uniform(-1, 1, (4, 3))
    if parallel:
        b1 = b0 + rng.uniform(-2, 2) * (a1 - a0)
    if points & 1:
        a1 = a0
    if points & 2:
        b1 = b0
    a, b = np.empty(3), np.empty(3)
    distance = closest_on_segments(a0, a1, b0, b1, a, b)
    s = np.linspace(0, 1, 200)[:, None]
    grid = np.linalg.norm((a0 + s * (a1 - a0))[:, None] - (b0 + s * (b1 - b0))[None], axis=2)
    assert distance == pytest.approx(np.linalg.norm(a - b), abs=1e-12)
    assert grid.min() - 0.02 < distance <= grid.min() + 1e-12
    for p, p0, p1 in ((a, a0, a1), (b, b0, b1)):
        assert np.linalg.norm(p - p0) + np.linalg.norm(p - p1) == pytest.approx(np.linalg.norm(p1 - p0), abs=1e-9)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS)
def test_round_shapes_have_exactly_drakes_distance(seed):
    rng = np.random.default_rng(seed)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    inertia = SpatialInertia(1.0, [0, 0, 0], UnitInertia.SolidSphere(0.1))
    bodies = [plant.AddRigidBody(f"body_{i}", inertia) for i in range(3)]
    for i in (1, 2):
        # Drake leaves out the pairs that a joint connects, so the shapes sit on the leaves.
        X_PF = RigidTransform(RollPitchYaw(rng.uniform(-3, 3, 3)), rng.uniform(-0.5, 0.5, 3))
        plant.AddJoint(
            RevoluteJoint(
                f"j{i}", plant.AddFrame(FixedOffsetFrame(f"F{i}", bodies[0], X_PF)), bodies[i].body_frame(), [0, 0, 1]
            )
        )
        shape = Sphere(rng.uniform(0.05, 0.2)) if rng.random() < 0.5 else Capsule(*rng.uniform(0.05, 0.3, 2))
        X_BG = RigidTransform(RollPitchYaw(rng.uniform(-3, 3, 3)), rng.uniform(-0.3, 0.3, 3))
        plant.RegisterCollisionGeometry(bodies[i], X_BG, shape, "shape", CoulombFriction(0.5, 0.5))
    plant.Finalize()
    diagram = builder.Build()
    kinematics = Kinematics.from_plant(plant, [])
    q = np.r_[1.0, np.zeros(6), rng.uniform(-2, 2, 2)]
    capsules = read_capsules(kinematics, plant, scene_graph, q, -1.0)
    context = diagram.CreateDefaultContext()
    plant.SetPositions(plant.GetMyContextFromRoot(context), q)
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    rows = make_rows(4)
    assert close_pairs(capsules, *kinematics.link_poses(q), 10.0, rows) == 1
    (pair,) = query.ComputeSignedDistancePairwiseClosestPoints(10.0)
    if pair.distance > 1e-3:
        assert rows.distance[0] == pytest.approx(pair.distance, abs=DRAKE)
    else:
        assert rows.distance[0] < 2e-3


@pytest.mark.parametrize("shape", [Box(0.2, 0.28, 0.34), Box(0.22, 0.1, 0.03), Cylinder(0.05, 0.4)])
def test_capsules_of_a_box_stay_near_its_surface_from_both_sides(shape):
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    inertia = SpatialInertia(1.0, [0, 0, 0], UnitInertia.SolidSphere(0.1))
    root, arm = plant.AddRigidBody("root", inertia), plant.AddRigidBody("arm", inertia)
    middle = plant.AddRigidBody("middle", inertia)
    plant.AddJoint(RevoluteJoint("a", root.body_frame(), middle.body_frame(), [0, 0, 1]))
    plant.AddJoint(RevoluteJoint("b", middle.body_frame(), arm.body_frame(), [0, 0, 1]))
    for body, geometry in ((root, shape), (arm, Sphere(0.01))):
        plant.RegisterCollisionGeometry(body, RigidTransform(), geometry, "shape", CoulombFriction(0.5, 0.5))
    plant.Finalize()
    builder.Build()
    kinematics = Kinematics.from_plant(plant, [])
    body = read_capsules(kinematics, plant, scene_graph, np.r_[1.0, np.zeros(8)], 0.0)
    s = int(np.argmax(body.reach))
    own = slice(body.first[s], body.first[s + 1])
    size = (
        np.array([shape.width(), shape.depth(), shape.height()])
        if isinstance(shape, Box)
        else np.array([0.1, 0.1, 0.4])
    )
    rng = np.random.default_rng(0)
    for _ in range(300):
        point = rng.uniform(-0.5, 0.5, 3) * size
        face = rng.integers(3)
        point[face] = 0.5 * size[face] * rng.choice([-1, 1])
        a, b = np.empty(3), np.empty(3)
        gap = min(
            closest_on_segments(A, B, point, point, a, b) - r
            for A, B, r in zip(body.p_LA[own], body.p_LB[own], body.radius[own], strict=True)
        )
        # Capsules leave out corners by up to 0.73 radii, and overfill what is thinner than 5 cm.
        assert -0.026 < gap < 0.73 * 0.05 + 1e-9


def test_row_is_the_derivative_of_the_distance(escher):
    _, kinematics, capsules, q_nominal = escher
    rng = np.random.default_rng(4)
    rows, ahead, behind = make_rows(60), make_rows(60), make_rows(60)
    compared = 0
    for _ in range(20):
        q = posture_near(rng, kinematics, q_nominal, 0.4)
        v = rng.standard_normal(kinematics.num_velocities)
        R, p = kinematics.link_poses(q)
        count = close_pairs(capsules, R, p, 0.1, rows)
        h = 1e-6
        n1 = close_pairs(capsules, *kinematics.link_poses(kinematics.integrate(q, v, h)), 0.2, ahead)
        n0 = close_pairs(capsules, *kinematics.link_poses(kinematics.integrate(q, v, -h)), 0.2, behind)
        later = dict(zip(ahead.pair[:n1], ahead.distance[:n1], strict=True))
        earlier = dict(zip(behind.pair[:n0], behind.distance[:n0], strict=True))
        row = np.empty(kinematics.num_velocities)
        for k in range(count):
            distance_row(kinematics.tree, R, p, rows, k, row)
            rate = (later[rows.pair[k]] - earlier[rows.pair[k]]) / (2 * h)
            # Where the nearest capsule of a shape changes the distance has a kink; the row is one of its sides.
            if abs(later[rows.pair[k]] + earlier[rows.pair[k]] - 2 * rows.distance[k]) < 1e-9:
                assert row @ v == pytest.approx(rate, abs=1e-5)
                compared += 1
    assert compared > 50


def keeps_clearance(capsules, R, p):
    """Whether no pair of bodies is nearer than the clearance that it must keep."""
    rows = make_rows(200)
    count = close_pairs(capsules, R, p, 0.03, rows)
    return (rows.distance[:count] >= capsules.clearance[rows.pair[:count]]).all()


def test_nominal_posture_keeps_every_clearance(escher):
    _, kinematics, capsules, q_nominal = escher
    assert keeps_clearance(capsules, *kinematics.link_poses(q_nominal))


def test_few_postures_that_the_capsules_call_free_collide_by_more_than_5_mm(escher):
    built, kinematics, capsules, q_nominal = escher
    rng = np.random.default_rng(0)
    missed, free = 0, 0
    for _ in range(300):
        q = posture_near(rng, kinematics, q_nominal, 0.5)
        if keeps_clearance(capsules, *kinematics.link_poses(q)):
            free += 1
            missed += drake_clearance(built, q) < -0.005
    assert free > 100
    assert missed <= 0.02 * free


def test_rows_that_do_not_fit_are_left_out(escher):
    _, kinematics, capsules, q_nominal = escher
    R, p = kinematics.link_poses(q_nominal)
    assert close_pairs(capsules, R, p, 10.0, make_rows(5)) == 5
    assert close_pairs(capsules, R, p, 10.0, make_rows(500)) == len(capsules.pair)
