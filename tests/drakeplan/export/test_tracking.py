"""Reference motions: the layout of retargeted LAFAN1 motions, resampled on the great circle."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drakeplan.export.samples import sample_motion
from drakeplan.export.tracking import tracking_rows

PRINTED = 1e-8  # nine digits of numbers up to ten


@pytest.mark.parametrize("rate", [30, 50])
def test_rows_are_position_quaternion_with_w_last_and_joints(stepping_plan, write, tmp_path, rate):
    write(stepping_plan, "tracking", "motion.csv", rate=rate)
    rows = np.loadtxt(tmp_path / "motion.csv", delimiter=",")
    about = json.loads((tmp_path / "motion.csv.json").read_text(encoding="utf-8"))
    samples = sample_motion(stepping_plan)
    assert (
        rows.shape
        == (int(9.8 * rate + 1e-9) + 1, 7 + len(samples.joint_names))
        == (about["rows"], len(about["columns"]))
    )
    assert about["rate"] == rate
    assert about["robot"] == "escher"
    assert about["joint_names"] == list(samples.joint_names)
    for second in range(10):  # whole seconds are samples of the plan
        k = int(np.argmin(np.abs(samples.t - second)))
        row = rows[second * rate]
        assert np.allclose(row[:3], samples.base_position[k], atol=PRINTED)
        assert np.allclose(row[3:7], samples.base_quaternion[k, [1, 2, 3, 0]], atol=PRINTED)
        assert np.allclose(row[7:], samples.joint_position[k], atol=PRINTED)


@given(st.integers(1, 240), st.floats(-3.0, 3.0), st.integers(2, 9), st.floats(0.05, 1.0))
def test_a_base_that_turns_steadily_turns_steadily_between_samples(stepping_plan, rate, speed, count, step):
    """Closed form: the angle is speed times time at every row, whatever the rate."""
    t = step * np.arange(count)
    axis = np.array([1.0, -2.0, 0.5]) / np.linalg.norm([1.0, -2.0, 0.5])
    xyzw = Rotation.from_rotvec(np.outer(speed * t, axis)).as_quat()
    xyzw[1::2] *= -1.0  # the same rotations
    rows = tracking_rows(turning(stepping_plan, t, xyzw[:, [3, 0, 1, 2]]), rate)
    instants = np.arange(len(rows)) / rate
    assert instants[-1] <= t[-1] + 1e-9 < instants[-1] + 1.0 / rate + 2e-9
    expected = Rotation.from_rotvec(np.outer(speed * np.minimum(instants, t[-1]), axis))
    assert (expected.inv() * Rotation.from_quat(rows[:, 3:7])).magnitude().max() < 1e-7
    assert ((rows[1:, 3:7] * rows[:-1, 3:7]).sum(axis=1) > -1e-9).all()  # the sign is continuous
    assert np.allclose(rows[:, 0], 2.0 * np.minimum(instants, t[-1]), atol=1e-9)
    assert np.allclose(rows[:, 7], rows[:, 0], atol=1e-9)


def test_a_motion_of_one_sample_is_one_row(stepping_plan):
    rows = tracking_rows(turning(stepping_plan, np.array([0.7]), np.array([[2.0, 0.0, 0.0, 0.0]])), 30)
    assert rows.tolist() == [[1.4, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.4]]


def turning(plan, t, wxyz):
    """Samples of a base that turns as given and goes along x at 2 m/s, as does the position of its one joint."""
    position = np.zeros((len(t), 3))
    position[:, 0] = 2.0 * t
    return replace(
        sample_motion(plan),
        t=t,
        base_position=position,
        base_quaternion=wxyz,
        joint_names=("joint",),
        joint_position=position[:, :1],
    )
