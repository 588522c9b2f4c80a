"""Velocities from positions."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RollPitchYaw, RotationMatrix

from drakeplan.verifier.motion import _difference


@given(st.integers(0, 10_000))
def test_a_steady_turn_has_that_angular_velocity(seed: int) -> None:
    rng = np.random.default_rng(seed)
    w_WB, dt = rng.uniform(-3, 3, 3), 0.02
    q = np.zeros((2, 7))
    R = RotationMatrix(RollPitchYaw(rng.uniform(-1, 1, 3)))
    angle = np.linalg.norm(w_WB) * dt
    K = np.cross(np.eye(3), w_WB * dt / angle)  # Rodrigues: R1 = exp(w dt) R0
    turned = RotationMatrix(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K) @ R
    q[0, :4], q[1, :4] = R.ToQuaternion().wxyz(), turned.ToQuaternion().wxyz()
    if q[0, :4] @ q[1, :4] < 0:
        q[1, :4] *= -1
    q[1, 4:] = [0.02, 0.04, 0.06]
    found = _difference(np.array([0.0, dt]), q)[0]
    np.testing.assert_allclose(found, [*w_WB, 1.0, 2.0, 3.0], atol=1e-9)
