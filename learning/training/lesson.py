"""What one network is taught: inputs, answers, and which of them count. No torch here."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from learning.labelled_transitions import TRAIN, VALIDATION, LearningSet
from learning.network import COST_OFFSET, Mlp
from learning.palm_networks import NUM_PALMS, PALMS
from learning.training.options import TrainingOptions
from learning.transition_features import (
    documented_feature_names,
    documented_features,
)

_SPREAD_FLOOR = 1e-3  # what varies less is a constant: as a feature it is left alone
_RIDGE = 1e-3  # a row, in squares of standard deviations
_NEAR_PI = np.pi / 4  # [rad] angles within this of +-pi are duplicated


@dataclass(frozen=True, eq=False)
class Lesson:
    """The data of one network; validation rows only measure.

    Attributes:
        name: of the network in the weight file.
        x, x_validation: (n, inputs) float32.
        feasible, feasible_validation: (n,) bool.
        y, y_validation: (n, r) regressed outputs in SI units, counted where feasible; r may be 0.
        worth, worth_validation: (n,) float32 weights of the rows among the regressed outputs; None: all alike.
        classifies: whether the first output is the logit of feasibility.
        positive_first: whether the first regressed output passes through a ReLU (the documented objective).
        skip: whether a linear path runs beside the hidden layers.
        bounded: whether answers are cut off at the least and greatest ones of the feasible training rows. Where the truth
            lies there, a prediction beyond is right (a censored regression, Tobin 1958).
    """

    name: str
    x: np.ndarray
    feasible: np.ndarray
    y: np.ndarray
    x_validation: np.ndarray
    feasible_validation: np.ndarray
    y_validation: np.ndarray
    classifies: bool
    worth: np.ndarray | None = None
    worth_validation: np.ndarray | None = None
    positive_first: bool = False
    skip: bool = False
    bounded: bool = False

    @property
    def num_outputs(self) -> int:
        """Outputs of the network."""
        return int(self.classifies) + self.y.shape[1]

    def input_scaling(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and spread (inputs,) of the training rows."""
        mean, spread = _mean_and_spread(self.x)
        return mean, np.where(spread > _SPREAD_FLOOR, spread, 1.0)

    def output_scaling(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and spread (r,) of the feasible training rows."""
        mean, spread = _mean_and_spread(self.y[self.feasible])
        return mean, np.maximum(spread, _SPREAD_FLOOR)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest (r,) of the feasible training rows; those of all numbers where answers are not bounded."""
        if not self.bounded or not self.feasible.any():
            return np.full(self.y.shape[1], -np.inf), np.full(self.y.shape[1], np.inf)
        return self.y[self.feasible].min(axis=0), self.y[self.feasible].max(axis=0)

    def linear_fit(self) -> np.ndarray:
        """(inputs, outputs) float32: ridge regression of the scaled outputs on the scaled inputs; 0 for a logit."""
        mean, spread = self.input_scaling()
        centre, scale = self.output_scaling()
        x = (self.x[self.feasible] - mean) / spread
        y = (self.y[self.feasible] - centre) / scale
        fit = np.linalg.solve(x.T @ x + _RIDGE * max(len(x), 1) * np.eye(x.shape[1]), x.T @ y)
        return np.concatenate([np.zeros((x.shape[1], int(self.classifies))), fit], axis=1).astype(np.float32)

    def fingerprint(self, options: TrainingOptions) -> str:
        """SHA-256 over data and options: a training is taken up only where both are the same."""
        sha = hashlib.sha256(
            repr((self.name, options, self.classifies, self.positive_first, self.skip, self.bounded)).encode()
        )
        arrays = [self.x, self.feasible, self.y, self.x_validation, self.feasible_validation, self.y_validation]
        for array in arrays + [worth for worth in (self.worth, self.worth_validation) if worth is not None]:
            sha.update(repr((array.shape, array.dtype.str)).encode())
            sha.update(np.ascontiguousarray(array).tobytes())
        return sha.hexdigest()


def lessons(data: LearningSet, options: TrainingOptions) -> list[Lesson]:
    """One lesson for each network of this kind; documented ones only where there is something to learn from.

    Args:
        data: representatives and what the program said of them.
        options: which kind of networks, and how large.
    """
    if options.kind == "shared":
        every = np.ones(len(data.feasible), bool)
        return [_shared(data, every, f"member{k}", options.dear) for k in range(options.members)]
    if options.kind == "palms":
        palms = PALMS[data.representatives.category]
        return [
            _shared(data, palms == n, palms_name(n, k), options.dear)
            for n in range(NUM_PALMS)
            for k in range(options.members)
        ]
    made = []
    for category in np.unique(data.representatives.category):
        if len(data.rows(TRAIN, int(category))):
            made += _documented(data, int(category))
    return made


def fold_scaling(lesson: Lesson, mlp: Mlp) -> Mlp:
    """The network on features as they are and answers in SI units, from one on scaled ones.

    Args:
        lesson: holds means and scales of inputs and outputs.
        mlp: the network on scaled ones.
    """
    mean, spread = lesson.input_scaling()
    weights = [np.array(W, float) for W in mlp.weights]
    biases = [np.array(b, float) for b in mlp.biases]
    skip = None if mlp.skip is None else np.array(mlp.skip, float)
    biases[0] = biases[0] - (mean / spread) @ weights[0]
    weights[0] = weights[0] / spread[:, None]
    shift = np.zeros(lesson.num_outputs)
    if skip is not None:
        shift -= (mean / spread) @ skip
        skip = skip / spread[:, None]
    centre, scale = np.zeros(lesson.num_outputs), np.ones(lesson.num_outputs)
    first = int(lesson.classifies)
    if lesson.y.shape[1]:
        centre[first:], scale[first:] = lesson.output_scaling()
    weights[-1] = weights[-1] * scale
    biases[-1] = (biases[-1] + shift) * scale + centre
    skip = None if skip is None else (skip * scale).astype(np.float32)
    return Mlp(tuple(W.astype(np.float32) for W in weights), tuple(b.astype(np.float32) for b in biases), skip)


def with_turned_angles(x: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and their duplicates with angles near +-pi shifted by 2 pi, and the row each comes from.

    Lin et al. 2019 sec. VII: angles near pi and -pi mean the same, so those samples are duplicated with -+2 pi.

    Args:
        x: (n, d) features.
        angles: columns that are angles in [-pi, pi).

    Returns:
        (m, d) features, m >= n with the rows themselves first, and (m,) indices into x.
    """
    rows, origin = [x], [np.arange(len(x))]
    for column in angles:
        near = np.flatnonzero(np.abs(x[:, column]) > np.pi - _NEAR_PI)
        turned = x[near].copy()
        turned[:, column] -= 2 * np.pi * np.sign(turned[:, column])
        rows.append(turned)
        origin.append(near)
    return np.concatenate(rows), np.concatenate(origin)


def palms_name(palms: int, member: int) -> str:
    """Name of a network of kind "palms" in the weight file.

    Args:
        palms: how many are held, 0 to 2.
        member: number of the network among those that are averaged.
    """
    return f"palms{palms}_member{member}"


def _shared(data: LearningSet, chosen: np.ndarray, name: str, dear: float) -> Lesson:
    """Both tasks in one network, for the chosen (n,) rows."""
    y = np.concatenate(
        [np.log(data.cost + COST_OFFSET)[:, None], data.com - data.representatives.feet_after, data.velocity], axis=1
    )  # fmt: skip
    y[~data.feasible] = 0.0
    y, worth = y.astype(np.float32), (1.0 / (1.0 + data.cost / dear)).astype(np.float32)
    train, check = (np.flatnonzero((data.part == part) & chosen) for part in (TRAIN, VALIDATION))
    return Lesson(
        name, data.relative[train], data.feasible[train], y[train], data.relative[check], data.feasible[check], y[check],
        classifies=True, worth=worth[train], worth_validation=worth[check], skip=True, bounded=True,
    )  # fmt: skip


def _documented(data: LearningSet, category: int) -> list[Lesson]:
    """Classifier and regressor of one category; the regressor learns from feasible transitions alone."""
    c = data.representatives
    x = documented_features(c, category).astype(np.float32)
    rows = np.flatnonzero(c.category == category)
    y = np.concatenate([data.cost[rows, None], data.com[rows], data.velocity[rows]], axis=1).astype(np.float32)
    feasible, part = data.feasible[rows], data.part[rows]
    names = documented_feature_names(category)
    angles = np.array([k for k, name in enumerate(names) if name.endswith((".rx", ".ry", ".rz"))])
    made = []
    for name, classifies in (("classifier", True), ("regressor", False)):
        train = np.flatnonzero((part == TRAIN) & (classifies | feasible))
        check = np.flatnonzero((part == VALIDATION) & (classifies | feasible))
        if not len(train):
            continue
        x_train, origin = with_turned_angles(x[train], angles)
        r = 0 if classifies else y.shape[1]
        made.append(
            Lesson(
                f"{name}{category}", x_train, feasible[train][origin], y[train][origin][:, :r], x[check],
                feasible[check], y[check][:, :r], classifies=classifies, positive_first=not classifies,
            )
        )  # fmt: skip
    return made


def _mean_and_spread(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if not len(rows):
        return np.zeros(rows.shape[1]), np.ones(rows.shape[1])
    return rows.mean(axis=0, dtype=float), rows.std(axis=0, dtype=float)
