"""The linear inverted pendulum's capture point, against the pendulum itself integrated in small steps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import box

from optimization.capture.inverted_pendulum import (
    angular_allowance,
    capture_point,
    depth_inside,
    frequency,
    one_step_region,
    support_polygon,
)
from optimization.centroidal.options import CentroidalOptions
from scenes.contact import Contact, contact_pose
from scenes.gravity import GRAVITY
from scenes.robots.robot import load_robot
from scenes.stance import Stance

HEIGHT = 0.9
OMEGA = frequency(HEIGHT)
BEFORE, AFTER = box(-0.1, -0.05, 0.1, 0.05), box(-0.1, -0.05, 0.4, 0.4)


def _coast(
    com: np.ndarray, velocity: np.ndarray, pressure: np.ndarray, duration: float
) -> tuple[np.ndarray, np.ndarray]:
    """The pendulum over a fixed centre of pressure, by the midpoint rule: c'' = omega^2 (c - p)."""
    steps = 1000
    h = duration / steps
    for _ in range(steps):
        middle = com + h / 2 * velocity
        half = velocity + h / 2 * OMEGA**2 * (com - pressure)
        velocity = velocity + h * OMEGA**2 * (middle - pressure)
        com = com + h * half
    return com, velocity


@given(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_a_pendulum_with_its_pressure_at_the_capture_point_comes_to_rest_there(
    x: float, y: float, vx: float, vy: float
) -> None:
    com, velocity = np.array([x, y]), np.array([vx, vy])
    xi = capture_point(np.append(com, HEIGHT), np.append(velocity, 0.0))
    # Over 1.5 s, and no longer: errors of the integration grow with exp(omega t).
    com, velocity = _coast(com, velocity, xi, 1.5)
    shrunk = np.exp(-1.5 * OMEGA) * np.hypot(vx, vy) / OMEGA
    assert np.linalg.norm(com - xi) <= shrunk + 1e-3
    assert np.linalg.norm(velocity) <= OMEGA * (shrunk + 1e-3)


def test_the_capture_point_counts_the_height_over_the_ground() -> None:
    com, velocity = np.array([0.0, 0.0, 1.4]), np.array([0.3, 0.0, 0.0])
    np.testing.assert_allclose(capture_point(com, velocity, 0.5), [0.3 * np.sqrt(0.9 / GRAVITY), 0.0])


@given(st.floats(-0.1, 0.1), st.floats(-0.05, 0.05), st.floats(-0.1, 0.4), st.floats(-0.05, 0.4), st.floats(0.05, 0.8))
def test_every_point_of_the_one_step_region_is_captured_by_some_pressures(
    px: float, py: float, x: float, y: float, swing: float
) -> None:
    """xi(d) = (x, y) after the pressure stood at (px, py): run backwards it must start inside the region, and be all."""
    start = np.array([px, py]) + np.exp(-OMEGA * swing) * (np.array([x, y]) - [px, py])
    region = one_step_region(BEFORE, AFTER, swing, OMEGA)
    assert depth_inside(region, start) >= -1e-9


def test_the_corners_of_the_one_step_region_need_the_corners_of_both_supports() -> None:
    shrink = np.exp(-OMEGA * 0.4)
    expected = shrink * np.array([0.4, 0.4]) + (1 - shrink) * np.array([0.1, 0.05])
    x, y = one_step_region(BEFORE, AFTER, 0.4, OMEGA).bounds[2:]
    np.testing.assert_allclose([x, y], expected)


def test_without_time_to_fall_a_step_captures_what_its_support_holds_and_with_much_time_no_more_than_before() -> None:
    assert one_step_region(BEFORE, AFTER, 1e-9, OMEGA).symmetric_difference(AFTER).area == pytest.approx(0.0, abs=1e-6)
    assert one_step_region(BEFORE, AFTER, 9.0, OMEGA).symmetric_difference(BEFORE).area == pytest.approx(0.0, abs=1e-6)


def test_depth_is_positive_inside_and_negative_outside() -> None:
    assert depth_inside(BEFORE, np.array([0.0, 0.02])) == pytest.approx(0.03)
    assert depth_inside(BEFORE, np.array([0.4, 0.05])) == pytest.approx(-0.3)


def test_support_is_the_hull_of_the_feet_that_are_held() -> None:
    robot = load_robot("escher")
    up = np.array([0.0, 0.0, 1.0])
    left, right = (
        Contact(e, 0, contact_pose(e, np.array([0.0, y, 0.0]), up, 0.0), 0.5)
        for e, y in (("left_foot", 0.1), ("right_foot", -0.1))
    )
    one = support_polygon(Stance((left, None, None, None)), robot)
    both = support_polygon(Stance((left, right, None, None)), robot)
    np.testing.assert_allclose(one.bounds, [-0.11, 0.05, 0.11, 0.15])
    np.testing.assert_allclose(both.bounds, [-0.11, -0.15, 0.11, 0.15])


def test_the_allowance_is_what_a_constant_turning_moment_shifts_the_pressure_by() -> None:
    """With kdot at its limit for ever the effective pressure moves by kdot / (M g); storing k adds omega k / (M g)."""
    options = CentroidalOptions(
        angular_momentum_limit=(20.0, 10.0, 99.0), angular_momentum_rate_limit=(30.0, 40.0, 99.0)
    )
    assert angular_allowance(options, 70.0, OMEGA) == pytest.approx((40.0 + OMEGA * 20.0) / (70.0 * GRAVITY))
