"""Sparse constraint rows, gathered in whole arrays; their pattern is sorted once and filled again and again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp


class SparseRows:
    """Collects the entries of a sparse matrix, each place once. Zeros are kept: they hold the pattern."""

    def __init__(self) -> None:
        self._rows: list[np.ndarray] = []
        self._cols: list[np.ndarray] = []
        self._values: list[np.ndarray] = []

    def add(self, rows: np.ndarray, cols: np.ndarray, values: np.ndarray | float) -> None:
        """Adds values at (rows, cols); the three are broadcast against one another.

        Args:
            rows, cols: places.
            values: coefficients.
        """
        rows, cols, values = np.broadcast_arrays(rows, cols, np.asarray(values, float))
        self._rows.append(rows.ravel())
        self._cols.append(cols.ravel())
        self._values.append(values.ravel())

    def add_blocks(self, rows: np.ndarray, cols: np.ndarray, blocks: np.ndarray) -> None:
        """Adds (..., a, b) blocks at rows (..., a) and columns (..., b).

        Args:
            rows: (..., a) places.
            cols: (..., b) places.
            blocks: (..., a, b) coefficients.
        """
        self.add(rows[..., :, None], cols[..., None, :], blocks)

    @property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """(nnz,) rows and (nnz,) columns in the order in which they were added."""
        rows, cols = (np.concatenate([np.zeros(0, int), *parts]) for parts in (self._rows, self._cols))
        return rows, cols

    @property
    def values(self) -> np.ndarray:
        """(nnz,) values in the order in which they were added."""
        return np.concatenate([np.zeros(0), *self._values])

    def pattern(self, num_rows: int, num_cols: int) -> RowPattern:
        """Where the entries stand, over the columns that occur.

        Args:
            num_rows: of the matrix.
            num_cols: number of the program's variables.
        """
        rows, cols = self.places
        occurs = np.zeros(num_cols, bool)
        occurs[cols] = True
        place = np.cumsum(occurs) - 1
        return RowPattern.of(rows, place[cols], (num_rows, int(occurs.sum())), np.flatnonzero(occurs))


@dataclass(frozen=True, eq=False)
class RowPattern:
    """The places of a sparse matrix's entries, in the order that a compressed matrix wants.

    Attributes:
        shape: of the matrix.
        columns: which variable each column is.
        order: (nnz,) place of each compressed entry among the values as they were added.
        indices, indptr: as in `scipy.sparse.csc_matrix`.
    """

    shape: tuple[int, int]
    columns: np.ndarray
    order: np.ndarray
    indices: np.ndarray
    indptr: np.ndarray

    @classmethod
    def of(cls, rows: np.ndarray, cols: np.ndarray, shape: tuple[int, int], columns: np.ndarray) -> RowPattern:
        """The pattern of entries at (rows, cols), each place occurring once.

        Args:
            rows, cols: (k,) places of the entries.
            shape: of the matrix over all columns.
            columns: (m,) columns that are kept, ascending.
        """
        numbered = sp.coo_matrix((np.arange(1, len(rows) + 1), (rows, cols)), shape=shape).tocsc()
        numbered.sort_indices()
        if numbered.nnz != len(rows):
            raise ValueError("an entry of a sparse matrix was given twice")
        return cls(shape, columns, numbered.data - 1, numbered.indices, numbered.indptr)

    def matrix(self, values: np.ndarray) -> sp.csc_matrix:
        """The matrix with these (nnz,) values, in the order in which the entries were added."""
        return sp.csc_matrix((values[self.order], self.indices, self.indptr), shape=self.shape)
