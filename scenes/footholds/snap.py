"""Candidate contacts moved to the nearest foothold: a step or a palm ray that finds none is not lost.

Near means within a radius in the surface's plane and, for feet, within a turn. Of footholds as near the roomier is taken,
and a contact is moved off the edge of where it fits as far as there is room. The projection has the last word.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.footholds.fit_region import most_corners
from scenes.footholds.foothold_table import TURN, TURNS, FootholdTable, enlarged, foothold_table, region_of
from scenes.footholds.nearest_foothold import Plane, nearest_on_surface
from scenes.footholds.projection import (
    PatchShape,
    Placements,
    contact_axes,
    near_patches,
    no_placements,
    patch_fits,
    project_feet,
    project_palms,
)
from scenes.terrain.packed_terrain import PackedTerrain, height_at, near

ALIKE = 1e-3  # [m] footholds whose cost differs by less are equal: the roomier one is taken
FULL = -2  # in place of a surface: the table has no room for a region that is needed
INNER = 3  # row of the half space that keeps a foot to its side


class Snap(NamedTuple):
    """How far candidates are moved.

    Attributes:
        radius: in the plane of the surface [m].
        turns: of the foot's heading to either side, in steps of `stride` turns of the table.
        stride: turns of the table from one heading that is tried to the next.
        turn_cost: what a turn costs against a distance [m/rad].
        margin: a contact that was moved keeps this distance from where it does not fit, as far as there is room [m].
        apart: a candidate that would come nearer than this to another one, with about its heading, is dropped [m].
        enough: where so many steps find footholds as they are, none is moved.
    """

    radius: float = 0.10
    turns: int = 2
    stride: int = 2
    turn_cost: float = 0.1
    margin: float = 0.01
    apart: float = 0.04
    enough: int = 20


class StepLimits(NamedTuple):
    """The steps that a foot may make: bounds of a transition model, seen from the standing foot.

    Attributes:
        x: (2,) least and greatest, forward [m].
        inner: the foot's patch stays outside the line this far to its side [m].
        outer: greatest distance of its contact point to that side [m].
        yaw: (2,) least and greatest turn to that side [rad].
    """

    x: tuple[float, float]
    inner: float
    outer: float
    yaw: tuple[float, float]


def step_limits(steps: np.ndarray, half_extent: tuple[float, float], beyond: float) -> StepLimits:
    """The bounds of a transition model's steps.

    Args:
        steps: (M, 3) of the left foot: x, y [m], yaw [rad].
        half_extent: half length and half width of the sole [m].
        beyond: how much farther than the model's steps a foot may go forwards, backwards and outwards [m].
    """
    turn = steps[:, 2]
    inner = steps[:, 1] - half_extent[0] * np.abs(np.sin(turn)) - half_extent[1] * np.abs(np.cos(turn))
    return StepLimits(
        (float(steps[:, 0].min()) - beyond, float(steps[:, 0].max()) + beyond),
        float(inner.min()),
        float(steps[:, 1].max()) + beyond,
        (float(turn.min()), float(turn.max())),
    )


class Footholds:
    """Where the end effectors of one robot fit on one terrain; candidates without a foothold move to the nearest one."""

    def __init__(self, packed: PackedTerrain, heading: float = 0.0, snap: Snap | None = None) -> None:
        """Prepares empty tables.

        Args:
            packed: the terrain.
            heading: one that feet often have [rad]; those that are tried are 5 deg apart from it.
            snap: how far candidates are moved; None: not at all.
        """
        self.packed, self.snap = packed, snap
        self._heading = heading
        self._tables: dict[tuple[PatchShape, bool], FootholdTable] = {}

    def parts(self, surface: int, turn: int, patch: PatchShape, palm: bool) -> tuple[np.ndarray, list[np.ndarray]]:
        """(3, 3) contact frame R_WC, and the convex parts (K, 2) of where a patch fits on a surface at a heading [m].

        Coordinates are x and y of that frame at the origin of W. A large surface comes in tiles.

        Args:
            surface: number of the surface.
            turn: number of the heading; turn 0 is the heading that was given at the start, others are 5 deg apart.
            patch: the room that the end effector takes.
            palm: whether a palm touches, not a foot.
        """
        R, found = np.empty((3, 3)), []
        contact_axes(self.packed.normal[surface], self._heading + turn * TURN, palm, R)
        table = self._table(patch, palm)
        for tile in range(*table.tile_start[surface : surface + 2].tolist()):
            number = region_of(self.packed, table, tile, surface, turn % TURNS, patch, palm)
            while number < 0:
                table = self._enlarge(patch, palm)
                number = region_of(self.packed, table, tile, surface, turn % TURNS, patch, palm)
            for part in range(*table.part_start[number : number + 2].tolist()):
                found.append(table.corner[slice(*table.corner_start[part : part + 2].tolist())].copy())
        return R, found

    def place_feet(
        self,
        effector: int,
        xy_yaw: np.ndarray,
        z_range: tuple[float, float],
        patch: PatchShape,
        stand: np.ndarray,
        limits: StepLimits,
    ) -> Placements:
        """Sets feet down below n candidates, or on the foothold nearest to them; `xy_yaw` gets the headings that they have then.

        Args:
            effector: index into `EFFECTORS`.
            xy_yaw: (n, 3) place [m] and heading [rad] in W.
            z_range: least and greatest height of the contact points in W [m].
            patch: the room that the foot takes.
            stand: (3,) place [m] and heading [rad] of the standing foot in W.
            limits: of the steps.
        """
        placed = no_placements(len(xy_yaw))
        project_feet(self.packed, effector, xy_yaw, z_range, patch, placed)
        if self.snap is None or (placed.surface >= 0).sum() >= self.snap.enough:
            return placed
        done = 0
        while True:
            table = self._table(patch, False)
            done = _snap_feet(
                self.packed, table, effector, xy_yaw, z_range, patch, self.snap, stand, limits, placed, done
            )
            if done == len(xy_yaw):
                return placed
            self._enlarge(patch, False)

    def place_palms(
        self,
        effector: int,
        origin: np.ndarray,
        rays: np.ndarray,
        heading: float,
        reach: tuple[float, float],
        patch: PatchShape,
    ) -> Placements:
        """Sets palms down where n rays from a shoulder point meet a surface, or on the foothold nearest to there.

        Args:
            effector: index into `EFFECTORS`.
            origin: (3,) shoulder point in W [m].
            rays: (n, 3) unit vectors in W.
            heading: of the body [rad].
            reach: least and greatest distance of a contact point from the shoulder [m].
            patch: the room that the palm takes.
        """
        placed = no_placements(len(rays))
        project_palms(self.packed, effector, origin, rays, heading, reach, patch, placed)
        if self.snap is None or (placed.surface >= 0).all():
            return placed
        done = 0
        while True:
            table = self._table(patch, True)
            done = _snap_palms(
                self.packed, table, effector, origin, rays, heading, reach, patch, self.snap, placed, done
            )
            if done == len(rays):
                return placed
            self._enlarge(patch, True)

    def _table(self, patch: PatchShape, palm: bool) -> FootholdTable:
        key = (patch, palm)
        if key not in self._tables:
            self._tables[key] = foothold_table(self.packed, self._heading)
        return self._tables[key]

    def _enlarge(self, patch: PatchShape, palm: bool) -> FootholdTable:
        table = self._tables[patch, palm] = enlarged(self._tables[patch, palm], self.packed)
        return table


@njit(cache=True)
def _snap_feet(
    packed: PackedTerrain,
    table: FootholdTable,
    effector: int,
    xy_yaw: np.ndarray,
    z_range: tuple[float, float],
    patch: PatchShape,
    snap: Snap,
    stand: np.ndarray,
    limits: StepLimits,
    placed: Placements,
    done: int,
) -> int:
    """Moves the candidates from number `done` on that have no foothold; how many are done when the table is full."""
    around = near_patches(packed, xy_yaw, patch, snap.radius)
    bounds = _step_bounds(effector, z_range, stand, limits)
    for m in range(done, xy_yaw.shape[0]):
        if placed.surface[m] >= 0:
            continue
        surface, heading = _snap_foot(
            packed, table, effector, xy_yaw[m], patch, snap, stand, limits, bounds, around, placed.p[m], placed.R[m]
        )
        if surface == FULL:
            return m
        if surface >= 0 and not _doubled(placed, m, surface, snap.apart, xy_yaw[:, 2], heading):
            placed.surface[m] = surface
            xy_yaw[m, 2] = heading
    return xy_yaw.shape[0]


@njit(cache=True)
def _step_bounds(effector: int, z_range: tuple[float, float], stand: np.ndarray, limits: StepLimits) -> np.ndarray:
    """(6, 4) half spaces of W that a step's contact point has to be in: rows (a, b) mean a @ q <= b [m].

    Row `INNER` depends on the turn of the step, too: what the turned sole needs has to be taken from its bound.
    """
    left = 1.0 if effector == 0 else -1.0
    c, s = np.cos(stand[2]), np.sin(stand[2])
    ahead, aside = c * stand[0] + s * stand[1], left * (c * stand[1] - s * stand[0])
    return np.array(
        [
            [c, s, 0.0, ahead + limits.x[1]],
            [-c, -s, 0.0, -ahead - limits.x[0]],
            [-left * s, left * c, 0.0, aside + limits.outer],
            [left * s, -left * c, 0.0, -aside],
            [0.0, 0.0, 1.0, z_range[1]],
            [0.0, 0.0, -1.0, -z_range[0]],
        ]
    )


@njit(cache=True)
def _snap_foot(
    packed: PackedTerrain,
    table: FootholdTable,
    effector: int,
    place: np.ndarray,
    patch: PatchShape,
    snap: Snap,
    stand: np.ndarray,
    limits: StepLimits,
    step_bounds: np.ndarray,
    around: np.ndarray,
    p_WC: np.ndarray,
    R_WC: np.ndarray,
) -> tuple[int, float]:
    """Surface and heading of the foothold nearest to a place (3,), -1 for none, `FULL` for a full table; its pose is written."""
    x, y, yaw = place[0], place[1], place[2]
    left = 1.0 if effector == 0 else -1.0
    wanted = int(np.round((yaw - table.heading[0]) / TURN))
    bounds = step_bounds.copy()
    corners = np.empty((2, most_corners(packed) + bounds.shape[0], 2))
    work = np.empty((2, packed.vertices.shape[1] + 8, 3))
    p, R, q = np.empty(3), np.empty((3, 3)), np.empty(3)
    best, best_room, best_surface, best_yaw = snap.radius + snap.turn_cost * np.pi, 0.0, -1, 0.0
    for i in range(around.shape[0]):
        k = around[i]
        if k >= packed.num_surfaces:
            break  # ascending: triangles follow
        if not packed.allowed[k, effector] or packed.normal[k, 2] < 1e-3:
            continue
        if not _within(packed.low[k], packed.high[k], x, y, snap.radius):
            continue
        p[0], p[1], p[2] = x, y, height_at(packed, k, x, y)
        plane = Plane(k, packed.normal[k], packed.offset[k], packed.low[k])
        for t in range(2 * snap.turns + 1):  # 0, -1, 1, -2, 2, ...: the cheap ones first
            turn = wanted + snap.stride * (t // 2 if t % 2 == 0 else -(t + 1) // 2)
            heading = table.heading[0] + turn * TURN
            turned = _wrapped(heading - stand[2]) * left
            if turned < limits.yaw[0] - 1e-6 or turned > limits.yaw[1] + 1e-6:
                continue
            price = snap.turn_cost * abs(heading - yaw)
            if price > best + ALIKE:
                continue
            inner = limits.inner + patch.half_length * abs(np.sin(turned)) + patch.half_width * abs(np.cos(turned))
            bounds[INNER, 3] = step_bounds[INNER, 3] - inner
            least = best + ALIKE - price
            while True:
                tile, away, room = nearest_on_surface(
                    table, plane, turn % TURNS, False, snap.radius, snap.margin, p, least, bounds, corners, q
                )
                if tile < 0:
                    break
                if region_of(packed, table, tile, k, turn % TURNS, patch, False) < 0:
                    return FULL, 0.0
            cost = away + price
            if room < 0.0 or cost > best + ALIKE or (cost > best - ALIKE and room <= best_room):
                continue
            contact_axes(packed.normal[k], heading, False, R)
            if patch_fits(packed, k, q, R, patch, around, work):
                best, best_room, best_surface, best_yaw = min(best, cost), room, k, heading
                p_WC[:], R_WC[:] = q, R
    return best_surface, best_yaw


@njit(cache=True)
def _snap_palms(
    packed: PackedTerrain,
    table: FootholdTable,
    effector: int,
    origin: np.ndarray,
    rays: np.ndarray,
    heading: float,
    reach: tuple[float, float],
    patch: PatchShape,
    snap: Snap,
    placed: Placements,
    done: int,
) -> int:
    """Moves the rays from number `done` on that found no foothold; how many are done when the table is full."""
    around = near(packed, origin[0] - reach[1], origin[1] - reach[1], origin[0] + reach[1], origin[1] + reach[1])
    turn = int(np.round((heading - table.heading[0]) / TURN)) % TURNS
    p, q = np.empty(3), np.empty(3)
    ray, anywhere, corners = np.empty((1, 3)), np.empty((0, 4)), np.empty((2, most_corners(packed), 2))
    same = np.zeros(rays.shape[0])  # headings of palms do not matter
    one = (np.empty((1, 3)), np.empty((1, 3, 3)), np.empty(1, np.int64))
    for m in range(done, rays.shape[0]):
        if placed.surface[m] >= 0:
            continue
        best = snap.radius
        for i in range(around.shape[0]):
            k = around[i]
            if k >= packed.num_surfaces:
                break  # ascending: triangles follow
            n = packed.normal[k]
            along = n[0] * rays[m, 0] + n[1] * rays[m, 1] + n[2] * rays[m, 2]
            if not packed.allowed[k, effector] or along > -0.2:
                continue
            t = (packed.offset[k] - n[0] * origin[0] - n[1] * origin[1] - n[2] * origin[2]) / along
            if t < reach[0] or t > reach[1]:
                continue
            apart = False
            for a in range(3):
                p[a] = origin[a] + t * rays[m, a]
                if p[a] < packed.low[k, a] - best or p[a] > packed.high[k, a] + best:
                    apart = True
            if apart:
                continue
            plane = Plane(k, packed.normal[k], packed.offset[k], packed.low[k])
            while True:
                tile, away, room = nearest_on_surface(
                    table, plane, turn, True, snap.radius, snap.margin, p, best, anywhere, corners, q
                )
                if tile < 0:
                    break
                if region_of(packed, table, tile, k, turn, patch, True) < 0:
                    placed.surface[m] = -1  # it is looked at again, from the start
                    return m
            if room < 0.0 or away >= best:
                continue
            length = 0.0
            for a in range(3):
                ray[0, a] = q[a] - origin[a]
                length += ray[0, a] ** 2
            length = np.sqrt(length)
            ray /= length
            project_palms(packed, effector, origin, ray, heading, reach, patch, Placements(one[0], one[1], one[2]))
            if one[2][0] == k:
                best = away
                placed.p[m], placed.R[m], placed.surface[m] = one[0][0], one[1][0], k
        if placed.surface[m] >= 0 and _doubled(placed, m, placed.surface[m], snap.apart, same, 0.0):
            placed.surface[m] = -1
    return rays.shape[0]


@njit(cache=True)
def _doubled(placed: Placements, m: int, surface: int, apart: float, yaw: np.ndarray, heading: float) -> bool:
    """Whether another candidate on this surface is so near to number m, and has about this heading."""
    for j in range(yaw.shape[0]):
        if j == m or placed.surface[j] != surface or abs(_wrapped(yaw[j] - heading)) > 2.1 * TURN:
            continue
        away = 0.0
        for a in range(3):
            away += (placed.p[j, a] - placed.p[m, a]) ** 2
        if away < apart * apart:
            return True
    return False


@njit(cache=True)
def _wrapped(angle: float) -> float:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@njit(cache=True)
def _within(low: np.ndarray, high: np.ndarray, x: float, y: float, radius: float) -> bool:
    return low[0] - radius <= x <= high[0] + radius and low[1] - radius <= y <= high[1] + radius
