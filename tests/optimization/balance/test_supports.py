"""A sole that rests on part of itself, or on several things: forces act at the corners of what touches, nowhere else."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from optimization.balance.balance_regions import balance_region, contact_arrays
from optimization.balance.friction import CONES, FrictionCone
from optimization.balance.reference_program import StaticEquilibriumProgram
from optimization.balance.static_equilibrium import is_balanced
from scenes.contact import Contact, contact_pose, patch_corners, support_corners
from scenes.robots.robot import load_robot

ROBOT = load_robot("escher")
HALF = np.array(ROBOT.effectors[0].half_extent)
WHOLE = patch_corners(HALF)
FRONT = np.array([[HALF[0], HALF[1]], [0.0, HALF[1]], [0.0, -HALF[1]], [HALF[0], -HALF[1]]])
EIGHT = 0.9 * HALF[1] * np.stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)], axis=1)
EXACT = 1e-9  # [m]


def sole(support, point=(0.3, -0.2, 0.1), yaw=0.4, tilt=0.0, friction=0.5):
    normal = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    return Contact("left_foot", 0, contact_pose("left_foot", np.array(point), normal, yaw), friction, yaw, support)


def area(contacts, cone=FrictionCone.INNER):
    return shapely.Polygon(balance_region(contacts, ROBOT, cone))


@pytest.mark.parametrize("support", [FRONT, EIGHT, EIGHT[:3]])
def test_over_a_level_support_the_centre_of_mass_may_rest_and_nowhere_else(support):
    contact = sole(support)
    seen = contact.p_WC[:2] + support @ contact.R_WC[:2, :2].T
    assert area([contact]).symmetric_difference(shapely.Polygon(seen)).area < EXACT


def test_half_a_sole_carries_the_moment_up_to_its_edge_and_not_more():
    """m g d about the middle of the sole, d the distance of the centre of mass: as far as the half reaches."""
    arrays = contact_arrays([sole(FRONT, point=(0, 0, 0), yaw=0.0)], ROBOT)
    for d in (1e-6, 0.5 * HALF[0], HALF[0] - 1e-6):
        assert is_balanced(*arrays, np.array([d, 0.0]))
    for d in (-1e-6, HALF[0] + 1e-6):
        assert not is_balanced(*arrays, np.array([d, 0.0]))


@pytest.mark.parametrize("cone", CONES)
@pytest.mark.parametrize("tilt", [0.0, 0.2])
def test_a_sole_across_two_bars_is_as_good_as_their_hull(cone, tilt):
    """Forces on both bars add up to what forces at the corners of the hull add up to."""
    bars = [np.array([[x + 0.01, 0.04], [x - 0.01, 0.04], [x - 0.01, -0.04], [x + 0.01, -0.04]]) for x in (-0.07, 0.08)]
    hull = np.array([[0.09, 0.04], [-0.08, 0.04], [-0.08, -0.04], [0.09, -0.04]])
    limited = dataclasses.replace(ROBOT, force_limit=(9.0, 9.0, 0.6, 0.6))  # two contacts have two limits
    apart = [
        dataclasses.replace(sole(bar, tilt=tilt), effector=e)
        for bar, e in zip(bars, ("left_foot", "right_foot"), strict=True)
    ]
    apart = shapely.Polygon(balance_region(apart, limited, cone))
    together = shapely.Polygon(balance_region([sole(hull, tilt=tilt)], limited, cone))
    assert together.area > 1e-3
    assert apart.symmetric_difference(together).area < 1e-8


@given(st.integers(0, 10_000))
def test_a_support_that_is_the_whole_patch_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    yaw, tilt = rng.uniform(-3, 3), rng.uniform(-0.3, 0.3)
    both = [balance_region([sole(support, yaw=yaw, tilt=tilt)], ROBOT) for support in (None, WHOLE)]
    assert np.array_equal(*both)


@given(st.integers(0, 10_000), st.sampled_from(CONES))
def test_supports_of_different_size_agree_with_the_reference_program(seed, cone):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(5, 9)))
    points = HALF * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    corners = shapely.orient_polygons(shapely.MultiPoint(points).convex_hull)
    support = shapely.get_coordinates(corners)[:-1]
    left = sole(support, tilt=rng.uniform(-0.2, 0.2), yaw=rng.uniform(-1, 1))
    X = contact_pose("right_foot", np.array([0.2, -0.5, 0.2]), np.array([0.0, 0.0, 1.0]), 0.0)
    contacts = [left, Contact("right_foot", 0, X, 0.5)]
    region, program = balance_region(contacts, ROBOT, cone), StaticEquilibriumProgram(contacts, ROBOT, cone)
    for direction in ((1.0, 0.2), (-0.6, 1.0), (0.1, -1.0)):
        assert program.farthest(np.array(direction)) @ direction == pytest.approx((region @ direction).max(), abs=1e-6)


def test_less_support_never_carries_more():
    contacts = [
        sole(None, tilt=0.1),
        Contact("left_palm", 0, contact_pose("left_palm", np.array([0.4, 0.4, 1.2]), np.array([0, -1.0, 0]), 0.0), 0.6),
    ]
    less = [sole(FRONT, tilt=0.1), contacts[1]]
    assert area(contacts).buffer(1e-7).contains(area(less))
    assert area(less).area < 0.9 * area(contacts).area


def test_what_is_no_convex_polygon_is_refused():
    for wrong in (FRONT[::-1], FRONT[:2], np.vstack([FRONT, FRONT]), FRONT[[0, 2, 1, 3]], np.full((4, 2), np.nan)):
        with pytest.raises(ValueError, match="support"):
            sole(wrong)


def test_contacts_differ_where_their_supports_do():
    assert sole(FRONT) == sole(FRONT.copy())
    assert len({sole(None), sole(FRONT), sole(FRONT.copy()), sole(EIGHT)}) == 3


def test_rows_of_fewer_corners_repeat_their_last():
    corners = support_corners([sole(None), sole(EIGHT)], ROBOT.half_extents)
    assert corners.shape == (2, 8, 2)
    assert np.array_equal(corners[0, 4:], np.tile(WHOLE[3], (4, 1)))
    assert np.array_equal(corners[1], EIGHT)
