"""Distance to the goal for a floating torso box on an SE(2) grid (Lin 2020 sec. 6.4, fig. 6.3, eq. 6.7).

Dijkstra runs from the goal over cells of x, y and yaw (8-connected, or turning on the spot). A cell is free when there is
ground to step on nearby and the torso box over it touches nothing. Cells are checked when the wave reaches them and the
wave stops as soon as the cell that was asked for is settled, so a large terrain costs no more than the part in question.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from scenes.footholds.projection import box_is_free, nothing_near
from scenes.robots.robot import Robot
from scenes.terrain.packed_terrain import PackedTerrain

TURNS = 12  # yaw cells, 30 deg each
UNSEEN, SETTLED, BLOCKED = -1, -2, -3
INSIDE_MARGIN = 0.02  # [m] a cell's centre this far outside a polygon still has its ground


@dataclass(frozen=True)
class TorsoGridOptions:
    """Resolution and costs of the grid.

    Attributes:
        cell: edge of a cell [m].
        turn_cost: cost of turning, in metres per radian.
        support_radius: ground must lie this near a cell's centre [m]; gaps wider than twice this cannot be crossed.
    """

    cell: float = 0.1
    turn_cost: float = 0.3
    support_radius: float = 0.4


class TorsoGrid:
    """Distances to one goal on one terrain, grown on demand."""

    def __init__(
        self, packed: PackedTerrain, robot: Robot, goal_xy: np.ndarray, goal_radius: float, goal_yaw: float | None,
        options: TorsoGridOptions | None = None,
    ) -> None:  # fmt: skip
        """Prepares the grid around the terrain and the goal.

        Args:
            packed: the terrain.
            robot: its torso box and greatest step height.
            goal_xy: (2,) centre of the goal region in W [m].
            goal_radius: of the goal region [m].
            goal_yaw: heading at the goal about W's z [rad]; None: any.
            options: resolution and costs.
        """
        self.options = options or TorsoGridOptions()
        feet = packed.allowed[:, 0] | packed.allowed[:, 1]
        low = packed.low[feet, :2].min(axis=0) if feet.any() else np.zeros(2)
        high = packed.high[feet, :2].max(axis=0) if feet.any() else np.zeros(2)
        cell = self.options.cell
        self._packed = packed
        self._origin = np.floor(np.minimum(low, goal_xy) / cell - 1) * cell
        nx, ny = (np.ceil((np.maximum(high, goal_xy) - self._origin) / cell) + 2).astype(int).tolist()
        self.shape = (nx, ny, TURNS)
        self._ground = np.full((nx, ny), -np.inf)
        _rasterise(packed, feet, self._origin, cell, self._ground)
        total = nx * ny * TURNS
        self._cost = np.full(total, np.inf)
        self._place = np.full(total, UNSEEN, np.int32)
        self._heap = np.empty(total, np.int32)
        self._height = np.full((nx, ny), np.nan)
        self._clear = np.zeros((nx, ny), np.int8)
        self._size = np.zeros(1, np.int64)
        self._box = (
            np.asarray(robot.torso_box_centre, float),
            np.asarray(robot.torso_box_size, float),
        )
        self._step = float(robot.max_step_height)
        self.num_goal_cells = _seed(
            packed, self._ground, self._height, self._clear, self._cost, self._place, self._heap, self._size, self._origin, cell,
            self.options.support_radius, *self._box, np.asarray(goal_xy, float), max(goal_radius, 0.75 * cell),
            np.nan if goal_yaw is None else goal_yaw,
        )  # fmt: skip

    def distance(self, x: np.ndarray, y: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """(n,) distance to the goal region [m] from these poses, interpolated between cells; inf where there is no path.

        Args:
            x: (n,) position in W [m].
            y: (n,) position in W [m].
            yaw: (n,) heading about W's z [rad].
        """
        out = np.empty(len(x))
        _query(
            self._packed, self._ground, self._height, self._clear, self._cost, self._place, self._heap, self._size, self._origin,
            self.options.cell, self.options.support_radius, *self._box, self._step, self.options.turn_cost,
            np.ascontiguousarray(x, float), np.ascontiguousarray(y, float), np.ascontiguousarray(yaw, float), out,
        )  # fmt: skip
        return out

    def settled(self) -> np.ndarray:
        """(nx, ny) least distance over the yaws of the cells reached so far [m], inf elsewhere; for pictures."""
        return np.where(self._place == SETTLED, self._cost, np.inf).reshape(self.shape).min(axis=2)


GridDistance = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@njit(cache=True)
def _rasterise(
    packed: PackedTerrain,
    feet: np.ndarray,
    origin: np.ndarray,
    cell: float,
    ground: np.ndarray,
) -> None:
    """Height of the highest foot surface over each cell's centre, -inf where there is none."""
    for k in range(packed.num_surfaces):
        if not feet[k] or packed.normal[k, 2] < 1e-3:
            continue
        i0 = max(int(np.floor((packed.low[k, 0] - origin[0]) / cell - 0.5)), 0)
        i1 = min(
            int(np.ceil((packed.high[k, 0] - origin[0]) / cell - 0.5)),
            ground.shape[0] - 1,
        )
        j0 = max(int(np.floor((packed.low[k, 1] - origin[1]) / cell - 0.5)), 0)
        j1 = min(
            int(np.ceil((packed.high[k, 1] - origin[1]) / cell - 0.5)),
            ground.shape[1] - 1,
        )
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                x, y = origin[0] + (i + 0.5) * cell, origin[1] + (j + 0.5) * cell
                n = packed.normal[k]
                z = (packed.offset[k] - n[0] * x - n[1] * y) / n[2]
                inside = True
                for e in range(packed.count[k]):
                    w = packed.edge_normal[k, e]
                    if w[0] * x + w[1] * y + w[2] * z > packed.edge_offset[k, e] + INSIDE_MARGIN:
                        inside = False
                        break
                if inside and z > ground[i, j]:
                    ground[i, j] = z


@njit(cache=True)
def _height_at(ground: np.ndarray, height: np.ndarray, i: int, j: int, cell: float, radius: float) -> float:
    """Ground under a cell, or of the nearest cell within the support radius; -inf where there is none (kept)."""
    if not np.isnan(height[i, j]):
        return height[i, j]
    z = ground[i, j]
    if z == -np.inf:
        r = int(np.ceil(radius / cell))
        best = radius * radius / (cell * cell) + 1e-9
        for a in range(-r, r + 1):
            for b in range(-r, r + 1):
                u, v = i + a, j + b
                if not (0 <= u < ground.shape[0] and 0 <= v < ground.shape[1]) or ground[u, v] == -np.inf:
                    continue
                squared = float(a * a + b * b)
                if squared < best or (squared == best and ground[u, v] > z):
                    best = squared
                    z = ground[u, v]
    height[i, j] = z
    return z


@njit(cache=True)
def _sift_up(heap: np.ndarray, place: np.ndarray, cost: np.ndarray, k: int) -> None:
    while k > 0:
        parent = (k - 1) >> 1
        if cost[heap[parent]] <= cost[heap[k]]:
            break
        heap[parent], heap[k] = heap[k], heap[parent]
        place[heap[parent]], place[heap[k]] = parent, k
        k = parent


@njit(cache=True)
def _pop(heap: np.ndarray, place: np.ndarray, cost: np.ndarray, size: np.ndarray) -> int:
    top = heap[0]
    size[0] -= 1
    n = size[0]
    if n > 0:
        heap[0] = heap[n]
        place[heap[0]] = 0
        k = 0
        while True:
            child = 2 * k + 1
            if child >= n:
                break
            if child + 1 < n and cost[heap[child + 1]] < cost[heap[child]]:
                child += 1
            if cost[heap[k]] <= cost[heap[child]]:
                break
            heap[k], heap[child] = heap[child], heap[k]
            place[heap[k]], place[heap[child]] = k, child
            k = child
    place[top] = SETTLED
    return top


@njit(cache=True)
def _free(
    packed: PackedTerrain, ground: np.ndarray, height: np.ndarray, clear: np.ndarray, origin: np.ndarray, cell: float,
    radius: float, centre: np.ndarray, box: np.ndarray, i: int, j: int, t: int,
) -> bool:  # fmt: skip
    """Whether the torso may be in a cell; `clear` remembers the cells where nothing is near at any yaw."""
    z = _height_at(ground, height, i, j, cell, radius)
    if z == -np.inf:
        return False
    x, y = origin[0] + (i + 0.5) * cell, origin[1] + (j + 0.5) * cell
    if clear[i, j] == 0:
        reach = np.sqrt((abs(centre[0]) + 0.5 * box[0]) ** 2 + (abs(centre[1]) + 0.5 * box[1]) ** 2)
        empty = nothing_near(
            packed,
            x,
            y,
            reach,
            z + centre[2] - 0.5 * box[2],
            z + centre[2] + 0.5 * box[2],
        )
        clear[i, j] = 1 if empty else 2
    return clear[i, j] == 1 or box_is_free(packed, np.array([x, y, z]), 2 * np.pi * t / TURNS, centre, box)


@njit(cache=True)
def _seed(
    packed: PackedTerrain, ground: np.ndarray, height: np.ndarray, clear: np.ndarray, cost: np.ndarray, place: np.ndarray,
    heap: np.ndarray, size: np.ndarray, origin: np.ndarray, cell: float, radius: float, centre: np.ndarray,
    box: np.ndarray, goal: np.ndarray, goal_radius: float, goal_yaw: float,
) -> int:  # fmt: skip
    nx, ny = ground.shape
    r = int(np.ceil(goal_radius / cell)) + 1
    gi, gj = (
        int(np.floor((goal[0] - origin[0]) / cell)),
        int(np.floor((goal[1] - origin[1]) / cell)),
    )
    for i in range(max(gi - r, 0), min(gi + r + 1, nx)):
        for j in range(max(gj - r, 0), min(gj + r + 1, ny)):
            dx, dy = (
                origin[0] + (i + 0.5) * cell - goal[0],
                origin[1] + (j + 0.5) * cell - goal[1],
            )
            if dx * dx + dy * dy > goal_radius * goal_radius:
                continue
            for t in range(TURNS):
                if not np.isnan(goal_yaw):
                    turn = 2 * np.pi * t / TURNS - goal_yaw
                    if abs(np.arctan2(np.sin(turn), np.cos(turn))) > np.pi / TURNS + 1e-6:
                        continue
                if _free(
                    packed,
                    ground,
                    height,
                    clear,
                    origin,
                    cell,
                    radius,
                    centre,
                    box,
                    i,
                    j,
                    t,
                ):
                    s = (i * ny + j) * TURNS + t
                    cost[s] = 0.0
                    heap[size[0]] = s
                    place[s] = size[0]
                    size[0] += 1
    return size[0]


@njit(cache=True)
def _grow_until(
    target: int, packed: PackedTerrain, ground: np.ndarray, height: np.ndarray, clear: np.ndarray, cost: np.ndarray, place: np.ndarray,
    heap: np.ndarray, size: np.ndarray, origin: np.ndarray, cell: float, radius: float, centre: np.ndarray,
    box: np.ndarray, step: float, turn_cost: float,
) -> None:  # fmt: skip
    """Dijkstra from the goal until the target cell is settled or the wave has nowhere left to go."""
    nx, ny = ground.shape
    while size[0] > 0 and place[target] != SETTLED:
        s = _pop(heap, place, cost, size)
        t, j, i = s % TURNS, (s // TURNS) % ny, s // (TURNS * ny)
        z = _height_at(ground, height, i, j, cell, radius)
        for m in range(10):
            u, v, w = i, j, t
            if m < 8:
                m9 = m if m < 4 else m + 1
                u, v = i + m9 // 3 - 1, j + m9 % 3 - 1
                edge = cell * np.sqrt(float(abs(u - i) + abs(v - j)))
            else:
                w = (t + (1 if m == 8 else TURNS - 1)) % TURNS
                edge = turn_cost * 2 * np.pi / TURNS
            if u < 0 or v < 0 or u >= nx or v >= ny:
                continue
            q = (u * ny + v) * TURNS + w
            if place[q] <= SETTLED or cost[q] <= cost[s] + edge:
                continue
            if abs(_height_at(ground, height, u, v, cell, radius) - z) > step:
                continue
            if place[q] == UNSEEN:
                if not _free(
                    packed,
                    ground,
                    height,
                    clear,
                    origin,
                    cell,
                    radius,
                    centre,
                    box,
                    u,
                    v,
                    w,
                ):
                    place[q] = BLOCKED
                    continue
                heap[size[0]] = q
                place[q] = size[0]
                size[0] += 1
            cost[q] = cost[s] + edge
            _sift_up(heap, place, cost, place[q])


@njit(cache=True)
def _query(
    packed: PackedTerrain, ground: np.ndarray, height: np.ndarray, clear: np.ndarray, cost: np.ndarray, place: np.ndarray,
    heap: np.ndarray, size: np.ndarray, origin: np.ndarray, cell: float, radius: float, centre: np.ndarray,
    box: np.ndarray, step: float, turn_cost: float, x: np.ndarray, y: np.ndarray, yaw: np.ndarray, out: np.ndarray,
) -> None:  # fmt: skip
    nx, ny = ground.shape
    for k in range(x.shape[0]):
        t = int(np.round(yaw[k] / (2 * np.pi / TURNS))) % TURNS
        u, v = (x[k] - origin[0]) / cell - 0.5, (y[k] - origin[1]) / cell - 0.5
        i0, j0 = int(np.floor(u)), int(np.floor(v))
        total, weight, nearest, nearest_weight = 0.0, 0.0, np.inf, -1.0
        for a in range(2):
            for b in range(2):
                i, j = i0 + a, j0 + b
                if i < 0 or j < 0 or i >= nx or j >= ny:
                    continue
                s = (i * ny + j) * TURNS + t
                if place[s] == UNSEEN and not _free(
                    packed, ground, height, clear, origin, cell, radius, centre, box, i, j, t
                ):  # never worth growing the wave for
                    place[s] = BLOCKED
                if place[s] != SETTLED and place[s] != BLOCKED:
                    _grow_until(
                        s, packed, ground, height, clear, cost, place, heap, size, origin, cell, radius, centre, box, step,
                        turn_cost,
                    )  # fmt: skip
                w = (u - i0 if a else i0 + 1 - u) * (v - j0 if b else j0 + 1 - v)
                if cost[s] < np.inf and place[s] == SETTLED:
                    total += w * cost[s]
                    weight += w
                    if w > nearest_weight:
                        nearest, nearest_weight = cost[s], w
        out[k] = total / weight if weight > 1e-9 else nearest
