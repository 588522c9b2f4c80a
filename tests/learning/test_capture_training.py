"""Training of capture and of the state at lift: learns simple rules, the same bytes each time, also after a kill."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from learning.capture_labels import CAMPAIGN, SCHEMA, VERSION
from learning.capture_networks import load_capture, weights_name
from learning.capture_view import NUM_MOTIONS, STAY, CaptureViews
from learning.dataset import TEST, VALIDATION, split_by_scene
from learning.lift_off import load_lift_off
from learning.shard_file import ShardHeader, encode_shard, shard_name
from learning.training.options import TrainingOptions
from optimization.capture.sampling import CAPTURE_MOTIONS
from scenes.gravity import GRAVITY
from scenes.input_error import InputError
from scenes.pose import rpy_rotation
from scenes.robots.robot import load_robot

pytestmark = pytest.mark.train
torch = pytest.importorskip("torch")

ESCHER = load_robot("escher")
REACH = 0.1  # [m] of the capture point from the foot
QUICK = TrainingOptions(width=16, depth=2, epochs=2, batch=64, jitter=0.02)
TIMES = (0.6, 0.4)


def silent(*told) -> None:
    """Of progress."""


def toy_labels(n: int = 3000, tasks: int = 60, seed: int = 0):
    """Captured where the capture point is near the standing foot, whatever the motion; none lies near the border."""
    from learning.training.capture import CaptureLabels

    rng = np.random.default_rng(seed)
    com, velocity = rng.uniform([-0.1, -0.1, 0.8], [0.1, 0.1, 1.0], (2 * n, 3)), rng.uniform(-0.4, 0.4, (2 * n, 3))
    away = np.linalg.norm(com[:, :2] + np.sqrt(com[:, 2:] / GRAVITY) * velocity[:, :2], axis=1) - REACH
    rows = np.flatnonzero(np.abs(away) > 0.02)[:n]
    assert len(rows) == n
    foot, new = (np.array([rpy_rotation([*rng.uniform(-0.2, 0.2, 2), 0.0]) for _ in range(n)]) for _ in range(2))
    p_new, spin = rng.uniform(-0.3, 0.3, (n, 3)), rng.normal(0, 0.05, (n, 3)) * (rng.uniform(size=(n, 1)) < 0.5)
    views = CaptureViews(rng.integers(NUM_MOTIONS, size=n), foot, p_new, new, com[rows], velocity[rows], spin)
    walked, scene = rng.uniform(size=n) < 0.5, rng.integers(tasks, size=n)
    return CaptureLabels(views, away[rows] < 0, walked, scene, 0.5, {"fingerprint": "toy", "seed": seed})


def train(labels, out: Path, options: TrainingOptions = QUICK, kind: str = "ensemble", tell=silent):
    from learning.training.capture import train_capture

    return train_capture(labels, ESCHER, out, kind, options, tell)


def written(folder: Path, kind: str = "ensemble") -> list[bytes]:
    return [(folder / f"{weights_name(kind)}.{ending}").read_bytes() for ending in ("safetensors", "json")]


@pytest.mark.parametrize("kind", ["ensemble", "documented"])
def test_where_the_capture_point_is_decides_is_learned_from_tasks_that_are_not_tested(kind, tmp_path) -> None:
    options = TrainingOptions(width=24, depth=2, epochs=12, batch=64, jitter=0.02, rate=1e-2)
    options = replace(options, kind="documented", dropout=0.02) if kind == "documented" else options
    labels = toy_labels(5000)
    trained = train(labels, tmp_path, options, kind)
    part = split_by_scene(labels.scene, options.seed)
    fits = [fit for fit in trained.fits if fit.about == "all"]
    assert [fit.motion for fit in fits] == list(CAPTURE_MOTIONS)
    for motion, fit in enumerate(fits):
        assert fit.accuracy > 0.9 and fit.balanced > 0.9 and fit.calibration < 0.1
        assert fit.sure_wrong < 0.1 and fit.sure > 0.1 and fit.far < 0.2
        assert fit.test == ((part == TEST) & (labels.views.motion == motion)).sum() > 50


def test_a_rule_about_the_spin_is_learned_by_those_that_see_it(tmp_path) -> None:
    labels, options = toy_labels(4000), replace(QUICK, epochs=8, rate=1e-2)
    spin = np.random.default_rng(1).normal(0, 0.1, (4000, 3))
    spin[:, 0] += 0.05 * np.sign(spin[:, 0])
    labels = replace(labels, views=replace(labels.views, spin=spin), captured=spin[:, 0] > 0)
    seen, blind = (train(labels, tmp_path / kind, options, kind).fits for kind in ("spin", "ensemble"))
    for fit, other in zip(seen, blind, strict=True):
        if fit.about == "all":
            assert fit.accuracy > 0.9 and abs(other.accuracy - 0.5) < 0.15


@pytest.mark.parametrize("kind", ["ensemble", "documented"])
def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(kind, tmp_path) -> None:
    labels, options = toy_labels(), replace(QUICK, members=2, kind="documented" if kind == "documented" else "shared")
    for name in ("one", "two"):
        train(labels, tmp_path / name, options, kind)
    train(labels, tmp_path / "other", replace(options, seed=1), kind)
    assert written(tmp_path / "one", kind) == written(tmp_path / "two", kind) != written(tmp_path / "other", kind)


@pytest.mark.parametrize("dropout", [0.0, 0.3])
def test_a_training_stopped_at_any_epoch_ends_in_the_same_bytes(dropout: float, tmp_path) -> None:
    labels, options, done = toy_labels(), replace(QUICK, epochs=3, members=2, dropout=dropout), []
    train(labels, tmp_path / "whole", options)

    def stop_twice(name: str, epoch: int, *_) -> None:
        done.append((name, epoch))
        if len(done) in (5, 13):  # within a network, and after the first epoch of another
            raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            train(labels, tmp_path / "stopped", options, tell=stop_twice)
    train(labels, tmp_path / "stopped", options, tell=stop_twice)
    names = [f"ensemble {motion}{k}" for motion in CAPTURE_MOTIONS for k in range(2)]
    assert done == [(name, epoch) for name in names for epoch in (1, 2, 3)]  # no epoch twice, none left out
    assert written(tmp_path / "whole") == written(tmp_path / "stopped")


def test_what_is_written_is_what_was_measured_and_loads_as_such(tmp_path) -> None:
    labels = toy_labels()
    trained = train(labels, tmp_path, replace(QUICK, members=2))
    again = load_capture(ESCHER, folder=tmp_path)
    for one, other in zip(trained.networks.predict(labels.views), again.predict(labels.views), strict=True):
        np.testing.assert_array_equal(one, other)
    card = json.loads((tmp_path / f"{weights_name('ensemble')}.json").read_text())
    assert card["data"] == labels.source and card["training"]["members"] == 2 and card["motions"] == [*CAPTURE_MOTIONS]
    assert [fit["accuracy"] for fit in card["measured"]] == [fit.accuracy for fit in trained.fits]
    assert again.friction == labels.friction
    assert (again.predict(labels.views).spread > 0).mean() > 0.99, "members differ"


def test_shares_are_counted_as_they_are_called(tmp_path) -> None:
    """The slow twin: one row after the other."""
    labels = toy_labels()
    trained = train(labels, tmp_path, replace(QUICK, members=2))
    part = split_by_scene(labels.scene, QUICK.seed)
    fits = {(fit.motion, fit.about): fit for fit in trained.fits}
    assert set(fits) == {(m, about) for m in CAPTURE_MOTIONS for about in ("all", "random", "walk", "no spin")}
    for (motion, about), fit in fits.items():
        both = []
        for i in np.flatnonzero((part == TEST) & (labels.views.motion == CAPTURE_MOTIONS.index(motion))):
            still = not labels.views.spin[i].any()
            if about == "all" or {"random": not labels.walked[i], "walk": labels.walked[i], "no spin": still}[about]:
                says = trained.networks.predict(labels.views.take(np.array([i])))
                both.append((says.probability[0], bool(labels.captured[i])))
        yes, captured = [truth for p, truth in both if p >= 0.5], [p for p, truth in both if truth]
        right = [(p >= 0.5) == truth for p, truth in both]
        assert fit.test == len(both) and fit.captured == pytest.approx(len(captured) / len(both))
        assert fit.accuracy == pytest.approx(np.mean(right))
        assert fit.precision == pytest.approx(np.mean(yes) if yes else 0.0)
        assert fit.recall == pytest.approx(np.mean([p >= 0.5 for p in captured]))
        sure = [truth for p, truth in both if p > 0.9]
        assert fit.sure == pytest.approx(len(sure) / len(both))
        assert fit.sure_wrong == pytest.approx(1.0 - np.mean(sure) if sure else 0.0)


def test_probabilities_of_validation_tasks_are_right_on_the_whole(tmp_path) -> None:
    """Of one member: there the offset is fitted so that as many are captured as the probabilities add up to."""
    labels = toy_labels()
    networks = train(labels, tmp_path, replace(QUICK, rate=1e-2)).networks
    part = split_by_scene(labels.scene, QUICK.seed)
    assert (networks.scale > 0).all() and np.ptp(networks.scale) > 0
    for motion in range(NUM_MOTIONS):
        rows = np.flatnonzero((part == VALIDATION) & (labels.views.motion == motion))
        says = networks.predict(labels.views.take(rows)).probability
        assert says.mean() == pytest.approx(labels.captured[rows].mean(), abs=0.02)


def test_the_table_has_a_line_for_each_motion_and_each_part_where_wanted(tmp_path) -> None:
    from learning.training.capture import held_out_text

    trained = train(toy_labels(), tmp_path, replace(QUICK, epochs=1))
    head, *lines = held_out_text(trained).splitlines()
    assert [line.split()[:2] for line in lines] == [[motion, "all"] for motion in CAPTURE_MOTIONS]
    assert head.split()[0] == "ensemble"
    fit = trained.fits[0]
    assert lines[0].split()[2:5] == [str(fit.train), str(fit.test), f"{100 * fit.captured:.1f}"]
    assert len(held_out_text(trained, every=True).splitlines()) == 1 + len(trained.fits)


# ---- what cannot be learned from


def test_too_few_labels_of_a_motion_are_refused(tmp_path) -> None:
    labels = toy_labels()
    few = labels.views.motion != STAY
    few[np.flatnonzero(~few)[:150]] = True
    some = replace(labels, views=labels.views.take(few), captured=labels.captured[few], walked=labels.walked[few],
                   scene=labels.scene[few])  # fmt: skip
    with pytest.raises(InputError, match=r"labels of 'stay', expected 200 of both answers: collect more"):
        train(some, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("answer", [True, False])
def test_one_answer_only_is_refused(answer: bool, tmp_path) -> None:
    labels = toy_labels()
    captured = np.where(labels.views.motion == 2, answer, labels.captured)
    with pytest.raises(InputError, match="labels of 'same_palm', expected 200 of both answers"):
        train(replace(labels, captured=captured), tmp_path)


def test_too_few_tasks_to_hold_any_out_are_refused(tmp_path) -> None:
    labels = toy_labels(1200)
    (train_only, *_) = (k for k in range(100) if split_by_scene(np.array([k]), 0)[0] == 0)
    with pytest.raises(InputError, match="too few tasks, none is left to calibrate on"):
        train(replace(labels, scene=np.full(1200, train_only)), tmp_path)


# ---- labels on disk


def write_labels(folder: Path, labels, model: str = ESCHER.model_sha256) -> None:
    """As the campaign leaves them."""
    views, n = labels.views, len(labels.captured)
    columns = {
        "scene": labels.scene, "source": np.where(labels.walked, "walk", "random"), "motion": views.motion,
        "mirrored": np.zeros(n, bool), "foot_R": views.foot_R.reshape(n, 9), "p_new": views.p_new,
        "R_new": views.R_new.reshape(n, 9), "com": views.com, "velocity": views.velocity, "spin": views.spin,
        "friction": np.linspace(0.4, 0.6, n), "captured": labels.captured, "swing_time": np.zeros(n),
        "reason": [""] * n,
    }  # fmt: skip
    table = pa.table({f.name: pa.array(list(columns[f.name]), f.type) for f in SCHEMA}, schema=SCHEMA)
    folder.mkdir()
    parameters = {"robot": "escher", "robot_model_sha256": model}
    facts = {"campaign": CAMPAIGN, "version": VERSION, "seed": 3, "parameters": parameters}
    (folder / "campaign.json").write_text(json.dumps(facts))
    (folder / shard_name(0)).write_bytes(encode_shard(table, ShardHeader("a", 0, 1)))


def test_labels_are_read_as_the_campaign_wrote_them(tmp_path) -> None:
    from learning.training.capture import CaptureLabels

    labels = toy_labels(40)
    write_labels(tmp_path / "labels", labels)
    again = CaptureLabels.read(tmp_path / "labels", ESCHER)
    for name in ("motion", "foot_R", "p_new", "R_new", "com", "velocity", "spin"):
        np.testing.assert_array_equal(getattr(again.views, name), getattr(labels.views, name))
    for name in ("captured", "walked", "scene"):
        np.testing.assert_array_equal(getattr(again, name), getattr(labels, name))
    assert again.friction == 0.4 and again.source["rows"] == 40
    json.dumps(dict(again.source))  # goes on the card


def test_labels_of_another_robot_are_refused(tmp_path) -> None:
    from learning.training.capture import CaptureLabels

    write_labels(tmp_path / "labels", toy_labels(40), model="0" * 64)
    with pytest.raises(InputError, match="expected 'escher' as it is now"):
        CaptureLabels.read(tmp_path / "labels", ESCHER)


# ---- dropout


def lesson_and_net(depth: int = 1):
    from learning.training.lesson import Lesson
    from learning.training.teacher import _Net

    rng = np.random.default_rng(0)
    x, none = rng.normal(size=(50, 6)).astype(np.float32), np.zeros((50, 0), np.float32)
    yes = x[:, 0] > 0
    lesson = Lesson("toy", x, yes, none, x, yes, none, classifies=True)
    return torch.from_numpy(x), _Net(lesson, TrainingOptions(width=32, depth=depth))


def test_dropout_of_nothing_changes_nothing_and_draws_nothing() -> None:
    x, net = lesson_and_net(depth=2)
    chance = torch.Generator().manual_seed(0)
    before = chance.get_state()
    assert torch.equal(net(x, 0.0, chance), net(x)) and torch.equal(chance.get_state(), before)
    assert not torch.equal(net(x, 0.3, chance), net(x)) and not torch.equal(chance.get_state(), before)


def test_dropout_leaves_the_mean_answer_of_one_hidden_layer_as_it_is() -> None:
    """What is left counts 1 / (1 - p) times: of a sum over the units the expectation is the sum over all of them."""
    x, net = lesson_and_net(depth=1)
    chance, draws = torch.Generator().manual_seed(1), 3000
    with torch.no_grad():
        many = torch.stack([net(x, 0.3, chance) for _ in range(draws)])
        off = (many.mean(dim=0) - net(x)).abs()
    assert (off < 5.0 * many.std(dim=0) / draws**0.5).all() and many.std() > 0.1


def test_dropout_depends_on_the_seed_alone_and_does_something(tmp_path) -> None:
    labels, options = toy_labels(), replace(QUICK, dropout=0.2)
    for name in ("one", "two"):
        train(labels, tmp_path / name, options)
    train(labels, tmp_path / "none", replace(options, dropout=0.0))
    (one, _), (two, _), (none, _) = (written(tmp_path / name) for name in ("one", "two", "none"))
    assert one == two != none


@pytest.mark.parametrize("dropout", [-0.1, 1.0, float("nan")])
def test_shares_that_leave_nothing_or_less_are_refused(dropout: float) -> None:
    with pytest.raises(InputError, match=r"dropout must lie in \[0, 1\)"):
        TrainingOptions(dropout=dropout)


# ---- the state at lift


@pytest.fixture
def small_lift(monkeypatch) -> None:
    import learning.training.lift_off as lift_off

    monkeypatch.setattr(lift_off, "OPTIONS", TrainingOptions(width=16, depth=2, epochs=3, batch=128, jitter=0.0))


def with_lift(labels):
    """A CoM that drifts on, ever slower, until it lifts."""
    b = labels.batch
    return replace(labels, lift_com=b.com + 0.3 * b.velocity, lift_velocity=0.5 * b.velocity)


def train_lift(labels, out: Path, seed: int = 0, tell=silent):
    from learning.training.lift_off import train_lift_off

    return train_lift_off(labels, ESCHER, out, TIMES, seed, tell)


@pytest.mark.usefixtures("small_lift")
def test_a_drifting_com_is_learned_and_comes_back_from_disk(toy_labels, tmp_path) -> None:
    trained = train_lift(with_lift(toy_labels(1500, categories=(0,))), tmp_path)
    fresh = with_lift(toy_labels(300, seed=2, categories=(0,)))
    com, velocity = trained.predict(fresh.batch)
    assert np.linalg.norm(com - fresh.lift_com, axis=1).mean() < 0.01
    assert np.linalg.norm(velocity - fresh.lift_velocity, axis=1).mean() < 0.01
    measured = trained.card["measured"]
    assert 0 < measured["com_distance"] < 0.01 and 0 < measured["velocity_distance"] < 0.01 and measured["test"] > 20
    again = load_lift_off(ESCHER, TIMES, tmp_path)
    assert again is not None and again.card["times"] == list(TIMES)
    np.testing.assert_array_equal(again.predict(fresh.batch)[0], com)


@pytest.mark.usefixtures("small_lift")
def test_a_lift_that_was_stopped_or_done_twice_gives_the_same_bytes(toy_labels, tmp_path) -> None:
    labels, epochs = with_lift(toy_labels(500, categories=(0,))), []

    def stop(name: str, epoch: int, *_) -> None:
        epochs.append(epoch)
        if epochs == [1, 2]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_lift(labels, tmp_path / "stopped", tell=stop)
    train_lift(labels, tmp_path / "stopped", tell=stop)
    train_lift(labels, tmp_path / "whole")
    train_lift(labels, tmp_path / "other", seed=1)
    assert epochs == [1, 2, 3]
    stopped, whole, other = (
        [(tmp_path / name / f"lift_off_0.6_0.4.{ending}").read_bytes() for ending in ("safetensors", "json")]
        for name in ("stopped", "whole", "other")
    )
    assert stopped == whole and whole[0] != other[0]


@pytest.mark.usefixtures("small_lift")
def test_transitions_that_do_not_lift_teach_nothing(toy_labels, tmp_path) -> None:
    labels = with_lift(toy_labels(600, categories=(0,)))
    lift_com, lift_velocity = labels.lift_com.copy(), labels.lift_velocity.copy()
    none = np.flatnonzero(~labels.feasible)
    lift_com[none[::2]], lift_velocity[none[1::2]] = np.nan, 1e6  # no trajectory, and one that fails its checks
    spoilt = replace(labels, lift_com=lift_com, lift_velocity=lift_velocity)
    for name, one in (("clean", labels), ("spoilt", spoilt)):
        train_lift(one, tmp_path / name)
    clean, bad = ((tmp_path / name / "lift_off_0.6_0.4.safetensors").read_bytes() for name in ("clean", "spoilt"))
    assert len(none) > 100 and clean == bad
