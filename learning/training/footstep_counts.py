"""Trains the regressors of useful footsteps on a campaign's labels and measures them on scenes that were held out.

Everything comes from scikit-learn: SVR with an RBF kernel and nearest neighbours as in Lin & Berenson 2017 sec. IV.E and IV.F,
and a small network. Arrays are kept, never objects.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from learning.dataset import TEST, TRAIN, Dataset, read_dataset, split_by_scene
from learning.footstep_counts import (
    BOTH_PALMS,
    FEET,
    LEFT_PALM,
    PALM_COLUMNS,
    RIGHT_PALM,
    WIDEST,
    FootstepCounts,
    NetworkRegressor,
    PoseFeatures,
    RowRegressor,
    network_inputs,
    network_of,
)
from learning.traversability import KINDS, PREDICTS, weights_name
from learning.traversability_labels import CAMPAIGN, MODES, SCHEMA, VERSION
from learning.weights import write_weights
from scenes.input_error import InputError
from scenes.robots.robot import Robot

ROWS = 600  # training rows of each row regressor: its time grows with them
SVR_OPTIONS = {"C": 10.0, "epsilon": 0.1, "gamma": "scale"}
HIDDEN, EPOCHS, BATCH, STEP = (64, 64), 60, 256, 2e-3


@dataclass(frozen=True, eq=False)
class FootstepLabels:
    """Labels by torso pose and motion mode, n of them.

    Attributes:
        scene: (n,) number of the environment.
        mode: (n,) number of the motion mode.
        scores: approximate contact checking.
        exact: exact contact checking.
        useful: (n, V) |Gamma+| by translation.
        source: what the data are.
    """

    scene: np.ndarray
    mode: np.ndarray
    scores: PoseFeatures
    exact: PoseFeatures
    useful: np.ndarray
    source: Mapping[str, Any]

    @staticmethod
    def read(folder: Path, robot: Robot) -> FootstepLabels:
        """The rows that a traversability campaign wrote.

        Args:
            folder: of the campaign.
            robot: that the labels have to be of.

        Raises:
            InputError: as `learning.dataset.read_dataset`, or labels of another robot.
        """
        data = read_dataset(folder, campaign=CAMPAIGN, version=VERSION, schema=SCHEMA)
        parameters = data.source["parameters"]
        assert isinstance(parameters, dict)
        if parameters.get("robot") != robot.name:
            raise InputError(
                f"{folder}: these are labels of robot {parameters.get('robot')!r}, expected {robot.name!r}"
            )
        return _by_pose(data, len(parameters["translations"]))

    def take(self, chosen: np.ndarray) -> FootstepLabels:
        """Some of the poses and modes, by index or mask."""
        scores, exact = (PoseFeatures(*(array[chosen] for array in seen)) for seen in (self.scores, self.exact))
        return FootstepLabels(self.scene[chosen], self.mode[chosen], scores, exact, self.useful[chosen], self.source)

    def mirrored(self, mirror: np.ndarray) -> FootstepLabels:
        """The mirror images, left for right.

        Args:
            mirror: (V,) mirror image of each translation.
        """
        mode = np.array([FEET, RIGHT_PALM, LEFT_PALM, BOTH_PALMS])[self.mode]
        scores, exact = self.scores.mirrored(mirror), self.exact.mirrored(mirror)
        return FootstepLabels(self.scene, mode, scores, exact, self.useful[:, mirror], self.source)


@dataclass(frozen=True)
class HeldOut:
    """How good a regressor is on scenes that it was not trained on.

    Attributes:
        kind: of `learning.traversability.KINDS`.
        cost_error: root mean square error of the traversability cost exp(-|Gamma+|), by mode.
        count_error: mean absolute error of log(1 + |Gamma+|), by mode.
        rank: Spearman's rank correlation with |Gamma+|, by mode.
        microseconds: of one estimate, in a batch.
    """

    kind: str
    cost_error: Mapping[str, float]
    count_error: Mapping[str, float]
    rank: Mapping[str, float]
    microseconds: float

    def facts(self) -> dict[str, Any]:
        """As JSON values, rounded to what is known."""

        def rounded(values: Mapping[str, float]) -> dict[str, float]:
            return {name: round(value, 4) for name, value in values.items()}

        return {
            "kind": self.kind,
            "cost_error": rounded(self.cost_error),
            "count_error": rounded(self.count_error),
            "rank": rounded(self.rank),
        }


def train_footstep_counts(
    labels: FootstepLabels, robot: Robot, out: Path, seed: int, tell: Callable[[str], None]
) -> list[HeldOut]:
    """Trains regressors, measures them on held-out scenes, and writes weights and cards to a folder.

    Labels of steps that move to the nearest foothold make the network for these; those of fixed steps make all others, or the
    network alone where not every motion mode has labels.

    Args:
        labels: of one robot.
        robot: whose labels they are.
        out: folder.
        seed: of the split, of the rows that are drawn and of the initial weights.
        tell: told what goes on, a line each.
    """
    part = split_by_scene(labels.scene, seed)
    train, test = labels.take(part == TRAIN), labels.take(part == TEST)
    if not len(train.mode) or not len(test.mode):
        raise InputError("too few environments to hold any out: collect more, with --count and --resume")
    translations = np.array(labels.source["parameters"]["translations"])
    mirror = mirror_of(translations)
    found = []
    snapped = labels.source["parameters"].get("footholds") == "snapped"
    fixed = KINDS[1:] if set(range(len(MODES))) <= set(train.mode.tolist()) else KINDS[1:2]
    for kind in KINDS[:1] if snapped else fixed:
        tell(f"{kind}: training on {len(np.unique(train.scene))} environments")
        regressor = _train(kind, train, mirror, seed)
        held_out = measure(kind, regressor, test)
        parameters = labels.source["parameters"]
        card = {
            "kind": kind,
            "robot": robot.name,
            "robot_model_sha256": parameters["robot_model_sha256"],
            "transition_model": parameters["transition_model"],
            "footholds": parameters["footholds"],
            "predicts": PREDICTS[kind.startswith("network")],
            "translations": translations.tolist(),
            "data": dict(labels.source),
            "seed": seed,
            "held_out": held_out.facts(),
        }
        write_weights(out, weights_name(kind), regressor.tensors(), card)
        found.append(held_out)
    return found


def measure(kind: str, regressor: FootstepCounts, test: FootstepLabels) -> HeldOut:
    """Errors and rank correlation on some labels.

    Args:
        kind: of `learning.traversability.KINDS`.
        regressor: of that kind.
        test: labels.
    """
    cost, count, rank, seconds, estimates = {}, {}, {}, 0.0, 0
    for mode, name in enumerate(MODES):
        rows = test.take(test.mode == mode)
        if not len(rows.mode):
            continue
        seen = features_of(kind, rows)
        regressor.counts(mode, PoseFeatures(*(array[:1] for array in seen)))  # compiled before the clock runs
        began = time.perf_counter()
        predicted = regressor.counts(mode, seen)
        seconds, estimates = seconds + time.perf_counter() - began, estimates + predicted.size
        cost[name] = float(np.sqrt(((np.exp(-predicted) - np.exp(-rows.useful)) ** 2).mean()))
        count[name] = float(np.abs(np.log1p(predicted) - np.log1p(rows.useful)).mean())
        rank[name] = float(np.asarray(spearmanr(predicted.ravel(), rows.useful.ravel()))[0])
    return HeldOut(kind, cost, count, rank, 1e6 * seconds / max(estimates, 1))


def held_out_text(found: list[HeldOut]) -> str:
    """A table: errors and rank correlation of each kind, the mean over the motion modes."""
    lines = [f"{'regressor':<14}{'cost error':>12}{'count error':>13}{'rank corr.':>12}{'us an estimate':>16}"]
    for one in found:
        means = [np.mean(list(values.values())) for values in (one.cost_error, one.count_error, one.rank)]
        lines.append(f"{one.kind:<14}{means[0]:>12.4f}{means[1]:>13.4f}{means[2]:>12.4f}{one.microseconds:>16.2f}")
    return "\n".join(lines)


def mirror_of(translations: np.ndarray) -> np.ndarray:
    """(V,) the translation that is the mirror image of each.

    Args:
        translations: (V, 2) in cells, forward and to the left.
    """
    known = {(x, y): k for k, (x, y) in enumerate(translations.tolist())}
    return np.array([known[x, -y] for x, y in translations.tolist()])


def features_of(kind: str, labels: FootstepLabels) -> PoseFeatures:
    """The features that a kind of regressor sees.

    Args:
        kind: of `learning.traversability.KINDS`.
        labels: that have both.
    """
    return labels.exact if kind.startswith("ecc") else labels.scores


def _train(kind: str, train: FootstepLabels, mirror: np.ndarray, seed: int) -> FootstepCounts:
    if kind.startswith("network"):
        return _train_network(train, mirror, seed)
    return _train_rows(kind, train, seed)


def _train_network(train: FootstepLabels, mirror: np.ndarray, seed: int) -> NetworkRegressor:
    """One network for each motion mode, up to mirror images."""
    from sklearn.neural_network import MLPRegressor

    both, layers, mean, scale = train.mirrored(mirror), {}, {}, {}
    for mode in (m for m in (FEET, LEFT_PALM, BOTH_PALMS) if (train.mode == m).any()):
        some = [labels.take(labels.mode == mode) for labels in (train, both)]
        x = np.concatenate([network_inputs(mode, labels.scores) for labels in some])
        y = np.exp(-np.concatenate([labels.useful for labels in some]))
        name = network_of(mode)
        mean[name], scale[name] = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-3)
        model = MLPRegressor(
            hidden_layer_sizes=HIDDEN, batch_size=min(BATCH, len(x)), learning_rate_init=STEP, max_iter=EPOCHS,  # type: ignore[arg-type]
            random_state=seed, tol=0.0, n_iter_no_change=EPOCHS,
        )  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that it has not converged: the number of epochs is chosen
            model.fit(((x - mean[name]) / scale[name]).astype(np.float32), y.astype(np.float32))
        layers[name] = list(zip(model.coefs_, model.intercepts_, strict=True))
    return NetworkRegressor(layers, mean, scale, mirror)


def _train_rows(kind: str, train: FootstepLabels, seed: int) -> RowRegressor:
    """The regressors of Lin & Berenson 2017: one for each motion mode and translation."""
    from sklearn.svm import SVR

    rng, method = np.random.default_rng(seed), kind.split("-")[1]
    start, rows, value, bias, gamma, mean, scale = [0], [], [], [], [], [], []
    for mode in range(len(MODES)):
        of_mode = train.take(train.mode == mode)
        seen = features_of(kind, of_mode)
        palms = seen.palms[:, list(PALM_COLUMNS[mode])]
        chosen = rng.permutation(len(palms))[:ROWS]
        for v in range(of_mode.useful.shape[1]):
            x = np.zeros((len(chosen), WIDEST))
            x[:, 0], x[:, 1 : 1 + palms.shape[1]] = seen.feet[chosen, v], palms[chosen]
            y = of_mode.useful[chosen, v].astype(float)
            mean.append(x.mean(axis=0))
            scale.append(np.maximum(x.std(axis=0), 1e-3))
            x = (x - mean[-1]) / scale[-1]
            if method == "svr":
                width = 1 + palms.shape[1]
                model = SVR(**SVR_OPTIONS).fit(x[:, :width], y)
                support = np.zeros((len(model.support_), WIDEST))
                support[:, :width] = model.support_vectors_
                rows.append(support)
                value.append(model.dual_coef_[0])
                bias.append(float(model.intercept_[0]))
                gamma.append(float(model._gamma))
            else:
                rows.append(x)
                value.append(y)
                bias.append(0.0)
                gamma.append(0.0)
            start.append(start[-1] + len(rows[-1]))
    arrays = np.concatenate(rows), np.concatenate(value), np.array(bias), np.array(gamma), np.array(mean)
    return RowRegressor(method, np.array(start), *arrays, np.array(scale))


def _by_pose(data: Dataset, width: int) -> FootstepLabels:
    """Rows of one pose and mode put side by side."""

    def first(name: str) -> np.ndarray:
        return data.array(name)[::width]

    def wide(name: str) -> np.ndarray:
        return data.array(name).reshape(-1, width).astype(float)

    if len(data) % width or (data.array("translation").reshape(-1, width) != np.arange(width)).any():
        raise InputError("these labels do not have every translation of every torso pose")
    pairs = first("pair_scores")
    scores = PoseFeatures(wide("foot_scores"), pairs, first("palm_scores"))
    exact = PoseFeatures(wide("feet_fit"), pairs, first("palms_fit"))
    return FootstepLabels(first("scene"), first("mode").astype(int), scores, exact, wide("useful"), data.source)
