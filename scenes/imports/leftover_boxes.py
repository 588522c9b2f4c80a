"""Boxes around the points of a cloud that lie on no surface: in the way, and not to be touched."""

from __future__ import annotations

import numpy as np

from scenes.imports.small_holes import TWENTY_SIX, labelled

FINEST = 0.04  # [m] edge of the cells that are joined to boxes
MOST_BOXES = 300  # larger cells are taken until there are no more
FEW_POINTS = 3  # a cell of fewer holds noise
SPECK = 3  # cells that hang together, fewer of which are noise or a flying pixel
THINNEST = 0.005  # [m] a box is this thick at least


def leftover_boxes(points: np.ndarray) -> tuple[np.ndarray, int, float]:
    """(B, 2, 3) lowest and greatest corners of boxes around points, how many points were noise, and the cells' edge [m].

    Cells of a grid that hold points are joined along z, then x, then y while they make a box; a box is then drawn in to
    its points.

    Args:
        points: (N, 3) [m].
    """
    cell = FINEST
    while True:
        boxes, noise = _boxes(points, cell)
        if len(boxes) <= MOST_BOXES:
            return boxes, noise, cell
        cell *= 1.5


def _boxes(points: np.ndarray, cell: float) -> tuple[np.ndarray, int]:
    if not len(points):
        return np.zeros((0, 2, 3)), 0
    place = np.floor(points / cell).astype(np.int64)
    keys, of_point, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    of_point = of_point.ravel()
    kept = _not_specks(keys, count >= FEW_POINTS)
    noise = int((~kept)[of_point].sum())
    low, high = np.full((len(keys), 3), np.inf), np.full((len(keys), 3), -np.inf)
    np.minimum.at(low, of_point, points)
    np.maximum.at(high, of_point, points)
    # A block of cells is its first and last cell; blocks of equal extent across an axis are joined along it.
    blocks = np.concatenate([keys[kept], keys[kept]], axis=1)
    reach = np.concatenate([low[kept], high[kept]], axis=1)
    for axis in (2, 0, 1):
        others = [k for k in range(6) if k % 3 != axis]
        order = np.lexsort((blocks[:, axis], *blocks[:, others].T))
        blocks, reach = blocks[order], reach[order]
        same = (blocks[1:, others] == blocks[:-1, others]).all(axis=1)
        starts = np.concatenate([[True], ~(same & (blocks[1:, axis] == blocks[:-1, axis + 3] + 1))])[: len(blocks)]
        first = np.flatnonzero(starts)
        last = np.append(first[1:], len(blocks)) - 1
        if len(first):
            low_reach = np.minimum.reduceat(reach[:, :3], first)
            high_reach = np.maximum.reduceat(reach[:, 3:], first)
            reach = np.concatenate([low_reach, high_reach], axis=1)
            end = blocks[last, axis + 3]
            blocks = blocks[first].copy()
            blocks[:, axis + 3] = end
    middle, half = (reach[:, :3] + reach[:, 3:]) / 2, np.maximum(reach[:, 3:] - reach[:, :3], THINNEST) / 2
    return np.stack([middle - half, middle + half], axis=1), noise


def _not_specks(keys: np.ndarray, enough: np.ndarray) -> np.ndarray:
    """(K,) bool, the cells with enough points that hang together with others, corners included.

    Args:
        keys: (K, 3) places of the cells.
        enough: (K,) whether each has enough points.
    """
    size = np.ptp(keys, axis=0) + 3
    if np.prod(size.astype(float)) > 5e7:  # far apart: no grid of all cells between them
        return enough
    grid = np.zeros(size, bool)
    at = tuple((keys - keys.min(axis=0) + 1).T)
    grid[at] = enough
    number, _ = labelled(grid, TWENTY_SIX)
    together = np.bincount(number.ravel())
    return enough & (together[number[at]] >= SPECK)
