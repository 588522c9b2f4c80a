"""Sparse constraint rows, gathered in whole arrays."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp


class SparseRows:
    """Collects entries of a sparse matrix; entries that share a place add up. Zeros are kept: they hold the pattern."""

    def __init__(self) -> None:
        self._rows: list[np.ndarray] = []
        self._cols: list[np.ndarray] = []
        self._values: list[np.ndarray] = []

    def add(self, rows: np.ndarray, cols: np.ndarray, values: np.ndarray | float) -> None:
        """Adds values at (rows, cols); the three are broadcast against one another."""
        rows, cols, values = np.broadcast_arrays(rows, cols, np.asarray(values, float))
        self._rows.append(rows.ravel())
        self._cols.append(cols.ravel())
        self._values.append(values.ravel())

    def add_blocks(self, rows: np.ndarray, cols: np.ndarray, blocks: np.ndarray) -> None:
        """Adds (..., a, b) blocks at rows (..., a) and columns (..., b)."""
        self.add(rows[..., :, None], cols[..., None, :], blocks)

    def compressed(self, num_rows: int, num_cols: int) -> tuple[sp.csc_matrix, np.ndarray]:
        """The matrix over the columns that occur, and which those are, ascending."""
        rows, cols = np.concatenate(self._rows), np.concatenate(self._cols)
        occurs = np.zeros(num_cols, bool)
        occurs[cols] = True
        used = np.flatnonzero(occurs)
        place = np.cumsum(occurs) - 1
        entries = np.concatenate(self._values), (rows, place[cols])
        return sp.coo_matrix(entries, shape=(num_rows, len(used))).tocsc(), used
