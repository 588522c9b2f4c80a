"""Convex covers of flat regions."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box

from scenes.footholds.convex_cover import SMOOTHING, convex_cover, min_width


def assert_covers(region, pieces):
    """Every piece convex and counter-clockwise, inside the region, and their union the region."""
    slack = SMOOTHING * region.length + 1e-6
    for corners in pieces:
        edges = np.roll(corners, -1, axis=0) - corners
        turn = edges[:, 0] * np.roll(edges, -1, axis=0)[:, 1] - edges[:, 1] * np.roll(edges, -1, axis=0)[:, 0]
        assert (turn > -1e-9).all()
        assert Polygon(corners).difference(region.buffer(2 * SMOOTHING)).area < 1e-9
    union = shapely.union_all([Polygon(corners) for corners in pieces])
    assert union.symmetric_difference(region).area < slack


def test_a_convex_region_is_its_own_cover():
    hexagon = shapely.Point(0, 0).buffer(1, quad_segs=2)
    pieces = convex_cover(hexagon)
    assert len(pieces) == 1
    assert len(pieces[0]) == 8


def test_an_angle_is_two_arms_that_share_the_corner():
    """A partition would leave a seam there; a sole across it lies in one of the two arms all the same."""
    region = box(0, 0, 3, 1) | box(0, 0, 1, 3)
    pieces = convex_cover(region)
    assert sorted(Polygon(p).area for p in pieces) == pytest.approx([3.0, 3.0])
    assert_covers(region, pieces)


def test_a_frame_is_four_bars_that_overlap_in_the_corners():
    region = box(0, 0, 4, 4) - box(1, 1, 3, 3)
    pieces = convex_cover(region)
    assert sorted(Polygon(p).area for p in pieces) == pytest.approx([4.0] * 4)
    assert_covers(region, pieces)


@settings(max_examples=60)
@given(st.lists(st.tuples(*[st.floats(-1.5, 1.5)] * 2, st.floats(0.1, 1.0), st.floats(0.1, 1.0), st.floats(0, 180)),
                min_size=1, max_size=8), st.booleans())  # fmt: skip
def test_whatever_blocks_add_or_take_the_cover_is_exact(blocks, take):
    parts = [shapely.affinity.rotate(box(x - w, y - h, x + w, y + h), turn) for x, y, w, h, turn in blocks]
    union = shapely.union_all(parts)
    for region in shapely.get_parts(box(-2, -2, 2, 2) - union if take else union):
        assert_covers(region, convex_cover(region))


@given(st.floats(0.1, 2.0), st.floats(0.1, 2.0), st.floats(0, 180))
def test_the_width_of_a_rectangle_is_its_shorter_side_however_it_lies(length, width, turn):
    turned = shapely.orient_polygons(shapely.affinity.rotate(box(0, 0, length, width), turn))
    corners = shapely.get_coordinates(turned)[:-1]
    assert min_width(corners) == pytest.approx(min(length, width))


def test_the_width_of_a_triangle_is_its_least_height():
    assert min_width(np.array([[0, 0], [4, 0], [0, 3]], float)) == pytest.approx(12 / 5)


def test_a_needle_has_no_cover():
    assert convex_cover(Polygon([(0, 0), (1, 0), (1, 1e-9)])) == []
