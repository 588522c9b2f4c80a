"""What the times of learned predictions are compared with: the same networks by NumPy and by onnxruntime."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from drakeplan.bench import surrogate
from drakeplan.bench.peers import onnx_model
from drakeplan.bench.surrogate_times import Recording, by_numpy, expansion
from learning.fit_report import DOCUMENTED
from learning.network import Mlp, SharedNetwork
from learning.surrogate import load_surrogate

INFINITE = np.full(7, np.inf, np.float32)


def members(count: int, linear: bool) -> tuple[Mlp, ...]:
    rng = np.random.default_rng(count)
    made = []
    for _ in range(count):
        weights = [rng.normal(0, m**-0.5, (m, n)).astype(np.float32) for m, n in pairwise((101, 64, 48, 8))]
        biases = tuple(rng.normal(0, 0.1, n).astype(np.float32) for n in (64, 48, 8))
        skip = rng.normal(0, 0.1, (101, 8)).astype(np.float32) if linear else None
        made.append(Mlp(tuple(weights), biases, skip))
    return tuple(made)


@pytest.mark.parametrize(("count", "linear"), [(1, False), (1, True), (3, True)])
def test_numpy_and_onnxruntime_say_the_same_within_rounding(count: int, linear: bool) -> None:
    made = members(count, linear)
    x = np.random.default_rng(0).normal(size=(37, 101)).astype(np.float32)
    ours = SharedNetwork(made, -INFINITE, INFINITE).mean_of_members(x)
    np.testing.assert_allclose(by_numpy(made, x), ours, atol=2e-5)
    onnxruntime = pytest.importorskip("onnxruntime")
    session = onnxruntime.InferenceSession(onnx_model.onnx_model(made), providers=["CPUExecutionProvider"])
    np.testing.assert_allclose(session.run(None, {"x": x})[0], ours, atol=2e-5)


def test_numbers_are_written_as_protocol_buffers_write_them() -> None:
    """The examples of protobuf.dev/programming-guides/encoding."""
    assert onnx_model._number(1, 150) == bytes.fromhex("089601")
    assert onnx_model._text(2, "testing") == bytes.fromhex("120774657374696e67")
    assert onnx_model._varint(0) == b"\x00" and onnx_model._varint(300) == bytes.fromhex("ac02")


def test_a_recording_answers_as_the_surrogate_and_keeps_what_it_was_asked() -> None:
    told = load_surrogate("escher")
    recording = Recording.of(told)
    batch, _ = expansion(12, 3)
    np.testing.assert_array_equal(recording.predict(batch).com, told.predict(batch).com)
    assert recording.batches == [batch]


def test_the_table_has_the_documents_numbers_beside_and_dashes_for_what_was_not_measured() -> None:
    fit = dict.fromkeys(("train", "test", "majority", "accuracy", "balanced", "calibration", "far", "objective"), 0.5)
    fit |= {"objective_error": None, "com_error": 0.01, "velocity_error": None}
    first, total = surrogate._rows([fit | {"category": 3}, fit | {"category": -1}])
    assert len(first) == len(total) == len(surrogate.COLUMNS)
    theirs = [cell for cell, name in zip(first, surrogate.COLUMNS, strict=True) if name == "doc."]
    accuracy, objective, error, com, velocity = DOCUMENTED[3]
    assert theirs == [
        f"{100 * accuracy:.1f} %", f"{100 * error / objective:.1f} %", f"{1e3 * com:.1f}", f"{1e3 * velocity:.1f}",
    ]  # fmt: skip
    row = dict(zip(surrogate.COLUMNS, total, strict=True))
    assert row["category"] == "all" and row["no"] == row["median"] == row["velocity mm/s"] == row["doc."] == "-"
