"""Meshes of noisy height maps: planes within a tolerance, treads, hills, holes; exact meshes stay as they are."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from scenes.meshes.mesh_import import surfaces_of_mesh
from scenes.meshes.mesh_orientation import Bodies
from scenes.meshes.rough_ground import TOLERANCE, RoughGround, fit_rough_ground
from scenes.terrain.polygon import area_vectors
from scenes.terrain.surface import PALM_TILT

CELL = 0.02  # [m]
X, Y = np.meshgrid(CELL * np.arange(75), CELL * np.arange(50))  # 1.5 x 1 m


def map_mesh(height: np.ndarray) -> np.ndarray:
    """(K, 3, 3) two triangles a cell; none where a corner is not known."""
    points = np.stack([X, Y, height], axis=-1)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    triangles = np.concatenate([np.stack([a, b, c], axis=-2), np.stack([a, c, d], axis=-2)]).reshape(-1, 3, 3)
    return triangles[np.isfinite(triangles).all(axis=(1, 2))]


def noise(deviation: float, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, deviation, X.shape)


def fit(height: np.ndarray) -> RoughGround:
    ground = fit_rough_ground(Bodies(map_mesh(height)), min_width=0.04, max_tilt=PALM_TILT[1])
    assert ground is not None
    return ground


@pytest.mark.parametrize("deviation", [0.001, 0.003, 0.01])
@pytest.mark.parametrize("slope", [0.0, 0.2])
def test_level_and_sloping_ground_with_noise_is_one_plane_close_to_the_true_one(deviation: float, slope: float) -> None:
    ground = fit(slope * X + noise(deviation))
    (region,) = ground.regions
    assert region.outline.area == pytest.approx(74 * 49 * CELL**2 * np.hypot(1, slope), rel=0.06)
    true = np.array([-slope, 0.0, 1.0]) / np.hypot(1, slope)
    # Slope of a line through n points with noise s over a length L: deviation s sqrt(12 / n) / L.
    assert np.arccos(min(region.axes[2] @ true, 1.0)) < 4 * deviation * np.sqrt(12 / X.size)
    assert ground.rms == pytest.approx(deviation / np.hypot(1, slope), rel=0.05)
    assert ground.greatest <= 2 * ground.tolerance


def test_the_flattened_mesh_lies_in_the_planes_of_its_regions() -> None:
    ground = fit(noise(0.005))
    (region,) = ground.regions
    off = (ground.body.reshape(-1, 3) - region.origin) @ region.axes[2]
    assert np.abs(off).max() < 1e-9
    doubled = area_vectors(ground.body)
    assert (doubled @ region.axes[2]).min() > 0
    assert np.linalg.norm(doubled, axis=1).sum() / 2 == pytest.approx(74 * 49 * CELL**2, rel=0.01)
    assert len(ground.body) < 2 * (75 + 50) * 1.1  # a triangle for each corner of the rim


@pytest.mark.parametrize("wavelength", [0.25, 0.5, 1.0])
def test_waves_of_five_millimetres_are_one_plane(wavelength: float) -> None:
    ground = fit(0.005 * np.sin(2 * np.pi * X / wavelength))
    assert len(ground.regions) == 1
    assert ground.fitted == pytest.approx(1.0)
    assert ground.greatest <= 0.01


@pytest.mark.parametrize("deviation", [0.001, 0.005, 0.01])
def test_stairs_come_out_as_treads_and_their_risers_as_nothing(deviation: float) -> None:
    tread = np.floor(X / 0.3 + 1e-9)
    ground = fit(0.15 * tread + noise(deviation, 3))
    level = sorted(ground.regions, key=lambda region: region.origin[2])
    np.testing.assert_allclose([r.origin[2] for r in level], 0.15 * np.arange(5), atol=0.003)
    for region in level:
        assert region.axes[2, 2] > np.cos(np.deg2rad(1.0))
        around = shapely.get_coordinates(region.outline.minimum_rotated_rectangle)
        edges = np.linalg.norm(np.diff(around, axis=0), axis=1)
        assert 0.25 <= edges.min() <= 0.29  # of a tread of 15 vertices, 0.28 m


def test_smooth_hills_become_patches_that_a_sole_stands_on_and_that_stay_within_the_tolerance() -> None:
    height = 0.06 * np.sin(2 * np.pi * X / 3) * np.cos(2 * np.pi * Y / 3)
    ground = fit(height)
    assert ground.greatest <= 2 * ground.tolerance
    assert ground.tolerance == TOLERANCE[0]
    assert ground.fitted > 0.8
    soles = [r for r in ground.regions if not r.outline.buffer(-0.12).is_empty]
    assert sum(r.outline.area for r in soles) > 0.6 * 1.5


def test_unknown_cells_are_holes() -> None:
    height = noise(0.003)
    unknown = np.hypot(X - 0.75, Y - 0.5) < 0.2
    height[unknown] = np.nan
    (region,) = fit(height).regions
    centre = (np.array([0.75, 0.5, 0.0]) - region.origin) @ region.axes[:2].T
    assert not region.outline.intersects(shapely.Point(centre).buffer(0.18))
    assert (
        region.outline.area > 1.48 * 0.98 - np.pi * 0.24**2 - 0.06
    )  # the rim of an outline with steps is drawn in by half a cell


def test_a_block_on_a_noisy_floor_stays_a_block() -> None:
    """Its top is a plane of its own and what it covers is none of the floor's."""
    block = (np.abs(X - 0.75) < 0.2) & (np.abs(Y - 0.5) < 0.2)
    ground = fit(0.2 * block + noise(0.002))
    floor, top = sorted(ground.regions, key=lambda region: region.origin[2])
    assert top.origin[2] == pytest.approx(0.2, abs=0.002)
    assert top.outline.area == pytest.approx(0.38**2, rel=0.1)
    assert floor.outline.area == pytest.approx(1.48 * 0.98 - 0.42**2, rel=0.1)


@pytest.mark.parametrize(
    "height", [0.0 * X, 0.1 * X, 0.15 * np.floor(X / 0.3 + 1e-9)], ids=["level", "slope", "stairs"]
)
def test_exact_maps_are_not_rough(height: np.ndarray) -> None:
    triangles = map_mesh(height).astype(np.float32).astype(float)  # as an STL file holds them
    assert fit_rough_ground(Bodies(triangles), min_width=0.04, max_tilt=PALM_TILT[1]) is None


def test_rubble_that_no_plane_fits_is_left_alone() -> None:
    assert fit_rough_ground(Bodies(map_mesh(noise(0.15))), min_width=0.04, max_tilt=PALM_TILT[1]) is None


def test_the_note_names_tolerance_share_and_how_far_the_mesh_was_moved() -> None:
    triangles, surfaces, (note,) = surfaces_of_mesh(Bodies(map_mesh(noise(0.003))), "map", 0.6)
    assert "planes were fitted within 11 mm, they hold 100% of it" in note
    assert "3 mm RMS" in note
    assert len(surfaces) == 1
    assert surfaces[0].friction == 0.6
    assert np.ptp(triangles[..., 2]) < 0.01
