"""Which surfaces are one floor."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from scenes.terrain.floors import FLUSH, JOINT, closed
from scenes.terrain.packed_terrain import PackedTerrain, pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain


def tile(name: str, x: tuple[float, float], y: tuple[float, float] = (-0.5, 0.5), z: float = 0.0, **other) -> Surface:
    return Surface(name, np.array([[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]]), **other)


def tilted(surface: Surface, degrees: float) -> Surface:
    """The surface turned about the y axis."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    R = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    return Surface(surface.name, surface.vertices @ R.T, surface.friction, surface.effectors)


def packed(*surfaces: Surface) -> PackedTerrain:
    return pack_terrain(Terrain(surfaces))


WEST = tile("west", (-1, 0))


@pytest.mark.parametrize(
    ("other", "one"),
    [
        (tile("touching", (0, 1)), True),
        (tile("overlapping", (-0.3, 1)), True),
        (tile("5 mm away", (0.005, 1)), True),
        (tile("7 mm away", (0.007, 1)), False),
        (tile("2 mm higher", (0, 1), z=0.002), True),
        (tile("4 mm lower", (0, 1), z=-0.004), False),
        (tilted(tile("turned by half a degree", (0, 1)), 0.5), True),
        (tilted(tile("turned by two degrees", (0, 1)), 2.0), False),
        (tile("smoother", (0, 1), friction=0.3), False),
        (tile("for the left foot", (0, 1), effectors=frozenset({"left_foot"})), False),
        (tile("touching at a corner", (0, 1), (0.5, 1)), True),
        (tile("far away", (5, 6)), False),
    ],
    ids=lambda value: value.name if isinstance(value, Surface) else None,
)
def test_two_surfaces_are_one_floor_where_they_meet_in_one_plane_with_equal_rights(other: Surface, one: bool) -> None:
    for pair in ((WEST, other), (other, WEST)):
        floor = packed(*pair).floor
        assert (floor == (0 if one else -1)).all(), floor


def test_a_floor_is_what_hangs_together_and_single_surfaces_are_none() -> None:
    row = [tile(f"t{k}", (0.3 * k, 0.3 * k + 0.3)) for k in range(4)]
    shelf = [tile(f"s{k}", (0.3 * k, 0.3 * k + 0.3), z=1.0) for k in range(2)]
    floor = packed(row[0], tile("alone", (5, 6)), row[2], shelf[0], row[1], shelf[1], row[3]).floor
    assert floor[1] == -1
    assert len({floor[k] for k in (0, 2, 4, 6)}) == 1
    assert floor[3] == floor[5] >= 0
    assert floor[3] != floor[0]


def test_joints_fill_what_lies_between_pieces_and_nothing_beyond_the_rim() -> None:
    gap = 0.004
    terrain = packed(WEST, tile("east", (gap, 1), z=0.001))
    assert terrain.joint_start.tolist() == [0, len(terrain.joint) // 2, len(terrain.joint)]
    corners = terrain.joint.reshape(-1, 3)
    assert corners[:, 0].min() == pytest.approx(0.0, abs=1e-9)
    assert corners[:, 0].max() == pytest.approx(gap, abs=1e-9)
    assert np.abs(corners[:, 1]).max() == pytest.approx(0.5, abs=1e-9)
    doubled = np.cross(terrain.joint[:, 1] - terrain.joint[:, 0], terrain.joint[:, 2] - terrain.joint[:, 0])
    assert np.linalg.norm(doubled, axis=1).sum() / 2 == pytest.approx(2 * gap, rel=1e-6)  # listed with either neighbour
    assert corners[:, 2].min() >= 0.0
    assert corners[:, 2].max() <= 0.001 + 1e-12


def test_every_point_of_a_joint_between_two_pieces_is_as_near_to_one_as_a_support_has_to_be() -> None:
    joint = packed(WEST, tile("east", (2 * JOINT - 1e-6, 1))).joint
    away = np.minimum(np.maximum(joint[..., 0], 0), np.maximum(2 * JOINT - 1e-6 - joint[..., 0], 0))
    middle = (joint[..., 0].min() + joint[..., 0].max()) / 2
    assert away.max() <= FLUSH
    assert middle <= FLUSH


def test_a_needle_between_two_pieces_is_no_error() -> None:
    """The mitres that GEOS puts round a needle's point cross each other."""
    needle = [[0.096346, 0.105758], [0.096763, 0.106212], [0.041104, 0.096049]]
    beside = [[0.124178, 0.110781], [0.119265, 0.139929], [0.091912, 0.134926], needle[1]]
    below = [[0.101194, 0.076995], needle[0], needle[2], [0.045954, 0.06739]]
    union = shapely.union_all([shapely.Polygon(p) for p in (needle, beside, below)])
    assert not union.buffer(JOINT, join_style="mitre").buffer(-JOINT, join_style="mitre").is_valid
    filled = closed(union)
    assert filled.is_valid
    assert filled.difference(union.buffer(JOINT)).area < 1e-8
    assert union.difference(filled).area < 1e-8
