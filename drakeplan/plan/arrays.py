"""Arrays of a plan: copied in, checked once and read-only from then on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

Shape = tuple[int | None, ...]  # None: any length
SAME_TIME = 1e-9  # [s] times nearer than this are one: multiples of a step are rounded


def freeze(record: object, name: str, *, floats: Mapping[str, Shape], indices: set[str]) -> None:
    """Copies the named arrays in, read-only, after checking that they are finite numbers of the right shape.

    Args:
        record: a frozen dataclass under construction.
        name: of the record, for messages.
        floats: shape of each array of real numbers.
        indices: names of the arrays of integers, of any shape.

    Raises:
        ValueError: another shape, a number that is not finite, or no integers where these are expected.
    """
    for key, shape in floats.items():
        array = np.array(getattr(record, key), dtype=np.float64, order="C")
        if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
            expected = " x ".join("any" if n is None else str(n) for n in shape)
            raise ValueError(f"{name}/{key} must be {expected}, got shape {array.shape}")
        if not np.isfinite(array).all():
            raise ValueError(f"{name}/{key} holds a number that is not finite")
        object.__setattr__(record, key, read_only(array))
    for key in sorted(indices):
        array = np.asarray(getattr(record, key))
        if array.size and not np.issubdtype(array.dtype, np.integer):
            raise ValueError(f"{name}/{key} must hold integers, got {array.dtype}")
        object.__setattr__(record, key, read_only(np.array(array, dtype=np.int64, order="C")))


def read_only(array: np.ndarray) -> np.ndarray:
    """The same array, which nobody may write to any more."""
    array.setflags(write=False)
    return array


def require_same_length(record: object, name: str, first: str, *others: str) -> None:
    """Raises ValueError unless the named arrays have as many rows as the first.

    Args:
        record: that has them.
        name: of the record, for messages.
        first: name of the array that the others are compared with.
        *others: their names.
    """
    length = len(getattr(record, first))
    for key in others:
        if len(getattr(record, key)) != length:
            raise ValueError(f"{name}/{key} has {len(getattr(record, key))} rows, {name}/{first} {length}")


def require_indices(name: str, array: np.ndarray, lowest: int, count: int | None) -> None:
    """Raises ValueError unless an array is a list of indices in a range.

    Args:
        name: of the array, for messages.
        array: of integers.
        lowest: index.
        count: the first index that names nothing; None for no such.
    """
    if array.ndim != 1:
        raise ValueError(f"{name} must be a list of indices, got shape {array.shape}")
    if array.size and (array.min() < lowest or (count is not None and array.max() >= count)):
        raise ValueError(f"{name} holds an index that names nothing")


def require_contact_table(name: str, table: np.ndarray, num_effectors: int, num_contacts: int) -> None:
    """Raises ValueError unless a table holds an index into the contacts, or -1, for each end effector.

    Args:
        name: of the table, for messages.
        table: (any, E) of integers.
        num_effectors: E.
        num_contacts: the first index that names no contact.
    """
    if table.ndim != 2 or table.shape[1] != num_effectors:
        raise ValueError(f"{name} must have {num_effectors} columns, got shape {table.shape}")
    if table.size and (table.min() < -1 or table.max() >= num_contacts):
        raise ValueError(f"{name} holds an index that names no contact")


def last_before(times: np.ndarray, t: np.ndarray | float) -> np.ndarray:
    """The row that holds at time t, where row n holds over [times[n], times[n + 1]); the first or the last one outside.

    Args:
        times: (N,) ascending [s].
        t: any shape [s].
    """
    row = np.searchsorted(times, np.asarray(t) + SAME_TIME, side="right") - 1
    return np.clip(row, 0, max(len(times) - 1, 0))
