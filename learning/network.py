"""Fully connected networks without torch: float32, one thread, a handful of matrix products for a whole expansion.

These arrangements answer the same question, what the centroidal program would say of a transition:

    documented   a classifier and a regressor for each category, 3 x 256 ReLU, documented inputs (Lin et al. 2019 fig. 4)
    shared       one network for all categories on the relative inputs, a linear path beside it, averaged over members
    palms        three of these, by how many palms are held (`palm_networks.py`)

Normalisation is folded into the first and last layers when weights are written: networks take features as they are and
answer in SI units.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit

from learning.packed_network import PackedNetwork
from learning.relative_features import RELATIVE_FRAME
from learning.transition_features import (
    CanonicalTransitions,
    Frame,
    documented_features,
)

NUM_REGRESSED = 7  # objective, final CoM (3), final CoM velocity (3)
COST_OFFSET = 10.0  # [-] the shared network learns log(objective + this): below it differences matter little to a plan


class NetworkAnswer(NamedTuple):
    """What networks say of n transitions, in frame F and before calibration; rows of unknown category hold zeros.

    Attributes:
        logit: (n,) of feasibility.
        cost: (n,) objective of the centroidal program [-].
        com: (n, 3) final CoM in F [m].
        velocity: (n, 3) its velocity in F [m/s].
    """

    logit: np.ndarray
    cost: np.ndarray
    com: np.ndarray
    velocity: np.ndarray


class TransitionNetwork(Protocol):
    """Any arrangement of networks for transitions; `frame` is the F in which it takes and gives positions."""

    @property
    def frame(self) -> Frame: ...

    def answer(self, c: CanonicalTransitions, relative: np.ndarray) -> NetworkAnswer:
        """Answers for representatives, of which `relative` holds the features of `relative_features.py` (n, d).

        Args:
            c: n representatives, in the frame of these networks.
            relative: (n, d) their features of `relative_features.py`.
        """
        ...


@dataclass(frozen=True, eq=False)
class Mlp:
    """y = W_L relu(... relu(W_0 x + b_0) ...) + b_L + S x.

    Attributes:
        weights: L + 1 arrays (inputs, outputs), float32.
        biases: as many (outputs,), float32.
        skip: (inputs of the first, outputs of the last), or None: no linear path.
    """

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    skip: np.ndarray | None = None

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """(n, outputs) for inputs (n, inputs), float32."""
        return self._packed(x)

    @cached_property
    def _packed(self) -> PackedNetwork:
        return PackedNetwork.of([self.weights], [self.biases], [self.skip])

    @property
    def shape(self) -> tuple[int, ...]:
        """Width of every layer, inputs and outputs among them."""
        return (len(self.weights[0]), *(W.shape[1] for W in self.weights))


@dataclass(frozen=True, eq=False)
class SharedNetwork:
    """One network for all categories; the mean of its members where there are several.

    Outputs: logit, log(objective + COST_OFFSET), final CoM from the feet's mean after (3) [m], final velocity (3) [m/s].

    Attributes:
        members: networks on the features of `relative_features.py`.
        low, high: (7,) least and greatest of each output but the logit: answers are cut off there. The program keeps the
            final CoM in a box, and often at its border.
    """

    members: tuple[Mlp, ...]
    low: np.ndarray
    high: np.ndarray
    frame: Frame = RELATIVE_FRAME

    def answer(self, c: CanonicalTransitions, relative: np.ndarray) -> NetworkAnswer:
        """See `TransitionNetwork`.

        Args:
            c: n representatives, in the frame of these networks.
            relative: (n, d) their features of `relative_features.py`.
        """
        y, n = self.mean_of_members(relative), len(relative)
        answer = NetworkAnswer(np.empty(n), np.empty(n), np.empty((n, 3)), np.empty((n, 3)))
        _read(y, self.low, self.high, c.feet_after, answer)
        return answer

    def mean_of_members(self, relative: np.ndarray) -> np.ndarray:
        """(n, 8) raw outputs."""
        return self._packed(relative)

    @cached_property
    def _packed(self) -> PackedNetwork:
        members = self.members
        return PackedNetwork.of([m.weights for m in members], [m.biases for m in members], [m.skip for m in members])


@dataclass(frozen=True, eq=False)
class DocumentedNetworks:
    """A classifier and a regressor for each category; None where there was nothing to learn a category from.

    Regressor's outputs: objective (through a ReLU), final CoM in F (3) [m], final velocity in F (3) [m/s].
    """

    classifiers: tuple[Mlp | None, ...]
    regressors: tuple[Mlp | None, ...]
    frame: Frame = "heading"

    def answer(self, c: CanonicalTransitions, relative: np.ndarray) -> NetworkAnswer:
        """See `TransitionNetwork`; categories without networks are answered as infeasible.

        Args:
            c: n representatives, in the frame of these networks.
            relative: (n, d) their features of `relative_features.py`.
        """
        n = len(c.category)
        logit, regressed = np.full(n, -np.inf, np.float32), np.zeros((n, NUM_REGRESSED), np.float32)
        logit[c.category < 0] = 0.0
        for category in np.unique(c.category[c.category >= 0]):
            classifier, regressor = self.classifiers[category], self.regressors[category]
            rows = c.category == category
            x = documented_features(c, int(category)).astype(np.float32)
            if classifier is not None:
                logit[rows] = classifier(x)[:, 0]
            if regressor is not None:
                regressed[rows] = regressor(x)
        return NetworkAnswer(logit, regressed[:, 0].clip(0.0), regressed[:, 1:4], regressed[:, 4:7])


@njit(cache=True)
def _read(y: np.ndarray, low: np.ndarray, high: np.ndarray, feet_after: np.ndarray, answer: NetworkAnswer) -> None:
    """Outputs of the shared network, cut off at the bounds and brought to SI units, into the answer."""
    for i in range(len(y)):
        for k in range(NUM_REGRESSED):
            y[i, 1 + k] = min(max(y[i, 1 + k], low[k]), high[k])
        answer.logit[i], answer.cost[i] = y[i, 0], max(np.exp(y[i, 1]) - COST_OFFSET, 0.0)
        for a in range(3):
            answer.com[i, a], answer.velocity[i, a] = feet_after[i, a] + y[i, 2 + a], y[i, 5 + a]
