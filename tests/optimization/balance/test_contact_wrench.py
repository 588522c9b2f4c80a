"""Corner forces: their wrenches, their cones, and the derivatives of centre of pressure and torque."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from optimization.balance.contact_wrench import CornerForces, cross, pressure_residuals, skew
from optimization.balance.friction import CONES, contains
from scenes.contact import patch_corners

HALF = np.array([[0.11, 0.05], [0.06, 0.07]])
FRICTION = np.array([0.5, 0.8])
ARM = 0.05
INSIDE = 1e-12  # rounding of forces of order one


def test_skew_is_the_cross_product():
    a, b = np.random.default_rng(0).normal(size=(2, 5, 3))
    assert np.allclose(np.einsum("nab,nb->na", skew(a), b), np.cross(a, b))


def test_a_wrench_is_the_sum_of_four_forces_at_the_corners():
    forces = np.random.default_rng(1).normal(size=(2, 4, 3))
    wrench = CornerForces("inner", FRICTION, patch_corners(HALF), ARM).wrench(forces)
    for j, (hx, hy) in enumerate(HALF):
        corners = np.array([[hx, hy, 0], [-hx, hy, 0], [-hx, -hy, 0], [hx, -hy, 0]])
        assert np.allclose(wrench[j, :3], forces[j].sum(axis=0))
        assert np.allclose(ARM * wrench[j, 3:], np.cross(corners, forces[j]).sum(axis=0))


@pytest.mark.parametrize("cone", CONES)
@given(forces=arrays(float, (2, 4, 3), elements=st.floats(-2, 2)))
def test_projection_leads_into_the_cone_along_the_tangent_and_leaves_what_is_inside(cone, forces):
    corners = CornerForces(cone, FRICTION, patch_corners(HALF), ARM)
    projected = corners.project(forces)
    assert contains(cone, FRICTION[:, None], projected, INSIDE).all()
    assert np.array_equal(projected[..., 2], np.maximum(forces[..., 2], 0))
    inside = contains(cone, FRICTION[:, None], forces, 0.0)
    assert np.allclose(projected[inside], forces[inside], rtol=0, atol=1e-9)
    turned = projected[..., 0] * forces[..., 1] - projected[..., 1] * forces[..., 0]
    assert np.allclose(turned, 0, atol=1e-9)


def test_pressure_residuals_are_the_pressure_centre_over_the_lengths_and_the_torque_there():
    rng = np.random.default_rng(2)
    cop, torque, force = rng.uniform(-0.05, 0.05, (2, 2)), rng.normal(size=2), rng.normal(size=(2, 3))
    force[:, 2] = rng.uniform(0.2, 1.0, 2)
    moment = np.cross(np.concatenate([cop, np.zeros((2, 1))], axis=1), force) + torque[:, None] * [0, 0, 1]
    z, _ = pressure_residuals(np.concatenate([force, moment / ARM], axis=1), HALF, ARM, 0.01)
    assert np.allclose(z[:, :2], cop / (2 * HALF))
    assert np.allclose(ARM * z[:, 2], torque)


@pytest.mark.parametrize("load", [0.5, 0.004])
def test_the_jacobian_of_the_residuals_is_that_of_central_differences(load):
    rng = np.random.default_rng(3)
    wrench = rng.normal(size=(2, 6)) * 0.1
    wrench[:, 2] = load
    _, jacobian = pressure_residuals(wrench, HALF, ARM, 0.01)
    step = 1e-6
    for i in range(6):
        shift = step * np.eye(6)[i]
        ahead, behind = (pressure_residuals(wrench + s * shift, HALF, ARM, 0.01)[0] for s in (1, -1))
        assert np.allclose(jacobian[:, :, i], (ahead - behind) / (2 * step), atol=1e-6)


def test_cross_products_are_those_of_numpy():
    a, b = np.random.default_rng(0).normal(size=(2, 7, 3))
    assert np.allclose(cross(a, b), np.cross(a, b), atol=1e-15)
    assert cross(a[:0], b[:0]).shape == (0, 3)
