"""Whole-body IK: every answer is measured again with Drake, and its failures are compared with SNOPT's."""

from dataclasses import dataclass

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit
from pydrake.math import RotationMatrix
from pydrake.multibody.inverse_kinematics import ComPositionConstraint, InverseKinematics
from pydrake.solvers import SnoptSolver

from optimization.inverse_kinematics.posture_guess import guess_posture
from optimization.inverse_kinematics.whole_body_ik import IkOptions, WholeBodyIK, solve_stance
from scenes.contact import contact_pose
from scenes.effector import EFFECTORS
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot

SEEDS = st.integers(0, 2**32 - 1)
ROUNDING = 1e-9  # [m, rad] Drake's kinematics and ours agree to 1e-12
FEET = np.array([True, True, False, False])


@dataclass(frozen=True)
class Setup:
    """One solver and Drake's plant of the same robot."""

    ik: WholeBodyIK
    built: object

    def misses(self, task, q):
        """Greatest position and angle error, CoM outside the polygon, joints beyond their limits; by Drake."""
        X_WE, active, region = task
        plant = self.built.plant
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, q)
        position = angle = 0.0
        for e in np.flatnonzero(active):
            X = plant.GetFrameByName(self.ik.robot.effectors[e].frame).CalcPoseInWorld(context)
            position = max(position, np.linalg.norm(X.translation() - X_WE[e, :3, 3]))
            turn = RotationMatrix(X_WE[e, :3, :3].T @ X.rotation().matrix())
            angle = max(angle, abs(turn.ToAngleAxis().angle()))
        com = plant.CalcCenterOfMassPositionInWorld(context)[:2]
        outside = 0.0 if region is None else shapely.Polygon(region).distance(shapely.Point(com))
        beyond = max((plant.GetPositionLowerLimits()[7:] - q[7:]).max(), (q - plant.GetPositionUpperLimits())[7:].max())
        return position, angle, outside, beyond

    def penetration(self, q):
        """Depth of the robot in itself [m], negative where it is clear; by Drake."""
        context = self.built.new_context()
        self.built.plant.SetPositions(self.built.plant.GetMyContextFromRoot(context), q)
        scene_graph = self.built.scene_graph
        query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
        return -min([s.distance for s in query.ComputeSignedDistancePairwiseClosestPoints(0.02)] + [0.02])


@pytest.fixture(scope="module")
def escher():
    robot = load_robot("escher")
    return Setup(WholeBodyIK(robot), build_plant(robot))


def assert_held(setup, task, q, options=IkOptions()):  # noqa: B008
    position, angle, outside, beyond = setup.misses(task, q)
    assert position <= options.position_tolerance + ROUNDING
    assert angle <= options.angle_tolerance + ROUNDING
    assert outside <= 1e-6 + ROUNDING
    assert beyond <= 0.0


def random_stance(rng, num_contacts, reach=1.0):
    """Feet on stones tilted up to 20 deg, palms on walls at y = +-0.7; the polygon is that of both feet or of one."""
    yaw = rng.uniform(-0.4, 0.4)
    c, s = np.cos(yaw), np.sin(yaw)
    ahead, apart, up = reach * rng.uniform(-0.45, 0.45), rng.uniform(0.15, 0.15 + 0.3 * reach), rng.uniform(-0.25, 0.25)
    X_WE = np.tile(np.eye(4), (4, 1, 1))
    patches = []
    for e, side in ((0, 0.5), (1, -0.5)):
        point = side * np.array([c * ahead - s * apart, s * ahead + c * apart, reach * up])
        normal = np.array([*np.tan(np.deg2rad(rng.uniform(-20, 20, 2))), 1.0])
        X_WE[e] = contact_pose(EFFECTORS[e], point, normal / np.linalg.norm(normal), yaw + rng.uniform(-0.4, 0.4))
        corners = np.array([[x, y, 0.0] for x in (-0.09, 0.09) for y in (-0.04, 0.04)])
        patches.append((corners @ X_WE[e, :3, :3].T + point)[:, :2])
    active = FEET.copy()
    for e in rng.permutation([2, 3])[: num_contacts - 2]:
        wall = 1.0 if e == 2 else -1.0
        normal = np.array([0.0, -wall, 0.0]) + rng.uniform(-0.25, 0.25, 3)
        point = np.array([rng.uniform(-0.2, 0.5), 0.7 * wall + rng.uniform(-0.1, 0.1), rng.uniform(1.0, 1.7)])
        X_WE[e] = contact_pose(EFFECTORS[e], point, normal / np.linalg.norm(normal), yaw)
        active[e] = True
    kept = patches if rng.random() < 0.7 else [patches[rng.integers(2)]]
    hull = shapely.MultiPoint(np.concatenate(kept)).convex_hull.buffer(0.03 * (num_contacts - 2), quad_segs=2)
    region = np.array(shapely.geometry.polygon.orient(hull, 1.0).exterior.coords)[:-1]
    return X_WE, active, region


def test_standing_as_nominal_needs_no_iteration(escher):
    X_WE = escher.ik.kinematics.effector_poses(escher.ik.model.q_nominal)
    answer = escher.ik.solve(X_WE, FEET)
    assert answer.ok
    assert answer.iterations == 0
    np.testing.assert_allclose(answer.q, escher.ik.model.q_nominal, atol=1e-12)


@settings(max_examples=80, deadline=None)
@given(seed=SEEDS, num_contacts=st.integers(2, 4))
def test_what_is_called_found_is_found_by_drakes_measure(escher, seed, num_contacts):
    task = random_stance(np.random.default_rng(seed), num_contacts, reach=1.3)
    answer = escher.ik.solve(*task)
    assert np.isfinite(answer.q).all()
    assert np.linalg.norm(answer.q[:4]) == pytest.approx(1.0, abs=1e-12)
    position, angle, outside, beyond = escher.misses(task, answer.q)
    assert beyond <= 0.0
    assert answer.contact_error == pytest.approx(position, abs=ROUNDING)
    assert answer.contact_angle == pytest.approx(angle, abs=1e-7)
    if answer.ok:
        assert_held(escher, task, answer.q)
    else:
        assert position > 1e-3 or angle > np.deg2rad(0.2) or outside > 0 or answer.clearance < -5e-3


def test_postures_that_exist_are_found_again(escher):
    rng = np.random.default_rng(1)
    tree, q_nominal = escher.ik.kinematics.tree, escher.ik.model.q_nominal
    tried = found = 0
    while tried < 60:
        q = q_nominal.copy()
        q[7:] = np.clip(q[7:] + rng.normal(0, 0.35, len(q) - 7), tree.lower, tree.upper)
        X_WE = escher.ik.kinematics.effector_poses(q)
        apart = X_WE[0, :3, 3] - X_WE[1, :3, 3]
        if np.hypot(*apart[:2]) < 0.15 or escher.penetration(q) > 0 or (X_WE[:2, 2, 2] < np.cos(0.7)).any():
            continue
        com = escher.ik.kinematics.com(q)[:2]
        region = com + 0.03 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        tried += 1
        task = (X_WE, np.ones(4, bool), region)
        answer = escher.ik.solve(*task)
        if answer.ok:
            found += 1
            assert_held(escher, task, answer.q)
    assert found >= 0.9 * tried


def test_a_seed_that_already_holds_is_returned_as_it_is(escher):
    task = random_stance(np.random.default_rng(3), 4, reach=0.5)
    first = escher.ik.solve(*task)
    again = escher.ik.solve(*task, q_seed=first.q)
    assert first.ok
    assert again.ok
    assert again.iterations == 0
    np.testing.assert_array_equal(first.q, again.q)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_a_stance_moved_and_turned_gives_the_same_posture_moved_and_turned(escher, seed):
    rng = np.random.default_rng(seed)
    X_WE, active, region = random_stance(rng, 3, reach=0.6)
    X = np.eye(4)
    yaw = rng.uniform(-3, 3)
    X[:3, :3] = [[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]
    X[:3, 3] = rng.uniform(-20, 20, 3)
    here = escher.ik.solve(X_WE, active, region)
    there = escher.ik.solve(X @ X_WE, active, region @ X[:2, :2].T + X[:2, 3])
    assume(here.iterations < 10)  # longer searches amplify rounding
    assert here.ok == there.ok
    np.testing.assert_allclose(there.q[7:], here.q[7:], atol=1e-5)
    np.testing.assert_allclose(there.q[4:7], X[:3, :3] @ here.q[4:7] + X[:3, 3], atol=1e-5)


def test_what_no_leg_can_reach_is_refused(escher):
    X_WE = escher.ik.kinematics.effector_poses(escher.ik.model.q_nominal)
    X_WE[0, 0, 3] += 2.0
    answer = escher.ik.solve(X_WE, FEET, options=IkOptions(restarts=3))
    assert not answer.ok
    assert answer.contact_error > 0.05
    assert np.isfinite(answer.q).all()


def test_restarts_lose_nothing_and_recover_from_a_bad_seed(escher):
    rng = np.random.default_rng(4)
    tree = escher.ik.kinematics.tree
    once, often = [], []
    for k in range(60):
        task = random_stance(rng, 2 + k % 3, reach=1.2)
        seed = np.r_[1.0, np.zeros(3), rng.uniform(-2, 2, 3), rng.uniform(tree.lower, tree.upper)]
        once.append(escher.ik.solve(*task, q_seed=seed).ok)
        answer = escher.ik.solve(*task, q_seed=seed, options=IkOptions(restarts=3))
        often.append(answer.ok)
        if answer.ok:
            assert_held(escher, task, answer.q)
    once, often = np.array(once), np.array(often)
    assert not np.any(once & ~often)
    assert once.sum() < 55
    assert often.sum() > once.sum()


def test_a_polygon_out_of_reach_is_refused_and_says_how_far(escher):
    X_WE = escher.ik.kinematics.effector_poses(escher.ik.model.q_nominal)
    square = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    answer = escher.ik.solve(X_WE, FEET, square + np.array([2.0, 0.0]))
    assert not answer.ok
    assert answer.com_violation > 0.2
    assert escher.ik.solve(X_WE, FEET, square).ok


def test_the_margin_keeps_the_centre_of_mass_inside_by_that_much(escher):
    X_WE = escher.ik.kinematics.effector_poses(escher.ik.model.q_nominal)
    square = np.array([[-0.06, -0.06], [0.06, -0.06], [0.06, 0.06], [-0.06, 0.06]]) + np.array([0.03, 0.05])
    answer = escher.ik.solve(X_WE, FEET, square, options=IkOptions(com_margin=0.04))
    assert answer.ok
    com = escher.ik.kinematics.com(answer.q)[:2]
    assert shapely.Polygon(square).exterior.distance(shapely.Point(com)) >= 0.04 - 1e-6


def test_the_centre_of_mass_goes_where_it_is_asked_to(escher):
    X_WE = escher.ik.kinematics.effector_poses(escher.ik.model.q_nominal)
    target = escher.ik.kinematics.com(escher.ik.model.q_nominal) + np.array([0.03, 0.06, -0.08])
    answer = escher.ik.solve(X_WE, FEET, com_target=target)
    assert answer.ok
    assert np.linalg.norm(escher.ik.kinematics.com(answer.q) - target) <= 2e-3 + ROUNDING
    sideways = escher.ik.solve(X_WE, FEET, com_target=np.array([np.nan, 0.05, np.nan]))
    assert abs(escher.ik.kinematics.com(sideways.q)[1] - 0.05) <= 2e-3 + ROUNDING


def test_one_foot_is_enough(escher):
    X_WE = escher.ik.kinematics.effector_poses(escher.ik.model.q_nominal)
    region = X_WE[1, :2, 3] + 0.03 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    X_WE[[0, 2, 3]] = np.nan
    task = (X_WE, np.array([False, True, False, False]), region)
    answer = escher.ik.solve(*task)
    assert answer.ok
    assert_held(escher, task, answer.q)


def test_answers_do_not_reach_into_themselves(escher):
    rng = np.random.default_rng(8)
    depths = []
    for _ in range(120):
        answer = escher.ik.solve(*random_stance(rng, int(rng.integers(2, 5)), reach=1.2))
        if answer.ok:
            depths.append(escher.penetration(answer.q))
    assert len(depths) > 60
    assert np.mean(np.array(depths) > 5e-3) <= 0.02


def test_two_runs_are_identical_to_the_bit(escher):
    rng = np.random.default_rng(5)
    for _ in range(10):
        task = random_stance(rng, 4)
        np.testing.assert_array_equal(escher.ik.solve(*task).q, escher.ik.solve(*task).q)


@pytest.mark.slow
def test_it_can_be_called_from_another_kernel(escher):
    @njit
    def count_found(model, tasks, options, seeded, q_nominal):
        found = 0
        for task in tasks:
            ok, _, _ = solve_stance(model, task, options, seeded, q_nominal.copy())
            found += ok
        return found

    rng = np.random.default_rng(6)
    stances = [random_stance(rng, 2, reach=0.7) for _ in range(5)]
    tasks = tuple(escher.ik.task(*stance, None) for stance in stances)
    expected = sum(escher.ik.solve(*stance).ok for stance in stances)
    assert count_found(escher.ik.model, tasks, escher.ik.options, False, escher.ik.model.q_nominal) == expected


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_the_guess_stands_over_the_feet_with_its_centre_of_mass_in_the_polygon(escher, seed):
    X_WE, active, region = random_stance(np.random.default_rng(seed), 2, reach=0.8)
    q = escher.ik.model.q_nominal.copy()
    guess_posture(escher.ik.model, escher.ik.task(X_WE, active, region, None), 0.0, 0.0, q)
    com = escher.ik.kinematics.com(q)
    assert shapely.Polygon(region).distance(shapely.Point(com[:2])) < 1e-9
    assert (np.linalg.norm(q[4:7] - X_WE[:2, :3, 3], axis=1) < 1.2).all()
    forward = X_WE[0, :2, 0] / np.linalg.norm(X_WE[0, :2, 0]) + X_WE[1, :2, 0] / np.linalg.norm(X_WE[1, :2, 0])
    X_WB = escher.ik.kinematics.body_pose(q, "pelvis")
    assert np.cross(np.append(forward, 0), X_WB[:3, 0])[2] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda X, a, r: (X[:3], a, r), "X_WE"),
        (lambda X, a, r: (np.full_like(X, np.nan), a, r), "X_WE"),
        (lambda X, a, r: (X, a[:2], r), "active"),
        (lambda X, a, r: (X, a, r[:2]), "region"),
        (lambda X, a, r: (X, a, r * np.inf), "region"),
        (lambda X, a, r: (X, a, r, np.zeros(7)), "q_seed"),
    ],
)
def test_malformed_tasks_are_refused(escher, change, match):
    with pytest.raises(ValueError, match=match):
        escher.ik.solve(*change(*random_stance(np.random.default_rng(0), 2)))


def test_another_robot_needs_only_its_data():
    pytest.importorskip("jvrc_description")
    robot = load_robot("jvrc1")
    setup = Setup(WholeBodyIK(robot), build_plant(robot))
    rng = np.random.default_rng(2)
    found = 0
    for _ in range(15):
        task = random_stance(rng, 2, reach=0.7)
        answer = setup.ik.solve(*task)
        if answer.ok:
            found += 1
            assert_held(setup, task, answer.q)
            assert setup.penetration(answer.q) < 5e-3
    assert found >= 13


def snopt_finds(setup, task):
    """Whether Drake's InverseKinematics finds a posture (verified), and the time of its first attempt [s]."""
    X_WE, active, region = task
    plant = setup.built.plant
    world = plant.world_frame()
    for drop in (0.0, 0.15):
        q_guess = setup.ik.model.q_nominal.copy()
        guess_posture(setup.ik.model, setup.ik.task(X_WE, active, region, None), drop, 0.0, q_guess)
        context = plant.GetMyContextFromRoot(setup.built.new_context())
        program = InverseKinematics(plant, context, True)
        q, prog = program.q(), program.prog()
        for e in np.flatnonzero(active):
            frame, p, R = plant.GetFrameByName(EFFECTORS[e]), X_WE[e, :3, 3], RotationMatrix(X_WE[e, :3, :3])
            program.AddPositionConstraint(frame, np.zeros(3), world, p - 5e-4, p + 5e-4)
            program.AddOrientationConstraint(world, R, frame, RotationMatrix(), np.deg2rad(0.15))
        com = prog.NewContinuousVariables(3)
        prog.AddConstraint(ComPositionConstraint(plant, None, world, context), np.r_[q, com])
        edges = np.roll(region, -1, axis=0) - region
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
        bounds = (normals * region).sum(axis=1)
        prog.AddLinearConstraint(normals, np.full(len(bounds), -np.inf), bounds, com[:2])
        prog.AddQuadraticErrorCost(np.diag(np.r_[np.zeros(7), np.full(len(q) - 7, 0.01)]), q_guess, q)
        prog.SetInitialGuess(q, q_guess)
        prog.SetInitialGuess(com, setup.ik.kinematics.com(q_guess))
        answer = SnoptSolver().Solve(prog).GetSolution(q)
        position, angle, outside, beyond = setup.misses(task, answer)
        if position < 1.01e-3 and angle < np.deg2rad(0.21) and outside < 1e-4 and beyond < 1e-4:
            return True
    return False


@pytest.mark.slow
@pytest.mark.parametrize("num_contacts", [2, 3, 4])
def test_few_postures_that_snopt_finds_are_missed(escher, num_contacts):
    rng = np.random.default_rng(num_contacts)
    tasks = [random_stance(rng, num_contacts, reach=1.3) for _ in range(100)]
    ours = np.array([escher.ik.solve(*task).ok for task in tasks])
    theirs = np.array([snopt_finds(escher, task) for task in tasks])
    missed = np.sum(theirs & ~ours) / max(np.sum(theirs), 1)
    assert theirs.sum() > 50
    assert missed <= 0.02
