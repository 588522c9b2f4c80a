"""Whole motions over made-up contact sequences, judged by Drake and by the planned momenta alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.tree import MultibodyForces

from drakeplan.bench.kinodynamic import plan_gap
from drakeplan.context import QueryContext
from drakeplan.motion.check import velocities
from drakeplan.motion.course_dynamics import monotone_course
from drakeplan.motion.maker import MotionMaker, MotionOptions, MotionResult
from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from optimization.kinodynamic.momentum_gap import PROMISED
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS, LEFT_FOOT, LEFT_PALM, RIGHT_FOOT
from scenes.robots.plant import RobotPlant, build_plant
from scenes.robots.robot import load_robot
from scenes.scene import Scene
from scenes.stance import Stance
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain, terrain_from

ROBOT = load_robot("escher")
HELD, HELD_ANGLE, COM = 5e-3, np.deg2rad(1.0), 0.02  # [m, rad, m] what the verifier allows
PENETRATION, SOLE_PENETRATION = 5e-3, 0.01  # [m]
REST = 1e-3  # [rad/s, m/s]


def slab(name: str, x: float, y: float, rx: float, ry: float, z: float = 0.0, half: float = 0.17) -> Surface:
    """A square stone tilted by rx and ry [rad] about its centre (x, y, z) [m]."""
    u, v = np.array([np.cos(ry), 0.0, -np.sin(ry)]), np.array([0.0, np.cos(rx), np.sin(rx)])
    v = v - (v @ u) * u
    v /= np.linalg.norm(v)
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    return Surface(name, np.array([[x, y, z] + half * (a * u + b * v) for a, b in corners]))


def ground(x0: float = -0.6, x1: float = 3.0) -> Surface:
    return Surface("ground", np.array([[x0, -1.0, 0.0], [x1, -1.0, 0.0], [x1, 1.0, 0.0], [x0, 1.0, 0.0]]))


def contact_on(terrain: Terrain, effector: int, surface: int, point: Sequence[float]) -> Contact:
    """The end effector on the surface, below or before `point` [m]."""
    name, on = EFFECTORS[effector], terrain.surfaces[surface]
    n, p = on.normal, np.array(point, dtype=float)
    p[2] -= (n @ (p - on.vertices[0])) / n[2] if abs(n[2]) > 0.5 else 0.0
    return Contact(name, surface, contact_pose(name, p, n, 0.0), on.friction)


def sequence(terrain: Terrain, start: tuple[int, int], moves: Sequence[tuple[int, int, Sequence[float] | None]]):
    """The stances that follow from both feet at x = 0 and moves (effector, surface, point or None to break)."""
    feet = [contact_on(terrain, e, start[e], [0.0, 0.1 if e == LEFT_FOOT else -0.1, 0.0]) for e in (0, 1)]
    stances = [Stance((*feet, None, None))]
    for effector, surface, point in moves:
        contact = None if point is None else contact_on(terrain, effector, surface, point)
        stances.append(stances[-1].replace(effector, contact))
    return stances


def walk_on_flat_ground() -> tuple[Terrain, list[Stance]]:
    terrain = terrain_from([ground()])
    x, moves = 0.0, []
    for k in range(6):
        x += 0.14 if k in (0, 5) else 0.28
        moves.append((k % 2, 0, [min(x, 1.12), 0.1 if k % 2 == 0 else -0.1, 0.0]))
    return terrain, sequence(terrain, (0, 0), moves)


def walk_over_stones() -> tuple[Terrain, list[Stance]]:
    tilts = np.deg2rad([(12, -8), (-10, 14), (-15, -12), (8, 15), (14, 6), (-6, -15)])
    stones = [ground(-0.6, 0.14)]
    for k, (rx, ry) in enumerate(tilts):
        stones.append(slab(f"stone {k}", 0.33 + 0.36 * (k // 2), 0.18 if k % 2 == 0 else -0.18, rx, ry, 0.02 * (k % 3)))
    stones.append(Surface("end", np.array([[1.25, -1, 0.05], [2.5, -1, 0.05], [2.5, 1, 0.05], [1.25, 1, 0.05]])))
    terrain = terrain_from(stones)
    moves = [(k % 2, k + 1, [0.33 + 0.36 * (k // 2), 0.13 if k % 2 == 0 else -0.13, 0.0]) for k in range(6)]
    moves += [(LEFT_FOOT, 7, [1.40, 0.12, 0.0]), (RIGHT_FOOT, 7, [1.40, -0.1, 0.0])]
    return terrain, sequence(terrain, (0, 0), moves)


def walk_along_a_wall() -> tuple[Terrain, list[Stance]]:
    wall = Surface("wall", np.array([[-0.5, 0.7, 1.1], [2.5, 0.7, 1.1], [2.5, 0.7, 1.8], [-0.5, 0.7, 1.8]]))
    terrain = terrain_from([ground(), wall if wall.normal[1] < 0 else wall.flipped()])
    moves = [
        (LEFT_PALM, 1, [0.25, 0.7, 1.4]),
        (RIGHT_FOOT, 0, [0.25, -0.1, 0.0]),
        (LEFT_FOOT, 0, [0.35, 0.1, 0.0]),
        (LEFT_PALM, 1, [0.55, 0.7, 1.4]),
        (RIGHT_FOOT, 0, [0.5, -0.1, 0.0]),
        (LEFT_PALM, 1, None),
        (LEFT_FOOT, 0, [0.5, 0.1, 0.0]),
    ]
    return terrain, sequence(terrain, (0, 0), moves)


def make_motion(terrain: Terrain, stances: list[Stance], options: MotionOptions | None = None) -> MotionResult:
    context = QueryContext(Scene("walk", terrain), ROBOT, WholeBodyIK(ROBOT))
    return MotionMaker(context, options).run(stances, lambda _: None)


WALKS = {"flat": walk_on_flat_ground, "stones": walk_over_stones, "wall": walk_along_a_wall}


@pytest.fixture(scope="module", params=list(WALKS))
def walk(request) -> tuple[Terrain, list[Stance], MotionResult]:
    terrain, stances = WALKS[request.param]()
    return terrain, stances, make_motion(terrain, stances)


def test_the_motion_is_found_and_covers_its_phases(walk):
    _, stances, result = walk
    assert result.ok, result.reason
    assert not result.problems
    assert result.t[0] == 0.0
    assert result.t[-1] == pytest.approx(result.schedule.duration)
    assert np.allclose(np.diff(result.t), 0.02)
    assert result.centroidal.t[-1] == pytest.approx(result.schedule.duration)
    assert len(result.schedule.phases) == 2 * len(stances) - 1
    assert np.isfinite(result.q).all()
    assert np.isfinite(result.v).all()


def test_drake_finds_every_held_contact_in_place(walk):
    _, _, result = walk
    plant = build_plant(ROBOT).plant
    context = plant.CreateDefaultContext()
    frames = [plant.GetFrameByName(e.frame) for e in ROBOT.effectors]
    for t, q in zip(result.t, result.q, strict=True):
        plant.SetPositions(context, q)
        for phase in result.schedule.phases:
            if not phase.start - 1e-9 <= t <= phase.end + 1e-9:
                continue
            for e, c in enumerate(phase.contacts):
                if c < 0:
                    continue
                X, X_WC = frames[e].CalcPoseInWorld(context).GetAsMatrix4(), result.schedule.contacts[c].X_WC
                assert np.linalg.norm(X[:3, 3] - X_WC[:3, 3]) < HELD, f"{EFFECTORS[e]} at {t:.2f} s"
                assert np.arccos(min(1.0, (np.trace(X[:3, :3].T @ X_WC[:3, :3]) - 1) / 2)) < HELD_ANGLE


def test_drakes_centre_of_mass_follows_the_momenta(walk):
    _, _, result = walk
    plant = build_plant(ROBOT).plant
    context = plant.CreateDefaultContext()
    knots, com = result.centroidal.t, result.centroidal.com
    planned = np.stack([np.interp(result.t, knots, com[:, i]) for i in range(3)], axis=1)
    for q, com in zip(result.q, planned, strict=True):
        plant.SetPositions(context, q)
        assert np.linalg.norm(plant.CalcCenterOfMassPositionInWorld(context) - com) < COM


def test_drakes_momenta_follow_the_dynamics_at_every_frame(walk):
    _, _, result = walk
    gap = plan_gap(build_plant(ROBOT), result)
    assert gap.within(PROMISED), str(gap)
    assert gap.angular.rms < 1.0
    assert result.gaps[-1].angular.rms == pytest.approx(gap.angular.rms, abs=0.1)


def test_drakes_joint_torques_are_those_reported_and_within_the_limits(walk):
    _, _, result = walk
    plant = build_plant(ROBOT).plant
    context, forces = plant.CreateDefaultContext(), MultibodyForces(plant)
    c, greatest = result.centroidal, 0.0
    limit = {
        a.joint().velocity_start(): a.effort_limit()
        for a in map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    }
    names = [plant.get_joint_actuator(i).name() for i in plant.GetJointActuatorIndices()]
    joints = [plant.get_joint_actuator(i).joint().velocity_start() for i in plant.GetJointActuatorIndices()]
    assert result.actuator_names == tuple(names)
    assert result.tau.shape == (len(result.t), len(names))
    assert np.array_equal(result.tau[-1], result.tau[-2])
    for n, t in enumerate(result.t[:-1]):
        k = min(np.flatnonzero(c.t <= t + 1e-6)[-1], len(c.t) - 2)
        plant.SetPositions(context, result.q[n])
        plant.SetVelocities(context, result.v[n])
        plant.CalcForceElementsContribution(context, forces)  # gravity and the joints' damping
        for e, spec in enumerate(ROBOT.effectors):
            if c.contact[k, e] < 0:
                continue
            X_WC = result.schedule.contacts[c.contact[k, e]].X_WC
            force, body = c.force_W[k, e], plant.GetFrameByName(spec.frame).body()
            moment = np.cross(X_WC[:3, :2] @ c.cop_C[k, e], force) + X_WC[:3, 2] * c.torque_n[k, e]
            p_BC_W = X_WC[:3, 3] - body.EvalPoseInWorld(context).translation()
            body.AddInForce(context, p_BC_W, SpatialForce(moment, force), plant.world_frame(), forces)
        tau = plant.CalcInverseDynamics(context, (result.v[n + 1] - result.v[n]) / 0.02, forces)
        assert np.abs(tau[joints] - result.tau[n]).max() < 1e-9
        greatest = max(greatest, *(abs(tau[j]) / most for j, most in limit.items()))
    assert greatest == pytest.approx(result.torque.share, rel=1e-6)
    assert greatest < 1.0


def test_feeding_the_angular_momentum_back_brings_it_near_the_dynamics():
    terrain, stances = walk_on_flat_ground()
    peer, motion = (make_motion(terrain, stances, MotionOptions(feedback=f)) for f in (False, True))
    assert peer.ok, peer.reason
    assert motion.gaps[-1].angular.rms < 0.3 * peer.gaps[-1].angular.rms
    assert motion.gaps[-1].angular.rms < 0.3 * motion.gaps[0].angular.rms


def test_joints_keep_their_limits_and_speeds_and_velocities_are_those_of_the_positions(walk):
    _, _, result = walk
    plant = build_plant(ROBOT).plant
    context = plant.CreateDefaultContext()
    assert (result.q >= plant.GetPositionLowerLimits() - 1e-9).all()
    assert (result.q <= plant.GetPositionUpperLimits() + 1e-9).all()
    assert (np.abs(result.v) <= plant.GetVelocityUpperLimits() + 1e-9).all()
    for k in range(len(result.t) - 1):
        middle = 0.5 * (result.q[k] + result.q[k + 1])
        middle[:4] /= np.linalg.norm(middle[:4])
        plant.SetPositions(context, middle)
        mean = plant.MapQDotToVelocity(context, (result.q[k + 1] - result.q[k]) / 0.02)
        low, high = np.minimum(result.v[k], result.v[k + 1]), np.maximum(result.v[k], result.v[k + 1])
        assert np.maximum(low - mean, mean - high).max() < 0.2
        assert result.q[k, :4] @ result.q[k + 1, :4] > 0


def test_it_starts_and_ends_at_rest(walk):
    _, _, result = walk
    assert np.abs(result.v[[0, -1]]).max() < REST
    assert np.abs(result.centroidal.linear_momentum[[0, -1]]).max() < REST * ROBOT.mass
    first, last = result.q[1] - result.q[0], result.q[-1] - result.q[-2]
    assert max(np.abs(first).max(), np.abs(last).max()) / 0.02 < 0.1  # [rad/s] at most the first frame's acceleration


def test_drake_finds_no_penetration(walk):
    terrain, _, result = walk
    around: RobotPlant = build_plant(ROBOT, terrain)
    context = around.new_context()
    plant_context = around.plant.GetMyMutableContextFromRoot(context)
    port, query_context = around.scene_graph.get_query_output_port(), around.scene_graph.GetMyContextFromRoot(context)
    soles = frozenset().union(*around.effector_geometry)
    for t, q in zip(result.t, result.q, strict=True):
        around.plant.SetPositions(plant_context, q)
        for pair in port.Eval(query_context).ComputePointPairPenetration():
            on_ground = {pair.id_A, pair.id_B} & around.terrain_geometry.keys()
            limit = SOLE_PENETRATION if on_ground and {pair.id_A, pair.id_B} & soles else PENETRATION
            names = around.body_of(pair.id_A), around.body_of(pair.id_B)
            assert pair.depth < limit, f"{names} overlap by {pair.depth:.4f} m at {t:.2f} s"


def test_the_trunk_stays_upright_and_faces_the_way(walk):
    _, _, result = walk
    w, x, y, z = result.q[:, :4].T
    up = 1 - 2 * (x**2 + y**2)  # z of the base's z axis
    heading = np.arctan2(2 * (x * y + w * z), 1 - 2 * (y**2 + z**2))
    assert up.min() > np.cos(np.deg2rad(20))
    assert np.abs(heading).max() < np.deg2rad(25)


def test_the_same_contacts_give_the_same_motion():
    terrain, stances = walk_on_flat_ground()
    first, second = (make_motion(terrain, stances[:4]) for _ in range(2))
    assert np.array_equal(first.q, second.q)
    assert np.array_equal(first.centroidal.force_W, second.centroidal.force_W)


def test_a_foothold_out_of_reach_is_named():
    terrain = terrain_from([ground()])
    stances = sequence(terrain, (0, 0), [(RIGHT_FOOT, 0, [0.25, -0.1, 0]), (LEFT_FOOT, 0, [1.9, 0.1, 0])])
    result = make_motion(terrain, stances)
    assert not result.ok
    assert result.failed_transitions == (1,)
    assert "posture" in result.reason
    assert result.centroidal is None


def test_a_step_that_cannot_be_balanced_is_named():
    icy = Surface("ice", np.array([[0.14, -1, -0.2], [1.2, -1, 0.4], [1.2, 1, 0.4], [0.14, 1, -0.2]]), friction=0.2)
    terrain = terrain_from([ground(-0.6, 0.14), icy])  # tan of its tilt is 0.57
    stances = sequence(terrain, (0, 0), [(RIGHT_FOOT, 1, [0.3, -0.1, 0]), (LEFT_FOOT, 1, [0.35, 0.1, 0])])
    result = make_motion(terrain, stances)
    assert not result.ok
    assert 1 in result.failed_transitions


def test_an_obstacle_that_no_swing_avoids_is_reported_not_hidden():
    """A wall of 0.55 m: the robot can stand astride it, but no foot gets over it from one place to the other."""
    wall = Surface("wall", np.array([[0.2, -3, -0.1], [0.2, 3, -0.1], [0.2, 3, 0.55], [0.2, -3, 0.55]]))
    terrain = terrain_from([ground(), wall])
    stances = sequence(terrain, (0, 0), [(RIGHT_FOOT, 0, [0.4, -0.1, 0.0])])
    result = make_motion(terrain, stances, MotionOptions(rounds=1, attempts=1))
    assert not result.ok
    assert result.failed_transitions == (0,)
    assert result.reason == "no way for the right_foot past the terrain in transition 0"


def test_a_robot_that_only_stands_stands():
    terrain = terrain_from([ground()])
    result = make_motion(terrain, sequence(terrain, (0, 0), []))
    assert result.ok, result.reason
    assert np.abs(result.v).max() < 0.05


def test_a_course_passes_its_keys_at_rest_at_both_ends_without_overshoot():
    key_t, key_x = np.array([0.0, 1.0, 1.5, 3.0]), np.array([[0.0], [1.0], [0.4], [0.4]])
    t = np.linspace(0.0, 3.0, 3001)
    x = monotone_course(key_t, key_x, t)[:, 0]
    assert np.allclose(np.interp(key_t, t, x), key_x[:, 0])
    assert abs(x[1] - x[0]) < 1e-5
    assert abs(x[-1] - x[-2]) < 1e-5
    assert x.min() >= -1e-12
    assert x.max() <= 1.0 + 1e-12


def test_velocities_of_a_smooth_motion_are_its_derivative():
    t = np.arange(0.0, 2.0001, 0.02)
    q = np.zeros((len(t), 8))
    angle = 0.3 * (1 - np.cos(np.pi * t))  # at rest at 0 and 2
    q[:, 0], q[:, 3] = np.cos(angle / 2), np.sin(angle / 2)  # the base turns about z
    q[:, 5], q[:, 7] = angle, 2 * angle
    v = velocities(q, 0.02)
    exact = 0.3 * np.pi * np.sin(np.pi * t)
    for column, factor in ((2, 1.0), (4, 1.0), (6, 2.0)):
        assert np.allclose(v[:, column], factor * exact, atol=1e-5)
