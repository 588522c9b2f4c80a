"""The torso's steps over its grid as a graph: cells of SE(2) and floors, joined where one footstep takes the torso across.

A step keeps the heading and moves the torso by one of the translations that a transition model makes, turned with the heading
(the ellipse of Lin 2020 fig. 5.3), or turns it on the spot by one heading of the grid. Cells come from `TorsoGrid`: there is
ground to step on nearby, the torso fits, and there is a way to the goal.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from drakeplan.contact_planning.binary_heap import pop, push, sift_up
from drakeplan.contact_planning.torso_grid import SETTLED, TURNS, UNSEEN, TorsoGrid
from drakeplan.guide.torso_steps import CELL as TRANSLATION_CELL

CELL = 0.15  # [m] edge of a cell, Lin 2020 sec. 5.11
BESIDE = 0.5  # of a cell of translations: how far outside their ellipse a step may end
BEYOND, SLACK = (
    1.3,
    2.0,
)  # cells this many times as far from the goal as the start, and so far more [m], belong to the graph


class TorsoGraph(NamedTuple):
    """Nodes are torso poses; those of one cell of the plan view lie side by side.

    Attributes:
        origin: (2,) lowest x and y of the cells in W [m].
        cell: edge of a cell [m].
        start: (nx, ny) first node of each cell.
        count: (nx, ny) nodes of each cell; they follow one another.
        place: (N, 3) i, j and heading t of each node.
        z: (N,) height of its floor [m].
        goal: (N,) whether it is in the goal region.
        step: how high a footstep is at most [m].
        offset: (12, E, 2) steps of each heading: cells along x and y.
        translation: (12, E) number of the translation that each step makes, -1 where a heading has fewer.
        stay: number of the translation of a turn on the spot.
        turn_length: what a turn by one heading counts [m].
    """

    origin: np.ndarray
    cell: float
    start: np.ndarray
    count: np.ndarray
    place: np.ndarray
    z: np.ndarray
    goal: np.ndarray
    step: float
    offset: np.ndarray
    translation: np.ndarray
    stay: int
    turn_length: float


class StepWeights(NamedTuple):
    """Weights of a step of the torso (Lin 2020 eq. 5.3), l w_length + w_s + w_tr Delta g_tr + M; defaults of Lin 2020 sec. 5.11.

    Attributes:
        length: of the step's length; 1 in the document.
        step: w_s, of the step itself.
        traversability: w_tr.
        mode: w_m, of a change of motion mode.
    """

    length: float = 1.0
    step: float = 3.0
    traversability: float = 10.0
    mode: float = 2.0


def torso_graph(grid: TorsoGrid, step: float, translations: np.ndarray, start_distance: float) -> TorsoGraph:
    """The graph of a grid's cells, as far from the goal as is of use.

    Args:
        grid: with a way from the start.
        step: how high a footstep is at most [m].
        translations: (V, 2) of the torso by one footstep, forward and to the left, in cells of 0.1 m.
        start_distance: of the start from the goal on the grid [m].
    """
    grid.grow(BEYOND * start_distance + SLACK)
    cells, z, distance = grid.settled_nodes()
    low = cells[:, :2].min(axis=0)
    cells = cells - [*low, 0]
    order = np.lexsort((z, cells[:, 2], cells[:, 1], cells[:, 0]))
    cells, z, distance = cells[order], z[order], distance[order]
    shape = cells[:, :2].max(axis=0) + 1
    count = np.zeros(shape, np.int64)
    np.add.at(count, (cells[:, 0], cells[:, 1]), 1)
    start = np.concatenate([[0], np.cumsum(count.ravel())])[:-1].reshape(shape)
    offset, translation = _steps(translations)
    return TorsoGraph(
        origin=grid.origin + low * grid.options.cell,
        cell=grid.options.cell,
        start=start,
        count=count,
        place=np.ascontiguousarray(cells, np.int64),
        z=z,
        goal=distance <= 0.0,
        step=float(step),
        offset=offset,
        translation=translation,
        stay=int(np.flatnonzero((translations == 0).all(axis=1))[0]),
        turn_length=grid.options.turn_cost * 2 * np.pi / TURNS,
    )


def torso_poses(graph: TorsoGraph, nodes: np.ndarray) -> np.ndarray:
    """(n, 4) x, y, z of the ground [m] and yaw [rad] of some nodes.

    Args:
        graph: of the torso.
        nodes: (n,) their numbers.
    """
    place = graph.place[nodes]
    xy = graph.origin + (place[:, :2] + 0.5) * graph.cell
    return np.column_stack([xy, graph.z[nodes], 2 * np.pi * place[:, 2] / TURNS])


def _steps(translations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(12, E, 2) offsets in cells and (12, E) the nearest translation of each, for every heading."""
    moved = translations * TRANSLATION_CELL
    reach = int(np.ceil(np.abs(moved).max() / CELL)) + 1
    i, j = (a.ravel() for a in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    found = []
    for t in range(TURNS):
        c, s = np.cos(2 * np.pi * t / TURNS), np.sin(2 * np.pi * t / TURNS)
        forward, left = (c * i + s * j) * CELL, (c * j - s * i) * CELL
        away = np.hypot(forward[:, None] - moved[:, 0], left[:, None] - moved[:, 1])
        near = (away.min(axis=1) <= BESIDE * TRANSLATION_CELL * np.sqrt(2.0) + 1e-9) & ((i != 0) | (j != 0))
        found.append((np.column_stack([i, j])[near], away.argmin(axis=1)[near]))
    most = max(len(steps) for steps, _ in found)
    offset, translation = np.zeros((TURNS, most, 2), np.int64), np.full((TURNS, most), -1, np.int64)
    for t, (steps, number) in enumerate(found):
        offset[t, : len(steps)], translation[t, : len(steps)] = steps, number
    return offset, translation


@njit(cache=True)
def node_at(graph: TorsoGraph, i: int, j: int, t: int, z: float) -> int:
    """The node of a cell and heading whose floor is nearest to a height, within a footstep's; -1 where there is none.

    Args:
        graph: of the torso.
        i: cell along x.
        j: cell along y.
        t: heading.
        z: height [m].
    """
    if i < 0 or j < 0 or i >= graph.count.shape[0] or j >= graph.count.shape[1]:
        return -1
    best, nearest = -1, graph.step
    for n in range(graph.start[i, j], graph.start[i, j] + graph.count[i, j]):
        if graph.place[n, 2] == t and abs(graph.z[n] - z) <= nearest:
            best, nearest = n, abs(graph.z[n] - z)
    return best


@njit(cache=True)
def _any_at(graph: TorsoGraph, i: int, j: int, z: float) -> bool:
    """Whether a cell has a node at any heading near a height."""
    found = False
    for n in range(graph.start[i, j], graph.start[i, j] + graph.count[i, j]):
        found = found or abs(graph.z[n] - z) <= graph.step
    return found


@njit(cache=True)
def neighbour(graph: TorsoGraph, node: int, e: int, back: bool) -> int:
    """The node that step e leads to, or comes from where `back`; -1 where there is none. The last two steps are turns.

    Args:
        graph: of the torso.
        node: where the torso is.
        e: number of the step.
        back: whether the step ends at the node.
    """
    i, j, t = graph.place[node]
    most = graph.offset.shape[1]
    if e >= most:
        return node_at(graph, i, j, (t + (1 if (e == most) != back else TURNS - 1)) % TURNS, graph.z[node])
    if graph.translation[t, e] < 0:
        return -1
    sign = -1 if back else 1
    u, v = sign * graph.offset[t, e, 0], sign * graph.offset[t, e, 1]
    other = node_at(graph, i + u, j + v, t, graph.z[node])
    # No step leads through a thin wall or over what the torso cannot pass.
    if other < 0:
        return -1
    tail = other if back else node
    if max(abs(u), abs(v)) > 1 and not _any_at(graph, i + u // 2, j + v // 2, graph.z[tail]):
        return -1
    return other


@njit(cache=True)
def step_length(graph: TorsoGraph, t: int, e: int) -> float:
    """Length of step e at heading t; of a turn what that counts [m].

    Args:
        graph: of the torso.
        t: heading.
        e: number of the step.
    """
    if e >= graph.offset.shape[1]:
        return graph.turn_length
    u, w = graph.offset[t, e]
    return graph.cell * np.sqrt(float(u * u + w * w))


@njit(cache=True)
def step_translation(graph: TorsoGraph, t: int, e: int) -> int:
    """Number of the translation that step e makes at heading t.

    Args:
        graph: of the torso.
        t: heading.
        e: number of the step.
    """
    return graph.stay if e >= graph.offset.shape[1] else graph.translation[t, e]


@njit(cache=True)
def costs_to_go(
    graph: TorsoGraph, weights: StepWeights, row: np.ndarray, cost: np.ndarray, modes: np.ndarray
) -> np.ndarray:
    """(N,) least sum of step costs to the goal from every node, each step in the best of some modes; inf where there is no way.

    Args:
        graph: of the torso.
        weights: of a step; changes of mode are free.
        row: (N,) row of `cost` that each node has.
        cost: (M, R, V) traversability cost Delta g_tr by mode, row and translation.
        modes: (m,) motion modes that may be used.
    """
    nodes, steps = len(graph.z), graph.offset.shape[1] + 2
    best = np.full(nodes, np.inf)
    place, heap, size = np.full(nodes, UNSEEN, np.int32), np.empty(nodes, np.int32), np.zeros(1, np.int64)
    for n in range(nodes):
        if graph.goal[n]:
            best[n] = 0.0
            push(heap, place, size, n)
    while size[0] > 0:
        n = pop(heap, place, best, size)
        place[n] = SETTLED
        for e in range(steps):
            other = neighbour(graph, n, e, True)
            if other < 0 or place[other] == SETTLED:
                continue
            t = graph.place[other, 2]
            v, hard = step_translation(graph, t, e), np.inf
            for m in modes:
                hard = min(hard, cost[m, row[other], v])
            there = weights.length * step_length(graph, t, e) + weights.step + weights.traversability * hard + best[n]
            if there < best[other]:
                best[other] = there
                if place[other] == UNSEEN:
                    push(heap, place, size, other)
                sift_up(heap, place, best, place[other])
    return best
