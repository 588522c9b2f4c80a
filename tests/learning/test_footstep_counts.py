"""Regressors of useful footsteps against scikit-learn, mirror images, and weights that come back as they were written."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from sklearn.neighbors import KNeighborsRegressor
from sklearn.svm import SVR

from drakeplan.cli import main
from drakeplan.guide.ground_view import MODEL, documented_steps
from learning.dataset import TEST, TRAIN, split_by_scene
from learning.footstep_counts import (
    BOTH_PALMS,
    FEET,
    LEAST_COST,
    LEFT_PALM,
    NETWORKS,
    PALM_COLUMNS,
    RIGHT_PALM,
    NetworkRegressor,
    PoseFeatures,
    RowRegressor,
    network_inputs,
    network_of,
    some_score,
)
from learning.shard_file import ShardHeader, encode_shard, shard_name
from learning.training import footstep_counts as training
from learning.training.footstep_counts import FootstepLabels, mirror_of, train_footstep_counts
from learning.traversability import KINDS, Traversability, load_traversability, weights_name
from learning.traversability_labels import CAMPAIGN, MODES, SCHEMA, VERSION
from learning.weights import NoWeightsError, OtherRobotError, WeightsError
from scenes.input_error import InputError
from scenes.robots.robot import load_robot

ESCHER = load_robot("escher")
TRANSLATIONS = np.array([[x, y] for x in (-1, 0, 1) for y in (-1, 0, 1)])
MIRROR = mirror_of(TRANSLATIONS)
V, SCENES, POSES = len(TRANSLATIONS), 30, 2
RTOL = 1e-5  # weights are kept in single precision


def parameters(footholds: str) -> dict:
    return {
        "robot": "escher",
        "robot_model_sha256": ESCHER.model_sha256,
        "transition_model": MODEL,
        "translations": TRANSLATIONS.tolist(),
        "footholds": footholds,
    }


def toy_features(n: int, rng: np.random.Generator) -> PoseFeatures:
    feet = rng.uniform(0, 40, (n, V)) * (rng.uniform(size=(n, V)) < 0.9)
    return PoseFeatures(feet, feet.sum(axis=1) / 3, rng.uniform(0, 4, (n, 4)) * (rng.uniform(size=(n, 4)) < 0.7))


def toy_labels(footholds: str = "fixed", scenes: int = SCENES, seed: int = 0) -> FootstepLabels:
    """More useful footsteps where the scores are greater; each pose in every mode."""
    rng = np.random.default_rng(seed)
    n = scenes * POSES
    seen = toy_features(n, rng)
    exact = toy_features(n, rng)
    exact = PoseFeatures(0.9 * seen.feet + 0.1 * exact.feet, seen.pairs, 0.9 * seen.palms + 0.1 * exact.palms)
    mode = np.tile(np.arange(4), n)
    repeated = [PoseFeatures(*(np.repeat(a, 4, axis=0) for a in some)) for some in (seen, exact)]
    useful = np.round(repeated[0].feet * np.where(some_scores(mode, repeated[0]), 1.0 - 0.1 * mode[:, None], 0.0))
    source = {"campaign": CAMPAIGN, "parameters": parameters(footholds)}
    return FootstepLabels(np.repeat(np.arange(n) // POSES, 4), mode, *repeated, useful, source)


def some_scores(mode: np.ndarray, seen: PoseFeatures) -> np.ndarray:
    each = np.stack([some_score(m, seen) for m in range(4)])
    return each[mode, np.arange(len(mode))]


@pytest.fixture(scope="module", params=["fixed", "snapped"])
def trained(request, tmp_path_factory) -> tuple[Path, FootstepLabels, list[str]]:
    """A folder of weights, what they were trained on and their kinds."""
    out, labels = tmp_path_factory.mktemp(request.param) / "weights", toy_labels(request.param)
    found = train_footstep_counts(labels, ESCHER, out, 3, lambda line: None)
    return out, labels, [one.kind for one in found]


@pytest.fixture(scope="module")
def loaded(trained) -> dict[str, Traversability]:
    out, _, kinds = trained
    return {kind: load_traversability(ESCHER, MODEL, kind, out) for kind in kinds}


def network(seed: int = 0) -> NetworkRegressor:
    """Random weights."""
    rng, layers, mean, scale = np.random.default_rng(seed), {}, {}, {}
    for name, palms in zip(NETWORKS, (0, 2, 4), strict=True):
        width = V + 1 + palms
        layers[name] = [
            (rng.normal(size=(a, b)) / np.sqrt(a), rng.normal(size=b)) for a, b in ((width, 8), (8, 8), (8, V))
        ]
        mean[name], scale[name] = rng.normal(size=width), rng.uniform(0.5, 2.0, width)
    return NetworkRegressor(layers, mean, scale, MIRROR)


# ---- the documents' regressors


@pytest.mark.parametrize("kind", ["acc-svr", "ecc-svr", "acc-nearest", "ecc-nearest"])
def test_rows_give_what_scikit_learn_predicts_from_the_same_training_set(kind: str) -> None:
    labels = toy_labels()
    regressor = training._train_rows(kind, labels, 0)
    rng = np.random.default_rng(9)
    asked, order = toy_features(12, rng), np.random.default_rng(0)
    for mode, columns in enumerate(PALM_COLUMNS):
        rows = labels.take(labels.mode == mode)
        rows = rows.take(order.permutation(len(rows.mode)))  # the solver's answer depends on it, within its tolerance
        seen = rows.exact if kind.startswith("ecc") else rows.scores
        found = regressor.counts(mode, asked)
        for v in range(V):
            x = np.column_stack([seen.feet[:, v], seen.palms[:, list(columns)]])
            q = np.column_stack([asked.feet[:, v], asked.palms[:, list(columns)]])
            mean, scale = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-3)
            svr = SVR(C=10.0, epsilon=0.1, gamma="scale")
            model = svr if kind.endswith("svr") else KNeighborsRegressor(1)
            expected = model.fit((x - mean) / scale, rows.useful[:, v]).predict((q - mean) / scale)
            np.testing.assert_allclose(found[:, v], np.maximum(expected, 0.0), rtol=1e-6, atol=1e-6)


def test_rows_that_are_far_from_everything_give_the_bias_and_never_less_than_nothing() -> None:
    start = np.arange(4 * V + 1)
    one = RowRegressor("svr", start, np.zeros((4 * V, 5)), np.full(4 * V, 3.0), np.linspace(-1, 1, 4 * V),
                       np.ones(4 * V), np.zeros((4 * V, 5)), np.ones((4 * V, 5)))  # fmt: skip
    far = PoseFeatures(np.full((1, V), 50.0), np.zeros(1), np.zeros((1, 4)))
    for mode in range(4):
        bias = np.linspace(-1, 1, 4 * V)[mode * V : (mode + 1) * V]
        np.testing.assert_allclose(one.counts(mode, far)[0], np.maximum(bias, 0.0))
    near = PoseFeatures(np.zeros((1, V)), np.zeros(1), np.zeros((1, 4)))
    np.testing.assert_allclose(one.counts(3, near)[0], np.linspace(-1, 1, 4 * V)[3 * V :] + 3.0)


# ---- ours


def test_the_right_palm_is_the_mirror_image_of_the_left_one() -> None:
    regressor, seen = network(), toy_features(20, np.random.default_rng(1))
    right = regressor.counts(RIGHT_PALM, seen)
    np.testing.assert_array_equal(right[:, MIRROR], regressor.counts(LEFT_PALM, seen.mirrored(MIRROR)))
    assert (right > 0).any() and not np.allclose(right, regressor.counts(LEFT_PALM, seen))
    assert network_of(RIGHT_PALM) == network_of(LEFT_PALM) != network_of(FEET)


def test_mirrored_twice_features_and_labels_are_what_they_were() -> None:
    labels = toy_labels(scenes=4)
    twice = labels.mirrored(MIRROR).mirrored(MIRROR)
    for one, other in zip(
        (*labels.scores, labels.useful, labels.mode), (*twice.scores, twice.useful, twice.mode), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    once = labels.mirrored(MIRROR)
    assert {(int(a), int(b)) for a, b in zip(labels.mode, once.mode, strict=True)} == {(0, 0), (1, 2), (2, 1), (3, 3)}


def test_a_network_gives_the_cost_by_layers_of_rectified_sums_of_logarithms() -> None:
    regressor, seen = network(), toy_features(6, np.random.default_rng(2))
    for mode in (FEET, LEFT_PALM, BOTH_PALMS):
        name, found = network_of(mode), regressor.counts(mode, seen)
        for k in range(6):
            x = [*np.log1p(seen.feet[k]), np.log1p(seen.pairs[k]), *seen.palms[k, list(PALM_COLUMNS[mode])]]
            h = (np.array(x) - regressor.mean[name]) / regressor.scale[name]
            for weights, bias in regressor.layers[name][:-1]:
                h = np.maximum(weights.T @ h + bias, 0.0)
            weights, bias = regressor.layers[name][-1]
            cost = np.where(some_score(mode, seen)[k], np.clip(weights.T @ h + bias, LEAST_COST, 1.0), 1.0)
            np.testing.assert_allclose(np.exp(-found[k]), cost, rtol=1e-4, atol=1e-5)
        assert network_inputs(mode, seen).shape == (6, len(regressor.mean[name]))


def test_without_feet_or_without_a_palm_of_the_mode_there_is_no_useful_footstep() -> None:
    regressor, seen = network(), toy_features(50, np.random.default_rng(3))
    left, right = (seen.palms[:, columns].any(axis=1) for columns in ([0, 1], [2, 3]))
    for mode, palms in enumerate((np.ones(50, bool), left, right, left & right)):
        found = regressor.counts(mode, seen)
        assert not found[~palms].any() and not found[seen.feet == 0.0].any() and found.any()
        assert (found >= 0.0).all()


# ---- training, weights and cards


def test_training_measures_itself_on_environments_that_it_has_not_seen(trained, loaded) -> None:
    _, labels, kinds = trained
    test = labels.take(split_by_scene(labels.scene, 3) == TEST)
    assert 0 < len(test.mode) < len(labels.mode)
    for kind in kinds:
        card = loaded[kind].card
        seen = training.features_of(kind, test)
        for mode, name in enumerate(MODES):
            rows = test.mode == mode
            cost = loaded[kind].costs(mode, PoseFeatures(*(a[rows] for a in seen)))
            error = np.sqrt(((cost - np.exp(-test.useful[rows])) ** 2).mean())
            assert card["held_out"]["cost_error"][name] == pytest.approx(error, abs=1e-3)
        assert (card["robot"], card["transition_model"], card["seed"]) == ("escher", MODEL, 3)
        np.testing.assert_array_equal(loaded[kind].translations, TRANSLATIONS)
        assert loaded[kind].exact == kind.startswith("ecc")
    if any(kind.startswith("network") for kind in kinds):
        (kind,) = (kind for kind in kinds if kind.startswith("network"))
        assert max(loaded[kind].card["held_out"]["cost_error"].values()) < 0.3, "toy labels are easily learned"


def test_weights_come_back_as_they_were_written(trained, loaded) -> None:
    _, labels, kinds = trained
    train = labels.take(split_by_scene(labels.scene, 3) == TRAIN)
    seen = toy_features(15, np.random.default_rng(4))
    for kind in kinds:
        fresh = training._train(kind, train, MIRROR, 3)
        for mode in range(4):
            counts, cost = fresh.counts(mode, seen), loaded[kind].costs(mode, seen)
            np.testing.assert_allclose(cost, np.exp(-counts), rtol=1e-3, atol=RTOL)
            assert ((cost >= 0.0) & (cost <= 1.0)).all()


def test_both_kinds_of_labels_together_make_every_kind_of_regressor(tmp_path) -> None:
    kinds = [one.kind for how in ("fixed", "snapped") for one in train_footstep_counts(
        toy_labels(how, scenes=20), ESCHER, tmp_path, 3, lambda line: None)]  # fmt: skip
    assert set(kinds) == set(KINDS)
    assert {path.stem for path in tmp_path.iterdir()} == {weights_name(kind) for kind in KINDS}


def test_equal_seeds_give_equal_bytes_and_other_seeds_others(trained, tmp_path) -> None:
    out, labels, kinds = trained
    train_footstep_counts(labels, ESCHER, tmp_path / "again", 3, lambda line: None)
    for path in out.iterdir():
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes(), path.name
    train_footstep_counts(labels, ESCHER, tmp_path / "other", 5, lambda line: None)
    name = f"{weights_name(kinds[0])}.safetensors"
    assert (out / name).read_bytes() != (tmp_path / "other" / name).read_bytes()


def test_too_few_environments_to_hold_any_out_are_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="too few environments to hold any out"):
        train_footstep_counts(toy_labels(scenes=1), ESCHER, tmp_path / "w", 0, lambda line: None)
    assert not (tmp_path / "w").exists()


def edited(folder: Path, name: str, **facts) -> None:
    card = json.loads((folder / f"{name}.json").read_text())
    (folder / f"{name}.json").write_text(json.dumps(card | facts))


SPOIL = {
    "none": (
        lambda f, n: [path.unlink() for path in f.glob(f"{n}.*")],
        NoWeightsError,
        "has no such traversability weights",
    ),
    "weights missing": (lambda f, n: (f / f"{n}.safetensors").unlink(), WeightsError, "missing, though its card"),
    "card missing": (lambda f, n: (f / f"{n}.json").unlink(), WeightsError, "missing, though its weights"),
    "cut off": (
        lambda f, n: (f / f"{n}.safetensors").write_bytes((f / f"{n}.safetensors").read_bytes()[:-9]),
        WeightsError,
        "SHA-256 differs",
    ),
    "no card": (lambda f, n: (f / f"{n}.json").write_text("]"), WeightsError, "expected a JSON card"),
    "other robot": (lambda f, n: edited(f, n, robot_model_sha256="0" * 64), OtherRobotError, "made for another robot"),
    "other steps": (
        lambda f, n: edited(f, n, transition_model="training"),
        WeightsError,
        f"made for the transition model 'training', expected '{MODEL}'",
    ),
}


@pytest.mark.parametrize("fault", SPOIL)
def test_weights_that_do_not_fit_get_one_line_with_file_and_expectation(fault: str, trained, tmp_path) -> None:
    out, _, (kind, *_) = trained
    name = weights_name(kind)
    for path in out.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    spoil, error, complaint = SPOIL[fault]
    spoil(tmp_path, name)
    with pytest.raises(error) as caught:
        load_traversability(ESCHER, MODEL, kind, tmp_path)
    said = str(caught.value)
    assert complaint in said and str(tmp_path / name) in said and len(said.splitlines()) == 1


def test_weights_of_another_kind_under_this_name_are_incomplete(trained, tmp_path) -> None:
    out, _, (kind, *_) = trained
    other = "acc-svr" if kind.startswith("network") else "network"
    for suffix in ("safetensors", "json"):
        data = (out / f"{weights_name(kind)}.{suffix}").read_bytes()
        (tmp_path / f"{weights_name(other)}.{suffix}").write_bytes(data)
    with pytest.raises(WeightsError, match=r"predicts|incomplete weights"):
        load_traversability(ESCHER, MODEL, other, tmp_path)


@pytest.mark.parametrize("kind", KINDS)
def test_the_weights_that_come_with_escher_fit_its_steps(kind: str) -> None:
    loaded = load_traversability(ESCHER, MODEL, kind)
    _, steps = documented_steps(ESCHER)
    np.testing.assert_array_equal(loaded.translations, steps.translations)
    none = PoseFeatures(np.zeros((1, len(steps.translations))), np.zeros(1), np.zeros((1, 4)))
    plenty = PoseFeatures(np.bincount(steps.translation)[None].astype(float), np.full(1, 114.0), np.zeros((1, 4)))
    if kind.startswith("ecc"):
        plenty = plenty._replace(feet=np.full_like(none.feet, 110.0))
    hard, easy = loaded.costs(FEET, none), loaded.costs(FEET, plenty)
    assert easy.mean() < 0.5 < hard.mean() <= 1.0


# ---- labels from files


def write_labels(folder: Path, labels: FootstepLabels, drop: int = 0, **facts) -> None:
    """Labels as a campaign leaves them."""
    rows = []
    for k, mode in enumerate(labels.mode.tolist()):
        for v in range(V):
            rows.append(
                {"scene": labels.scene[k], "pose": k // 4 % POSES, "ground": "crossing", "walls": "none", "mode": mode,
                 "translation": v, "torso": [0.0, 0.0, 0.0, 0.0], "foot_scores": labels.scores.feet[k, v],
                 "pair_scores": labels.scores.pairs[k], "palm_scores": labels.scores.palms[k],
                 "feet_fit": labels.exact.feet[k, v], "palms_fit": labels.exact.palms[k], "pairs": 114,
                 "useful": int(labels.useful[k, v])}
            )  # fmt: skip
    rows = rows[: len(rows) - drop]
    table = pa.table({f.name: pa.array([row[f.name] for row in rows], f.type) for f in SCHEMA}, schema=SCHEMA)
    folder.mkdir()
    described = {"campaign": CAMPAIGN, "version": VERSION, "seed": 3, "parameters": parameters("fixed") | facts}
    (folder / "campaign.json").write_text(json.dumps(described))
    (folder / shard_name(0)).write_bytes(encode_shard(table, ShardHeader("a", 0, 1)))


def test_labels_are_read_as_they_were_written(tmp_path) -> None:
    labels = toy_labels(scenes=3)
    write_labels(tmp_path / "labels", labels)
    read = FootstepLabels.read(tmp_path / "labels", ESCHER)
    for mine, its in zip((*labels.scores, *labels.exact), (*read.scores, *read.exact), strict=True):
        np.testing.assert_allclose(its, mine)
    np.testing.assert_array_equal(read.useful, labels.useful)
    np.testing.assert_array_equal(read.scene, labels.scene)
    np.testing.assert_array_equal(read.mode, labels.mode)


def refused(capsys, words: list[str], *complaints: str) -> None:
    assert main(["train", "traversability", *words]) == 2
    said = capsys.readouterr()
    lines = [line for line in said.err.splitlines() if line.strip()]
    assert said.out == "" and len(lines) == 1 and all(complaint in lines[0] for complaint in complaints)


def test_wrong_data_get_one_line_that_names_what_was_expected(tmp_path, capsys) -> None:
    out = ["--out", str(tmp_path / "weights")]
    refused(capsys, out, "--data is missing")
    refused(capsys, ["--data", str(tmp_path)], "--out is missing")
    refused(capsys, ["--data", str(tmp_path / "nowhere"), *out], "nowhere", "expected a folder of labels")
    refused(capsys, ["--data", str(tmp_path), *out], "no shards of labels", "drakeplan collect")
    refused(capsys, ["--data", str(tmp_path), *out, "--robot", "eschr"], "did you mean escher")
    write_labels(tmp_path / "jvrc1", toy_labels(scenes=2), robot="jvrc1")
    refused(capsys, ["--data", str(tmp_path / "jvrc1"), *out], "labels of robot 'jvrc1', expected 'escher'")
    write_labels(tmp_path / "cut", toy_labels(scenes=2), drop=1)
    refused(capsys, ["--data", str(tmp_path / "cut"), *out], "do not have every translation of every torso pose")
    write_labels(tmp_path / "few", toy_labels(scenes=1))
    refused(capsys, ["--data", str(tmp_path / "few"), *out], "too few environments", "--resume")
    assert not (tmp_path / "weights").exists()


def test_training_prints_a_table_and_leaves_weights_that_load(tmp_path, capsys) -> None:
    write_labels(tmp_path / "labels", toy_labels(scenes=20))
    words = ["--data", str(tmp_path / "labels"), "--out", str(tmp_path / "weights"), "--seed", "3"]
    assert main(["train", "traversability", *words]) == 0
    said = capsys.readouterr()
    kinds = [path.stem for path in (tmp_path / "weights").glob("*.json")]
    assert f"wrote weights and cards of {len(kinds)} regressors" in said.out
    assert len([line for line in said.out.splitlines() if line.split()[0] in KINDS]) == len(kinds)
    assert (
        load_traversability(ESCHER, MODEL, "acc-nearest", tmp_path / "weights").card["data"]["rows"]
        == 20 * POSES * 4 * V
    )
    assert main(["train", "traversability", *words, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert len(facts["held_out"]) == len(kinds) and set(facts["held_out"][0]["rank"]) == set(MODES)


def test_labels_of_another_robot_model_are_weights_of_another_robot(tmp_path) -> None:
    write_labels(tmp_path / "labels", toy_labels(scenes=20), robot_model_sha256="0" * 64)
    labels = FootstepLabels.read(tmp_path / "labels", ESCHER)
    (kind, *_) = (one.kind for one in train_footstep_counts(labels, ESCHER, tmp_path / "w", 3, lambda line: None))
    with pytest.raises(OtherRobotError):
        load_traversability(ESCHER, MODEL, kind, tmp_path / "w")
    other = dataclasses.replace(ESCHER, model_sha256="0" * 64)
    assert load_traversability(other, MODEL, kind, tmp_path / "w").kind == kind
