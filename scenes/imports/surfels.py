"""Surfels: a point cloud averaged over the cells of a grid in space, each joined to its neighbours."""

# SciPy's stubs lose the types of sparse arrays.
# pyright: reportReturnType=false, reportOperatorIssue=false, reportCallIssue=false, reportArgumentType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, eye_array

from scenes.meshes.mesh_orientation import row_numbers

STEPS = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)])
MAX_PASSES = 30


@dataclass(frozen=True, eq=False)
class Surfels:
    """The cells of a cloud that hold points.

    Attributes:
        cell: edge of a cell [m].
        points: (V, 3) mean of each cell's points [m].
        count: (V,) how many points each has.
        of_point: (N,) surfel of each point of the cloud.
        around: (V, 27) surfel in each of the cells around, itself included; -1 where there is none.
    """

    cell: float
    points: np.ndarray
    count: np.ndarray
    of_point: np.ndarray
    around: np.ndarray

    def graph(self) -> csr_array:
        """(V, V) neighbours of each surfel, without itself."""
        size = len(self.points)
        row = np.repeat(np.arange(size), len(STEPS))
        column = self.around.ravel()
        keep = (column >= 0) & (column != row)
        return coo_array((np.ones(int(keep.sum())), (row[keep], column[keep])), shape=(size, size)).tocsr()

    def average(self) -> csr_array:
        """(V, V) what takes values at surfels to their means over each surfel and its neighbours."""
        graph = self.graph() + eye_array(len(self.points), format="csr")
        return csr_array(graph.multiply(1 / np.asarray(graph.sum(axis=1))[:, None]))

    def passes(self, reach: float) -> int:
        """How often to average so that the weights have about this standard deviation [m]."""
        return int(np.clip(round((reach / self.cell) ** 2 / 0.67), 1, MAX_PASSES))


def surfels_of(points: np.ndarray, cell: float) -> Surfels:
    """Averages a cloud over cubes.

    Args:
        points: (N, 3) finite [m].
        cell: edge of a cube [m].
    """
    place = np.floor((points - points.min(axis=0)) / cell).astype(np.int64) + 1
    size = place.max(axis=0) + 2  # an empty cell on each side: no step leads round to the other end
    if np.prod(size.astype(float)) < 2**62:
        key = (place[:, 0] * size[1] + place[:, 1]) * size[2] + place[:, 2]
        step = (STEPS[:, 0] * size[1] + STEPS[:, 1]) * size[2] + STEPS[:, 2]
        keys, of_point = np.unique(key, return_inverse=True)
        wanted = keys[:, None] + step
        found = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        around = np.where(keys[found] == wanted, found, -1)
    else:  # a few points very far apart
        of_point = row_numbers(place)
        around = np.full((int(of_point.max()) + 1, len(STEPS)), -1)
        around[:, len(STEPS) // 2] = np.arange(len(around))
    count = np.bincount(of_point)
    means = np.stack([np.bincount(of_point, weights=points[:, k]) / count for k in range(3)], axis=1)
    return Surfels(cell, means, count, of_point, around)


def local_planes(points: np.ndarray, average: csr_array, passes: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(V, 3) mean, (V, 3) unit normal of either sign, and (V,) standard deviation [m] of a plane fitted around each point.

    Args:
        points: (V, 3) [m].
        average: (V, V) what takes values at points to means over each and its neighbours.
        passes: how often moments are averaged: the more, the wider the plane.
    """
    centre = points.mean(axis=0)
    p = points - centre
    pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    moments = np.concatenate([p, np.stack([p[:, i] * p[:, j] for i, j in pairs], axis=1)], axis=1)
    for _ in range(passes):
        moments = average @ moments
    mean = moments[:, :3]
    spread = np.empty((len(p), 3, 3))
    for column, (i, j) in enumerate(pairs):
        spread[:, i, j] = spread[:, j, i] = moments[:, 3 + column] - mean[:, i] * mean[:, j]
    value, vector = np.linalg.eigh(spread)
    return mean + centre, vector[:, :, 0], np.sqrt(np.maximum(value[:, 0], 0.0))
