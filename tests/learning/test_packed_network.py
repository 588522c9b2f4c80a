"""A packed network answers what its formula says, for every row on its own."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from learning.packed_network import PackedNetwork

WIDTHS = (11, 40, 33, 5)


def member(seed: int, widths: tuple[int, ...] = WIDTHS) -> tuple[list[np.ndarray], list[np.ndarray], np.ndarray]:
    rng = np.random.default_rng(seed)
    weights = [rng.normal(0, m**-0.5, (m, n)).astype(np.float32) for m, n in pairwise(widths)]
    biases = [rng.normal(0, 0.3, n).astype(np.float32) for n in widths[1:]]
    return weights, biases, rng.normal(size=(widths[0], widths[-1])).astype(np.float32)


def formula(weights: list[np.ndarray], biases: list[np.ndarray], skip: np.ndarray, x: np.ndarray) -> np.ndarray:
    y = x.astype(float)
    for k, (W, b) in enumerate(zip(weights, biases, strict=True)):
        y = y @ W.astype(float) + b
        if k < len(weights) - 1:
            y = np.maximum(y, 0.0)
    return y + x @ skip.astype(float)


@pytest.mark.parametrize("members", [1, 2, 3])
def test_it_is_the_mean_of_its_members(members: int) -> None:
    made = [member(seed) for seed in range(members)]
    x = np.random.default_rng(9).normal(size=(17, WIDTHS[0])).astype(np.float32)
    packed = PackedNetwork.of(*([m[k] for m in made] for k in range(3)))
    np.testing.assert_allclose(packed(x), np.mean([formula(*m, x) for m in made], axis=0), atol=1e-5)


def test_rows_are_answered_to_the_bit_as_they_are_alone() -> None:
    packed = PackedNetwork.of(*([m] for m in member(3)))
    x = np.random.default_rng(9).normal(size=(31, WIDTHS[0])).astype(np.float32)
    whole = packed(x)
    for i in range(31):
        np.testing.assert_array_equal(packed(x[i : i + 1])[0], whole[i])
    assert packed(x[:0]).shape == (0, WIDTHS[-1])


def test_no_linear_path_and_no_hidden_layer_are_networks_too() -> None:
    weights, biases, skip = member(4)
    x = np.random.default_rng(9).normal(size=(6, WIDTHS[0])).astype(np.float32)
    np.testing.assert_allclose(
        PackedNetwork.of([weights], [biases], [None])(x), formula(weights, biases, 0 * skip, x), atol=1e-5
    )
    weights, biases, skip = member(5, (11, 5))
    np.testing.assert_allclose(
        PackedNetwork.of([weights], [biases], [skip])(x), formula(weights, biases, skip, x), atol=1e-5
    )


def test_a_number_that_is_none_spoils_its_own_row_and_no_other() -> None:
    packed = PackedNetwork.of(*([m] for m in member(3)))
    x = np.random.default_rng(9).normal(size=(8, WIDTHS[0])).astype(np.float32)
    lost = x.copy()
    lost[5, 2] = np.nan
    assert np.isnan(packed(lost)[5]).all()
    np.testing.assert_array_equal(np.delete(packed(lost), 5, axis=0), np.delete(packed(x), 5, axis=0))


def test_shapes_that_do_not_fit_are_refused() -> None:
    one, other = member(0), member(1, (11, 41, 33, 5))
    with pytest.raises(ValueError, match="different widths"):
        PackedNetwork.of(*([a, b] for a, b in zip(one, other, strict=True)))
    with pytest.raises(ValueError, match=r"expected \(n, 11\)"):
        PackedNetwork.of(*([m] for m in one))(np.zeros((3, 10), np.float32))
