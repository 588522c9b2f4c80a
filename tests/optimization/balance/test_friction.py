"""Friction cones: closed forms, two descriptions of one cone, and patches against sums of corner forces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from optimization.balance.friction import (
    CONES,
    FrictionCone,
    cone_generators,
    cone_rows,
    contains,
    corner_points,
    stands_alone,
    wrench_rows,
)
from scenes.contact import contact_rotation
from scenes.input_error import InputError

POLYHEDRAL = ("inner", "square", "diamond")
NEAR = 1e-6  # an order above HiGHS's feasibility tolerance: nearer to a face its verdict says nothing
FRICTION = st.floats(0.05, 1.5)


def true_cone_excess(mu, f):
    return np.hypot(f[..., 0], f[..., 1]) - mu * f[..., 2]


def largest_tilt(cone, mu, direction):
    """Largest tangent that the cone allows in a direction of the contact plane."""
    rows = cone_rows(cone, mu)[:-1]
    across = rows[:, :2] @ [np.cos(direction), np.sin(direction)]
    return np.min(-rows[across > 1e-9, 2] / across[across > 1e-9])


@pytest.mark.parametrize("cone", CONES)
@settings(deadline=None)  # the first call loads compiled code
@given(mu=FRICTION)
def test_every_generator_lies_on_a_face_and_outside_none(cone, mu):
    out = cone_generators(cone, mu) @ cone_rows(cone, mu)[:-1].T
    assert out.max() <= 1e-12
    assert np.allclose(np.sort(out, axis=1)[:, -2:], 0.0, atol=1e-12)  # each ray joins two faces
    assert (cone_generators(cone, mu)[:, 2] == 1.0).all()


@pytest.mark.parametrize("cone", POLYHEDRAL)
@settings(deadline=None)  # the first call loads compiled code
@given(mu=FRICTION, f=st.tuples(*[st.floats(-2, 2)] * 3))
def test_contains_is_membership_in_the_rows(cone, mu, f):
    out = (cone_rows(cone, mu) @ f).max()
    assert contains(cone, mu, f, tol=out + 1e-12)
    assert not contains(cone, mu, f, tol=out - 1e-12)


@pytest.mark.parametrize("cone", ["inner", "square", "second_order"])
def test_inscribed_cones_never_exceed_coulomb_friction_and_touch_it(cone):
    out = true_cone_excess(0.5, cone_generators(cone, 0.5))
    assert np.allclose(out, 0.0, atol=1e-12)


def test_diamond_exceeds_coulomb_friction_by_41_percent():
    tangential = np.linalg.norm(cone_generators("diamond", 0.5)[:, :2], axis=1)
    assert np.allclose(tangential / 0.5, np.sqrt(2))
    assert contains("diamond", 0.5, [0.7, 0.0, 1.0])
    assert not contains("second_order", 0.5, [0.7, 0.0, 1.0])


def test_octagon_holds_24_8_degrees_and_square_19_5_along_the_foot():
    worst = min(largest_tilt("inner", 0.5, a) for a in np.linspace(0, 2 * np.pi, 721))
    assert np.rad2deg(np.arctan(worst)) == pytest.approx(24.8, abs=0.05)
    assert np.rad2deg(np.arctan(largest_tilt("square", 0.5, 0.0))) == pytest.approx(19.47, abs=0.01)
    assert np.rad2deg(np.arctan(largest_tilt("inner", 0.5, 0.0))) == pytest.approx(26.57, abs=0.01)


def test_second_order_is_the_true_cone_and_its_rows_stay_inside():
    rng = np.random.default_rng(0)
    f = rng.normal(size=(2000, 3))
    assert (contains("second_order", 0.6, f) == (true_cone_excess(0.6, f) <= 1e-9) & (f[:, 2] >= -1e-9)).all()
    inside_16 = (f @ cone_rows("second_order", 0.6).T <= 0).all(axis=1)
    assert inside_16.any()
    assert contains("second_order", 0.6, f[inside_16]).all()


@pytest.mark.parametrize("cone", CONES)
def test_nothing_pulls_and_nothing_slides_without_friction(cone):
    assert not contains(cone, 0.5, [0.0, 0.0, -1.0])
    assert contains(cone, 0.5, [0.0, 0.0, 0.0])
    assert contains(cone, 0.0, [0.0, 0.0, 1.0])
    assert not contains(cone, 0.0, [1e-3, 0.0, 1.0])
    assert not contains(cone, 0.5, [np.nan, 0.0, 1.0])
    assert not contains(cone, np.nan, [0.0, 0.0, 1.0])


def test_contains_broadcasts_friction_over_forces():
    f = np.array([[0.4, 0.0, 1.0], [0.4, 0.0, 1.0]])
    assert contains("inner", [0.3, 0.5], f).tolist() == [False, True]
    assert contains("inner", 0.5, f[0]).shape == ()


def test_unknown_cone_is_named_with_its_neighbours():
    with pytest.raises(InputError, match="second_order"):
        FrictionCone("second")
    with pytest.raises(ValueError, match="friction"):
        cone_generators("inner", -0.1)


@settings(deadline=None)  # the first call loads compiled code
@given(mu=st.floats(0.1, 1.0), tilt=st.floats(0.0, 1.0), towards=st.floats(-np.pi, np.pi), yaw=st.floats(-np.pi, np.pi))
def test_a_foot_stands_alone_on_a_slope_exactly_when_the_vertical_is_in_its_cone(mu, tilt, towards, yaw):
    normal = np.array([np.sin(tilt) * np.cos(towards), np.sin(tilt) * np.sin(towards), np.cos(tilt)])
    R_WC = contact_rotation("left_foot", normal, yaw)
    if abs(np.tan(tilt) - mu) > 1e-9:
        assert stands_alone("second_order", mu, R_WC) == (np.tan(tilt) < mu)
    for cone in POLYHEDRAL:
        out = (cone_rows(cone, mu) @ R_WC.T @ [0.0, 0.0, 1.0]).max()
        if abs(out) > 1e-9:
            assert stands_alone(cone, mu, R_WC[None])[0] == (out < 0)


def corner_wrenches(mu, half_extent, cone="square"):
    """(6, 16) wrenches of unit normal force that four corner forces generate."""
    p, g = corner_points(half_extent), cone_generators(cone, mu)
    return np.array([[*f, *np.cross(c, f)] for c in p for f in g]).T


def test_seventeen_rows_describe_exactly_the_sums_of_four_corner_forces():
    rng = np.random.default_rng(1)
    half_extent, mu = (0.11, 0.05), 0.5
    rows, columns = wrench_rows(mu, half_extent), corner_wrenches(mu, half_extent)
    inside = 0
    for _ in range(600):
        # Around the boundary: a random combination of generators pushed outwards by a random amount.
        wrench = columns @ (rng.exponential(size=16) * (rng.random(16) < 0.25))
        wrench += rng.normal(size=6) * 0.05 * np.array([1, 1, 1, 0.1, 0.1, 0.1])
        out = (rows @ wrench).max()
        if abs(out) < NEAR:
            continue
        answer = linprog(np.zeros(16), A_eq=columns, b_eq=wrench, method="highs")
        assert (answer.status == 0) == (out < 0), (out, answer.message)
        inside += out < 0
    assert 100 < inside < 500


@settings(deadline=None)  # the first call loads compiled code
@given(mu=st.floats(0.05, 1.2), hx=st.floats(0.01, 0.3), hy=st.floats(0.01, 0.3), seed=st.integers(0, 10**6))
def test_no_sum_of_corner_forces_breaks_a_wrench_row_and_every_row_is_reached(mu, hx, hy, seed):
    rows, columns = wrench_rows(mu, (hx, hy)), corner_wrenches(mu, (hx, hy))
    out = rows @ columns
    assert out.max() <= 1e-12
    assert np.allclose(out[np.r_[0:4, 5:17]].max(axis=1), 0.0, atol=1e-12)
    weights = np.random.default_rng(seed).random(16)
    assert (rows @ columns @ weights).max() <= 1e-11


def test_yaw_torque_of_a_centred_load_is_friction_times_the_lever_of_the_corners():
    """All corners slide about the centre: m = mu/sqrt(2), mz = m (X + Y) fz."""
    rows, m = wrench_rows(0.5, (0.1, 0.05)), 0.5 / np.sqrt(2)
    limit = m * 0.15
    assert (rows @ [0, 0, 1, 0, 0, limit]).max() == pytest.approx(0.0, abs=1e-12)
    assert (rows @ [0, 0, 1, 0, 0, limit + 1e-6]).max() > 0
