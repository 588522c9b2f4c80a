"""The packed kinematics against Drake and against finite differences, on random trees and on the robots."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    JacobianWrtVariable,
    PlanarJoint,
    PrismaticJoint,
    RevoluteJoint,
    RotationalInertia,
    SpatialInertia,
    WeldJoint,
)

from optimization.multibody.kinematic_tree import rotation_error
from optimization.multibody.kinematics import Kinematics
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

ATOL = 1e-12  # both sides round in a different order; lengths are of the order of a metre
FRAMES = ("frame_0", "frame_1", "frame_2")
SEEDS = st.integers(0, 2**32 - 1)


def random_pose(rng):
    return RigidTransform(RollPitchYaw(rng.uniform(-3, 3, 3)), rng.uniform(-0.4, 0.4, 3))


def random_inertia(rng):
    """Five point masses: physical by construction, with products of inertia."""
    masses, points = rng.uniform(0.05, 1.0, 5), rng.uniform(-0.2, 0.2, (5, 3))
    com = masses @ points / masses.sum()
    about_com = np.zeros(6)
    for m, (x, y, z) in zip(masses, points - com, strict=True):
        about_com += m * np.array([y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z])
    return SpatialInertia.MakeFromCentralInertia(masses.sum(), com, RotationalInertia(*about_com))


def random_tree(rng, num_bodies):
    """A floating tree with every kind of joint, offset frames on both sides, and joints added in any order."""
    plant = MultibodyPlant(0.0)
    bodies = [plant.AddRigidBody(f"body_{i}", random_inertia(rng)) for i in range(num_bodies)]
    for i in 1 + rng.permutation(num_bodies - 1):
        parent, child = bodies[rng.integers(i)], bodies[i]
        F = plant.AddFrame(FixedOffsetFrame(f"F_{i}", parent, random_pose(rng)))
        M = plant.AddFrame(FixedOffsetFrame(f"M_{i}", child, random_pose(rng)))
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        kind = rng.choice(["revolute", "revolute", "prismatic", "weld"])
        if kind == "weld":
            plant.AddJoint(WeldJoint(f"joint_{i}", F, M, random_pose(rng)))
        else:
            plant.AddJoint((RevoluteJoint if kind == "revolute" else PrismaticJoint)(f"joint_{i}", F, M, axis, -2, 2))
    for k in range(len(FRAMES)):
        plant.AddFrame(FixedOffsetFrame(FRAMES[k], bodies[rng.integers(num_bodies)], random_pose(rng)))
    plant.Finalize()
    return plant


def random_positions(rng, plant):
    q = rng.uniform(-1.5, 1.5, plant.num_positions())
    q[:4] /= np.linalg.norm(q[:4])
    return q


def assert_equals_drake(plant, kinematics, q):
    context, world = plant.CreateDefaultContext(), plant.world_frame()
    plant.SetPositions(context, q)
    wrt = JacobianWrtVariable.kV
    for name in kinematics.bodies:
        X_WB = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name)).GetAsMatrix4()
        np.testing.assert_allclose(kinematics.body_pose(q, name), X_WB, atol=ATOL, err_msg=name)
    frames = [plant.GetFrameByName(name) for name in kinematics.frames]
    X_WE = [frame.CalcPoseInWorld(context).GetAsMatrix4() for frame in frames]
    np.testing.assert_allclose(kinematics.effector_poses(q), X_WE, atol=ATOL)
    J_E = [plant.CalcJacobianSpatialVelocity(context, wrt, frame, np.zeros(3), world, world) for frame in frames]
    np.testing.assert_allclose(kinematics.effector_jacobians(q), J_E, atol=ATOL)
    com = plant.CalcCenterOfMassPositionInWorld(context)
    np.testing.assert_allclose(kinematics.com(q), com, atol=ATOL)
    J_com = plant.CalcJacobianCenterOfMassTranslationalVelocity(context, wrt, world, world)
    np.testing.assert_allclose(kinematics.com_jacobian(q), J_com, atol=ATOL)
    A = np.empty((6, plant.num_velocities()))
    for i, unit in enumerate(np.eye(plant.num_velocities())):
        plant.SetVelocities(context, unit)
        L = plant.CalcSpatialMomentumInWorldAboutPoint(context, com)
        A[:, i] = np.concatenate([L.rotational(), L.translational()])
    scale = plant.CalcTotalMass(context)
    np.testing.assert_allclose(kinematics.momentum_matrix(q) / scale, A / scale, atol=ATOL)
    assert kinematics.total_mass == pytest.approx(scale, rel=1e-14)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, num_bodies=st.integers(1, 16))
def test_every_quantity_equals_drake_on_random_trees(seed, num_bodies):
    rng = np.random.default_rng(seed)
    plant = random_tree(rng, num_bodies)
    kinematics = Kinematics.from_plant(plant, FRAMES)
    for _ in range(2):
        assert_equals_drake(plant, kinematics, random_positions(rng, plant))


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
def test_jacobians_are_the_derivatives_of_poses_and_centre_of_mass(seed):
    rng = np.random.default_rng(seed)
    plant = random_tree(rng, 8)
    kinematics = Kinematics.from_plant(plant, FRAMES)
    q, v, h = random_positions(rng, plant), rng.standard_normal(plant.num_velocities()), 1e-5
    ahead, behind = kinematics.integrate(q, v, h), kinematics.integrate(q, v, -h)
    X_1, X_0 = kinematics.effector_poses(ahead), kinematics.effector_poses(behind)
    V_WE = kinematics.effector_jacobians(q) @ v
    w = np.empty(3)
    for e in range(len(FRAMES)):
        rotation_error(X_0[e, :3, :3], X_1[e, :3, :3], w)
        np.testing.assert_allclose(w / (2 * h), V_WE[e, :3], atol=1e-7)
        np.testing.assert_allclose((X_1[e, :3, 3] - X_0[e, :3, 3]) / (2 * h), V_WE[e, 3:], atol=1e-7)
    v_com = (kinematics.com(ahead) - kinematics.com(behind)) / (2 * h)
    np.testing.assert_allclose(kinematics.com_jacobian(q) @ v, v_com, atol=1e-7)


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
def test_linear_momentum_is_the_mass_times_the_velocity_of_the_centre_of_mass(seed):
    rng = np.random.default_rng(seed)
    plant = random_tree(rng, 10)
    kinematics = Kinematics.from_plant(plant, ())
    q = random_positions(rng, plant)
    np.testing.assert_allclose(
        kinematics.momentum_matrix(q)[3:], kinematics.total_mass * kinematics.com_jacobian(q), atol=1e-11
    )


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_integrate_agrees_with_drake_to_first_order_and_keeps_the_quaternion_unit(seed):
    rng = np.random.default_rng(seed)
    plant = random_tree(rng, 6)
    kinematics, context = Kinematics.from_plant(plant, ()), plant.CreateDefaultContext()
    q, v, h = random_positions(rng, plant), rng.standard_normal(plant.num_velocities()), 1e-6
    plant.SetPositions(context, q)
    rate = (kinematics.integrate(q, v, h) - kinematics.integrate(q, v, -h)) / (2 * h)
    np.testing.assert_allclose(rate, plant.MapVelocityToQDot(context, v), atol=1e-8)
    assert np.linalg.norm(kinematics.integrate(q, v, 3.0)[:4]) == pytest.approx(1.0, abs=1e-14)


@settings(max_examples=100, deadline=None)
@given(seed=SEEDS, angle=st.floats(0, 3.1), dt=st.floats(1e-3, 10))
def test_difference_undoes_integrate(seed, angle, dt):
    rng = np.random.default_rng(seed)
    kinematics = Kinematics.from_plant(random_tree(np.random.default_rng(1), 6), ())
    q = rng.uniform(-1, 1, kinematics.num_positions)
    q[:4] /= np.linalg.norm(q[:4])
    v = rng.standard_normal(kinematics.num_velocities)
    v[:3] *= angle / np.linalg.norm(v[:3]) / dt
    np.testing.assert_allclose(kinematics.difference(q, kinematics.integrate(q, v, dt)), v * dt, atol=1e-9)
    np.testing.assert_allclose(kinematics.difference(q, np.r_[-q[:4], q[4:]]), 0.0, atol=1e-12)


def test_integrating_half_a_step_twice_is_integrating_once():
    rng = np.random.default_rng(3)
    plant = random_tree(rng, 5)
    kinematics = Kinematics.from_plant(plant, ())
    q, v = random_positions(rng, plant), rng.standard_normal(plant.num_velocities())
    halfway = kinematics.integrate(q, v, 0.5)
    np.testing.assert_allclose(kinematics.integrate(halfway, v, 0.5), kinematics.integrate(q, v, 1.0), atol=1e-14)


@settings(max_examples=100, deadline=None)
@given(seed=SEEDS, angle=st.one_of(st.floats(0, np.pi), st.sampled_from([0.0, 1e-12, 1e-7, np.pi - 1e-7, np.pi])))
def test_rotation_error_is_the_rotation_that_was_made(seed, angle):
    rng = np.random.default_rng(seed)
    R_WA = RotationMatrix(RollPitchYaw(rng.uniform(-3, 3, 3))).matrix()
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    E = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    w = np.empty(3)
    assert rotation_error(R_WA, E @ R_WA, w) == pytest.approx(angle, abs=1e-7)
    sign = np.sign(w @ axis) if angle > np.pi - 1e-5 else 1.0
    np.testing.assert_allclose(w, sign * angle * axis, atol=2e-6)


def test_a_plant_that_is_no_single_floating_tree_is_refused():
    plant = MultibodyPlant(0.0)
    inertia = random_inertia(np.random.default_rng(0))
    plant.AddRigidBody("one", inertia)
    plant.AddRigidBody("two", inertia)
    plant.Finalize()
    with pytest.raises(ValueError, match="one floating base"):
        Kinematics.from_plant(plant, ())
    plant = MultibodyPlant(0.0)
    base, sled = plant.AddRigidBody("base", inertia), plant.AddRigidBody("sled", inertia)
    plant.AddJoint(PlanarJoint("plane", base.body_frame(), sled.body_frame()))
    plant.Finalize()
    with pytest.raises(ValueError, match="plane"):
        Kinematics.from_plant(plant, ())


def test_a_vector_of_the_wrong_size_is_refused():
    kinematics = Kinematics.from_plant(random_tree(np.random.default_rng(1), 4), ())
    with pytest.raises(ValueError, match="expected"):
        kinematics.com(np.zeros(kinematics.num_positions + 1))


@pytest.mark.parametrize("name", ["escher", "jvrc1"])
def test_every_quantity_equals_drake_on_the_robots(name):
    if name == "jvrc1":
        pytest.importorskip("jvrc_description")
    robot = load_robot(name)
    plant = build_plant(robot).plant
    kinematics = Kinematics.from_plant(plant, [e.frame for e in robot.effectors])
    rng = np.random.default_rng(0)
    for _ in range(10):
        q = random_positions(rng, plant)
        q[7:] = rng.uniform(kinematics.tree.lower, kinematics.tree.upper)
        assert_equals_drake(plant, kinematics, q)
    assert kinematics.total_mass == pytest.approx(robot.mass, rel=1e-9)
    for i, joint in enumerate(kinematics.joint_names):
        assert plant.GetJointByName(joint).velocity_start() == 6 + i


def test_terrain_around_the_robot_changes_nothing():
    robot = load_robot("escher")
    floor = Surface("floor", np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]))
    alone = Kinematics.from_plant(build_plant(robot).plant, ["left_foot"])
    around = Kinematics.from_plant(build_plant(robot, Terrain((floor,))).plant, ["left_foot"])
    for a, b in zip(alone.tree, around.tree, strict=True):
        np.testing.assert_array_equal(a, b)
