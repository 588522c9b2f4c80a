"""The state at lift: turns with the world, is on disk as in memory, and near what the exact program finds."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from drakeplan.timing.step_timing import WALKING
from learning.lift_off import OUTPUTS, LiftOff, load_lift_off, weights_name
from learning.network import Mlp
from learning.network_tensors import mlp_tensors
from learning.relative_features import NUM_RELATIVE, relative_feature_names, relative_features
from learning.surrogate import dynamics_fingerprint, load_surrogate
from learning.transition_batch import TransitionBatch
from learning.transition_features import canonicalise
from learning.weights import NoWeightsError, OtherRobotError, WeightsError, write_weights
from optimization.balance.friction import DEFAULT_CONE
from optimization.centroidal.transition_dynamics import TransitionDynamics
from scenes.contact import Contact, contact_pose
from scenes.effector import EFFECTORS
from scenes.pose import rpy_rotation
from scenes.robots.robot import load_robot
from scenes.stance import Stance

ESCHER = load_robot("escher")
TIMES = (0.6, 0.4)
CARD = {"robot_dynamics": dynamics_fingerprint(ESCHER), "features": list(relative_feature_names())}


@pytest.fixture(scope="module")
def lift_off() -> LiftOff:
    """Random weights."""
    rng, widths = np.random.default_rng(0), (NUM_RELATIVE, 24, 16, OUTPUTS)
    W = tuple(rng.normal(0, m**-0.5, (m, n)).astype(np.float32) for m, n in pairwise(widths))
    return LiftOff(Mlp(W, tuple(rng.normal(0, 0.1, n).astype(np.float32) for n in widths[1:])), dict(CARD))


def turned(batch: TransitionBatch, R: np.ndarray, shift: np.ndarray) -> TransitionBatch:
    return replace(
        batch, p=batch.p @ R.T + shift, R=R @ batch.R, p_new=batch.p_new @ R.T + shift, R_new=R @ batch.R_new,
        com=batch.com @ R.T + shift, velocity=batch.velocity @ R.T,
    )  # fmt: skip


@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_the_state_at_lift_turns_by_quarters_and_moves_with_the_world(quarters: int, lift_off, toy_labels) -> None:
    """By quarters: the program's box for the final CoM lies along W's axes."""
    batch = toy_labels(150, seed=5).batch
    R, shift = rpy_rotation([0, 0, quarters * np.pi / 2]), np.array([3.0, -2.0, 0.4])
    com, velocity = lift_off.predict(batch)
    com_there, velocity_there = lift_off.predict(turned(batch, R, shift))
    np.testing.assert_allclose(com_there, com @ R.T + shift, atol=1e-5)
    np.testing.assert_allclose(velocity_there, velocity @ R.T, atol=1e-5)
    assert np.ptp(velocity, axis=0).min() > 0.1


def test_the_state_at_lift_is_mirrored_with_the_world(lift_off, toy_labels) -> None:
    batch, M, swap = toy_labels(150, seed=6).batch, np.diag([1.0, -1.0, 1.0]), [1, 0, 3, 2]
    other = replace(
        batch, held=batch.held[:, swap], p=batch.p[:, swap] @ M, R=M @ batch.R[:, swap] @ M, mover=batch.mover ^ 1,
        p_new=batch.p_new @ M, R_new=M @ batch.R_new @ M, com=batch.com @ M, velocity=batch.velocity @ M,
    )  # fmt: skip
    for one, mirrored in zip(lift_off.predict(batch), lift_off.predict(other), strict=True):
        np.testing.assert_allclose(mirrored, one @ M, atol=1e-5)


def test_the_com_is_counted_from_the_mean_of_the_feet_after_the_step(lift_off, toy_labels) -> None:
    """A network that answers zero sees the CoM there, at rest."""
    batch = toy_labels(100, seed=7).batch
    nothing = LiftOff(Mlp((np.zeros((NUM_RELATIVE, OUTPUTS), np.float32),), (np.zeros(OUTPUTS, np.float32),)), {})
    com, velocity = nothing.predict(batch)
    feet = batch.p[:, :2].copy()
    for i in np.flatnonzero(batch.makes & (batch.mover < 2)):
        feet[i, batch.mover[i]] = batch.p_new[i]
    np.testing.assert_allclose(com, feet.mean(axis=1), atol=1e-9)
    assert not velocity.any()


def test_answers_do_not_depend_on_who_else_stands_in_the_batch(lift_off, toy_labels) -> None:
    batch = toy_labels(40, seed=8).batch
    whole = lift_off.predict(batch)
    for i in range(0, 40, 9):
        for one, all_of_them in zip(lift_off.predict(batch.take(np.array([i]))), whole, strict=True):
            np.testing.assert_array_equal(one[0], all_of_them[i])


def test_a_state_is_the_networks_answer_brought_back_to_the_world(lift_off, toy_labels) -> None:
    """The slow way round: features of the representative, the network, and back to the world."""
    batch = toy_labels(30, seed=10).batch
    c = canonicalise(batch, "quarter")
    x = relative_features(c)
    com, velocity = lift_off.predict(batch)
    for i in range(30):
        h = x[i].astype(float)
        for W, b in zip(lift_off.network.weights[:-1], lift_off.network.biases[:-1], strict=True):
            h = np.maximum(h @ W + b, 0.0)
        y = h @ lift_off.network.weights[-1] + lift_off.network.biases[-1]
        one = c.take(np.array([i]))
        np.testing.assert_allclose(one.points_from_world(com[i][None])[0] - one.feet_after[0], y[:3], atol=1e-4)
        np.testing.assert_allclose(one.vectors_from_world(velocity[i][None])[0], y[3:], atol=1e-4)


# ---- on disk


def write(folder, lift_off: LiftOff, card: dict, **tensors: np.ndarray) -> None:
    write_weights(folder, weights_name(TIMES), mlp_tensors("lift", lift_off.network) | tensors, card)


def test_the_network_comes_back_from_disk_as_it_was(lift_off, toy_labels, tmp_path) -> None:
    write(tmp_path, lift_off, CARD)
    again, batch = load_lift_off(ESCHER, TIMES, tmp_path), toy_labels(60, seed=9).batch
    assert again is not None and again.card["features"] == CARD["features"]
    for one, other in zip(lift_off.predict(batch), again.predict(batch), strict=True):
        np.testing.assert_array_equal(one, other)


def test_other_times_and_robots_without_weights_have_none(lift_off, tmp_path) -> None:
    write(tmp_path, lift_off, CARD)
    assert load_lift_off(ESCHER, (1.0, 1.0), tmp_path) is None
    assert load_lift_off(replace(ESCHER, name="nobody"), TIMES) is None
    assert weights_name((0.6, 0.4)) != weights_name((0.4, 0.6))


@pytest.mark.parametrize(
    ("card", "message"),
    [
        (
            {"robot_dynamics": dynamics_fingerprint(replace(ESCHER, mass=ESCHER.mass + 1.0))},
            "another robot than 'escher'",
        ),
        ({"features": ["x"]}, "list of features is not this version's"),
    ],
)
def test_weights_of_another_robot_or_other_features_are_refused(card, message, lift_off, tmp_path) -> None:
    write(tmp_path, lift_off, CARD | card)
    with pytest.raises(OtherRobotError if "robot" in message else WeightsError, match=message) as caught:
        load_lift_off(ESCHER, TIMES, tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "spoil", [{"lift.2.weight": np.ones((16, 5)), "lift.2.bias": np.ones(5)}, {"lift.0.bias": np.ones(3)},
              {"lift.skip": np.ones((3, OUTPUTS))}],
)  # fmt: skip
def test_networks_of_other_widths_are_refused(spoil, lift_off, tmp_path) -> None:
    write(tmp_path, lift_off, CARD, **spoil)
    with pytest.raises(WeightsError, match=r"lift_off_0\.6_0\.4\.json: lift"):
        load_lift_off(ESCHER, TIMES, tmp_path)


def test_one_of_two_files_is_damage_and_not_absence(lift_off, tmp_path) -> None:
    write(tmp_path, lift_off, CARD)
    path = tmp_path / f"{weights_name(TIMES)}.json"
    card = json.loads(path.read_text())
    path.unlink()
    with pytest.raises(WeightsError, match="missing"):
        load_lift_off(ESCHER, TIMES, tmp_path)
    path.write_text(json.dumps(card | {"sha256": "0" * 64}))
    with pytest.raises(WeightsError, match="SHA-256 differs"):
        load_lift_off(ESCHER, TIMES, tmp_path)


# ---- what comes with drakeplan


def foot(side: int, x: float, y: float) -> Contact:
    name = EFFECTORS[side]
    return Contact(name, 0, contact_pose(name, np.array([x, y, 0.0]), np.array([0.0, 0.0, 1.0]), 0.0), 0.5)


STANDING = Stance((foot(0, 0.0, 0.1), foot(1, 0.0, -0.1), None, None))
STEPS = ((1, 0.2, -0.12), (0, 0.15, 0.15), (1, 0.3, -0.2), (0, 0.0, 0.14))


def test_walking_weights_say_of_plain_steps_what_the_exact_program_says() -> None:
    """At lift the CoM has shifted towards the foot that stays; at the end it is over both."""
    dynamics = TransitionDynamics(ESCHER, WALKING.options(ESCHER, DEFAULT_CONE))
    lift, surrogate = load_lift_off(ESCHER, WALKING.times), load_surrogate(ESCHER, times=WALKING.times)
    assert WALKING.times == TIMES and lift is not None
    com, velocity = np.array([0.0, 0.0, ESCHER.com_height[1]]), np.array([0.05, 0.0, 0.0])
    for side, x, y in STEPS:
        after = STANDING.replace(side, foot(side, x, y))
        exact = dynamics.estimate(STANDING, after, com, ESCHER.mass * velocity)
        batch = TransitionBatch.from_stances([(STANDING, after)], com[None], velocity[None])
        lift_com, lift_velocity = dynamics.lift_state(exact)
        said_com, said_velocity = lift.predict(batch)
        np.testing.assert_allclose(said_com[0], lift_com, atol=0.02)
        np.testing.assert_allclose(said_velocity[0], lift_velocity, atol=0.02)
        assert said_com[0, 1] * (1.0 if side == 1 else -1.0) > 0.01
        says = surrogate.predict(batch)
        assert exact.feasible and says.feasible[0] and not says.far[0]
        np.testing.assert_allclose(says.com[0], dynamics.final_state(exact)[0], atol=0.03)


def test_times_without_weights_are_told_apart_and_what_to_do_is_said_in_one_line() -> None:
    assert load_surrogate("escher", times=TIMES).card["name"] == "dynamics_0.6_0.4"
    assert load_surrogate("escher").card["name"] == "dynamics"
    with pytest.raises(NoWeightsError, match=r"no learned dynamics for --shift 0\.3 --swing 0\.3") as caught:
        load_surrogate("escher", times=(0.3, 0.3))
    said = str(caught.value)
    assert "--dynamics exact" in said and "drakeplan collect dynamics" in said and "\n" not in said
