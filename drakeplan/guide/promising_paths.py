"""Ways to the goal that differ: the shortest, and those that remain where parts of known ones are closed.

Lin & Berenson 2017 sec. IV.H estimate traversability only near such ways, found as C. Voss, M. Moll and L. E. Kavraki,
"A heuristic approach to finding diverse short paths" (2015), propose: discs on known ways are closed, the next shortest way is
kept where it leads elsewhere, and so on.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from collections import deque

import numpy as np
from numba import njit
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from drakeplan.contact_planning.torso_grid import TURNS
from drakeplan.guide.torso_graph import TorsoGraph

MOST_PATHS = 4
MOST_TRIES = 12  # ways that are looked for
DISC = 0.8  # [m] radius of what is closed at the middle of a known way
ENDS = 1.0  # [m] nothing is closed this near to start or goal
DIFFERENT = 0.8  # [m] a way that somewhere is so far from another one leads elsewhere
LONGEST = 1.8  # times the length of the shortest


def promising_paths(graph: TorsoGraph, start: int) -> list[np.ndarray]:
    """Ways in the plan view that differ, (n, 3) points with heights each [m], the shortest first; none where no way leads there.

    Args:
        graph: of the torso.
        start: node.
    """
    rank, own, tail, head, length = _places(graph)
    xy = graph.origin + (graph.place[own, :2] + 0.5) * graph.cell
    points = np.column_stack([xy, graph.z[own]])
    number = np.full(len(graph.z), -1)
    number[own] = np.arange(len(own))
    tail, head = number[tail], number[head]
    first, goals = int(number[rank[start]]), np.unique(number[rank[graph.goal]])
    found: list[np.ndarray] = []
    closed: deque[np.ndarray] = deque([np.zeros(len(own), bool)])
    shortest = np.inf
    for _ in range(MOST_TRIES):
        if not closed or len(found) == MOST_PATHS:
            break
        shut = closed.popleft()
        path, far = _shortest(points, tail, head, length, shut, first, goals)
        if path is None or far > LONGEST * shortest:
            continue
        shortest = min(shortest, far)
        if all(KDTree(other).query(path)[0].max() > DIFFERENT for other in found):
            found.append(path)
        for share in (0.5, 0.3, 0.7):
            middle = path[int(share * (len(path) - 1))]
            ends = np.array([points[first], path[-1]])
            near_ends = np.linalg.norm(points[:, None] - ends, axis=2).min(axis=1) < ENDS
            closed.append(shut | ((np.linalg.norm(points - middle, axis=1) < DISC) & ~near_ends))
    return found


def nodes_near(graph: TorsoGraph, paths: list[np.ndarray], radius: float, turn: float) -> np.ndarray:
    """(n,) nodes near a way, turned about as it leads.

    Args:
        graph: of the torso.
        paths: (n, 3) points of each way [m].
        radius: how near [m].
        turn: how far from the direction of the way the torso may be turned, to either side [rad].
    """
    if not paths:
        return np.zeros(0, np.int64)
    points, ways = [], []
    for path in paths:
        step = np.gradient(path[:, :2], axis=0) if len(path) > 1 else np.zeros((1, 2))
        kernel = np.ones(5) / 5  # a grid's way is a staircase: its direction is that of half a metre
        smooth = [np.convolve(np.pad(a, 2, mode="edge"), kernel, "valid") for a in step.T]
        points.append(path)
        ways.append(np.arctan2(smooth[1], smooth[0]))
    points, ways = np.concatenate(points), np.concatenate(ways)
    xy = graph.origin + (graph.place[:, :2] + 0.5) * graph.cell
    away, nearest = KDTree(points).query(np.column_stack([xy, graph.z]), distance_upper_bound=radius)
    near = np.flatnonzero(np.isfinite(away))
    off = 2 * np.pi * graph.place[near, 2] / TURNS - ways[np.asarray(nearest)[near]]
    return near[np.abs(np.arctan2(np.sin(off), np.cos(off))) <= turn + 1e-9]


def _shortest(
    points: np.ndarray,
    tail: np.ndarray,
    head: np.ndarray,
    length: np.ndarray,
    shut: np.ndarray,
    first: int,
    goals: np.ndarray,
) -> tuple[np.ndarray | None, float]:
    """The shortest way past what is shut, and its length [m]."""
    open_ = ~(shut[tail] | shut[head])
    matrix = csr_matrix((length[open_], (tail[open_], head[open_])), shape=(len(points), len(points)))
    far, before = dijkstra(matrix, directed=False, indices=first, return_predecessors=True)
    if not len(goals) or not np.isfinite(far[goals]).any():
        return None, np.inf
    at = int(goals[np.argmin(far[goals])])
    total, way = float(far[at]), [at]
    while at != first:
        at = int(before[at])
        way.append(at)
    return points[way[::-1]], total


@njit(cache=True)
def _representative(graph: TorsoGraph, node: int) -> int:
    """The first node of the same cell and floor."""
    i, j = graph.place[node, 0], graph.place[node, 1]
    for n in range(graph.start[i, j], graph.start[i, j] + graph.count[i, j]):
        if abs(graph.z[n] - graph.z[node]) < 1e-9:
            return n
    return node


@njit(cache=True)
def _places(graph: TorsoGraph) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(N,) the first node of each node's cell and floor, those that are, and edges between neighbours: tail, head, length [m]."""
    nodes = len(graph.z)
    first = np.empty(nodes, np.int64)
    for n in range(nodes):
        first[n] = _representative(graph, n)
    own = np.flatnonzero(first == np.arange(nodes))
    tail, head, length = np.empty(16 * len(own), np.int64), np.empty(16 * len(own), np.int64), np.empty(16 * len(own))
    count = 0
    for n in own:
        i, j = graph.place[n, 0], graph.place[n, 1]
        for u, v in ((1, 0), (0, 1), (1, 1), (1, -1)):
            if i + u >= graph.count.shape[0] or not 0 <= j + v < graph.count.shape[1]:
                continue
            for m in range(graph.start[i + u, j + v], graph.start[i + u, j + v] + graph.count[i + u, j + v]):
                if first[m] == m and abs(graph.z[m] - graph.z[n]) <= graph.step and count < len(tail):
                    tail[count], head[count], length[count] = n, m, graph.cell * np.sqrt(float(u * u + v * v))
                    count += 1
    return first, own, tail[:count], head[:count], length[:count]
