"""Learned capture is its formula, says where it may not be trusted, and comes back from disk as it was written."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from learning.capture_features import DOCUMENTED, NUM_FEATURES, SPIN, documented_features, features
from learning.capture_networks import KINDS, CaptureNetworks, fit_range, load_capture, weights_name
from learning.capture_view import FOOT, NUM_MOTIONS, STAY, CaptureViews
from learning.network import Mlp
from learning.weights import NoWeightsError, OtherRobotError, WeightsError, write_weights
from scenes.pose import rpy_rotation
from scenes.robots.robot import load_robot

ESCHER = load_robot("escher")
MEMBERS = 3


def some_views(n: int, seed: int = 0, motion: int | None = None) -> CaptureViews:
    rng = np.random.default_rng(seed)
    motions = rng.integers(NUM_MOTIONS, size=n) if motion is None else np.full(n, motion)
    foot, new = (np.array([rpy_rotation(rng.uniform(-0.4, 0.4, 3)) for _ in range(n)]) for _ in range(2))
    com, p = (
        rng.uniform([-0.3, -0.3, 0.6], [0.3, 0.3, 1.2], (n, 3)),
        rng.uniform([-0.3, -0.6, -0.3], [0.3, 0, 0.3], (n, 3)),
    )
    return CaptureViews(motions, foot, p, new, com, rng.normal(0, 0.5, (n, 3)), rng.normal(0, 0.1, (n, 3)))


def random_mlp(rng: np.random.Generator, *widths: int) -> Mlp:
    W = tuple(rng.normal(0, (2 / m) ** 0.5, (m, n)).astype(np.float32) for m, n in pairwise(widths))
    skip = rng.normal(0, 0.1, (widths[0], widths[-1])).astype(np.float32)
    return Mlp(W, tuple(rng.normal(0, 0.3, n).astype(np.float32) for n in widths[1:]), skip)


def random_networks(kind: str = "ensemble", seed: int = 0) -> CaptureNetworks:
    rng = np.random.default_rng(seed)
    inputs = [DOCUMENTED[m != STAY] if kind == "documented" else NUM_FEATURES for m in range(NUM_MOTIONS)]
    members = tuple(tuple(random_mlp(rng, d, 9, 7, 1) for _ in range(MEMBERS)) for d in inputs)
    scale, offset = rng.uniform(0.5, 2.0, 4).astype(np.float32), rng.normal(0, 1, 4).astype(np.float32)
    seen = some_views(4000, seed=99)
    low, high = (bound.astype(np.float32) for bound in fit_range(features(seen), seen.motion))
    card = {"kind": kind, "robot": "escher", "robot_model_sha256": ESCHER.model_sha256, "friction": 0.5}
    return CaptureNetworks(kind, members, scale, offset, low, high, 0.5, card)


def forward(mlp: Mlp, x: np.ndarray) -> float:
    h = x.astype(float)
    for W, b in zip(mlp.weights[:-1], mlp.biases[:-1], strict=True):
        h = np.maximum(h @ W + b, 0.0)
    return float((h @ mlp.weights[-1] + mlp.biases[-1] + x @ mlp.skip)[0])


@pytest.mark.parametrize("kind", KINDS)
def test_a_probability_is_the_mean_of_the_members_and_the_spread_their_deviation(kind: str) -> None:
    networks, views = random_networks(kind), some_views(40)
    says, x = networks.predict(views), features(views)
    if kind != "spin":
        x[:, SPIN] = 0.0
    assert set(views.motion) == set(range(NUM_MOTIONS)) and np.ptp(says.probability) > 0.2
    for i, m in enumerate(views.motion):
        row = documented_features(views.take(np.array([i])))[0] if kind == "documented" else x[i]
        p = [expit(networks.scale[m] * forward(mlp, row) + networks.offset[m]) for mlp in networks.members[m]]
        assert says.probability[i] == pytest.approx(np.mean(p), abs=1e-4)
        assert says.spread[i] == pytest.approx(np.std(p), abs=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_a_batch_is_answered_as_its_rows_are(kind: str) -> None:
    networks, views = random_networks(kind), some_views(40, seed=1)
    whole = networks.predict(views)
    for i in range(0, 40, 7):
        one = networks.predict(views.take(np.array([i])))
        for part, of_whole in zip(one, whole, strict=True):
            assert part[0] == of_whole[i]  # to the bit: a plan does not depend on who else stands in a batch
    assert len(networks.predict(views.take(np.zeros(0, int))).far) == 0


@pytest.mark.parametrize("kind", KINDS)
def test_only_networks_of_kind_spin_know_the_spin(kind: str) -> None:
    networks, views = random_networks(kind), some_views(30, seed=2)
    other = replace(views, spin=views.spin + np.random.default_rng(0).normal(0, 5, views.spin.shape))
    one, two = networks.predict(views), networks.predict(other)
    changed = kind == "spin"
    assert np.any(one.probability != two.probability) == changed and np.any(one.far != two.far) == changed


def test_one_member_has_no_spread() -> None:
    networks = random_networks()
    single = replace(networks, members=tuple(members[:1] for members in networks.members))
    says = single.predict(some_views(30))
    np.testing.assert_allclose(says.spread, 0.0, atol=1e-7)
    assert np.ptp(says.probability) > 0.1


def test_the_border_of_the_training_data_is_not_far_and_a_step_beyond_it_is() -> None:
    views = some_views(1, seed=3, motion=FOOT)
    x, networks = features(views)[0], random_networks("spin")
    exact = np.tile(x, (NUM_MOTIONS, 1))
    assert not replace(networks, low=exact, high=exact).predict(views).far[0]
    for j in range(NUM_FEATURES):
        for bound, towards in (("low", np.inf), ("high", -np.inf)):
            moved = exact.copy()
            moved[FOOT, j] = np.nextafter(x[j], np.float32(towards))
            assert replace(networks, **({"low": exact, "high": exact} | {bound: moved})).predict(views).far[0]


@pytest.mark.parametrize("name", ["com", "velocity", "p_new", "foot_R"])
def test_a_question_with_nan_is_far(name: str) -> None:
    views = some_views(1, seed=4, motion=FOOT)
    assert not random_networks().predict(views).far[0]
    broken = np.array(getattr(views, name))
    broken.flat[0] = np.nan
    assert random_networks().predict(replace(views, **{name: broken})).far[0]


def test_ranges_hold_their_training_data_by_motion_and_a_twentieth_more() -> None:
    views = some_views(400, seed=5)
    x, motion = features(views), views.motion
    low, high = fit_range(x, motion)
    for k in range(NUM_MOTIONS):
        mine = x[motion == k].astype(float)
        extent = np.ptp(mine, axis=0)
        np.testing.assert_allclose(low[k], mine.min(axis=0) - 0.05 * extent - 1e-4, atol=1e-5)
        np.testing.assert_allclose(high[k], mine.max(axis=0) + 0.05 * extent + 1e-4, atol=1e-5)
    stretched = features(replace(views, com=1.3 * views.com))  # nobody stands so high
    assert (stretched[:, 2] > high[motion, 2]).any() and not (x > high[motion]).any() and not (x < low[motion]).any()


def without_stay() -> tuple[np.ndarray, np.ndarray]:
    views = some_views(200, seed=6)
    seen = views.take(views.motion != STAY)
    return fit_range(features(seen), seen.motion)


def test_a_motion_without_training_data_is_far_everywhere() -> None:
    low, high = without_stay()
    networks = replace(random_networks(), low=low.astype(np.float32), high=high.astype(np.float32))
    assert networks.predict(some_views(20, motion=STAY)).far.all()


def test_the_range_of_a_motion_without_training_data_can_be_read_again(tmp_path) -> None:
    low, high = without_stay()
    networks = replace(random_networks(), low=low, high=high)
    write_weights(tmp_path, weights_name("ensemble"), networks.tensors(), networks.card)
    assert load_capture(ESCHER, folder=tmp_path).predict(some_views(20, motion=STAY)).far.all()


# ---- on disk


@pytest.mark.parametrize("kind", KINDS)
def test_networks_come_back_from_disk_as_they_were(kind: str, tmp_path) -> None:
    networks, views = random_networks(kind), some_views(50, seed=7)
    write_weights(tmp_path, weights_name(kind), networks.tensors(), networks.card)
    again = load_capture(ESCHER, kind, tmp_path)
    for one, other in zip(networks.predict(views), again.predict(views), strict=True):
        np.testing.assert_array_equal(one, other)
    assert again.friction == networks.friction and again.card["kind"] == kind


def test_the_networks_that_come_with_drakeplan_tell_a_standing_robot_from_one_that_flies() -> None:
    networks, one = load_capture(ESCHER), some_views(1, motion=STAY)
    level = np.eye(3)[None]
    at_rest = replace(
        one, foot_R=level, com=np.array([[0.0, 0.0, 0.9]]), velocity=np.zeros((1, 3)), spin=np.zeros((1, 3))
    )
    flung = replace(at_rest, velocity=np.array([[0.9, 0.0, 0.0]]))
    assert networks.predict(at_rest).probability[0] > 0.95 and not networks.predict(at_rest).far[0]
    assert networks.predict(flung).probability[0] < 0.05


def test_without_weights_the_message_says_how_to_make_them(tmp_path) -> None:
    with pytest.raises(NoWeightsError, match="no learned capture") as caught:
        load_capture(ESCHER, folder=tmp_path)
    said = str(caught.value)
    assert "drakeplan collect capture --robot escher" in said and "drakeplan train capture" in said
    assert "\n" not in said


def test_weights_of_another_robot_are_refused(tmp_path) -> None:
    networks = random_networks()
    card = networks.card | {"robot_model_sha256": "0" * 64}
    write_weights(tmp_path, weights_name("ensemble"), networks.tensors(), card)
    with pytest.raises(OtherRobotError, match="another robot than 'escher'"):
        load_capture(ESCHER, folder=tmp_path)


def without(*parts: str):
    return lambda tensors: {name: a for name, a in tensors.items() if not any(part in name for part in parts)}


DAMAGE = {
    "no network of a motion": (without("motion2_"), {}, "no network for motion 2"),
    "the first member missing": (without("motion1_member0"), {}, "motion1_member0 has not 1 outputs"),
    "a layer missing": (without("motion1_member0.2"), {}, "motion1_member0 has not 1 outputs"),
    "a bias missing": (without("motion3_member1.1.bias"), {}, "motion3_member1.1.weight"),
    "no calibration": (without("calibration.offset"), {}, "calibration.offset"),
    "no range": (without("range.high"), {}, "range.high"),
    "other inputs": (
        lambda t: t | {"motion0_member0.0.weight": np.ones((NUM_FEATURES - 1, 9))},
        {},
        rf"expected \({NUM_FEATURES}, outputs\)",
    ),
    "another skip": (lambda t: t | {"motion0_member0.skip": np.ones((NUM_FEATURES - 1, 1))}, {}, "skip has shape"),
    "another calibration": (lambda t: t | {"calibration.scale": np.ones(5)}, {}, "calibration or range"),
    "another offset": (lambda t: t | {"calibration.offset": np.ones(3)}, {}, "calibration or range"),
    "another range": (lambda t: t | {"range.low": np.ones((4, NUM_FEATURES - 1))}, {}, "calibration or range"),
    "nan": (lambda t: t | {"calibration.scale": np.full(4, np.nan)}, {}, "must hold finite"),
    "another kind": (dict, {"kind": "spin"}, "networks of kind 'spin', expected 'ensemble'"),
    "no friction": (dict, {"friction": None}, "incomplete weights"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_weights_are_refused_in_one_clear_line(damage: str, tmp_path: Path) -> None:
    spoil, facts, message = DAMAGE[damage]
    networks = random_networks()
    write_weights(tmp_path, weights_name("ensemble"), spoil(networks.tensors()), networks.card | facts)
    with pytest.raises(WeightsError, match=message) as caught:
        load_capture(ESCHER, folder=tmp_path)
    assert not isinstance(caught.value, NoWeightsError) and "\n" not in str(caught.value)


def test_an_upper_range_of_another_shape_is_refused(tmp_path: Path) -> None:
    networks = random_networks()
    tensors = networks.tensors() | {"range.high": np.ones((4, NUM_FEATURES - 1))}
    write_weights(tmp_path, weights_name("ensemble"), tensors, networks.card)
    with pytest.raises(WeightsError, match="calibration or range"):
        load_capture(ESCHER, folder=tmp_path)
