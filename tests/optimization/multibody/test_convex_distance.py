"""Distances of convex hulls against closed forms and a least squares twin; of robots against Drake."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from optimization.inverse_kinematics.whole_body_ik import WholeBodyIK
from optimization.multibody.convex_distance import hull_distance, way_out
from optimization.multibody.robot_shapes import read_shapes, some_corners
from optimization.multibody.self_distance import near_itself
from optimization.multibody.terrain_distance import near_terrain, shape_distance
from scenes.library import NAMED_SCENES
from scenes.robots.plant import build_plant
from scenes.robots.robot import Robot, load_robot
from scenes.terrain.packed_terrain import pack_terrain, polygon_names
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

EXACT = 1e-8  # [m] ten times where the bounds of the algorithm meet
DRAKE = 4e-3  # [m] how far Drake's own distances of separated boxes and capsules are off
FLOOR = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])


@pytest.fixture(scope="module")
def escher() -> Robot:
    return load_robot("escher")


def distance(A: np.ndarray, B: np.ndarray, most: float = np.inf) -> tuple[float, np.ndarray, np.ndarray]:
    p_A, p_B = np.full(3, np.nan), np.full(3, np.nan)
    return hull_distance(A, len(A), B, len(B), most, p_A, p_B), p_A, p_B


def least_squares_distance(A: np.ndarray, B: np.ndarray) -> float:
    """The same by convex combinations in a nonnegative least squares problem: another algorithm, another library."""
    heavy = 1e4  # makes the two rows that ask for weights of sum one all but exact
    rows = np.vstack([np.hstack([A.T, -B.T]), np.zeros((2, len(A) + len(B)))])
    rows[3, : len(A)] = rows[4, len(A) :] = heavy
    x, _ = nnls(rows, np.array([0.0, 0, 0, heavy, heavy]), maxiter=10_000)
    a, b = x[: len(A)], x[len(A) :]
    return float(np.linalg.norm(A.T @ (a / a.sum()) - B.T @ (b / b.sum())))


def test_a_cube_over_a_floor_is_as_far_as_its_lowest_corner() -> None:
    cube = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (0.3, 0.5)])
    d, p_A, p_B = distance(cube, FLOOR)
    assert d == pytest.approx(0.3, abs=EXACT)
    np.testing.assert_allclose(p_A - p_B, [0, 0, 0.3], atol=EXACT)


@pytest.mark.parametrize("scale", [1.0, 20.0, 400.0])
def test_the_size_of_a_floor_does_not_matter(scale: float) -> None:
    capsule = np.array([[0.2, 0.1, 0.05], [0.3, -0.4, 0.25]])
    assert distance(capsule, scale * FLOOR)[0] == pytest.approx(0.05, abs=1e-7)


def test_distances_equal_those_of_nonnegative_least_squares() -> None:
    rng = np.random.default_rng(0)
    overlaps = 0
    for k in range(600):
        A = rng.normal(size=(rng.integers(1, 12), 3)) * rng.choice([0.01, 0.1, 1.0])
        B = rng.normal(size=(rng.integers(3, 10), 3)) * rng.choice([0.01, 1.0, 100.0])
        B[:, 2] *= k % 2  # every other one is flat
        A, B = np.round(A, 1 + k % 7), B + rng.normal(size=3) * rng.choice([0.0, 0.1, 3.0])
        d, p_A, p_B = distance(A, B)
        assert d == pytest.approx(least_squares_distance(A, B), abs=1e-7)
        overlaps += d == 0.0
        if d > 0.0:
            assert np.linalg.norm(p_A - p_B) == pytest.approx(d, abs=EXACT)
            # The witnesses certify the distance: the planes through them, square to their difference, hold the hulls.
            n = (p_A - p_B) / d
            slack = EXACT * (1.0 + np.abs(B).max())
            assert ((A - p_A) @ n).min() > -slack and ((B - p_B) @ n).max() < slack
    assert 50 < overlaps < 550


def test_what_is_further_than_asked_is_infinitely_far() -> None:
    high = FLOOR + np.array([0.0, 0.0, 0.5])
    assert distance(high, FLOOR, 0.4)[0] == np.inf
    assert distance(high, FLOOR, 0.6)[0] == pytest.approx(0.5, abs=EXACT)


def test_the_way_out_parts_what_overlaps() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        A, B = rng.normal(size=(8, 3)), rng.normal(size=(8, 3))
        p_A, p_B, n = np.empty(3), np.empty(3), np.empty(3)
        if distance(A, B)[0] > 0.0:
            continue
        way = way_out(A, 8, B, 8, p_A, p_B, n)
        assert np.linalg.norm(n) == pytest.approx(1.0)
        assert distance(A + (way + 1e-6) * n, B)[0] > 0.0
        np.testing.assert_allclose(p_B - p_A, way * n, atol=1e-12)


def test_a_box_slightly_in_another_leaves_by_the_nearest_side() -> None:
    box = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.2, 0.2) for z in (-0.1, 0.1)])
    n = np.empty(3)
    for axis, half in enumerate((0.3, 0.2, 0.1)):
        shift = np.eye(3)[axis] * (2 * half - 0.01)
        assert way_out(box + shift, 8, box, 8, np.empty(3), np.empty(3), n) == pytest.approx(0.01, abs=1e-9)
        np.testing.assert_allclose(n, np.eye(3)[axis], atol=1e-6)


def postures(robot: Robot, num: int) -> np.ndarray:
    """Random postures about the nominal one, over two metres of terrain."""
    rng, q = np.random.default_rng(2), np.tile(build_plant(robot).nominal_positions(), (num, 1))
    q[:, 7:] += 0.25 * rng.normal(size=(num, q.shape[1] - 7))
    q[:, 4:7] += rng.uniform([0, -0.5, -0.05], [2, 0.5, 0.3], (num, 3))
    return q


@pytest.mark.parametrize("name", ["escher", "g1", "talos"])
def test_distances_of_a_robot_are_those_that_drake_measures(name: str) -> None:
    """The same pairs come near, and as near; where bodies overlap ours is never shallower than Drake's depth."""
    seen, robot = 0.1, load_robot(name)
    scene, ik, q = NAMED_SCENES["rubble_corridor"](0), WholeBodyIK(robot), postures(robot, 25)
    packed, names = pack_terrain(scene.terrain), polygon_names(scene.terrain)
    shapes, bodies = read_shapes(build_plant(robot), ik.kinematics)
    drawn = DRAKE + 2 * shapes.thicker.max()  # [m] ours may be nearer by so much
    own: dict[tuple, float] = {}
    met = near_itself(ik.kinematics.tree, shapes, q, seen)
    hit = near_terrain(ik.kinematics.tree, shapes, packed, q, seen)
    found = [(t, bodies[a], bodies[b], d) for t, (a, b), d in zip(met.row, met.shape, met.distance, strict=True)]
    found += [
        (t, bodies[s], names[k], d) for t, s, k, d in zip(hit.row, hit.shape, hit.polygon, hit.distance, strict=True)
    ]
    for t, a, b, d in found:
        key = (int(t), *sorted((a, b)))
        own[key] = min(own.get(key, np.inf), float(d))

    plant = build_plant(robot, scene.terrain)
    context = plant.new_context()
    plant_context = plant.plant.GetMyMutableContextFromRoot(context)
    scene_context = plant.scene_graph.GetMyContextFromRoot(context)
    drake: dict[tuple, float] = {}
    for t, row in enumerate(q):
        plant.plant.SetPositions(plant_context, row)
        query = plant.scene_graph.get_query_output_port().Eval(scene_context)
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(seen):
            key = (t, *sorted((plant.body_of(pair.id_A), plant.body_of(pair.id_B))))
            drake[key] = min(drake.get(key, np.inf), pair.distance)

    assert {k for k, d in own.items() if d < seen - drawn} <= set(drake)
    assert {k for k, d in drake.items() if d < seen - DRAKE} <= set(own)
    for key in set(own) & set(drake):
        if drake[key] > 1e-3:
            assert drake[key] - drawn < own[key] < drake[key] + DRAKE
        else:
            assert own[key] < drake[key] + 1e-5
    assert sum(d < 0 for d in own.values()) > 20


def test_a_foot_in_a_plate_leaves_along_the_normal_and_points_are_in_their_frames(escher: Robot) -> None:
    terrain = Terrain((Surface("floor", 5 * FLOOR, 0.5),))
    ik, q = WholeBodyIK(escher), build_plant(escher).nominal_positions()[None].copy()
    q[:, 6] -= 0.004
    shapes, bodies = read_shapes(build_plant(escher), ik.kinematics)
    hit = near_terrain(ik.kinematics.tree, shapes, pack_terrain(terrain), q, 0.01)
    assert {bodies[s] for s in hit.shape} >= {"left_foot", "right_foot"}
    np.testing.assert_allclose(hit.distance, -0.004, atol=1e-9)
    np.testing.assert_allclose(hit.normal, np.tile([0.0, 0.0, 1.0], (len(hit.row), 1)), atol=1e-12)
    R, p = ik.kinematics.link_poses(q[0])
    for s, (p_L, p_W) in zip(hit.shape, hit.point, strict=True):
        np.testing.assert_allclose(R[shapes.link[s]] @ p_L + p[shapes.link[s]], p_W - [0, 0, 0.004], atol=1e-9)


def test_a_foot_on_the_edge_of_a_leaning_plate_is_as_deep_as_the_edge_and_moved_so_far_it_is_free() -> None:
    """The plate's face leans under the foot by centimetres; only its edge is millimetres over the sole."""
    corners = [[-0.05, 0.67, -0.123], [-0.47, 0.29, -0.18], [-0.07, -0.06, -0.005], [0.255, 0.373, 0.018]]
    packed = pack_terrain(Terrain((Surface("plate", np.array(corners), 0.5),)))
    foot = np.array([[x, y, z] for x in (-0.11, 0.11) for y in (-0.05, 0.05) for z in (0.0, 0.09)])
    corner = np.array(corners[2:])
    inside = np.linspace(*corner, 200)
    inside = inside[(np.abs(inside[:, 0]) < 0.11) & (np.abs(inside[:, 1]) < 0.05)]
    p_A, p_B, n = np.zeros(3), np.zeros(3), np.zeros(3)
    depth = -shape_distance(packed, 0, foot, 8, 0.0, 0.1, np.empty((12, 3)), p_A, p_B, n)
    assert inside[:, 2].max() - 1e-6 < depth < inside[:, 2].max() + 0.004
    moved = foot + (depth + 1e-6) * n
    assert -shape_distance(packed, 0, moved, 8, 0.0, 0.1, np.empty((12, 3)), p_A, p_B, n) < 1e-5


def test_a_polygon_far_away_costs_nothing_and_is_not_met(escher: Robot) -> None:
    X_WO = np.eye(4)
    X_WO[:3, 3] = [0.0, 0.0, 4.0]
    terrain = Terrain((Surface("floor", FLOOR, 0.5),), (Box("roof", (9.0, 9.0, 0.2), X_WO),))
    ik, q = WholeBodyIK(escher), build_plant(escher).nominal_positions()[None]
    shapes, _ = read_shapes(build_plant(escher), ik.kinematics)
    hit = near_terrain(ik.kinematics.tree, shapes, pack_terrain(terrain), q, 0.05)
    assert set(hit.polygon.tolist()) == {0}


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), away=st.floats(1e-3, 0.1))
def test_the_corners_that_are_kept_have_all_others_near_their_hull(seed: int, away: float) -> None:
    p = np.random.default_rng(seed).normal(size=(200, 3))
    p *= [1.0, 0.3, 0.5] / np.linalg.norm(p, axis=1, keepdims=True)  # on an ellipsoid
    kept = some_corners(p, away)
    assert {tuple(row) for row in kept} <= {tuple(row) for row in p}
    for point in p:
        assert hull_distance(point[None], 1, kept, len(kept), np.inf, np.empty(3), np.empty(3)) <= away + 1e-9
    assert len(kept) < 200 or away < 0.02
