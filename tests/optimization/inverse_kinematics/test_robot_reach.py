"""What robot files say of reaches is what their models can do."""

import importlib.metadata

import numpy as np
import pytest

from optimization.inverse_kinematics.robot_reach import measure_reach
from scenes.robots.plant import build_plant
from scenes.robots.robot import load_robot

ROUNDED = 2e-3  # [m] figures in the files are rounded to millimetres


def measured(name):
    if name == "jvrc1":
        try:
            importlib.metadata.distribution("jvrc-description")
        except importlib.metadata.PackageNotFoundError:
            pytest.skip("jvrc-description is not installed: pip install 'drakeplan[robots]'")
    robot = load_robot(name)
    return robot, measure_reach(build_plant(robot))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["escher", "jvrc1"])
def test_the_file_promises_what_the_model_can_do(name):
    robot, figures = measured(name)
    np.testing.assert_allclose(robot.shoulder, figures.shoulder, atol=ROUNDED)
    np.testing.assert_allclose(robot.hip, figures.hip, atol=ROUNDED)
    for promised, found in ((robot.arm_reach, figures.arm_reach), (robot.leg_reach, figures.leg_reach)):
        assert found[0] <= promised[0]
        assert found[1] - 0.02 <= promised[1] <= found[1] + ROUNDED
    assert figures.com_height[0] <= robot.com_height[0]
    assert robot.com_height[1] == pytest.approx(figures.com_height[1], abs=ROUNDED)
    assert robot.com_height[2] <= figures.com_height[2]
    for promised, found in zip(robot.com_reach[[0, 2]], figures.com_reach, strict=True):
        assert found - 0.08 <= promised <= found + ROUNDED
    assert figures.foot_separation <= robot.foot_separation[0] <= robot.foot_separation[1]


@pytest.mark.slow
def test_an_arm_reaches_as_far_as_its_links_are_long():
    _, figures = measured("escher")
    bend = 0.03  # [rad] the elbow's limit
    upper_arm, below = 0.30, 0.27 + 0.11
    straight = np.sqrt(upper_arm**2 + below**2 + 2 * upper_arm * below * np.cos(bend))
    assert figures.arm_reach[1] == pytest.approx(straight, abs=1e-4)


@pytest.mark.slow
def test_a_leg_reaches_as_far_as_its_links_are_long():
    _, figures = measured("escher")
    bend = 0.03  # [rad] the knee's limit
    thigh_and_shin = np.sqrt(0.4**2 + 0.4**2 + 2 * 0.4**2 * np.cos(bend))
    assert figures.leg_reach[1] == pytest.approx(thigh_and_shin + np.hypot(0.09, 0.035), abs=1e-4)
