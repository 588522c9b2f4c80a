"""Features of capture against their definitions, the linear pendulum, and rotations made from angles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, Point

from learning.capture_features import (
    ANGLES,
    DOCUMENTED,
    LEAST_HEIGHT,
    NAMES,
    NUM_FEATURES,
    NUM_STATE,
    SPIN,
    SWINGS,
    documented_features,
    features,
    tait_bryan,
)
from learning.capture_view import FOOT, NUM_MOTIONS, STAY, CaptureViews
from scenes.gravity import GRAVITY
from scenes.pose import rpy_rotation

XI = [NAMES.index(f"capture_point.{a}") for a in "xy"]


def some_views(n: int, seed: int = 0, motion: int | None = None) -> CaptureViews:
    """Any state over any foot, and any new contact, also where none is made."""
    rng = np.random.default_rng(seed)
    motions = rng.integers(NUM_MOTIONS, size=n) if motion is None else np.full(n, motion)
    feet = np.array([rpy_rotation([*rng.uniform(-0.4, 0.4, 2), 0.0]) for _ in range(n)])
    turned = np.array([rpy_rotation(rng.uniform(-3, 3, 3)) for _ in range(n)])
    com = rng.uniform([-0.3, -0.3, 0.6], [0.3, 0.3, 1.1], (n, 3))
    new = rng.uniform([-1, -1, -0.5], [1, 1, 1.5], (n, 3))
    return CaptureViews(motions, feet, new, turned, com, rng.normal(0, 0.5, (n, 3)), rng.normal(0, 0.1, (n, 3)))


def slow_row(v: CaptureViews, i: int) -> dict[str, float]:
    """The features of one question by name, from their definitions."""
    com, velocity, foot, p, R = v.com[i], v.velocity[i], v.foot_R[i], v.p_new[i], v.R_new[i]
    named = {f"{what}.{a}": value for what, three in (("com", com), ("velocity", velocity), ("spin", v.spin[i]))
             for a, value in zip("xyz", three, strict=True)}  # fmt: skip
    named |= {"foot.xx": foot[0, 0], "foot.xz": foot[2, 0]}
    named |= {f"foot.n{a}": n for a, n in zip("xyz", foot @ [0, 0, 1], strict=True)}
    xi = com[:2] + velocity[:2] / np.sqrt(GRAVITY / com[2])
    inside = foot.T @ [*xi, 0.0]
    named |= {"capture_point.x": xi[0], "capture_point.y": xi[1]}
    named |= {"capture_point_in_foot.x": inside[0], "capture_point_in_foot.y": inside[1]}
    named |= {f"reach_{t}": np.linalg.norm(com + t * velocity) for t in SWINGS[:2]}
    if v.motion[i] == STAY:
        return named | dict.fromkeys(NAMES[NUM_STATE:], 0.0)
    away = p - com
    named |= {f"new.{a}": value for a, value in zip("xyz", p, strict=True)}
    named |= {f"new.{axis}{a}": value for axis, three in (("x", R @ [1, 0, 0]), ("n", R @ [0, 0, 1]))
              for a, value in zip("xyz", three, strict=True)}  # fmt: skip
    named |= {"new_from_capture_point.x": p[0] - xi[0], "new_from_capture_point.y": p[1] - xi[1]}
    named |= {"new_from_com.distance": np.linalg.norm(away), "speed_along_normal": velocity @ R @ [0, 0, 1]}
    named |= {f"new_reach_{t}": np.linalg.norm(p - com - t * velocity) for t in SWINGS[:2]}
    for t in SWINGS:
        line = LineString([(0.0, 0.0), np.exp(-t * np.sqrt(GRAVITY / com[2])) * p[:2]])
        along = line.project(Point(xi), normalized=True)
        nearest = line.interpolate(along, normalized=True)
        named |= {f"off_line_{t}.x": xi[0] - nearest.x, f"off_line_{t}.y": xi[1] - nearest.y, f"along_line_{t}": along}
    return named | {"closing_speed": velocity @ away / np.linalg.norm(away)}


def test_every_feature_is_what_its_name_says() -> None:
    views = some_views(60)
    x = features(views)
    assert x.shape == (60, NUM_FEATURES) == (60, len(set(NAMES))) and x.dtype == np.float32
    assert set(views.motion) == set(range(NUM_MOTIONS))
    for i in range(len(views)):
        slow = slow_row(views, i)
        assert set(slow) == set(NAMES)
        np.testing.assert_allclose(x[i], [slow[name] for name in NAMES], rtol=1e-5, atol=2e-6)
    assert {name.split(".")[0] for name in NAMES[SPIN]} == {"spin"}


def test_a_pendulum_whose_foot_is_at_the_capture_point_comes_to_rest_over_it() -> None:
    views = some_views(30, seed=1)
    xi, c, v = features(views)[:, XI].astype(float), views.com[:, :2], views.velocity[:, :2]
    w = np.sqrt(GRAVITY / views.com[:, 2:])  # of x'' = w^2 (x - foot)
    t = 5.0 / w
    position = xi + (c - xi) * np.cosh(w * t) + v / w * np.sinh(w * t)
    speed = w * (c - xi) * np.sinh(w * t) + v * np.cosh(w * t)
    assert np.abs(position - xi).max() < 0.01 and np.abs(speed).max() < 0.02


def test_a_step_captures_the_pendulum_where_the_capture_point_lies_on_the_line() -> None:
    """It stands on its foot until the step lands: then its capture point must lie between the feet (Koolen 2012)."""
    views = some_views(40, seed=8, motion=FOOT)
    x = features(views)
    c, v, w = views.com[:, :2], views.velocity[:, :2], np.sqrt(GRAVITY / views.com[:, 2:])
    for t in SWINGS:
        then = c * np.cosh(w * t) + v / w * np.sinh(w * t)
        speed = w * c * np.sinh(w * t) + v * np.cosh(w * t)
        off = x[:, [NAMES.index(f"off_line_{t}.{a}") for a in "xy"]]
        along = x[:, NAMES.index(f"along_line_{t}"), None]
        np.testing.assert_allclose(then + speed / w, np.exp(w * t) * off + along * views.p_new[:, :2], atol=1e-4)
        assert ((along >= 0) & (along <= 1)).all() and ((along > 0) & (along < 1)).any() and (along == 0).any()


def test_closing_speed_is_how_fast_the_distance_to_the_new_contact_shrinks() -> None:
    views, h = some_views(40, seed=2, motion=FOOT), 1e-3
    ahead, behind = (replace(views, com=views.com + step * views.velocity) for step in (h, -h))
    at = NAMES.index("new_from_com.distance")
    shrinks = (np.linalg.norm(behind.p_new - behind.com, axis=1) - np.linalg.norm(ahead.p_new - ahead.com, axis=1)) / (
        2 * h
    )
    x = features(views)
    np.testing.assert_allclose(x[:, NAMES.index("closing_speed")], shrinks, atol=1e-4)
    np.testing.assert_allclose(x[:, at], np.linalg.norm(views.p_new - views.com, axis=1), rtol=1e-6)


def test_a_contact_that_is_not_made_leaves_no_trace() -> None:
    views = some_views(20, seed=3, motion=STAY)
    elsewhere = replace(views, p_new=views.p_new + 1.0, R_new=views.R_new[::-1])
    x = features(views)
    assert not x[:, NUM_STATE:].any() and x[:, :NUM_STATE].any(axis=1).all()
    np.testing.assert_array_equal(x, features(elsewhere))
    np.testing.assert_array_equal(documented_features(views), documented_features(elsewhere))


def test_a_com_at_or_under_the_foot_falls_as_from_the_least_height_and_gives_no_nan() -> None:
    views = some_views(3, seed=4)
    com = views.com * [1, 1, 0] + np.array([[0, 0, -0.5], [0, 0, 0.0], [0, 0, LEAST_HEIGHT]])
    x = features(replace(views, com=com))
    assert np.isfinite(x).all()
    fall = np.sqrt(LEAST_HEIGHT / GRAVITY)
    np.testing.assert_allclose(x[:, XI], com[:, :2] + fall * views.velocity[:, :2], rtol=1e-5, atol=1e-7)


def test_a_new_contact_at_the_com_or_over_the_foot_has_no_direction_and_gives_no_nan() -> None:
    views = some_views(2, seed=5, motion=FOOT)
    assert not features(replace(views, p_new=views.com))[:, NAMES.index("closing_speed")].any()
    above = features(replace(views, p_new=np.array([[0.0, 0.0, 1.0]] * 2)))
    assert np.isfinite(above).all()
    for t in SWINGS:  # no line to lie on but the foot
        off = above[:, [NAMES.index(f"off_line_{t}.{a}") for a in "xy"]]
        np.testing.assert_array_equal(off, above[:, XI])


@pytest.mark.parametrize("motion", range(NUM_MOTIONS))
def test_documented_inputs_are_poses_com_and_velocity_in_this_order(motion: int) -> None:
    views = some_views(10, seed=6, motion=motion)
    x = documented_features(views)
    contacts = 1 if motion == STAY else 2
    assert x.shape == (10, 6 * contacts + 6) == (10, DOCUMENTED[contacts - 1])
    assert not x[:, :3].any(), "the standing foot is the origin"
    np.testing.assert_allclose(x[:, -6:], np.hstack([views.com, views.velocity]), rtol=1e-6)
    for slot, R in enumerate((views.foot_R, views.R_new)[:contacts]):
        columns = list(ANGLES[3 * slot : 3 * slot + 3])
        np.testing.assert_allclose(x[:, columns], tait_bryan(R), rtol=1e-5, atol=1e-6)
    if contacts == 2:
        np.testing.assert_allclose(x[:, 6:9], views.p_new, rtol=1e-6)
    assert documented_features(views.take(np.zeros(0, int))).shape[0] == 0


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_angles_are_those_that_the_rotation_was_made_of(a: float, b: float, c: float) -> None:
    R = rpy_rotation([a, 0, 0]) @ rpy_rotation([0, b, 0]) @ rpy_rotation([0, 0, c])
    np.testing.assert_allclose(tait_bryan(R[None])[0], [a, b, c], atol=1e-9)


@given(st.tuples(*[st.floats(-7.0, 7.0)] * 3))
def test_any_rotation_comes_back_from_its_angles(rpy: tuple[float, float, float]) -> None:
    R = rpy_rotation(rpy)
    a, b, c = tait_bryan(R[None])[0]
    again = rpy_rotation([a, 0, 0]) @ rpy_rotation([0, b, 0]) @ rpy_rotation([0, 0, c])
    np.testing.assert_allclose(again, R, atol=1e-7)
    assert max(abs(a), abs(c)) <= np.pi and abs(b) <= np.pi / 2
