"""Poses written as roll, pitch and yaw."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RollPitchYaw

from scenes.pose import pose_matrix, rotation_rpy, rpy_rotation

ANGLES = st.floats(-7.0, 7.0)


@given(ANGLES, ANGLES, ANGLES)
def test_roll_pitch_yaw_means_what_drake_means_by_it(roll, pitch, yaw):
    expected = RollPitchYaw(roll, pitch, yaw).ToRotationMatrix().matrix()
    np.testing.assert_allclose(rpy_rotation((roll, pitch, yaw)), expected, atol=1e-15)


@given(
    ANGLES, st.one_of(ANGLES, st.sampled_from([np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9, -np.pi / 2 + 1e-13])), ANGLES
)
def test_angles_read_off_a_rotation_give_it_back_even_where_yaw_is_free(roll, pitch, yaw):
    R = rpy_rotation((roll, pitch, yaw))
    np.testing.assert_allclose(rpy_rotation(rotation_rpy(R)), R, atol=2e-12)


def test_no_rotation_is_written_without_signed_zeros():
    assert str(rotation_rpy(np.eye(3)).tolist()) == "[0.0, 0.0, 0.0]"


def test_a_pose_turns_first_and_moves_then():
    X = pose_matrix((1.0, 2.0, 3.0), (0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(X @ [1, 0, 0, 1], [1.0, 3.0, 3.0, 1.0], atol=1e-15)
