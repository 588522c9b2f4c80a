"""Flat regions of meshes."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes.meshes.mesh_file import drop_degenerate
from scenes.meshes.mesh_orientation import Bodies
from scenes.meshes.planar_regions import BURIED, _winds_round, planar_regions
from scenes.pose import pose_matrix

ANYWHERE = np.pi


def block(size, centre, rpy=(0.0, 0.0, 0.0)):
    """(12, 3, 3) outward triangles of a box."""
    return trimesh.creation.box(size, transform=pose_matrix(centre, rpy)).triangles


def regions(*parts, min_width=0.04, max_tilt=ANYWHERE):
    triangles = drop_degenerate(np.concatenate(parts))
    return list(planar_regions(Bodies(triangles), min_width=min_width, max_tilt=max_tilt))


def up(found):
    return [r for r in found if r.axes[2, 2] > 0.99]


def test_a_box_has_six_faces_that_look_outward():
    centre = np.array([1.0, 2.0, 3.0])
    found = regions(block((1.0, 2.0, 3.0), centre, (0.3, -0.4, 0.5)))
    assert sorted(r.outline.area for r in found) == pytest.approx([2, 2, 3, 3, 6, 6], abs=1e-3)
    for region in found:
        corners = region.lift(np.array(region.outline.exterior.coords))
        assert ((corners - centre) @ region.axes[2] > 0).all()
        np.testing.assert_allclose(np.cross(*region.axes[:2]), region.axes[2], atol=1e-12)


def test_blocks_side_by_side_share_one_top_though_no_edge_in_the_file_is_shared():
    row = [block((0.1, 0.3, 0.2), (0.1 * i, 0.01 * (i % 2), 0.1)) for i in range(5)]
    tops = up(regions(*row))
    assert len(tops) == 1
    assert tops[0].outline.area == pytest.approx(5 * 0.1 * 0.3, rel=1e-3)


def test_blocks_apart_or_of_other_height_keep_their_own_tops():
    assert len(up(regions(block((1, 1, 1), (0, 0, 0)), block((1, 1, 1), (1.01, 0, 0))))) == 2
    assert len(up(regions(block((1, 1, 1), (0, 0, 0)), block((1, 1, 1.01), (1, 0, 0))))) == 2


def test_the_floor_under_a_block_is_gone_and_the_rest_of_it_is_whole():
    """The hole is the section of the block 1.5 mm above the floor, whether it stands on the floor or cuts it."""
    floor, stone = block((4, 4, 0.2), (0, 0, -0.1)), block((1, 0.5, 0.3), (0.2, 0.3, 0.15))
    ground = next(r for r in up(regions(floor, stone)) if r.outline.area > 1)
    assert ground.outline.area == pytest.approx(16 - 0.5, rel=1e-3)
    assert len(ground.outline.interiors) == 1

    tilted = block((1, 0.5, 0.3), (0.2, 0.3, 0.0), (0, 0.2, 0))
    ground = next(r for r in up(regions(floor, tilted)) if r.outline.area > 1)
    section = trimesh.Trimesh(*_indexed(tilted)).section([0, 0, 1], [0, 0, BURIED]).to_2D()[0].area
    assert ground.outline.area == pytest.approx(16 - section, rel=1e-4)


def _indexed(triangles):
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def test_the_floor_under_a_block_in_the_air_stays():
    found = up(regions(block((4, 4, 0.2), (0, 0, -0.1)), block((1, 1, 0.3), (0, 0, 1.0))))
    assert max(r.outline.area for r in found) == pytest.approx(16.0, rel=1e-4)


def test_a_block_modelled_three_times_or_with_a_missing_face_loses_no_floor_beside_it():
    floor, stone = block((4, 4, 0.2), (0, 0, -0.1)), block((1, 1, 0.3), (0, 0, 0.15))
    doubled = max(r.outline.area for r in up(regions(floor, stone, stone + 1e-7, stone[::-1])))
    assert doubled == pytest.approx(15.0, rel=1e-3)
    for missing in range(12):
        left = max(r.outline.area for r in up(regions(floor, np.delete(stone, missing, axis=0))))
        assert left == pytest.approx(15.0, rel=1e-3) or left == pytest.approx(16.0, rel=1e-3)


def test_a_box_in_a_box_does_not_bury_the_outer_faces_and_is_buried_itself():
    found = regions(block((1, 1, 1), (0, 0, 0)), block((0.5, 0.5, 0.5), (0, 0, 0)))
    assert sorted(r.outline.area for r in found) == pytest.approx([1.0] * 6, abs=1e-3)


def test_strips_that_nothing_fits_on_are_left_out():
    assert up(regions(block((1.0, 0.03, 0.2), (0, 0, 0)))) == []
    assert len(up(regions(block((1.0, 0.05, 0.2), (0, 0, 0))))) == 1


def test_faces_beyond_the_greatest_tilt_are_left_out():
    found = regions(block((1, 1, 1), (0, 0, 0), (np.deg2rad(44), 0, 0)), max_tilt=np.deg2rad(135))
    tilts = sorted(np.rad2deg(np.arccos(r.axes[2, 2])) for r in found)
    np.testing.assert_allclose(tilts, [44, 46, 90, 90, 134], atol=1e-6)


def test_a_floor_of_a_hundred_noisy_triangles_is_one_region():
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.linspace(0, 2, 8), np.linspace(0, 2, 8), indexing="ij")
    points = np.stack([x, y, rng.uniform(-2e-4, 2e-4, x.shape)], axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    quads = np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2).reshape(-1, 3, 3)
    found = regions(quads)
    assert len(found) == 1
    assert found[0].outline.area == pytest.approx(4.0, rel=1e-3)


def test_a_cylinder_has_a_round_top_and_sides_as_wide_as_its_facets():
    cylinder = trimesh.creation.cylinder(0.5, 1.0, sections=16)
    found = regions(cylinder.triangles)
    assert max(r.outline.area for r in up(found)) == pytest.approx(0.5 * 16 * 0.25 * np.sin(2 * np.pi / 16), rel=1e-3)
    sides = [r for r in found if abs(r.axes[2, 2]) < 1e-6]
    assert len(sides) == 16


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(3, 40), st.booleans())
def test_half_a_turn_is_told_as_by_the_sum_of_the_angles(seed: int, count: int, closed: bool) -> None:
    """Closed curves that cross themselves, some of them wound the other way, and what is left when segments are missing."""
    rng = np.random.default_rng(seed)
    curves = [rng.normal(size=(count, 2)) for _ in range(rng.integers(1, 4))]
    segments = np.concatenate([np.stack([c, np.roll(c, -1, axis=0)], axis=1) for c in curves])
    if not closed:
        segments = segments[rng.random(len(segments)) < 0.8]
    for point in rng.normal(size=(20, 2)):
        a, b = segments[:, 0] - point, segments[:, 1] - point
        turns = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)).sum() / (2 * np.pi)
        if abs(turns - 0.5) > 1e-9:
            assert _winds_round(point[None], segments) == (turns > 0.5)
    assert _winds_round(np.zeros((0, 2)), segments)
