"""G1 and Talos from example-robot-data: they stand, their figures are those of their models, and nothing is ignored by hand."""

from __future__ import annotations

import importlib.metadata

import numpy as np
import pytest
import yaml

from optimization.inverse_kinematics.robot_reach import _limb_root
from scenes.effector import LEFT_FOOT, LEFT_PALM
from scenes.input_error import InputError
from scenes.robots.nominal_distances import nominal_distances
from scenes.robots.nominal_stance import check_nominal_stance
from scenes.robots.plant import build_plant, nominal_posture
from scenes.robots.robot import load_robot, robot_names, robot_path

NAMES = ("g1", "talos")
NEAR = 0.015  # [m] of points that the description rounds or that stand for joints whose axes do not meet
NO_PAIR_BELOW = 0.005  # [m] nearer bodies are taken to touch by design


def installed() -> bool:
    try:
        importlib.metadata.distribution("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


needs_package = pytest.mark.skipif(not installed(), reason="pip install 'drakeplan[robots]'")


@pytest.fixture(scope="module", params=NAMES)
def robot(request):
    return load_robot(request.param)


@pytest.mark.parametrize("name", NAMES)
def test_they_ship_with_few_keys_and_no_pair_ignored_by_hand(name):
    data = yaml.safe_load(robot_path(name).read_text())
    assert name in robot_names()
    assert len(data) <= 20
    assert "ignored_pairs" not in data["package"]


@pytest.mark.parametrize("name", NAMES)
def test_without_the_package_one_line_says_what_to_install(name, monkeypatch):
    def missing(distribution):
        raise importlib.metadata.PackageNotFoundError(distribution)

    monkeypatch.setattr(importlib.metadata, "distribution", missing)
    with pytest.raises(
        InputError, match=r"example-robot-data is not installed: pip install 'drakeplan\[robots\]'"
    ) as caught:
        load_robot(robot_path(name))
    assert "\n" not in str(caught.value)


@needs_package
def test_they_stand_on_level_soles_below_their_centre_of_mass(robot):
    check_nominal_stance(robot)
    robot_plant, q = build_plant(robot), nominal_posture(robot)
    context = robot_plant.plant.CreateDefaultContext()
    robot_plant.plant.SetPositions(context, q)
    for body in robot_plant.effector_bodies[:2]:
        X_WE = robot_plant.plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4()
        np.testing.assert_allclose(X_WE[:3, :3], np.eye(3), atol=1e-3)
        assert abs(X_WE[2, 3]) < 1e-6
    com = robot_plant.plant.CalcCenterOfMassPositionInWorld(context)
    assert np.abs(com[:2]).max() < 0.03
    assert com[2] == pytest.approx(robot.com_height[1], abs=0.003)


@needs_package
def test_shoulder_and_hip_are_where_the_model_has_them(robot):
    robot_plant = build_plant(robot)
    np.testing.assert_allclose(_limb_root(robot_plant, LEFT_FOOT)[0], robot.hip, atol=NEAR)
    np.testing.assert_allclose(_limb_root(robot_plant, LEFT_PALM)[0], robot.shoulder, atol=NEAR)


@needs_package
def test_what_is_built_closely_keeps_less_than_others_but_no_less_than_half_a_centimetre(robot):
    distances = nominal_distances(robot)
    assert min(distances.distance.values()) >= NO_PAIR_BELOW
    close = [pair for pair, d in distances.distance.items() if d < 0.02]
    assert close  # each has such pairs, which could never keep two centimetres
    assert all(distances.limit(pair) < distances.distance[pair] for pair in close)
