"""A surrogate answers in the world's frame, the same for equal transitions, and says where it may not be trusted."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save

from learning.calibration import fit_training_range
from learning.network import DocumentedNetworks, Mlp, SharedNetwork
from learning.network_tensors import network_from_tensors, network_tensors
from learning.relative_features import relative_feature_names, relative_features
from learning.surrogate import DynamicsSurrogate, dynamics_fingerprint, load_surrogate, weights_name
from learning.transition_batch import TransitionBatch
from learning.transition_features import (
    NUM_CATEGORIES,
    canonicalise,
    documented_feature_names,
)
from learning.weights import NoWeightsError, WeightsError, write_weights
from scenes.pose import rpy_rotation
from scenes.robots.robot import load_robot

D = len(relative_feature_names())


def random_mlp(rng: np.random.Generator, *widths: int) -> Mlp:
    weights = [rng.normal(0, m**-0.5, (m, n)).astype(np.float32) for m, n in pairwise(widths)]
    return Mlp(tuple(weights), tuple(rng.normal(0, 0.1, n).astype(np.float32) for n in widths[1:]))


@pytest.fixture(scope="module")
def surrogate(toy_labels) -> DynamicsSurrogate:
    rng = np.random.default_rng(0)
    c = canonicalise(toy_labels(6000).batch, "quarter")
    extent = fit_training_range(relative_features(c), c.category)
    ones, half = np.ones(NUM_CATEGORIES, np.float32), np.full(NUM_CATEGORIES, 0.5, np.float32)
    card = {"kind": "shared", "robot": "escher", "robot_dynamics": dynamics_fingerprint(load_robot("escher"))}
    card["features"] = list(relative_feature_names())
    bounds = np.array([[0, -0.12, -0.12, 0.8, -1, -1, -1], [9, 0.12, 0.12, 1.1, 1, 1, 1]], np.float32)
    network = SharedNetwork((random_mlp(rng, D, 256, 256, 256, 8),), *bounds)
    return DynamicsSurrogate(network, ones, 0 * ones, half, extent, (0.5, 0.5), card)


@pytest.fixture
def folder(surrogate, tmp_path) -> Path:
    write_weights(tmp_path, weights_name(), surrogate.tensors(), surrogate.card)
    return tmp_path


def test_a_network_is_its_formula(toy_labels) -> None:
    rng = np.random.default_rng(1)
    mlp = replace(random_mlp(rng, 3, 4, 2), skip=rng.normal(size=(3, 2)).astype(np.float32))
    x = rng.normal(size=(5, 3)).astype(np.float32)
    for row, y in zip(x, mlp(x), strict=True):
        hidden = [max(0.0, float(row @ mlp.weights[0][:, j] + mlp.biases[0][j])) for j in range(4)]
        slow = [np.dot(hidden, mlp.weights[1][:, j]) + mlp.biases[1][j] + row @ mlp.skip[:, j] for j in range(2)]
        np.testing.assert_allclose(y, slow, rtol=1e-4, atol=1e-6)


def test_answers_turn_by_quarters_shift_and_mirror_with_the_world(surrogate, toy_labels) -> None:
    batch = toy_labels(200, seed=5).batch
    R, shift = rpy_rotation([0, 0, np.pi / 2]), np.array([3.0, -2.0, 0.4])
    turned = replace(
        batch, p=batch.p @ R.T + shift, R=R @ batch.R, p_new=batch.p_new @ R.T + shift, R_new=R @ batch.R_new,
        com=batch.com @ R.T + shift, velocity=batch.velocity @ R.T,
    )  # fmt: skip
    here, there = surrogate.predict(batch), surrogate.predict(turned)
    np.testing.assert_allclose(there.com, here.com @ R.T + shift, atol=1e-5)
    np.testing.assert_allclose(there.velocity, here.velocity @ R.T, atol=1e-5)
    np.testing.assert_allclose(there.probability, here.probability, atol=1e-5)
    np.testing.assert_allclose(there.cost, here.cost, rtol=1e-4)
    M, swap = np.diag([1.0, -1.0, 1.0]), [1, 0, 3, 2]
    other = replace(
        batch, held=batch.held[:, swap], p=batch.p[:, swap] @ M, R=M @ batch.R[:, swap] @ M, mover=batch.mover ^ 1,
        p_new=batch.p_new @ M, R_new=M @ batch.R_new @ M, com=batch.com @ M, velocity=batch.velocity @ M,
    )  # fmt: skip
    mirrored = surrogate.predict(other)
    np.testing.assert_allclose(mirrored.com, here.com @ M, atol=1e-5)
    np.testing.assert_allclose(mirrored.probability, here.probability, atol=1e-5)


def test_answers_are_those_of_the_network_brought_back_to_the_world(surrogate, toy_labels) -> None:
    """The slow twin of the one pass over the rows."""
    batch = toy_labels(200, seed=4).batch
    c = canonicalise(batch, "quarter")
    says, raw = surrogate.predict(batch), surrogate.network.answer(c, relative_features(c))
    np.testing.assert_allclose(says.com, c.points_to_world(raw.com), atol=1e-6)
    np.testing.assert_allclose(says.velocity, c.vectors_to_world(raw.velocity), atol=1e-6)
    np.testing.assert_allclose(says.probability, 1 / (1 + np.exp(-raw.logit)), atol=1e-6)
    np.testing.assert_array_equal(says.feasible, says.probability >= 0.5)
    np.testing.assert_array_equal(says.cost, raw.cost)


def test_the_final_com_stays_in_the_box_of_the_training_data(surrogate, toy_labels) -> None:
    batch = toy_labels(300, seed=14).batch
    c = canonicalise(batch, "quarter")
    offset = c.points_from_world(surrogate.predict(batch).com) - c.feet_after
    assert (offset >= surrogate.network.low[1:4] - 1e-6).all() and (offset <= surrogate.network.high[1:4] + 1e-6).all()


def test_a_batch_is_answered_as_its_rows_are(surrogate, toy_labels) -> None:
    batch = toy_labels(60, seed=6).batch
    whole = surrogate.predict(batch)
    for i in range(0, 60, 7):  # to the bit: a plan does not depend on who else stands in a batch
        one = surrogate.predict(batch.take(np.array([i])))
        for name in ("probability", "cost", "com", "velocity", "far"):
            np.testing.assert_array_equal(getattr(one, name)[0], getattr(whole, name)[i])
    assert len(surrogate.predict(batch.take(np.zeros(0, int))).cost) == 0


def test_far_from_the_training_data_is_said(surrogate, toy_labels) -> None:
    batch = toy_labels(500, seed=7).batch
    assert surrogate.predict(batch).far.mean() < 0.1
    fast = replace(batch, velocity=batch.velocity + np.array([3.0, 0, 0]))
    high = replace(batch, com=batch.com + np.array([0, 0, 1.0]))
    slippery = replace(batch, friction=np.full(500, 0.3))
    for beyond in (fast, high, slippery):
        assert surrogate.predict(beyond).far.all()


def test_what_cannot_be_predicted_is_infeasible_and_far(surrogate, toy_labels) -> None:
    batch = toy_labels(4, seed=8).batch
    one_foot, lost = batch.held.copy(), batch.com.copy()
    one_foot[0, 0], lost[1] = False, np.nan
    says = surrogate.predict(replace(batch, held=one_foot, com=lost))
    assert says.far[:2].all() and not says.feasible[:2].any() and (says.probability[:2] == 0).all()
    assert np.isinf(says.cost[0]) and says.category[0] == -1
    assert np.isfinite(says.com[2:]).all()


def test_children_by_number_are_the_same_transitions_as_stances(toy_labels) -> None:
    batch = toy_labels(30, seed=9, categories=(0,)).batch
    i = 0
    p = np.concatenate([batch.p[i], batch.p_new[:5]])
    R = np.concatenate([batch.R[i], batch.R_new[:5]])
    friction = np.array([0.5, 0.6, 0.1, 0.1, 0.9, 0.4, 0.9, 0.9, 0.9])
    after = np.array([[4, 1, -1, -1], [0, 5, -1, -1], [0, 1, 6, -1], [0, 1, -1, 7]])
    children = TransitionBatch.of_children(p, R, (0, 1, -1, -1), after, batch.com[i], batch.velocity[i], friction)
    assert children.mover.tolist() == [0, 1, 2, 3] and children.makes.all()
    np.testing.assert_array_equal(children.p_new, p[4:8])
    np.testing.assert_array_equal(children.held[:, :], [[True, True, False, False]] * 4)
    np.testing.assert_array_equal(children.friction, [0.5, 0.4, 0.5, 0.5])
    broken = TransitionBatch.of_children(p, R, (0, 1, 6, 7), [[0, 1, -1, 7]], batch.com[i], batch.velocity[i])
    assert broken.mover[0] == 2 and not broken.makes[0] and broken.friction is None
    for wrong in ([[0, 1, -1, -1]], [[4, 5, -1, -1]]):
        with pytest.raises(ValueError, match="one end effector"):
            TransitionBatch.of_children(p, R, (0, 1, -1, -1), wrong, batch.com[i], batch.velocity[i])


def test_weights_come_back_as_they_were_written(surrogate, folder, toy_labels) -> None:
    batch = toy_labels(50, seed=10).batch
    one, two = surrogate.predict(batch), load_surrogate("escher", folder).predict(batch)
    for name in ("probability", "cost", "com", "velocity", "far"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    rng = np.random.default_rng(3)
    pairs = [
        [random_mlp(rng, len(documented_feature_names(k)), 8, n) if k != 3 else None for k in range(10)] for n in (1, 7)
    ]
    documented = DocumentedNetworks(tuple(pairs[0]), tuple(pairs[1]))
    again = network_from_tensors("documented", network_tensors(documented))
    c = canonicalise(batch)
    answers = [n.answer(c, relative_features(c)) for n in (documented, again)]
    np.testing.assert_array_equal(answers[0].com, answers[1].com)
    assert np.isneginf(answers[0].logit[c.category == 3]).all()  # nothing was learned of it


def test_a_robot_without_weights_is_its_own_kind_of_error() -> None:
    with pytest.raises(NoWeightsError, match=r"jvrc1.*no learned dynamics.*--dynamics exact"):
        load_surrogate("jvrc1")


def rewrite(folder: Path, tensors: dict, **facts) -> None:
    """Damages content, but keeps hash and shapes right, as a foreign program might write it."""
    card = json.loads((folder / f"{weights_name()}.json").read_text())
    write_weights(
        folder, weights_name(), tensors, {k: v for k, v in card.items() if k not in ("sha256", "shapes")} | facts
    )


DAMAGE = {
    "weights missing": (lambda f, t: (f / f"{weights_name()}.safetensors").unlink(), "missing, though its card"),
    "card missing": (lambda f, t: (f / f"{weights_name()}.json").unlink(), "missing, though its weights"),
    "card truncated": (lambda f, t: (f / f"{weights_name()}.json").write_text('{"format"'), "expected a JSON card"),
    "card foreign": (lambda f, t: (f / f"{weights_name()}.json").write_text('{"model": 1}'), "expected a card of format"),
    "card not an object": (lambda f, t: (f / f"{weights_name()}.json").write_text("[1]"), "expected a card of format"),
    "version": (lambda f, t: rewrite(f, t, version=99), "version 1, got 99"),
    "features": (lambda f, t: rewrite(f, t, features=["x"]), "list of features"),
    "robot": (lambda f, t: rewrite(f, t, robot_dynamics="0"), "another robot"),
    "kind": (lambda f, t: rewrite(f, t, kind="transformer"), "unknown kind"),
    "NaN": (lambda f, t: rewrite(f, t | {"range.mean": t["range.mean"] * np.nan}), "range.mean must hold finite"),
    "a layer's shape": (lambda f, t: rewrite(f, t | {"member0.1.weight": np.ones((3, 3))}), "member0.1.weight has shape"),
    "a layer missing": (lambda f, t: rewrite(f, {k: v for k, v in t.items() if "member0.3" not in k}), "8 outputs"),
    "members differ": (
        lambda f, t: rewrite(f, t | {k.replace("member0", "member1"): v for k, v in t.items() if "member0" in k}
                             | {"member1.1.weight": np.ones((256, 3)), "member1.1.bias": np.ones(3),
                                "member1.2.weight": np.ones((3, 256))}),
        "members have different widths"),
    "bounds": (lambda f, t: rewrite(f, t | {"answer.low": np.ones(3)}), "answer.low and answer.high"),
    "no layer": (lambda f, t: rewrite(f, {k: v for k, v in t.items() if "member" not in k}), "no member"),
    "calibration": (lambda f, t: rewrite(f, t | {"calibration.scale": np.ones(3)}), "calibration.scale: expected"),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_weights_are_refused_in_one_clear_line(damage, folder, surrogate) -> None:
    spoil, message = DAMAGE[damage]
    spoil(folder, surrogate.tensors())
    with pytest.raises(WeightsError, match=message) as caught:
        load_surrogate("escher", folder)
    assert not isinstance(caught.value, NoWeightsError) and "\n" not in str(caught.value)


@pytest.mark.parametrize("cut", [0, 1, 100, -1])
def test_truncated_or_changed_weights_are_refused(cut: int, folder) -> None:
    path = folder / f"{weights_name()}.safetensors"
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(WeightsError, match="SHA-256 differs"):
        load_surrogate("escher", folder)


def test_weights_of_something_else_are_refused_though_their_hash_is_right(folder) -> None:
    path, card_path = folder / f"{weights_name()}.safetensors", folder / f"{weights_name()}.json"
    card = json.loads(card_path.read_text())
    for data, message in ((b"PK\x03\x04 no tensors", "expected safetensors"), (save({"a": np.ones(2)}), "has shape")):
        path.write_bytes(data)
        card_path.write_text(json.dumps(card | {"sha256": hashlib.sha256(data).hexdigest()}))
        with pytest.raises(WeightsError, match=message):
            load_surrogate("escher", folder)


def test_an_expansion_is_answered_in_a_quarter_of_the_time_that_its_rows_take_one_by_one(surrogate, toy_labels) -> None:
    batch = toy_labels(60, seed=11, categories=(2, 3, 5)).batch
    rows = [batch.take(np.array([i])) for i in range(60)]
    together, apart = [], []
    for _ in range(50):
        start = time.process_time()
        surrogate.predict(batch)
        middle = time.process_time()
        for row in rows:
            surrogate.predict(row)
        together.append(middle - start)
        apart.append(time.process_time() - middle)
    assert min(together) < 0.25 * min(apart)
