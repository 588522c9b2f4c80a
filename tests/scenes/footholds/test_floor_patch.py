"""Soles and palms on floors of several pieces, against shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes.contact import Contact
from scenes.footholds.projection import PALM_CLEARANCE, PatchShape, no_placements, project_palms, set_down
from scenes.terrain.floors import FLUSH, JOINT
from scenes.terrain.packed_terrain import pack_terrain
from scenes.terrain.surface import Surface
from scenes.terrain.terrain import Terrain

HALF = (0.11, 0.06)  # sole [m]


def plate(name: str, corners: np.ndarray, z: float = 0.0, friction: float = 0.5) -> Surface:
    return Surface(name, np.column_stack([corners, np.full(len(corners), z)]), friction)


def tile(x0: float, x1: float, y0: float = -0.5, y1: float = 0.5, z: float = 0.0, friction: float = 0.5) -> Surface:
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    return plate(f"tile {x0:g} {y0:g} {z:g}", corners, z, friction)


def sole(x: float, y: float, yaw: float, half: tuple[float, float] = HALF) -> shapely.Polygon:
    c, s = np.cos(yaw), np.sin(yaw)
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return shapely.Polygon(
        [(x + c * a * half[0] - s * b * half[1], y + s * a * half[0] + c * b * half[1]) for a, b in signs]
    )


def down(surfaces: list[Surface], x: float, y: float, yaw: float = 0.0) -> Contact | None:
    return set_down(pack_terrain(Terrain(tuple(surfaces))), "left_foot", x, y, yaw, HALF)


@pytest.mark.parametrize(
    ("gap", "step", "friction", "stands"),
    [
        (0.0, 0.0, 0.5, True),
        (0.005, 0.0, 0.5, True),
        (0.02, 0.0, 0.5, False),
        (0.0, 0.002, 0.5, True),
        (0.0, -0.002, 0.5, True),
        (0.0, 0.004, 0.5, False),
        (0.0, -0.004, 0.5, False),
        (0.0, 0.0, 0.6, False),
        (-0.05, 0.0, 0.5, True),
    ],
)
def test_a_sole_stands_across_a_seam_unless_it_is_a_gap_a_step_or_a_change_of_friction(
    gap: float, step: float, friction: float, stands: bool
) -> None:
    contact = down([tile(-1, 0), tile(gap, 1, z=step, friction=friction)], -0.02, 0.1)
    assert (contact is not None) == stands
    if contact is not None and gap >= 0:
        assert contact.surface == 0


def test_a_sole_whose_middle_is_over_a_joint_stands_on_a_piece_beside_it() -> None:
    contact = down([tile(-1, 0), tile(0.005, 1)], 0.0025, 0.1, 0.3)
    assert contact is not None
    assert contact.surface in (0, 1)


def test_a_sole_may_not_reach_beyond_the_rim_of_a_floor() -> None:
    tiles = [tile(-0.3 * k - 0.3, -0.3 * k) for k in range(4)]
    assert down(tiles, -HALF[0] - 0.001, 0.0) is not None
    assert down(tiles, -HALF[0] + 0.001, 0.0) is None
    assert down(tiles, -0.3, 0.5 - HALF[1] - 0.001) is not None
    assert down(tiles, -0.3, 0.5 - HALF[1] + 0.001) is None


def test_four_tiles_with_joints_carry_a_sole_on_their_common_corner() -> None:
    gap = 0.005
    tiles = [tile(x, x + 0.3, y, y + 0.3) for x in (-0.3, gap) for y in (-0.3, gap)]
    for yaw in np.linspace(0, 3, 9):
        assert down(tiles, 0.001, 0.004, float(yaw)) is not None


def test_a_thin_wall_that_stands_in_a_joint_is_in_the_way() -> None:
    wall = Surface("wall", np.array([[0.002, -0.5, -0.1], [0.002, -0.5, 0.3], [0.002, 0.5, 0.3], [0.002, 0.5, -0.1]]))
    assert down([tile(-1, 0), tile(0.005, 1)], 0.0, 0.1) is not None
    assert down([tile(-1, 0), tile(0.005, 1), wall], 0.0, 0.1) is None


def test_a_patch_lies_in_the_plane_of_the_piece_under_its_middle() -> None:
    tilt = np.deg2rad(0.5)
    ramp = Surface("ramp", tile(0, 1).vertices @ np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [0, 0, 1]]))
    on_floor, on_ramp = (down([tile(-1, 0), ramp], x, 0.1) for x in (-0.02, 0.02))
    assert on_floor is not None
    assert on_ramp is not None
    assert on_floor.R_WC[2, 2] == pytest.approx(1.0, abs=1e-12)
    assert on_ramp.R_WC[0, 2] == pytest.approx(-np.sin(tilt), abs=1e-12)


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 10**6), yaw=st.floats(-np.pi, np.pi), x=st.floats(-0.4, 0.4), y=st.floats(-0.4, 0.4))
def test_a_sole_stands_where_shapely_says_that_the_closed_union_of_the_pieces_holds_it(
    seed: int, yaw: float, x: float, y: float
) -> None:
    """Random convex pieces of one plane: overlapping, apart by a joint, or by a gap."""
    rng = np.random.default_rng(seed)
    surfaces, outlines = [], []
    for k in range(rng.integers(2, 9)):
        hull = shapely.MultiPoint(rng.uniform(-0.5, 0.5, 2) + rng.uniform(-0.35, 0.35, (7, 2))).convex_hull
        corners = shapely.get_coordinates(shapely.orient_polygons(hull))[:-1]
        surfaces.append(plate(f"p{k}", corners))
        outlines.append(hull)
    slabs = [shapely.box(-0.6, -0.6, -0.1, 0.6), shapely.box(-0.1 + 0.0055, -0.6, 0.6, 0.6)]
    if rng.random() < 0.5:  # two large pieces with a joint between them
        surfaces += [tile(-0.6, -0.1, -0.6, 0.6), tile(-0.1 + 0.0055, 0.6, -0.6, 0.6)][: rng.integers(1, 3)]
        outlines += slabs[: len(surfaces) - len(outlines)]
    packed = pack_terrain(Terrain(tuple(surfaces)))
    contact = set_down(packed, "left_foot", x, y, yaw, HALF)
    union = shapely.union_all(outlines)
    floor = union.buffer(JOINT, join_style="mitre").buffer(-JOINT, join_style="mitre")
    # Only what hangs together is one floor: between separate ones no joint is closed.
    if contact is not None:
        assert floor.buffer(1e-6).contains(sole(x, y, yaw))
    elif union.buffer(-2e-4).contains(sole(x, y, yaw)):
        raise AssertionError("a sole inside the union of the pieces was refused")


def test_a_palm_rests_on_two_panels_of_a_wall() -> None:
    low, high = ([[x, 0.7, z] for x, z in ((0, a), (2, a), (2, b), (0, b))] for a, b in ((0.5, 1.2), (1.2, 2.0)))
    patch = PatchShape(0.05, 0.04, 0.0, 0.0, 0.0, PALM_CLEARANCE)
    ray, origin = np.array([[0.0, 1.0, 0.0]]), np.array([0.5, 0.3, 1.19])
    for panels, found in (((low, high), True), ((low,), False)):
        packed = pack_terrain(Terrain(tuple(Surface(f"panel {k}", np.array(p)) for k, p in enumerate(panels))))
        placed = no_placements(1)
        project_palms(packed, 2, origin, ray, 0.0, (0.1, 0.8), patch, placed)
        assert (placed.surface[0] >= 0) == found


def test_what_is_flush_to_the_last_millimetre_counts_and_more_does_not() -> None:
    for step, stands in ((FLUSH - 1e-4, True), (FLUSH + 1e-4, False)):
        assert (down([tile(-1, 0), tile(0, 1, z=-step)], 0.0, 0.1) is not None) == stands
