"""Swing curves: they start and end at rest on their contacts, along the normals, and clear what is between."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drakeplan.motion.swing import SwingCurve, hover, mirrored, plan_swing, smooth_step
from scenes.contact import Contact, contact_pose
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Box, Terrain, terrain_from

SOLE, THICKNESS = (0.11, 0.05), 0.08  # [m]
H = 1e-4  # step of finite differences in u


def plate(name: str, x0: float, x1: float, z: float, y: float = 1.0) -> Surface:
    return Surface(name, np.array([[x0, -y, z], [x1, -y, z], [x1, y, z], [x0, y, z]]))


def tilted(rx: float, ry: float) -> np.ndarray:
    normal = np.array([np.sin(ry), -np.sin(rx) * np.cos(ry), np.cos(rx) * np.cos(ry)])
    return normal / np.linalg.norm(normal)


def foot(point: list[float], normal=(0.0, 0.0, 1.0), yaw: float = 0.0, effector: str = "left_foot") -> Contact:
    return Contact(effector, 0, contact_pose(effector, np.array(point), np.array(normal), yaw), 0.5)


angles = st.floats(-0.35, 0.35)


@st.composite
def curves(draw) -> SwingCurve:
    a = foot([0.0, 0.1, 0.0], tilted(draw(angles), draw(angles)), draw(angles))
    step = [draw(st.floats(-0.2, 0.5)), draw(st.floats(-0.1, 0.3)), draw(st.floats(-0.2, 0.2))]
    b = foot(step, tilted(draw(angles), draw(angles)), draw(angles))
    side = np.array([0.0, draw(st.floats(0.0, 0.15)), 0.0])
    heights, draws = st.floats(0.03, 0.3), st.sampled_from([0.0, 0.06, 0.12])
    lift, lower, travel = draw(heights), draw(heights), draw(st.sampled_from([0.1, 0.22]))
    return SwingCurve(a.X_WC, b.X_WC, lift, lower, side, travel, 0.03, draw(draws), draw(draws))


def test_the_smooth_step_has_no_slope_and_no_curvature_at_its_ends_and_is_symmetric():
    for x in (0.0, 1.0):
        s = np.array([smooth_step(x - H), smooth_step(x), smooth_step(x + H)])
        assert abs(s[2] - s[0]) / H < 1e-6
        assert abs(s[2] - 2 * s[1] + s[0]) / H**2 < 1e-2
    assert smooth_step(0.3) + smooth_step(0.7) == pytest.approx(1.0)


@settings(deadline=None)  # the first call compiles
@given(curves())
def test_a_curve_starts_and_ends_exactly_on_its_contacts_and_all_its_poses_are_rigid(curve):
    poses = curve.poses(np.linspace(0.0, 1.0, 21))
    assert np.allclose(poses[0], curve.X_WA, atol=1e-12)
    assert np.allclose(poses[-1], curve.X_WB, atol=1e-9)
    R = poses[:, :3, :3]
    assert np.allclose(R @ R.transpose(0, 2, 1), np.eye(3), atol=1e-9)
    assert np.allclose(np.linalg.det(R), 1.0)


@settings(deadline=None)  # the first call compiles
@given(curves())
def test_velocity_and_acceleration_vanish_at_both_ends_and_the_speed_is_bounded(curve):
    for u in (np.array([0.0, H, 2 * H]), np.array([1.0, 1.0 - H, 1.0 - 2 * H])):
        X = curve.poses(u)
        assert np.abs(X[1] - X[0]).max() / H < 1e-4
        assert np.abs(X[2] - 2 * X[1] + X[0]).max() / H**2 < 0.2  # jerk times H is what is left
    p = curve.poses(np.linspace(0.0, 1.0, 201))[:, :3, 3]
    speed = np.linalg.norm(np.diff(p, axis=0), axis=1).max() * 200
    way = np.linalg.norm(p[-1] - p[0])
    # 15/8 is the greatest slope of the smooth step, 2.2 that of the bump, each over its share of the swing.
    up = curve.lift + curve.lower
    bound = 1.875 * ((way + up) / 0.56 + up / 0.4 + (curve.back + curve.beyond) / 0.16)
    assert speed < bound + 2.2 / 0.56 * np.linalg.norm(curve.side) + 1e-6


@settings(deadline=None)  # the first call compiles
@given(curves())
def test_it_leaves_and_lands_along_the_surface_normals(curve):
    for X, u, height in ((curve.X_WA, 0.055, curve.lift), (curve.X_WB, 0.945, curve.lower)):
        offset = curve.poses(np.array([u]))[0, :3, 3] - X[:3, 3]
        assert offset @ X[:3, 2] == pytest.approx(np.linalg.norm(offset))
        assert 0 < offset @ X[:3, 2] < height


@settings(deadline=None)  # the first call compiles
@given(curves())
def test_walking_a_curve_backwards_visits_the_same_poses(curve):
    u = np.linspace(0.0, 1.0, 11)
    assert np.allclose(mirrored(curve).poses(u), curve.poses(1.0 - u), atol=1e-9)


def lowest_sole_point_over(poses: np.ndarray, x0: float, x1: float) -> float:
    """Least height of the sole's outline [m] over the strip x0 <= x <= x1, sampled densely."""
    edge = np.linspace(-1.0, 1.0, 23)
    outline = np.array([[sx * SOLE[0], sy * SOLE[1], 0.0, 1.0] for sx in edge for sy in (-1, 1)])
    points = (poses @ outline.T).transpose(0, 2, 1).reshape(-1, 4)
    over = (points[:, 0] >= x0) & (points[:, 0] <= x1)
    return points[over, 2].min()


@settings(deadline=None, max_examples=20)
@given(st.floats(0.02, 0.22), st.floats(0.0, 0.1))
def test_the_whole_sole_stays_above_a_step_of_known_height(height, gap):
    riser = 0.11 + gap
    packed = pack_terrain(terrain_from([plate("low", -1, riser, 0.0), plate("high", riser, 2, height)]))
    up = plan_swing(packed, foot([0, 0.1, 0]), foot([riser + 0.13, 0.1, height]), SOLE, THICKNESS)
    down = plan_swing(packed, foot([riser + 0.13, 0.1, height]), foot([0, 0.1, 0]), SOLE, THICKNESS)
    for curve in (up, down):
        assert curve.clear
        poses = curve.poses(np.linspace(0.0, 1.0, 201))
        assert lowest_sole_point_over(poses, riser + 0.004, 2.0) > height - 0.004
        assert lowest_sole_point_over(poses[40:-40], riser + 0.004, 2.0) > height


def test_it_steps_over_an_obstacle_between_two_footholds_with_the_clearance():
    bar = Box("bar", np.array([0.05, 2.0, 0.2]), contact_pose("left_foot", [0.25, 0, 0.1], np.array([0, 0, 1.0]), 0))
    packed = pack_terrain(Terrain((plate("ground", -1, 2, 0.0),), (bar,)))
    curve = plan_swing(packed, foot([0, 0.1, 0]), foot([0.5, 0.1, 0]), SOLE, THICKNESS, clearance=0.02)
    assert curve.clear
    assert lowest_sole_point_over(curve.poses(np.linspace(0, 1, 201)), 0.225, 0.275) > 0.2 + 0.018


def test_a_foot_draws_back_from_under_an_overhang_and_goes_past_one_before_it_lands():
    terrain = pack_terrain(terrain_from([plate("low", -1, 0.3, 0.0), plate("shelf", 0.08, 2, 0.2)]))
    below, above = foot([0, 0.1, 0]), foot([0.25, 0.1, 0.2])
    up = plan_swing(terrain, below, above, SOLE, THICKNESS)
    down = plan_swing(terrain, above, below, SOLE, THICKNESS)
    assert up.clear
    assert down.clear
    assert up.back > 0
    assert down.beyond > 0
    for curve in (up, down):
        poses = curve.poses(np.linspace(0.0, 1.0, 201))
        crossing = poses[(poses[:, 2, 3] > 0.11) & (poses[:, 2, 3] < 0.2)]  # foot and shelf at one height
        assert (crossing[:, 0, 3] + SOLE[0] < 0.08 + 0.003).all()


def test_a_flat_swing_is_low_and_a_wall_in_the_way_is_reported():
    flat = pack_terrain(terrain_from([plate("ground", -1, 2, 0.0)]))
    curve = plan_swing(flat, foot([0, 0.1, 0]), foot([0.4, 0.1, 0]), SOLE, THICKNESS)
    assert curve.clear
    assert curve.lift < 0.06
    assert curve.lower < 0.06
    assert not curve.side.any()
    wall = Surface("wall", np.array([[0.2, -3, 0], [0.2, 3, 0], [0.2, 3, 3], [0.2, -3, 3.0]]))
    blocked = pack_terrain(terrain_from([plate("ground", -1, 2, 0.0), wall]))
    assert not plan_swing(blocked, foot([0, 0.1, 0]), foot([0.4, 0.1, 0]), SOLE, THICKNESS).clear


@settings(deadline=None, max_examples=40)
@given(st.floats(0.02, 0.6), st.floats(0.01, 0.15), st.floats(0.3, 0.6), st.floats(-0.1, 0.1), st.floats(0.0, 0.3))
def test_a_probe_knows_whether_there_is_a_clear_curve(height, thick, length, turn, edge):
    size = np.array([thick, 2.0, height])
    up = np.array([0, 0, 1.0])
    bar = Box("bar", size, contact_pose("left_foot", [0.5 * length, 1.0 + edge, 0.5 * height], up, turn))
    packed = pack_terrain(Terrain((plate("ground", -1, 2, 0.0),), (bar,)))
    ends = foot([0, 0.1, 0]), foot([length, 0.1, 0])
    standing = foot([0.5 * length, -0.1, 0], effector="right_foot")
    whole = plan_swing(packed, *ends, SOLE, THICKNESS, other=standing)
    assert plan_swing(packed, *ends, SOLE, THICKNESS, other=standing, probe=True).clear == whole.clear


def test_a_foot_goes_around_the_standing_leg():
    flat = pack_terrain(terrain_from([plate("ground", -1, 2, 0.0)]))
    standing = foot([0.25, -0.1, 0], effector="right_foot")
    before, after = foot([0.0, -0.02, 0]), foot([0.5, -0.02, 0])
    curve = plan_swing(flat, before, after, SOLE, THICKNESS, other=standing)
    assert curve.clear
    assert curve.side[1] > 0
    middle = curve.poses(np.array([0.5]))[0, :3, 3]
    assert middle[1] - SOLE[1] > -0.1 + 0.05


def test_a_free_palm_waits_at_its_wall_at_rest():
    palm = Contact("left_palm", 0, contact_pose("left_palm", np.array([0.3, 0.5, 1.2]), np.array([0, -1.0, 0]), 0), 0.5)
    poses = hover(palm, 0.1).poses(np.array([0.0, 0.45, 0.5, 0.55, 1.0]))
    assert np.allclose(poses[[0, -1], :3, 3], palm.p_WC)
    assert np.allclose(poses[1:4, :3, 3], palm.p_WC + np.array([0, -0.1, 0]))
    assert np.allclose(poses[:, :3, :3], palm.R_WC)
