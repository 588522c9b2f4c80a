"""A network as one array of numbers in the order in which a prediction reads them, and the pass through it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from learning.matrix_product import add_product, padded, panels


@dataclass(frozen=True, eq=False)
class PackedNetwork:
    """The mean of M networks of one shape, y = mean_m W_L relu(... relu(W_0 x + b_0) ...) + b_L + S x.

    Attributes:
        widths: (L + 2,) of every layer, inputs and outputs among them.
        members: M.
        linear: whether there is a linear path S.
        values: bias and panels of every layer of every member, the last ones over M, then the panels of the mean S.
    """

    widths: np.ndarray
    members: int
    linear: bool
    values: np.ndarray

    @classmethod
    def of(
        cls,
        weights: Sequence[Sequence[np.ndarray]],
        biases: Sequence[Sequence[np.ndarray]],
        skips: Sequence[np.ndarray | None],
    ) -> PackedNetwork:
        """Packs the members' weights, each (inputs, outputs) a layer, their biases (outputs,), and linear paths.

        Args:
            weights: of each of M members, an array (inputs, outputs) a layer.
            biases: of each member, an array (outputs,) a layer.
            skips: of each member, its linear path (inputs, outputs), or None.

        Raises:
            ValueError: members of different shapes.
        """
        widths = [[len(W[0]), *(layer.shape[1] for layer in W)] for W in weights]
        if any(w != widths[0] for w in widths):
            raise ValueError(f"members of one network have different widths: {widths}")
        share, values = 1.0 / len(weights), []
        for W, b in zip(weights, biases, strict=True):
            for k, (W_k, b_k) in enumerate(zip(W, b, strict=True)):
                scale = np.float32(share if k == len(W) - 1 else 1.0)
                values += [np.pad(scale * b_k, (0, padded(len(b_k)) - len(b_k))), panels(scale * W_k)]
        linear = [skip for skip in skips if skip is not None]
        if linear:
            values.append(panels(np.float32(share) * np.sum(linear, axis=0)))
        flat = np.concatenate(values).astype(np.float32)
        return cls(np.array(widths[0], np.int64), len(weights), bool(linear), flat)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """(n, outputs) float32 for inputs (n, inputs).

        Raises:
            ValueError: another number of inputs.
        """
        if x.ndim != 2 or x.shape[1] != self.widths[0]:
            raise ValueError(f"network: inputs have shape {x.shape}, expected (n, {self.widths[0]})")
        y = np.empty((len(x), padded(int(self.widths[-1]))), np.float32)
        forward(np.ascontiguousarray(x, np.float32), self.widths, self.members, self.linear, self.values, y)
        return y[:, : self.widths[-1]]


@njit(cache=True)
def forward(x: np.ndarray, widths: np.ndarray, members: int, linear: bool, values: np.ndarray, y: np.ndarray) -> None:
    """Answers for x (n, inputs) into y (n, padded(outputs)), see `PackedNetwork`; what is beyond the outputs is 0.

    Args:
        x: (n, inputs) float32.
        widths: (L + 2,) of every layer, inputs and outputs among them.
        members: how many networks are averaged.
        linear: whether there is a linear path.
        values: float32, all weights in the order of `PackedNetwork.values`.
        y: (n, padded(outputs)) float32, written here.
    """
    n, layers, at = len(x), len(widths) - 1, 0
    _fill(y, np.zeros(y.shape[1], np.float32))
    for _ in range(members):
        layer = x
        for k in range(layers - 1):
            columns = padded(widths[k + 1])
            after = np.empty((n, columns), np.float32)
            _fill(after, values[at : at + columns])
            add_product(layer, values, at + columns, widths[k], after)
            _rectify(after)
            layer = after
            at += columns * (1 + widths[k])
        columns = y.shape[1]
        y += values[at : at + columns]
        add_product(layer, values, at + columns, widths[layers - 1], y)
        at += columns * (1 + widths[layers - 1])
    if linear:
        add_product(x, values, at, widths[0], y)


@njit(cache=True)
def _fill(rows: np.ndarray, row: np.ndarray) -> None:
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            rows[i, j] = row[j]


@njit(cache=True)
def _rectify(rows: np.ndarray) -> None:
    """max(., 0) in place; NaN stays NaN."""
    zero = np.float32(0.0)
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            rows[i, j] = zero if rows[i, j] < zero else rows[i, j]
