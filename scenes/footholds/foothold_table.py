"""The regions where one kind of patch fits, found when they are first asked for and kept: by piece of surface and heading.

Large surfaces are looked at in pieces of a metre, so that a region never has more parts than what is near asks for.
"""

# An element of an integer array is an integer to a kernel, and an array to the type checker.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from scenes.footholds.convex_parts import PARTS
from scenes.footholds.fit_region import fit_region, most_corners
from scenes.footholds.projection import PatchShape, contact_axes
from scenes.terrain.packed_terrain import PackedTerrain

TURNS = 72  # headings that footholds are looked for at: every 5 deg, the resolution of `ContactPool`
TURN = 2.0 * np.pi / TURNS
TILE = 1.0  # [m] edge of the pieces that large surfaces are looked at in
MOST_TILES = 1_000_000  # a terrain with more of them gets larger ones
ROWS, REGIONS, PIECES, CORNERS_USED = 0, 1, 2, 3  # places in `count`


class FootholdTable(NamedTuple):
    """Regions of one kind of patch on one terrain; every array grows when it is full.

    Attributes:
        heading: (1,) of turn 0 in W [rad].
        edge: (1,) of a tile [m].
        tile_start: (S + 1,) the tiles of surface k are tile_start[k] to tile_start[k + 1].
        tiles: (S, 3) how many there are along each axis of W, 1 along that of the least extent: a surface is flat.
        row: (tiles,) row of `region` that a tile has, -1 before it is first asked for.
        region: (rows, TURNS) number of the region of a tile at each heading, -1 before it is first asked for.
        part_start: (regions + 1,) the parts of region k are part_start[k] to part_start[k + 1].
        bounds: (regions, 6) least and greatest coordinates of each region in W [m], inf and -inf where it is empty.
        corner_start: (parts + 1,) the same for the corners of each part.
        corner: (corners, 2) (u, v) in the contact frame of the region's heading at the origin of W [m].
        count: (4,) rows, regions, parts and corners that are in use.
    """

    heading: np.ndarray
    edge: np.ndarray
    tile_start: np.ndarray
    tiles: np.ndarray
    row: np.ndarray
    region: np.ndarray
    part_start: np.ndarray
    bounds: np.ndarray
    corner_start: np.ndarray
    corner: np.ndarray
    count: np.ndarray


def foothold_table(packed: PackedTerrain, heading: float = 0.0) -> FootholdTable:
    """An empty table for a terrain.

    Args:
        packed: the terrain.
        heading: of turn 0 in W [rad]; headings of the table are this and multiples of `TURN` from it.
    """
    size = packed.num_surfaces
    extent, edge = packed.high[:size] - packed.low[:size], TILE
    extent[np.arange(size), extent.argmin(axis=1)] = 0.0
    tiles = np.maximum(np.ceil(extent / edge), 1.0)
    while tiles.prod(axis=1).sum() > max(MOST_TILES, 4 * size):
        edge *= 2.0
        tiles = np.maximum(np.ceil(extent / edge), 1.0)
    tiles = tiles.astype(np.int64)
    start = np.concatenate([[0], np.cumsum(tiles.prod(axis=1))]).astype(np.int64)
    table = FootholdTable(
        heading=np.array([heading], float),
        edge=np.array([edge], float),
        tile_start=start,
        tiles=tiles,
        row=np.full(start[-1], -1, np.int32),
        region=np.empty((0, TURNS), np.int32),
        part_start=np.zeros(1, np.int64),
        bounds=np.empty((0, 6)),
        corner_start=np.zeros(1, np.int64),
        corner=np.empty((0, 2)),
        count=np.zeros(4, np.int64),
    )
    return enlarged(table, packed)


def enlarged(table: FootholdTable, packed: PackedTerrain) -> FootholdTable:
    """The same table with room for more, at least twice as many of everything that is nearly full.

    Args:
        table: one that is full.
        packed: its terrain.
    """
    rows, regions, pieces, corners = table.count.tolist()
    width = most_corners(packed)

    def longer(array: np.ndarray, used: int, spare: int, filled: float = 0) -> np.ndarray:
        if len(array) >= used + spare:
            return array
        new = np.full((max(2 * len(array), used + 2 * spare), *array.shape[1:]), filled, array.dtype)
        new[: len(array)] = array
        return new

    return table._replace(
        region=longer(table.region, rows, 64, -1),
        part_start=longer(table.part_start, regions + 1, 64),
        bounds=longer(table.bounds, regions, 64),
        corner_start=longer(table.corner_start, pieces + 1, 16 * PARTS),
        corner=longer(table.corner, corners, 16 * PARTS * width),
    )


@njit(cache=True)
def region_of(
    packed: PackedTerrain, table: FootholdTable, tile: int, surface: int, turn: int, patch: PatchShape, palm: bool
) -> int:
    """The number of a region in the table, found now if it was not before; -1 where the table has no room for it.

    Args:
        packed: the terrain.
        table: of this kind of patch.
        tile: number of the piece of the surface.
        surface: number of the surface.
        turn: number of the heading, 0 to TURNS - 1.
        patch: the room that the end effector takes.
        palm: whether a palm touches, not a foot.
    """
    row = table.row[tile]
    if row >= 0 and table.region[row, turn] >= 0:
        return table.region[row, turn]
    rows, regions, pieces, corners = (
        table.count[ROWS],
        table.count[REGIONS],
        table.count[PIECES],
        table.count[CORNERS_USED],
    )
    width = most_corners(packed)
    if (
        rows + 1 > table.region.shape[0]
        or regions + 1 > table.bounds.shape[0]
        or regions + 2 > table.part_start.shape[0]
        or pieces + PARTS + 1 > table.corner_start.shape[0]
        or corners + PARTS * width > table.corner.shape[0]
    ):
        return -1
    if row < 0:
        row = table.row[tile] = rows
        table.count[ROWS] += 1
    R = np.empty((3, 3))
    contact_axes(packed.normal[surface], table.heading[0] + turn * TURN, palm, R)
    low, high = np.empty(3), np.empty(3)
    rest = tile - table.tile_start[surface]
    for a in range(3):
        cell = rest % table.tiles[surface, a]
        rest //= table.tiles[surface, a]
        low[a], high[a] = packed.low[surface, a] - 1e-6, packed.high[surface, a] + 1e-6
        if table.tiles[surface, a] > 1:
            low[a] += cell * table.edge[0]
            high[a] = low[a] + table.edge[0] + 2e-6
    parts, size = np.empty((PARTS, width, 2)), np.empty(PARTS, np.int64)
    n = fit_region(packed, surface, R, patch, low, high, parts, size)
    bounds = table.bounds[regions]
    bounds[:3], bounds[3:] = np.inf, -np.inf
    for i in range(n):
        table.corner_start[pieces + i] = corners
        for k in range(size[i]):
            u, v = parts[i, k, 0], parts[i, k, 1]
            table.corner[corners, 0], table.corner[corners, 1] = u, v
            for a in range(3):
                at = R[a, 0] * u + R[a, 1] * v + R[a, 2] * packed.offset[surface]
                bounds[a], bounds[3 + a] = min(bounds[a], at), max(bounds[3 + a], at)
            corners += 1
    table.corner_start[pieces + n] = corners
    table.part_start[regions], table.part_start[regions + 1] = pieces, pieces + n
    table.count[REGIONS], table.count[PIECES], table.count[CORNERS_USED] = regions + 1, pieces + n, corners
    table.region[row, turn] = regions
    return regions
