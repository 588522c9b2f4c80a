"""Messages of ROS 2 that come back from YAML as they were meant."""

import numpy as np
import pytest
import yaml

from drakeplan.export import export_plan
from drakeplan.export.samples import sample_motion


def messages(plan, folder):
    export_plan(plan, "ros", folder / "plan.yaml")
    text = (folder / "plan.yaml").read_text(encoding="utf-8")
    assert "&id" not in text  # ROS knows no aliases
    return list(yaml.load_all(text, Loader=yaml.CSafeLoader))  # safe_load_all, faster


@pytest.fixture(scope="module")
def strolling(strolling_plan, tmp_path_factory):
    return messages(strolling_plan, tmp_path_factory.mktemp("ros"))


def test_joints_and_base_come_back(strolling_plan, strolling):
    joints, base = strolling
    samples = sample_motion(strolling_plan)
    assert joints["joint_names"] == list(samples.joint_names)
    assert base["joint_names"] == ["pelvis"]
    assert list(joints["points"][0]) == ["positions", "velocities", "accelerations", "effort", "time_from_start"]
    assert list(base["points"][0]) == ["transforms", "velocities", "accelerations", "time_from_start"]
    assert joints["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "world"} == base["header"]
    assert np.array_equal([p["positions"] for p in joints["points"]], samples.joint_position)
    assert np.array_equal([p["effort"] for p in joints["points"]], samples.joint_torque)
    for k, point in enumerate(base["points"]):
        pose = point["transforms"][0]
        assert [pose["translation"][i] for i in "xyz"] == samples.base_position[k].tolist()
        assert [pose["rotation"][i] for i in "wxyz"] == samples.base_quaternion[k].tolist()


def test_stamps_are_seconds_and_nanoseconds_since_the_first_point(strolling_plan, strolling):
    t = strolling_plan.motion.t
    for message in strolling:
        stamps = [p["time_from_start"] for p in message["points"]]
        assert all(0 <= s["nanosec"] < 10**9 for s in stamps)
        assert np.allclose([s["sec"] + 1e-9 * s["nanosec"] for s in stamps], t - t[0], atol=1e-9)


def test_accelerations_are_the_change_of_velocity_to_the_next_point(stepping_plan, tmp_path):
    joints, base = messages(stepping_plan, tmp_path)
    speed = np.array([p["velocities"] for p in joints["points"]])
    rate = np.array([p["accelerations"] for p in joints["points"]])
    assert np.allclose(speed[:-1] + 0.02 * rate[:-1], speed[1:], atol=1e-9)
    rise = np.array([p["velocities"][0]["linear"]["z"] for p in base["points"]])
    pull = np.array([p["accelerations"][0]["linear"]["z"] for p in base["points"]])
    assert np.allclose(rise[:-1] + 0.02 * pull[:-1], rise[1:], atol=1e-9)
    assert all(p["effort"] == [] for p in joints["points"])  # this plan has no torques
