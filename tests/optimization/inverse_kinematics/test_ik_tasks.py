"""Rows of an IK step against dense algebra, and the step's promise against the cost it is about."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from optimization.convex.box_qp import solve_box_qp
from optimization.inverse_kinematics.ik_tasks import (
    add_diagonal,
    add_frame_task,
    add_inequality,
    add_row,
    edge_normal,
    frame_error,
    make_program,
    predicted_gain,
)
from optimization.multibody.kinematics import Kinematics
from scenes.effector import EFFECTORS
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot

SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def kinematics():
    return Kinematics.from_plant(build_plant(load_robot("escher")).plant, EFFECTORS)


def random_positions(rng, kinematics):
    q = rng.uniform(-1, 1, kinematics.num_positions)
    q[:4] /= np.linalg.norm(q[:4])
    return q


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, effector=st.integers(0, 3))
def test_frame_task_is_the_weighted_square_of_the_jacobian(kinematics, seed, effector):
    rng = np.random.default_rng(seed)
    q, error = random_positions(rng, kinematics), rng.standard_normal(6)
    R, p = kinematics.link_poses(q)
    program = make_program(33, 0)
    add_frame_task(kinematics.tree, R, p, effector, error, 0.5, 2.0, program)
    J, W = kinematics.effector_jacobians(q)[effector], np.diag([0.25] * 3 + [4.0] * 3)
    np.testing.assert_allclose(np.triu(program.H), np.triu(J.T @ W @ J), atol=1e-12)
    np.testing.assert_allclose(program.g, J.T @ W @ error, atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_a_small_step_along_the_error_reaches_the_target(kinematics, seed):
    rng = np.random.default_rng(seed)
    q, v = random_positions(rng, kinematics), 1e-4 * rng.standard_normal(33)
    X_WE = kinematics.effector_poses(kinematics.integrate(q, v, 1.0))
    R, p = kinematics.link_poses(q)
    error = np.empty(6)
    for e in range(4):
        frame_error(kinematics.tree, R, p, e, X_WE[e], error)
        np.testing.assert_allclose(error, kinematics.effector_jacobians(q)[e] @ v, atol=1e-6)


def random_program(rng, n, rows):
    """A least-squares problem with inequality rows, and the cost that it stands for, written out."""
    program = make_program(n, rows)
    A, e, w = rng.standard_normal((n + 2, n)), rng.standard_normal(n + 2), rng.uniform(0.1, 2, n + 2)
    G, b = rng.standard_normal((rows, n)), rng.standard_normal(rows)
    for row, error, weight in zip(A, e, w, strict=True):
        add_row(row, error, weight, program)
    add_diagonal(1, 0.3, 0.7, program)
    program.lower[:n], program.upper[:n] = -0.4, 0.4
    for k in range(rows):
        assert add_inequality(G[k], b[k], 1.5, k, program) == k + 1

    def cost(v):
        short = np.maximum(b - G @ v, 0.0)
        return np.sum(w**2 * (A @ v - e) ** 2) + 0.49 * (v[1] - 0.3) ** 2 + 2.25 * np.sum(short**2)

    return program, cost


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, n=st.integers(2, 12), rows=st.integers(0, 6))
def test_the_step_minimises_the_cost_it_stands_for_and_promises_its_decrease(seed, n, rows):
    rng = np.random.default_rng(seed)
    program, cost = random_program(rng, n, rows)
    assert solve_box_qp(program.H, program.g, program.lower, program.upper, n + rows, program.side, program.x, 200) > 0
    best = cost(program.x[:n])
    assert predicted_gain(program, n, n + rows, 1.0) == pytest.approx(cost(np.zeros(n)) - best, rel=1e-7, abs=1e-9)
    for _ in range(50):
        nearby = np.clip(program.x[:n] + rng.normal(0, 10.0 ** rng.uniform(-4, 0), n), -0.4, 0.4)
        assert cost(nearby) >= best - 1e-10


def test_a_full_program_takes_no_more_rows():
    program = make_program(3, 1)
    assert add_inequality(np.ones(3), 1.0, 1.0, 0, program) == 1
    before = program.H.copy()
    assert add_inequality(np.ones(3), 1.0, 1.0, 1, program) == 1
    np.testing.assert_array_equal(program.H, before)


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, corners=st.integers(3, 12))
def test_edge_normals_describe_the_polygon(seed, corners):
    rng = np.random.default_rng(seed)
    hull = shapely.MultiPoint(rng.uniform(-1, 1, (corners, 2))).convex_hull
    region = np.array(shapely.geometry.polygon.orient(hull, 1.0).exterior.coords)[:-1]
    region = np.repeat(region, 1 + (np.arange(len(region)) == 0), axis=0)  # one vertex twice: an edge of no length
    normal = np.empty(2)
    for point in rng.uniform(-1, 1, (20, 2)):
        outside = -np.inf
        for k in range(len(region)):
            b = edge_normal(region, k, len(region), normal)
            outside = max(outside, normal @ point - b)
        assert (outside <= 0) == hull.covers(shapely.Point(point))
        if outside <= 0:
            assert -outside == pytest.approx(hull.exterior.distance(shapely.Point(point)), abs=1e-12)
