"""Distance to the goal for a floating torso box on an SE(2) grid (Lin 2020 sec. 6.4, fig. 6.3, eq. 6.7).

Dijkstra runs from the goal over cells of x, y and yaw (8-connected, or turning on the spot). A cell is free when there is
ground to step on nearby and the torso box over it touches nothing. Cells are checked when the wave reaches them and the
wave stops as soon as the cell that was asked for is settled, so a large terrain costs no more than the part in question.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

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


class _Wave(NamedTuple):
    """Dijkstra's wave over nx * ny * TURNS cells s = (i * ny + j) * TURNS + t, and what is known of the cells.

    Attributes:
        origin: (2,) lowest x and y of the grid in W [m].
        cell: edge of a cell [m].
        support_radius: ground must lie this near a cell's centre [m].
        turn_cost: cost of turning [m/rad].
        step: greatest height between neighbouring cells [m].
        box_centre: (3,) centre of the torso box over the ground, in a frame with its yaw [m].
        box_size: (3,) full edges of the torso box [m].
        ground: (nx, ny) height of the highest foot surface over each cell's centre [m], -inf where there is none.
        height: (nx, ny) ground that the torso stands over [m], NaN where it was not looked for yet.
        clear: (nx, ny) 1 where nothing is near the torso at any yaw, 2 where something is, 0 where that is unknown.
        cost: (cells,) distance to the goal [m].
        place: (cells,) place in the heap, or UNSEEN, SETTLED, BLOCKED.
        heap: (cells,) cells in the order of a binary heap by cost.
        size: (1,) how many cells are in the heap.
    """

    origin: np.ndarray
    cell: float
    support_radius: float
    turn_cost: float
    step: float
    box_centre: np.ndarray
    box_size: np.ndarray
    ground: np.ndarray
    height: np.ndarray
    clear: np.ndarray
    cost: np.ndarray
    place: np.ndarray
    heap: np.ndarray
    size: np.ndarray


class TorsoGrid:
    """Distances to one goal on one terrain, grown on demand.

    Attributes:
        options: resolution and costs.
        shape: cells in x, y and yaw.
        num_goal_cells: free cells in the goal region.
    """

    def __init__(
        self,
        packed: PackedTerrain,
        robot: Robot,
        goal_xy: np.ndarray,
        goal_radius: float,
        goal_yaw: float | None,
        options: TorsoGridOptions | None = None,
    ) -> None:
        """Lays the grid over the ground and starts the wave from the goal region.

        Args:
            packed: the terrain.
            robot: gives the torso box and the greatest height of a step.
            goal_xy: (2,) middle of the goal region in W [m].
            goal_radius: of the goal region [m].
            goal_yaw: heading at the goal in W [rad], None for any.
            options: resolution and costs.
        """
        self.options = options or TorsoGridOptions()
        feet = packed.allowed[:, 0] | packed.allowed[:, 1]
        low = packed.low[feet, :2].min(axis=0) if feet.any() else np.zeros(2)
        high = packed.high[feet, :2].max(axis=0) if feet.any() else np.zeros(2)
        cell = self.options.cell
        origin = np.floor(np.minimum(low, goal_xy) / cell - 1) * cell
        nx, ny = (np.ceil((np.maximum(high, goal_xy) - origin) / cell) + 2).astype(int).tolist()
        self.shape = (nx, ny, TURNS)
        total = nx * ny * TURNS
        self._packed = packed
        self._wave = _Wave(
            origin=origin,
            cell=float(cell),
            support_radius=float(self.options.support_radius),
            turn_cost=float(self.options.turn_cost),
            step=float(robot.max_step_height),
            box_centre=np.array(robot.torso_box_centre, float),
            box_size=np.array(robot.torso_box_size, float),
            ground=np.full((nx, ny), -np.inf),
            height=np.full((nx, ny), np.nan),
            clear=np.zeros((nx, ny), np.int8),
            cost=np.full(total, np.inf),
            place=np.full(total, UNSEEN, np.int32),
            heap=np.empty(total, np.int32),
            size=np.zeros(1, np.int64),
        )
        _rasterise(packed, self._wave, feet)
        yaw = np.nan if goal_yaw is None else float(goal_yaw)
        self.num_goal_cells = _seed(
            packed, self._wave, np.asarray(goal_xy, float), float(max(goal_radius, 0.75 * cell)), yaw
        )

    def distance(self, x: np.ndarray, y: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """(n,) distance to the goal region [m] from these poses, interpolated between cells; inf where there is no way.

        Args:
            x: (n,) of the means of the feet in W [m].
            y: (n,) of the means of the feet in W [m].
            yaw: (n,) headings in W [rad].
        """
        x, y, yaw = (np.ascontiguousarray(a, float) for a in (x, y, yaw))
        return _query(self._packed, self._wave, x, y, yaw)

    def settled(self) -> np.ndarray:
        """(nx, ny) least distance over the yaws of the cells reached so far [m], inf elsewhere; for pictures."""
        return np.where(self._wave.place == SETTLED, self._wave.cost, np.inf).reshape(self.shape).min(axis=2)


@njit(cache=True)
def _rasterise(packed: PackedTerrain, wave: _Wave, feet: np.ndarray) -> None:
    """Fills `ground` from the polygons that feet (P,) may use."""
    origin, cell, ground = wave.origin, wave.cell, wave.ground
    for k in range(packed.num_surfaces):
        if not feet[k] or packed.normal[k, 2] < 1e-3:
            continue
        i0 = max(int(np.floor((packed.low[k, 0] - origin[0]) / cell - 0.5)), 0)
        i1 = min(int(np.ceil((packed.high[k, 0] - origin[0]) / cell - 0.5)), ground.shape[0] - 1)
        j0 = max(int(np.floor((packed.low[k, 1] - origin[1]) / cell - 0.5)), 0)
        j1 = min(int(np.ceil((packed.high[k, 1] - origin[1]) / cell - 0.5)), ground.shape[1] - 1)
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
def _height_at(wave: _Wave, i: int, j: int) -> float:
    """Ground under a cell, or of the nearest cell within the support radius; -inf where there is none (kept)."""
    ground, height = wave.ground, wave.height
    if not np.isnan(height[i, j]):
        return height[i, j]
    z = ground[i, j]
    if z == -np.inf:
        cell, radius = wave.cell, wave.support_radius
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
def _push(wave: _Wave, s: int) -> None:
    """Adds a cell at the end of the heap."""
    wave.heap[wave.size[0]] = s
    wave.place[s] = wave.size[0]
    wave.size[0] += 1


@njit(cache=True)
def _free(packed: PackedTerrain, wave: _Wave, i: int, j: int, t: int) -> bool:
    """Whether the torso may be in a cell; `clear` remembers the cells where nothing is near at any yaw."""
    z = _height_at(wave, i, j)
    if z == -np.inf:
        return False
    centre, box, clear = wave.box_centre, wave.box_size, wave.clear
    x, y = wave.origin[0] + (i + 0.5) * wave.cell, wave.origin[1] + (j + 0.5) * wave.cell
    if clear[i, j] == 0:
        reach = np.sqrt((abs(centre[0]) + 0.5 * box[0]) ** 2 + (abs(centre[1]) + 0.5 * box[1]) ** 2)
        z_low, z_high = z + centre[2] - 0.5 * box[2], z + centre[2] + 0.5 * box[2]
        clear[i, j] = 1 if nothing_near(packed, x, y, reach, z_low, z_high) else 2
    return clear[i, j] == 1 or box_is_free(packed, np.array([x, y, z]), 2 * np.pi * t / TURNS, centre, box)


@njit(cache=True)
def _seed(packed: PackedTerrain, wave: _Wave, goal: np.ndarray, goal_radius: float, goal_yaw: float) -> int:
    """Starts the wave in the free cells of the goal region, at any yaw where `goal_yaw` is NaN; their number."""
    origin, cell = wave.origin, wave.cell
    nx, ny = wave.ground.shape
    r = int(np.ceil(goal_radius / cell)) + 1
    gi, gj = int(np.floor((goal[0] - origin[0]) / cell)), int(np.floor((goal[1] - origin[1]) / cell))
    for i in range(max(gi - r, 0), min(gi + r + 1, nx)):
        for j in range(max(gj - r, 0), min(gj + r + 1, ny)):
            dx, dy = origin[0] + (i + 0.5) * cell - goal[0], origin[1] + (j + 0.5) * cell - goal[1]
            if dx * dx + dy * dy > goal_radius * goal_radius:
                continue
            for t in range(TURNS):
                if not np.isnan(goal_yaw):
                    turn = 2 * np.pi * t / TURNS - goal_yaw
                    if abs(np.arctan2(np.sin(turn), np.cos(turn))) > np.pi / TURNS + 1e-6:
                        continue
                if _free(packed, wave, i, j, t):
                    s = (i * ny + j) * TURNS + t
                    wave.cost[s] = 0.0
                    _push(wave, s)
    return wave.size[0]


@njit(cache=True)
def _grow_until(packed: PackedTerrain, wave: _Wave, target: int) -> None:
    """Dijkstra from the goal until the target cell is settled or the wave has nowhere left to go."""
    cost, place = wave.cost, wave.place
    nx, ny = wave.ground.shape
    while wave.size[0] > 0 and place[target] != SETTLED:
        s = _pop(wave.heap, place, cost, wave.size)
        t, j, i = s % TURNS, (s // TURNS) % ny, s // (TURNS * ny)
        z = _height_at(wave, i, j)
        for m in range(10):
            u, v, w = i, j, t
            if m < 8:
                m9 = m if m < 4 else m + 1
                u, v = i + m9 // 3 - 1, j + m9 % 3 - 1
                edge = wave.cell * np.sqrt(float(abs(u - i) + abs(v - j)))
            else:
                w = (t + (1 if m == 8 else TURNS - 1)) % TURNS
                edge = wave.turn_cost * 2 * np.pi / TURNS
            if u < 0 or v < 0 or u >= nx or v >= ny:
                continue
            q = (u * ny + v) * TURNS + w
            if place[q] <= SETTLED or cost[q] <= cost[s] + edge:
                continue
            if abs(_height_at(wave, u, v) - z) > wave.step:
                continue
            if place[q] == UNSEEN:
                if not _free(packed, wave, u, v, w):
                    place[q] = BLOCKED
                    continue
                _push(wave, q)
            cost[q] = cost[s] + edge
            _sift_up(wave.heap, place, cost, place[q])


@njit(cache=True)
def _query(packed: PackedTerrain, wave: _Wave, x: np.ndarray, y: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """(n,) distances to the goal region from poses [m], the wave grown as far as they need."""
    origin, cell, cost, place = wave.origin, wave.cell, wave.cost, wave.place
    nx, ny = wave.ground.shape
    out = np.empty(x.shape[0])
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
                if place[s] == UNSEEN and not _free(packed, wave, i, j, t):  # never worth growing the wave for
                    place[s] = BLOCKED
                if place[s] != SETTLED and place[s] != BLOCKED:
                    _grow_until(packed, wave, s)
                w = (u - i0 if a else i0 + 1 - u) * (v - j0 if b else j0 + 1 - v)
                if cost[s] < np.inf and place[s] == SETTLED:
                    total += w * cost[s]
                    weight += w
                    if w > nearest_weight:
                        nearest, nearest_weight = cost[s], w
        out[k] = total / weight if weight > 1e-9 else nearest
    return out
