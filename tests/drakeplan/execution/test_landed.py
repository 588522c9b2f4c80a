"""Supports and wrenches of patches that do not lie exactly where the plan has them."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drakeplan.execution.landed import landed_support, landed_wrench

HALF = np.array([0.11, 0.05])
WHOLE = HALF * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
CUT = np.array(
    [[0.11, 0.05], [-0.02, 0.05], [0.03, -0.05], [0.11, -0.05]]
)  # the terrain ends on a line behind the toes
offsets = st.tuples(st.floats(-0.01, 0.01), st.floats(-0.01, 0.01), st.floats(-0.1, 0.1))


def pose(x: float, y: float, yaw: float, z: float = 0.0) -> np.ndarray:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = Rotation.from_rotvec([0, 0, yaw]).as_matrix(), (x, y, z)
    return X


def test_a_whole_sole_keeps_its_corners_wherever_it_lies() -> None:
    assert np.array_equal(landed_support(WHOLE, HALF, pose(0.01, -0.01, 0.1)), WHOLE)


@settings(max_examples=60, deadline=None)
@given(offsets)
def test_what_touches_lies_on_the_patch_and_on_the_terrain(offset: tuple[float, float, float]) -> None:
    X_CE = pose(*offset)
    touching = landed_support(CUT, HALF, X_CE)
    assert (np.abs(touching) <= HALF + 1e-12).all()
    a, b = CUT[1], CUT[2]  # the terrain's edge, in C
    inward = np.array([-(b - a)[1], (b - a)[0]])
    on_terrain = touching @ X_CE[:2, :2].T + X_CE[:2, 3]
    assert ((on_terrain - a) @ inward >= -1e-12).all()
    assert shapely.LinearRing(touching).is_ccw


def test_a_sole_that_lies_forward_of_an_edge_has_more_of_it() -> None:
    back, as_planned, forward = (
        shapely.Polygon(landed_support(CUT, HALF, pose(x, 0, 0))).area for x in (-0.005, 0, 0.005)
    )
    assert as_planned == pytest.approx(shapely.Polygon(CUT).area)
    assert back == pytest.approx(as_planned - 0.005 * 0.1)  # the edge stays; a strip of the patch's width is lost
    assert forward == pytest.approx(as_planned)  # the toes gain what lay beyond the planned support only if it is known


def test_a_sole_far_from_its_terrain_keeps_the_planned_support() -> None:
    assert np.array_equal(landed_support(CUT, HALF, pose(-0.3, 0, 0)), CUT)


@settings(max_examples=60, deadline=None)
@given(offsets, st.integers(0, 99))
def test_a_landed_wrench_does_the_same_work(offset: tuple[float, float, float], seed: int) -> None:
    """Its power on any rigid motion is that of the planned wrench: F . v_P + M . w is the same about every point."""
    rng = np.random.default_rng(seed)
    wrench, w, v = rng.normal(size=6), rng.normal(size=3), rng.normal(size=3)
    X_CE = pose(*offset, z=0.002)
    R, p = X_CE[:3, :3], X_CE[:3, 3]
    landed = landed_wrench(wrench, X_CE)
    power = wrench[:3] @ w + wrench[3:] @ v
    assert landed[:3] @ (R.T @ w) + landed[3:] @ (R.T @ (v + np.cross(w, p))) == pytest.approx(power, abs=1e-12)
