"""Distance to the goal for a floating torso box on a grid of SE(2) and floors (Lin 2020 sec. 6.4, fig. 6.3, eq. 6.7).

Dijkstra runs from the goal over cells of x, y and yaw (8-connected, or turning on the spot), one for each floor there. A
cell is free when there is ground to step on nearby and the torso box over it touches nothing, upright or lowered as far as
the robot can; neighbours are joined where a step joins their floors. A way on which the robot has to lower itself counts
`STOOPED` times, so that a short way round is preferred. Cells are looked at when the wave reaches them and the wave stops as
soon as the cell that was asked for is settled: time and memory go with the part in question, not with the terrain.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from drakeplan.contact_planning.binary_heap import pop, push, sift_up
from drakeplan.contact_planning.ground_levels import (
    ALL,
    MOST_LEVELS,
    UNKNOWN,
    GroundLevels,
    borrow_levels,
    level_near,
    most_new_levels,
    nearest_level,
    own_levels,
)
from scenes.robots.robot import Robot
from scenes.scene import GOAL_HEIGHT, Goal
from scenes.terrain.free_boxes import box_is_free, nothing_near
from scenes.terrain.packed_terrain import PackedTerrain

TURNS = 12  # yaw cells, 30 deg each
UNSEEN, SETTLED, BLOCKED = -1, -2, -3
STOOPED = 1.5  # times the length of a way on which the robot has to lower itself
TAKEN, LOWERED, UPRIGHT = 0, 1, 2  # whether the torso may be somewhere, and how


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
    """Dijkstra's wave over nodes s = level * TURNS + t, and what is known of the levels.

    Attributes:
        ground: the levels over each cell.
        turn_cost: cost of turning [m/rad].
        box_centre: (3,) centre of the torso box over the ground, in a frame with its yaw [m].
        box_size: (3,) full edges of the torso box [m].
        low_centre: (3,) centre of what is left of it when the robot lowers itself as far as it can [m].
        low_size: (3,) full edges of that [m].
        clear: (levels,) 1 where nothing is near the torso at any yaw, 2 where something is, 0 where that is unknown.
        cost: (nodes,) distance to the goal [m]; means something where the place is not UNSEEN.
        lowered: (nodes,) whether the robot has to lower itself there; means something where the place is not UNSEEN.
        place: (nodes,) place in the heap, or UNSEEN, SETTLED, BLOCKED.
        heap: (nodes,) nodes in the order of a binary heap by cost.
        size: (1,) how many nodes are in the heap.
        reserve: levels that must be free before a cell's neighbours are looked at.
    """

    ground: GroundLevels
    turn_cost: float
    box_centre: np.ndarray
    box_size: np.ndarray
    low_centre: np.ndarray
    low_size: np.ndarray
    clear: np.ndarray
    cost: np.ndarray
    lowered: np.ndarray
    place: np.ndarray
    heap: np.ndarray
    size: np.ndarray
    reserve: int


class TorsoGrid:
    """Distances to one goal on one terrain, grown on demand.

    Attributes:
        options: resolution and costs.
        shape: cells in x, y and yaw; each once for every floor there.
        num_goal_cells: free cells in the goal region.
    """

    def __init__(
        self, packed: PackedTerrain, robot: Robot, goal: Goal, options: TorsoGridOptions | None = None
    ) -> None:
        """Lays the grid over the ground and starts the wave from the goal region.

        Args:
            packed: the terrain.
            robot: gives the torso box and the greatest height of a step.
            goal: region, floor (any where its z is NaN) and heading to arrive at.
            options: resolution and costs.
        """
        self.options = options or TorsoGridOptions()
        goal_xy = np.array(goal.xyz[:2], float)
        feet = packed.allowed[:, 0] | packed.allowed[:, 1]
        low = packed.low[feet, :2].min(axis=0) if feet.any() else np.zeros(2)
        high = packed.high[feet, :2].max(axis=0) if feet.any() else np.zeros(2)
        cell = self.options.cell
        origin = np.floor(np.minimum(low, goal_xy) / cell - 1) * cell
        nx, ny = (np.ceil((np.maximum(high, goal_xy) - origin) / cell) + 2).astype(int).tolist()
        self.shape = (nx, ny, TURNS)
        self._packed = packed
        reserve = most_new_levels(self.options.support_radius, cell)
        box_centre, box_size = np.array(robot.torso_box_centre, float), np.array(robot.torso_box_size, float)
        low_centre, low_size = robot.lowest_torso_box
        ground = GroundLevels(
            origin=origin,
            cell=float(cell),
            support_radius=float(self.options.support_radius),
            step=float(robot.max_step_height),
            knee=float(box_centre[2] - 0.5 * box_size[2]),
            feet=feet,
            known=np.zeros((nx, ny), np.int8),
            first=np.zeros((nx, ny), np.int32),
            following=np.empty(0, np.int32),
            z=np.empty(0),
            own=np.empty(0, np.bool_),
            at=np.empty((0, 2), np.int32),
            count=np.zeros(1, np.int64),
        )
        self._wave = _Wave(
            ground=ground,
            turn_cost=float(self.options.turn_cost),
            box_centre=box_centre,
            box_size=box_size,
            low_centre=low_centre,
            low_size=low_size,
            clear=np.empty(0, np.int8),
            cost=np.empty(0),
            lowered=np.empty(0, np.bool_),
            place=np.empty(0, np.int32),
            heap=np.empty(0, np.int32),
            size=np.zeros(1, np.int64),
            reserve=reserve,
        )
        self._enlarge()
        yaw = np.nan if goal.yaw is None else float(goal.yaw)
        radius = float(max(goal.radius, 0.75 * cell))
        done = 0
        while done >= 0:
            done = _seed(packed, self._wave, np.array(goal.xyz, float), radius, yaw, done)
            if done >= 0:
                self._enlarge()
        self.num_goal_cells = int(self._wave.size[0])

    @property
    def origin(self) -> np.ndarray:
        """(2,) least x and y of cell (0, 0) in W [m]."""
        return self._wave.ground.origin

    def distance(self, x: np.ndarray, y: np.ndarray, z: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """(n,) distance to the goal region [m] from these poses, interpolated between cells; inf where there is no way.

        Args:
            x: (n,) of the means of the feet in W [m].
            y: (n,) of the means of the feet in W [m].
            z: (n,) of the means of the feet in W [m]; says on which floor.
            yaw: (n,) headings in W [rad].
        """
        x, y, z, yaw = (np.ascontiguousarray(a, float) for a in (x, y, z, yaw))
        out = np.empty(len(x))
        done = 0
        while True:
            done = _query(self._packed, self._wave, x, y, z, yaw, out, done)
            if done == len(x):
                return out
            self._enlarge()

    def grow(self, farthest: float) -> None:
        """Settles every cell from which the goal is this near [m], beyond those that were asked for."""
        while not _grow_until(self._packed, self._wave, -1, farthest):
            self._enlarge()

    def _settled(self) -> np.ndarray:
        """(n,) the nodes that the wave has settled."""
        return np.flatnonzero(self._wave.place[: int(self._wave.ground.count[0]) * TURNS] == SETTLED)

    def settled_nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n, 3) cells i, j and yaw of all that the wave has settled, (n,) heights [m] and (n,) distances [m]."""
        nodes, ground = self._settled(), self._wave.ground
        return (
            np.column_stack([ground.at[nodes // TURNS], nodes % TURNS]),
            ground.z[nodes // TURNS],
            self._wave.cost[nodes],
        )

    def settled_places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n, 3) middles of the settled cells on their floors [m], (n,) distances [m], and whether ground is right below."""
        nodes, ground = self._settled(), self._wave.ground
        level = nodes // TURNS
        xy = ground.origin + (ground.at[level] + 0.5) * ground.cell
        return np.column_stack([xy, ground.z[level]]), self._wave.cost[nodes], ground.own[level]

    def settled(self) -> np.ndarray:
        """(nx, ny) least distance over floors and yaws of the cells reached so far [m], inf elsewhere; for pictures."""
        out = np.full(self.shape[:2], np.inf)
        cells, _, cost = self.settled_nodes()
        np.minimum.at(out, (cells[:, 0], cells[:, 1]), cost)
        return out

    def _enlarge(self) -> None:
        """Room for more levels and their nodes: at least twice as many."""
        wave, ground = self._wave, self._wave.ground
        levels = max(2 * len(ground.z), int(ground.count[0]) + 2 * wave.reserve)

        def longer(array: np.ndarray, rows: int, filled: float = 0) -> np.ndarray:
            new = np.empty((rows, *array.shape[1:]), array.dtype)
            new[: len(array)] = array
            new[len(array) :] = filled
            return new

        ground = ground._replace(
            following=longer(ground.following, levels),
            z=longer(ground.z, levels),
            own=longer(ground.own, levels),
            at=longer(ground.at, levels),
        )
        nodes = levels * TURNS
        self._wave = wave._replace(
            ground=ground,
            clear=longer(wave.clear, levels),
            cost=longer(wave.cost, nodes, np.inf),
            lowered=longer(wave.lowered, nodes),
            place=longer(wave.place, nodes, UNSEEN),
            heap=longer(wave.heap, nodes),
        )


@njit(cache=True)
def _full(wave: _Wave) -> bool:
    """Whether there might be no room for what the next cells need."""
    return wave.ground.count[0] + wave.reserve > wave.ground.z.shape[0]


@njit(cache=True)
def _free(packed: PackedTerrain, wave: _Wave, level: int, t: int) -> int:
    """How the torso may be over a level: UPRIGHT, LOWERED, or TAKEN where it may not.

    `clear` remembers the levels where nothing is near at any yaw.
    """
    ground, centre, box, clear = wave.ground, wave.box_centre, wave.box_size, wave.clear
    x = ground.origin[0] + (ground.at[level, 0] + 0.5) * ground.cell
    y = ground.origin[1] + (ground.at[level, 1] + 0.5) * ground.cell
    z = ground.z[level]
    if clear[level] == 0:
        reach = np.sqrt((abs(centre[0]) + 0.5 * box[0]) ** 2 + (abs(centre[1]) + 0.5 * box[1]) ** 2)
        z_low, z_high = z + centre[2] - 0.5 * box[2], z + centre[2] + 0.5 * box[2]
        clear[level] = 1 if nothing_near(packed, x, y, reach, z_low, z_high) else 2
    if clear[level] == 1:
        return UPRIGHT
    p, yaw = np.array([x, y, z]), 2 * np.pi * t / TURNS
    if box_is_free(packed, p, yaw, centre, box):
        return UPRIGHT
    return LOWERED if box_is_free(packed, p, yaw, wave.low_centre, wave.low_size) else TAKEN


@njit(cache=True)
def _seed(packed: PackedTerrain, wave: _Wave, goal: np.ndarray, goal_radius: float, goal_yaw: float, done: int) -> int:
    """Starts the wave in the free cells of the goal region, at any yaw where `goal_yaw` is NaN.

    Returns -1, or, where there is no room for more levels, the number of rows that are done.
    """
    ground = wave.ground
    origin, cell = ground.origin, ground.cell
    nx, ny = ground.first.shape
    r = int(np.ceil(goal_radius / cell)) + 1
    gi, gj = int(np.floor((goal[0] - origin[0]) / cell)), int(np.floor((goal[1] - origin[1]) / cell))
    for a in range(done, (2 * r + 1) ** 2):
        i, j = gi - r + a // (2 * r + 1), gj - r + a % (2 * r + 1)
        if not (0 <= i < nx and 0 <= j < ny):
            continue
        dx, dy = origin[0] + (i + 0.5) * cell - goal[0], origin[1] + (j + 0.5) * cell - goal[1]
        if dx * dx + dy * dy > goal_radius * goal_radius:
            continue
        if _full(wave):
            return a
        found = False
        for _attempt in range(2):
            level = own_levels(packed, ground, i, j)
            while level > 0:
                if np.isnan(goal[2]) or abs(ground.z[level - 1] - goal[2]) <= GOAL_HEIGHT:
                    found = True
                    _seed_level(packed, wave, level - 1, goal_yaw)
                level = ground.following[level - 1]
            if found:
                break
            borrow_levels(packed, ground, i, j)
    return -1


@njit(cache=True)
def _seed_level(packed: PackedTerrain, wave: _Wave, level: int, goal_yaw: float) -> None:
    """Starts the wave in the nodes of one level."""
    for t in range(TURNS):
        if not np.isnan(goal_yaw):
            turn = 2 * np.pi * t / TURNS - goal_yaw
            if abs(np.arctan2(np.sin(turn), np.cos(turn))) > np.pi / TURNS + 1e-6:
                continue
        s = level * TURNS + t
        if wave.place[s] != UNSEEN:
            continue
        how = _free(packed, wave, level, t)
        if how != TAKEN:
            wave.cost[s], wave.lowered[s] = 0.0, how == LOWERED
            push(wave.heap, wave.place, wave.size, s)


@njit(cache=True)
def _grow_until(packed: PackedTerrain, wave: _Wave, target: int, farthest: float) -> bool:
    """Dijkstra from the goal until the target is settled, all nodes within a distance are, or none is left; False: no room.

    No node has to be named: -1.

    Functions that take whole terrains are called only for what is new: passing one costs more than a node.
    """
    ground, cost, place, clear, lowered = wave.ground, wave.cost, wave.place, wave.clear, wave.lowered
    known, first, following, height, at = ground.known, ground.first, ground.following, ground.z, ground.at
    nx, ny = first.shape
    turn = wave.turn_cost * 2 * np.pi / TURNS
    nodes, edges = np.empty(9 * MOST_LEVELS, np.int64), np.empty(9 * MOST_LEVELS)
    while wave.size[0] > 0 and (target < 0 or place[target] != SETTLED) and cost[wave.heap[0]] <= farthest:
        if ground.count[0] + wave.reserve > height.shape[0]:
            return False
        s = pop(wave.heap, place, cost, wave.size)
        place[s] = SETTLED
        level, t = s // TURNS, s % TURNS
        i, j, z = at[level, 0], at[level, 1], height[level]
        n = 0
        for m in range(9):
            u, v = i + m // 3 - 1, j + m % 3 - 1
            if m == 4 or u < 0 or v < 0 or u >= nx or v >= ny:
                continue
            edge = ground.cell * np.sqrt(float(abs(u - i) + abs(v - j)))
            before = n
            while True:
                if known[u, v] == UNKNOWN:
                    own_levels(packed, ground, u, v)
                other = first[u, v]
                while other > 0:
                    if abs(height[other - 1] - z) <= ground.step:
                        nodes[n], edges[n] = (other - 1) * TURNS + t, edge
                        n += 1
                    other = following[other - 1]
                if n > before or known[u, v] == ALL:
                    break
                borrow_levels(packed, ground, u, v)
        nodes[n], edges[n] = level * TURNS + (t + 1) % TURNS, turn
        nodes[n + 1], edges[n + 1] = level * TURNS + (t + TURNS - 1) % TURNS, turn
        for m in range(n + 2):
            q = nodes[m]
            if place[q] <= SETTLED or cost[q] <= cost[s] + edges[m]:
                continue
            if place[q] == UNSEEN:
                how = UPRIGHT if clear[q // TURNS] == 1 else _free(packed, wave, q // TURNS, q % TURNS)
                if how == TAKEN:
                    place[q] = BLOCKED
                    continue
                lowered[q] = how == LOWERED
                push(wave.heap, place, wave.size, q)
            new = cost[s] + edges[m] * (STOOPED if lowered[s] or lowered[q] else 1.0)
            if cost[q] <= new:
                continue
            cost[q] = new
            sift_up(wave.heap, place, cost, place[q])
    return True


@njit(cache=True)
def _query(
    packed: PackedTerrain,
    wave: _Wave,
    x: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    yaw: np.ndarray,
    out: np.ndarray,
    done: int,
) -> int:
    """Distances to the goal region from poses [m], the wave grown as far as they need; how many are done."""
    ground, cost, place = wave.ground, wave.cost, wave.place
    nx, ny = ground.first.shape
    for k in range(done, x.shape[0]):
        t = int(np.round(yaw[k] / (2 * np.pi / TURNS))) % TURNS
        u, v = (x[k] - ground.origin[0]) / ground.cell - 0.5, (y[k] - ground.origin[1]) / ground.cell - 0.5
        i0, j0 = int(np.floor(u)), int(np.floor(v))
        total, weight, nearest, nearest_weight = 0.0, 0.0, np.inf, -1.0
        for a in range(2):
            for b in range(2):
                i, j = i0 + a, j0 + b
                if i < 0 or j < 0 or i >= nx or j >= ny:
                    continue
                if ground.count[0] + wave.reserve > ground.z.shape[0]:
                    return k
                level = nearest_level(ground.first, ground.following, ground.z, i, j, z[k], ground.step)
                if level < 0:
                    level = level_near(packed, ground, i, j, z[k])
                if level < 0:
                    continue
                s = level * TURNS + t
                if (
                    place[s] == UNSEEN and wave.clear[level] != 1 and _free(packed, wave, level, t) == TAKEN
                ):  # never worth growing the wave for
                    place[s] = BLOCKED
                if place[s] != SETTLED and place[s] != BLOCKED and not _grow_until(packed, wave, s, np.inf):
                    return k
                w = (u - i0 if a else i0 + 1 - u) * (v - j0 if b else j0 + 1 - v)
                if place[s] == SETTLED:
                    total += w * cost[s]
                    weight += w
                    if w > nearest_weight:
                        nearest, nearest_weight = cost[s], w
        out[k] = total / weight if weight > 1e-9 else nearest
    return x.shape[0]
