"""Headings at start and goal."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RollPitchYaw, RotationMatrix

from drakeplan.verifier.ends import _feet, _wrap
from drakeplan.verifier.plan_file import PlanFile


@given(st.floats(-3.0, 3.0), st.floats(-0.7, 0.7), st.floats(-0.7, 0.7))
def test_a_heading_is_read_back_from_feet_on_tilted_ground(yaw: float, roll: float, pitch: float) -> None:
    normal = RotationMatrix(RollPitchYaw(roll, pitch, 0.0)).matrix()[:, 2]
    forward = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    x = forward - (forward @ normal) * normal
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3] = np.column_stack([x, np.cross(normal, x), normal])
    plan = PlanFile(Path(), {}, 1.0, {"contacts/X_WC": np.stack([X, X])}, {}, {})
    _, heading = _feet(plan, np.array([0, 1, -1, -1]))
    assert abs(_wrap(heading - yaw)) < 1e-9
