"""Postures: what is answered holds by forward kinematics, and what cannot hold is said."""

import numpy as np
import pytest

from optimization.inverse_kinematics.drake_posture import PostureOptions, PostureSolver, half_planes, solve_posture
from scenes.effector import EFFECTORS
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import load_robot
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain

GROUND = Surface("ground", np.array([[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]], float))
WALL = Surface("wall", np.array([[-2, 0.6, 0], [2, 0.6, 0], [2, 0.6, 2], [-2, 0.6, 2]], float))
SMALL = 0.06 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])  # a region around the origin [m]


@pytest.fixture(scope="module")
def escher():
    return load_robot("escher")


@pytest.fixture(scope="module")
def solver(escher):
    return PostureSolver(build_plant(escher, Terrain((GROUND, WALL))))


def pose(p, z=(0, 0, 1), x=(1, 0, 0)):
    z = np.array(z, float) / np.linalg.norm(z)
    x = np.array(x, float) - z * (z @ np.array(x, float))
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = np.column_stack([x, np.cross(z, x), z]), p
    return X


def check_by_kinematics(solver, answer, X_WE, region):
    """Contacts, CoM, limits and distances of an answer, from a fresh context of the plant."""
    built = solver.robot_plant
    context = built.new_context()
    plant, plant_context = built.plant, built.plant.GetMyContextFromRoot(context)
    plant.SetPositions(plant_context, answer.q)
    assert np.linalg.norm(answer.q[:4]) == pytest.approx(1.0, abs=1e-12)
    assert (answer.q >= plant.GetPositionLowerLimits() - 1e-5).all()
    assert (answer.q <= plant.GetPositionUpperLimits() + 1e-5).all()
    for X_WC, body in zip(X_WE, built.effector_bodies, strict=True):
        if X_WC is not None:
            X_WF = body.EvalPoseInWorld(plant_context).GetAsMatrix4()
            np.testing.assert_allclose(X_WF[:3, 3], X_WC[:3, 3], atol=1e-3)
            np.testing.assert_allclose(X_WF[:3, :3], X_WC[:3, :3], atol=5e-3)
    if region is not None:
        A, b = half_planes(region)
        assert (A @ plant.CalcCenterOfMassPositionInWorld(plant_context)[:2] - b).max() < 1e-3
    held = {EFFECTORS[k] for k, X in enumerate(X_WE) if X is not None}
    scene = plant.get_geometry_query_input_port().Eval(plant_context)
    for pair in scene.ComputeSignedDistancePairwiseClosestPoints(0.0):
        names = {built.body_of(pair.id_A), built.body_of(pair.id_B)}
        touches = names & held and names & set(built.terrain_geometry.values())
        assert touches, f"{names} are {pair.distance} m apart"
        assert pair.distance > -2e-3


def random_stance(rng, palms):
    stride, side = rng.uniform(-0.2, 0.2), rng.uniform(0.09, 0.14)
    feet = [
        pose([s * stride, s * side, 0.0], z=(*rng.uniform(-0.25, 0.25, 2), 1), x=(1, rng.uniform(-0.2, 0.2), 0))
        for s in (1, -1)
    ]
    left = pose([rng.uniform(0.0, 0.3), 0.6, rng.uniform(1.0, 1.5)], z=(0, -1, 0), x=(0, 0, 1)) if palms > 0 else None
    right = pose([0.35, -0.4, rng.uniform(1.0, 1.4)], z=(-1, 0, 0), x=(0, 0, 1)) if palms > 1 else None
    return [*feet, left, right]


@pytest.mark.parametrize("palms", [0, 1, 2])
def test_random_stances_are_held_by_forward_kinematics(escher, palms):
    # Stones of any tilt under the feet: the plates themselves would only get in each other's way.
    floor = Surface("floor", GROUND.vertices - [0, 0, 0.3])
    solver = PostureSolver(build_plant(escher, Terrain((floor, WALL))))
    rng = np.random.default_rng(palms)
    found = 0
    for _ in range(10):
        X_WE = random_stance(rng, palms)
        answer = solver.solve(X_WE, SMALL, nominal_posture(escher))
        if answer.ok:
            found += 1
            assert answer.violations == ()
            check_by_kinematics(solver, answer, X_WE, SMALL)
    assert found >= 9


def test_the_nominal_posture_is_its_own_answer(solver, escher):
    X_WE = [pose([0, 0.1, 0]), pose([0, -0.1, 0]), None, None]
    answer = solver.solve(X_WE, SMALL, nominal_posture(escher))
    assert answer.ok
    np.testing.assert_allclose(answer.q, nominal_posture(escher), atol=1e-3)


def test_on_one_foot_the_centre_of_mass_goes_over_it(solver, escher):
    X_WE = [pose([0, 0.1, 0]), pose([0, -0.1, 0.15]), None, None]
    region = np.array([[-0.08, 0.07], [0.08, 0.07], [0.08, 0.13], [-0.08, 0.13]])
    answer = solver.solve(X_WE, region, nominal_posture(escher))
    assert answer.ok
    check_by_kinematics(solver, answer, X_WE, region)


def test_a_contact_out_of_reach_is_named(solver, escher):
    answer = solver.solve([pose([0, 0.1, 0]), pose([1.9, -0.1, 0]), None, None], None, nominal_posture(escher))
    assert not answer.ok
    assert any("foot position" in v.name for v in answer.violations)
    assert all(v.value > v.limit for v in answer.violations)


def test_a_balance_region_out_of_reach_is_named(solver, escher):
    answer = solver.solve(
        [pose([0, 0.1, 0]), pose([0, -0.1, 0]), None, None], SMALL + np.array([1.0, 0.0]), nominal_posture(escher)
    )
    assert not answer.ok
    assert answer.violations


def test_the_robot_ducks_under_a_beam_where_its_head_was(escher):
    beam = Box("beam", np.array([0.3, 2.0, 0.2]), pose([0.0, 0.0, 1.62]))
    under = PostureSolver(build_plant(escher, Terrain((GROUND,), (beam,))))
    X_WE = [pose([0, 0.1, 0]), pose([0, -0.1, 0]), None, None]
    assert any("beam" in v.name for v in under.violations(nominal_posture(escher), X_WE, None))
    answer = under.solve(X_WE, SMALL, nominal_posture(escher))
    assert answer.ok
    check_by_kinematics(under, answer, X_WE, SMALL)


def test_a_posture_inside_the_wall_is_no_posture(solver, escher):
    X_WE = [pose([0, 0.5, 0]), pose([0, 0.3, 0]), None, None]
    q = nominal_posture(escher).copy()
    q[5] += 0.4
    assert any("wall" in v.name for v in solver.violations(q, X_WE, None))


def test_held_soles_may_touch_their_ground_and_free_ones_may_not(solver, escher):
    feet = [pose([0, 0.1, 0]), pose([0, -0.1, 0])]
    assert solver.violations(nominal_posture(escher), [*feet, None, None], None) == ()
    named = [v.name for v in solver.violations(nominal_posture(escher), [feet[0], None, None, None], None)]
    assert named
    assert all("right_foot" in n and "ground" in n for n in named)


def test_a_frame_turned_by_half_a_turn_is_no_answer(solver, escher):
    # The six rows of a contact are kept by a frame with x and z reversed as well.
    X_WE = [pose([0, 0.1, 0]), pose([0, -0.1, 0], x=(-1, 0, 0)), None, None]
    assert not solver.solve(X_WE, None, nominal_posture(escher)).ok


def test_an_answer_starts_the_next_search_well(solver, escher):
    rng = np.random.default_rng(5)
    X_WE = random_stance(rng, 1)
    first = solver.solve(X_WE, SMALL, nominal_posture(escher))
    again = solver.solve(X_WE, SMALL, first.q)
    assert first.ok
    assert again.ok
    assert np.abs(again.q - first.q).max() < 5e-3


def test_clearance_is_kept_where_it_is_asked_for(escher):
    built = build_plant(escher, Terrain((GROUND, WALL)))
    X_WE = [pose([0, 0.22, 0]), pose([0, 0.02, 0]), None, None]
    near = nominal_posture(escher).copy()
    near[5] += 0.12  # the left elbow is at the wall
    wide = solve_posture(built, X_WE, None, near, PostureOptions(min_distance=0.04))
    assert wide.ok
    context = built.new_context()
    plant_context = built.plant.GetMyContextFromRoot(context)
    built.plant.SetPositions(plant_context, wide.q)
    scene = built.plant.get_geometry_query_input_port().Eval(plant_context)
    to_wall = [
        p.distance
        for p in scene.ComputeSignedDistancePairwiseClosestPoints(0.2)
        if "wall" in (built.body_of(p.id_A), built.body_of(p.id_B))
    ]
    assert min(to_wall) > 0.039


@pytest.mark.parametrize(
    "spoil",
    [
        lambda X, r, q: (X, r, np.where(np.arange(len(q)) == 9, np.nan, q)),
        lambda X, r, q: ([X[0] * np.nan, *X[1:]], r, q),
        lambda X, r, q: (X, r * np.inf, q),
        lambda X, r, q: (X, r[:2], q),
        lambda X, r, q: (X[:2], r, q),
        lambda X, r, q: (X, r, q[:-1]),
    ],
)
def test_data_that_is_not_finite_never_reaches_the_solver(solver, escher, spoil):
    X_WE = [pose([0, 0.1, 0]), pose([0, -0.1, 0]), None, None]
    with pytest.raises(ValueError, match=r"finite|entries|polygon"):
        solver.solve(*spoil(X_WE, SMALL, nominal_posture(escher).copy()))


def test_half_planes_measure_metres_outside_a_polygon():
    A, b = half_planes(np.array([[0, 0], [2, 0], [2, 1], [0, 1]], float))
    np.testing.assert_allclose((A @ [1.0, 0.5] - b).max(), -0.5)
    np.testing.assert_allclose((A @ [2.3, 0.5] - b).max(), 0.3)
