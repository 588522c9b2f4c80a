"""Which holes in a raster are so small that they are filled."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

EIGHT, TWENTY_SIX = np.ones((3, 3), bool), np.ones((3, 3, 3), bool)


def small_holes(held: np.ndarray, width: float) -> np.ndarray:
    """(A, B) bool, the cells of holes whose greatest circle is at most so many cells across; notches in the rim are none.

    Args:
        held: (A, B) bool, the cells that are no hole.
        width: in cells.
    """
    number, count = labelled(~held)
    if not count:
        return np.zeros_like(held)
    away = np.asarray(ndimage.distance_transform_edt(np.pad(~held, 1)))[1:-1, 1:-1]
    widest = np.zeros(count + 1)
    np.maximum.at(widest, number.ravel(), away.ravel())
    small = 2 * widest - 1 <= width
    small[0] = False  # what is held
    small[np.concatenate([number[0], number[-1], number[:, 0], number[:, -1]])] = False
    return small[number]


def labelled(mask: np.ndarray, structure: np.ndarray | None = None) -> tuple[np.ndarray, int]:
    """The number of the connected part that each cell is in, from 1, 0 outside; and how many parts there are.

    Args:
        mask: bool.
        structure: which neighbours are connected; None: those across a face.
    """
    number = np.zeros(mask.shape, np.int32)
    count = ndimage.label(mask, structure=structure, output=number)
    return number, int(count)  # pyright: ignore[reportArgumentType]  with an output it is the count alone
