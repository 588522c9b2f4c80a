"""Three networks by the number of palms held: each row is answered by its own, whatever stands beside it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from learning.labelled_transitions import learning_set
from learning.network import NUM_REGRESSED, Mlp, SharedNetwork
from learning.network_tensors import network_from_tensors, network_tensors
from learning.palm_networks import PALMS, PalmNetworks
from learning.relative_features import NUM_RELATIVE
from learning.training.options import TrainingOptions
from learning.transition_features import CATEGORIES
from scenes.input_error import InputError
from scenes.robots.robot import load_robot


def shared(seed: int) -> SharedNetwork:
    rng = np.random.default_rng(seed)
    widths = (NUM_RELATIVE, 16, 1 + NUM_REGRESSED)
    weights = tuple(rng.normal(0, 0.1, (m, n)).astype(np.float32) for m, n in pairwise(widths))
    biases = tuple(rng.normal(0, 0.1, n).astype(np.float32) for n in widths[1:])
    far = np.full(NUM_REGRESSED, 1e3, np.float32)
    return SharedNetwork((Mlp(weights, biases),), -far, far)


NETWORK = PalmNetworks((shared(0), shared(1), shared(2)))


def test_the_categories_begin_with_as_many_palms_as_their_names_say() -> None:
    words = {"feet only": 0, "one palm": 1, "both palms": 2}
    assert [words[name.split(":")[0]] for name in CATEGORIES] == PALMS.tolist()


def test_every_row_is_answered_by_its_own_network(toy_labels) -> None:
    data = learning_set(toy_labels(60))
    c, whole = data.representatives, NETWORK.answer(data.representatives, data.relative)
    for palms, network in enumerate(NETWORK.networks):
        rows = np.flatnonzero(PALMS[c.category] == palms)
        assert len(rows)
        part = network.answer(c.take(rows), data.relative[rows])
        alone = NETWORK.answer(c.take(rows), data.relative[rows])
        for name in ("logit", "cost", "com", "velocity"):
            assert np.array_equal(getattr(whole, name)[rows], getattr(part, name))
            assert np.array_equal(getattr(alone, name), getattr(part, name))


def test_a_batch_may_be_empty(toy_labels) -> None:
    data = learning_set(toy_labels(10))
    none = np.zeros(0, int)
    assert NETWORK.answer(data.representatives.take(none), data.relative[none]).com.shape == (0, 3)


def test_arrays_by_name_and_back(toy_labels) -> None:
    tensors = network_tensors(NETWORK)
    again = network_from_tensors("palms", tensors)
    data = learning_set(toy_labels(30))
    answers = [n.answer(data.representatives, data.relative) for n in (NETWORK, again)]
    assert np.array_equal(answers[0].com, answers[1].com)
    del tensors["palms1_member0.0.weight"]
    with pytest.raises(ValueError, match="palms1_member0"):
        network_from_tensors("palms", tensors)


@pytest.mark.train
def test_labels_without_palms_are_refused_with_a_way_out(toy_labels, tmp_path) -> None:
    pytest.importorskip("torch")
    from learning.training.recipe import train_dynamics

    labels = replace(toy_labels(300, categories=(0, 1, 3)))
    with pytest.raises(InputError, match="--kind shared"):
        train_dynamics(labels, load_robot("escher"), tmp_path, TrainingOptions(kind="palms"), lambda _: None)
