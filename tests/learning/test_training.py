"""Training: repeatable to the bit, taken up after a kill, and able to learn what can be learned."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from learning.labelled_transitions import learning_set
from learning.surrogate import load_surrogate
from learning.training.options import TrainingOptions
from scenes.input_error import InputError
from scenes.robots.robot import load_robot

pytestmark = pytest.mark.train
torch = pytest.importorskip("torch")
SMALL = TrainingOptions(width=32, depth=2, epochs=4, batch=64)


def train(labels, out: Path, options: TrainingOptions = SMALL, tell=lambda progress: None):
    from learning.training.recipe import train_dynamics

    return train_dynamics(labels, load_robot("escher"), out, options, tell)


@pytest.mark.parametrize("kind", ["shared", "documented"])
def test_the_same_training_writes_the_same_bytes(kind, toy_labels, tmp_path) -> None:
    options = replace(SMALL, kind=kind, epochs=2, members=2)
    labels = toy_labels(600, categories=(0, 4))
    for name in ("one", "two"):
        train(labels, tmp_path / name, options)
    for file in ("dynamics.safetensors", "dynamics.json", "curves.csv", "report.json"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


def test_a_training_stopped_at_any_epoch_ends_in_the_same_bytes(toy_labels, tmp_path) -> None:
    labels, options = toy_labels(600), replace(SMALL, members=2)
    train(labels, tmp_path / "whole", options)
    done = []

    def stop_twice(progress) -> None:
        done.append((progress.network, progress.epoch))
        if done.count(("member0", 3)) + done.count(("member1", 1)) and len(done) in (3, 5):
            raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            train(labels, tmp_path / "stopped", options, stop_twice)
    train(labels, tmp_path / "stopped", options, stop_twice)
    expected = [(f"member{k}", e) for k in range(2) for e in range(1, 5)]
    assert done == expected  # no epoch twice, none left out
    whole, stopped = (tmp_path / n / "dynamics.safetensors" for n in ("whole", "stopped"))
    assert whole.read_bytes() == stopped.read_bytes()


@pytest.mark.slow
def test_a_killed_training_is_taken_up_from_its_last_epoch(toy_labels, tmp_path) -> None:
    """kill -9 from outside, at a moment that nobody chose."""
    script = textwrap.dedent(f"""
        import sys
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        from pathlib import Path
        from conftest import toy_labels
        from test_training import SMALL, replace, train
        labels = toy_labels.__wrapped__()(600)
        tell = lambda p: print(p.epoch, flush=True)
        train(labels, Path(sys.argv[1]), replace(SMALL, epochs=int(sys.argv[2])), tell)
    """)
    command = [sys.executable, "-c", script, tmp_path / "killed", "30"]
    killed = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    for _ in range(5):
        assert killed.stdout is not None and killed.stdout.readline()
    time.sleep(0.013)
    os.kill(killed.pid, signal.SIGKILL)
    killed.wait()
    assert not (tmp_path / "killed" / "dynamics.safetensors").exists()
    labels, options, epochs = toy_labels(600), replace(SMALL, epochs=30), []
    train(labels, tmp_path / "killed", options, lambda progress: epochs.append(progress.epoch))
    assert epochs[0] >= 5 and epochs[-1] == 30  # not from the start
    train(labels, tmp_path / "whole", options)
    for name in ("dynamics.safetensors", "dynamics.json", "curves.csv", "report.json"):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "killed" / name).read_bytes()


def test_a_damaged_or_foreign_checkpoint_starts_over(toy_labels, tmp_path) -> None:
    labels = toy_labels(300)
    first = train(labels, tmp_path / "a", SMALL).path.read_bytes()
    (tmp_path / "b" / "checkpoints").mkdir(parents=True)
    (tmp_path / "b" / "checkpoints" / "member0.checkpoint").write_bytes(first[: len(first) // 2])
    assert train(labels, tmp_path / "b", SMALL).path.read_bytes() == first
    epochs = []
    train(labels, tmp_path / "a", replace(SMALL, seed=1), lambda p: epochs.append(p.epoch))
    assert epochs == [1, 2, 3, 4]


@pytest.mark.slow
def test_a_shared_network_learns_the_toy_dynamics(toy_labels, tmp_path) -> None:
    options = TrainingOptions(width=64, depth=2, epochs=40, batch=128)
    trained = train(toy_labels(6000, seed=1, categories=(0, 4)), tmp_path, options)
    total = trained.report.rows[-1]
    assert total.balanced > 0.9
    assert total.com_error < 0.01 and total.velocity_error < 0.01
    assert total.objective_error < 0.1 * total.objective
    assert total.calibration < 0.05
    assert abs(total.far - 0.01) < 0.02
    again = load_surrogate("escher", tmp_path)
    fresh = toy_labels(500, seed=2, categories=(0, 4))
    one, two = trained.surrogate.predict(fresh.batch), again.predict(fresh.batch)
    np.testing.assert_array_equal(one.probability, two.probability)
    assert np.mean(np.linalg.norm(two.com - fresh.com, axis=1)[fresh.feasible]) < 0.02


def test_one_class_only_is_learned_as_such(toy_labels, tmp_path) -> None:
    labels = toy_labels(400, categories=(0, 1))
    everything = replace(labels, feasible=np.ones(400, bool))
    report = train(everything, tmp_path / "all", replace(SMALL, epochs=20)).report
    assert report.rows[-1].accuracy == 1.0 and np.isnan(report.rows[-1].balanced)
    assert "nan" in report.text()
    with pytest.raises(InputError, match="no feasible transition"):
        train(replace(labels, feasible=np.zeros(400, bool)), tmp_path / "none")


def test_too_few_scenes_to_hold_any_out_are_refused(toy_labels, tmp_path) -> None:
    labels = toy_labels(100)
    with pytest.raises(InputError, match="too few scenes"):
        train(replace(labels, scene=np.zeros(100, int)), tmp_path)


def test_the_card_names_the_cone_and_labels_of_another_model_are_refused(toy_labels, tmp_path) -> None:
    labels, model = toy_labels(300), load_robot("escher").model_sha256
    parameters = {"robot_model_sha256": model, "program": {"cone": "inner"}}
    options = replace(SMALL, epochs=1)
    card = train(replace(labels, source={"parameters": parameters}), tmp_path, options).surrogate.card
    assert card["cone"] == "inner" and card["data"]["parameters"] == parameters
    with pytest.raises(InputError, match="another model of 'escher'"):
        train(replace(labels, source={"parameters": parameters | {"robot_model_sha256": "0"}}), tmp_path, options)


@pytest.mark.parametrize("kind", ["shared", "documented"])
def test_folded_networks_answer_as_the_scaled_ones_did(kind, toy_labels, tmp_path) -> None:
    """Through an independent path: torch's network on scaled features, scaled back by hand."""
    from learning.training.lesson import fold_scaling, lessons
    from learning.training.teacher import _Net, _plain

    options = replace(SMALL, kind=kind)
    for lesson in lessons(learning_set(toy_labels(400, categories=(0,))), options):
        net = _Net(lesson, options)
        with torch.no_grad():
            for parameter in net.parameters():
                parameter += 0.1 * torch.randn(parameter.shape, generator=torch.Generator().manual_seed(0))
        mean, spread = lesson.input_scaling()
        out = net(torch.from_numpy(((lesson.x - mean) / spread).astype(np.float32))).detach().numpy()
        if lesson.y.shape[1]:
            centre, scale = lesson.output_scaling()
            out[:, int(lesson.classifies) :] = out[:, int(lesson.classifies) :] * scale + centre
        np.testing.assert_allclose(fold_scaling(lesson, _plain(net))(lesson.x), out, rtol=1e-3, atol=1e-3)
