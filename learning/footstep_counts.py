"""How many useful footsteps there are about torso poses, predicted from features: the regressors of Lin & Berenson 2017 and ours.

    svr        |Gamma+| = b + sum_i a_i exp(-g |x - x_i|^2)        one for each motion mode and translation, RBF kernel
    nearest    the label of the nearest training row               the same rows
    network    exp(-|Gamma+|) of all translations at once          one for each motion mode up to mirror images

x is (S_f, S_p of the mode's palms), exact or approximate (Lin & Berenson 2017 sec. IV.E, IV.F; Lin 2020 eq. 5.7), scaled. The
network sees the foot scores of all translations and the score of pairs beside them; all its activations are ReLU. It learns the
cost itself: mostly there are many useful footsteps or none, and their mean number says little about how often there are none.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit

FEET, LEFT_PALM, RIGHT_PALM, BOTH_PALMS = range(
    4
)  # numbers of the motion modes, as in `learning.traversability_labels.MODES`
PALM_COLUMNS = ((), (0, 1), (2, 3), (0, 1, 2, 3))  # of the palm scores, by motion mode
MIRRORED_PALMS = (2, 3, 0, 1)  # the palm scores of a mirror image
NETWORKS = ("feet", "palm", "palms")  # networks of the feet, of the left palm and of both
WIDEST = 5  # features of one row of a row regressor
LEAST_COST = 1e-9


class PoseFeatures(NamedTuple):
    """What the ground looks like about n torso poses.

    Attributes:
        feet: (n, V) scores of footsteps by translation, S_f or N_f.
        pairs: (n,) score of pairs of feet, S_pairs.
        palms: (n, 4) scores of palm contacts by quadrant, S_p or N_p: left front, left back, right front, right back.
    """

    feet: np.ndarray
    pairs: np.ndarray
    palms: np.ndarray

    def mirrored(self, mirror: np.ndarray) -> PoseFeatures:
        """The features of the mirror images, left for right.

        Args:
            mirror: (V,) mirror image of each translation.
        """
        return PoseFeatures(self.feet[:, mirror], self.pairs, self.palms[:, list(MIRRORED_PALMS)])


class FootstepCounts(Protocol):
    """A regressor."""

    def counts(self, mode: int, seen: PoseFeatures) -> np.ndarray:
        """(n, V) predicted |Gamma+| by translation, 0 or more.

        Args:
            mode: number of the motion mode.
            seen: features of n poses.
        """
        ...

    def tensors(self) -> Mapping[str, np.ndarray]:
        """Its arrays by name."""
        ...


@dataclass(frozen=True, eq=False)
class RowRegressor:
    """The regressors of Lin & Berenson 2017: one for each motion mode and translation, over rows of a training set.

    Attributes:
        kind: "svr" or "nearest".
        start: (4 V + 1,) the rows of mode m and translation v are start[m V + v] to start[m V + v + 1].
        rows: (S, 5) scaled features: support vectors, or all training rows.
        value: (S,) coefficients a_i, or labels.
        bias: (4 V,) b; 0 for nearest.
        gamma: (4 V,) g; 0 for nearest.
        mean: (4 V, 5) of the features; features are (x - mean) / scale.
        scale: (4 V, 5) of the features.
    """

    kind: str
    start: np.ndarray
    rows: np.ndarray
    value: np.ndarray
    bias: np.ndarray
    gamma: np.ndarray
    mean: np.ndarray
    scale: np.ndarray

    def counts(self, mode: int, seen: PoseFeatures) -> np.ndarray:
        """(n, V) predicted |Gamma+| by translation, 0 or more.

        Args:
            mode: number of the motion mode.
            seen: features of n poses.
        """
        n, v = seen.feet.shape
        x = np.zeros((n, WIDEST))
        columns = PALM_COLUMNS[mode]
        x[:, 1 : 1 + len(columns)] = seen.palms[:, list(columns)]
        out = np.empty((n, v))
        _from_rows(
            self.kind == "svr", mode * v, seen.feet, x, self.start, self.rows, self.value, self.bias, self.gamma,
            self.mean, self.scale, out,
        )  # fmt: skip
        return np.maximum(out, 0.0)

    def tensors(self) -> dict[str, np.ndarray]:
        """Its arrays by name."""
        names = ("start", "rows", "value", "bias", "gamma", "mean", "scale")
        return {name: getattr(self, name) for name in names}

    @staticmethod
    def of(kind: str, tensors: Mapping[str, np.ndarray]) -> RowRegressor:
        """The regressor that these arrays make.

        Args:
            kind: "svr" or "nearest".
            tensors: arrays by name, as `tensors` gives them.
        """
        arrays = {name: np.asarray(array, float) for name, array in tensors.items()}
        return RowRegressor(kind, arrays.pop("start").astype(np.int64), **arrays)


@njit(cache=True)
def _from_rows(
    smooth: bool,
    first: int,
    feet: np.ndarray,
    x: np.ndarray,
    start: np.ndarray,
    rows: np.ndarray,
    value: np.ndarray,
    bias: np.ndarray,
    gamma: np.ndarray,
    mean: np.ndarray,
    scale: np.ndarray,
    out: np.ndarray,
) -> None:
    """Sums kernels over support vectors, or takes the label of the nearest row."""
    width = rows.shape[1]
    at = np.empty(width)
    for k in range(out.shape[0]):
        for v in range(out.shape[1]):
            r = first + v
            for a in range(width):
                at[a] = ((feet[k, v] if a == 0 else x[k, a]) - mean[r, a]) / scale[r, a]
            total, nearest = bias[r], np.inf
            for i in range(start[r], start[r + 1]):
                away = 0.0
                for a in range(width):
                    away += (at[a] - rows[i, a]) ** 2
                if smooth:
                    total += value[i] * np.exp(-gamma[r] * away)
                elif away < nearest:
                    nearest, total = away, value[i]
            out[k, v] = total


@dataclass(frozen=True, eq=False)
class NetworkRegressor:
    """Ours: a small network for each motion mode that sees all translations of a pose at once.

    Attributes:
        layers: by name of `NETWORKS`, as many as there are, pairs of weights (in, out) and biases (out,), the last one linear.
        mean: by name, (inputs,) of the inputs.
        scale: by name, (inputs,) of the inputs.
        mirror: (V,) mirror image of each translation.
    """

    layers: Mapping[str, Sequence[tuple[np.ndarray, np.ndarray]]]
    mean: Mapping[str, np.ndarray]
    scale: Mapping[str, np.ndarray]
    mirror: np.ndarray

    def counts(self, mode: int, seen: PoseFeatures) -> np.ndarray:
        """(n, V) predicted |Gamma+| by translation, 0 or more.

        Args:
            mode: number of the motion mode.
            seen: features of n poses.
        """
        if mode == RIGHT_PALM:
            return self.counts(LEFT_PALM, seen.mirrored(self.mirror))[:, self.mirror]
        name = network_of(mode)
        x = (network_inputs(mode, seen) - self.mean[name]) / self.scale[name]
        *hidden, (last, bias) = self.layers[name]
        for weights, offset in hidden:
            x = np.maximum(x @ weights + offset, 0.0)
        cost = np.clip(x @ last + bias, LEAST_COST, 1.0)
        return -np.log(cost) * some_score(mode, seen)

    def tensors(self) -> dict[str, np.ndarray]:
        """Its arrays by name."""
        out = {"mirror": self.mirror}
        for name in self.layers:
            out |= {f"{name}.mean": self.mean[name], f"{name}.scale": self.scale[name]}
            for k, (weights, bias) in enumerate(self.layers[name]):
                out |= {f"{name}.{k}.weight": weights, f"{name}.{k}.bias": bias}
        return out

    @staticmethod
    def of(tensors: Mapping[str, np.ndarray]) -> NetworkRegressor:
        """The regressor that these arrays make.

        Args:
            tensors: arrays by name, as `tensors` gives them.
        """
        layers, mean, scale = {}, {}, {}
        for name in (name for name in NETWORKS if f"{name}.mean" in tensors):
            depth = sum(key.startswith(f"{name}.") and key.endswith(".weight") for key in tensors)
            layers[name] = [(tensors[f"{name}.{k}.weight"], tensors[f"{name}.{k}.bias"]) for k in range(depth)]
            mean[name], scale[name] = tensors[f"{name}.mean"], tensors[f"{name}.scale"]
        return NetworkRegressor(layers, mean, scale, np.asarray(tensors["mirror"]).astype(np.int64))


def some_score(mode: int, seen: PoseFeatures) -> np.ndarray:
    """(n, V) whether the scores allow a useful footstep at all: feet somewhere, and a contact for every palm of the mode.

    Args:
        mode: number of the motion mode.
        seen: features of n poses.
    """
    left, right = (seen.palms[:, columns].sum(axis=1) > 0.0 for columns in ([0, 1], [2, 3]))
    palms = (True, left, right, left & right)[mode]
    return (seen.feet > 0.0) & np.reshape(palms, (-1, 1))


def network_of(mode: int) -> str:
    """The network that answers for a motion mode, the right palm's by its mirror image."""
    return NETWORKS[{FEET: 0, LEFT_PALM: 1, RIGHT_PALM: 1, BOTH_PALMS: 2}[mode]]


def network_inputs(mode: int, seen: PoseFeatures) -> np.ndarray:
    """(n, inputs) what a network sees of n poses: logarithms of foot scores, palm scores of the mode.

    Args:
        mode: number of the motion mode, not that of the right palm.
        seen: features of n poses.
    """
    palms = seen.palms[:, list(PALM_COLUMNS[mode])]
    return np.column_stack([np.log1p(seen.feet), np.log1p(seen.pairs), palms]).astype(np.float32)
