"""Parts of polygons and angles between frames."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RollPitchYaw, RotationMatrix
from scipy.spatial import ConvexHull

from drakeplan.verifier.geometry import angle_between, clip


@given(seed=st.integers(0, 10_000))
def test_clipping_finds_the_highest_point_over_a_patch(seed: int) -> None:
    """Against the twin that looks at many points of the polygon."""
    rng = np.random.default_rng(seed)
    outline = rng.uniform(-1, 1, (12, 2))
    outline = outline[ConvexHull(outline).vertices]
    slope, height = rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.3, 0.8)
    polygon = np.column_stack([outline, outline @ slope + height])
    low, high = np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.5])
    clipped = clip(polygon, low, high)
    grid = np.stack(np.meshgrid(*(np.linspace(low[k], high[k], 121) for k in range(2))), axis=-1).reshape(-1, 2)
    hull = ConvexHull(outline)
    inside = (grid @ hull.equations[:, :2].T + hull.equations[:, 2] < 0).all(axis=1)
    z = grid[inside] @ slope + height
    z = z[(z >= 0) & (z <= 0.5)]
    step = 0.01  # [m] what the grid may miss: its spacing times the slope, and slivers between its points
    if len(z) > 30:
        assert z.max() - 1e-9 <= clipped[:, 2].max() <= z.max() + step
    if not len(clipped):
        assert not len(z)
    if len(clipped):
        assert (clipped >= low - 1e-12).all()
        assert (clipped <= high + 1e-12).all()


@given(st.floats(0.0, 3.0))
def test_the_angle_between_two_frames_is_the_angle_one_was_turned_by(angle: float) -> None:
    R = RotationMatrix(RollPitchYaw(0.3, -0.2, 1.0)).matrix()
    turned = R @ RotationMatrix.MakeXRotation(angle).matrix()
    assert angle_between(turned[None], R)[0] == pytest.approx(angle, abs=1e-7)
