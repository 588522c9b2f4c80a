"""Robot files: what they say is what one gets, and what is wrong in them is said in one line."""

import hashlib

import numpy as np
import pytest
import yaml

from scenes.input_error import InputError
from scenes.robots.plant import nominal_posture
from scenes.robots.robot import ROBOTS, load_robot, robot_names


@pytest.fixture
def robot_file(tmp_path):
    """Writes escher's file with changes (dotted key -> value, ... deletes) and returns its path."""

    def write(changes):
        data = yaml.safe_load((ROBOTS / "escher" / "escher.yaml").read_text())
        data["model"] = str(ROBOTS / "escher" / "escher.urdf")
        for key, value in changes.items():
            *parents, last = key.split(".")
            place = data
            for parent in parents:
                place = place[parent]
            if value is ...:
                del place[last]
            else:
                place[last] = value
        path = tmp_path / "mine.yaml"
        path.write_text(yaml.safe_dump(data))
        return path

    return write


def test_a_robot_file_by_path_describes_the_same_robot(robot_file):
    mine, escher = load_robot(robot_file({"name": "mine"})), load_robot("escher")
    assert mine.name == "mine"
    assert mine.model == escher.model
    np.testing.assert_array_equal(nominal_posture(mine), nominal_posture(escher))


def test_the_hash_is_that_of_the_model_file():
    robot = load_robot("escher")
    assert robot.model.is_absolute()
    assert robot.model_sha256 == hashlib.sha256(robot.model.read_bytes()).hexdigest()


def test_every_shipped_robot_is_named():
    assert {"escher", "jvrc1"} <= set(robot_names())


def test_an_unknown_robot_comes_with_the_nearest_name():
    with pytest.raises(InputError, match=r"unknown robot 'esher'.*escher"):
        load_robot("esher")


def test_arrays_of_a_robot_cannot_be_written():
    robot = load_robot("escher")
    for array in (robot.shoulder, nominal_posture(robot), robot.force_limit):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "drakeplan-scene"}, "format"),
        ({"shouldr": [0, 0, 0]}, "shouldr"),
        ({"hip": ...}, "hip"),
        ({"arm_reach": [0.7, 0.2]}, "arm_reach.*decrease"),
        ({"leg_reach": [float("nan"), 1.0]}, "leg_reach"),
        ({"max_step_height": -0.1}, "max_step_height"),
        ({"effectors.left_foot.half_extent": [0.1, 0.0]}, "effectors.left_foot.half_extent"),
        ({"effectors.left_foot": ...}, "effectors.*left_foot"),
        ({"shoulder": ...}, "shoulder: expected it for a robot with palms"),
        ({"model": "nowhere.urdf"}, "model.*nowhere.urdf"),
        ({"model": ...}, "either model"),
        ({"nominal.left_knee": "bent"}, "nominal.left_knee"),
        ({"nominal.third_knee": 0.1}, "nominal.*'third_knee'"),
        ({"base_body": "hips"}, "base_body.*'hips'"),
        ({"effectors.left_palm.frame": "left_paw"}, "effectors.left_palm.frame.*'left_paw'"),
    ],
)
def test_what_is_wrong_is_named(robot_file, changes, message):
    with pytest.raises(InputError, match=message) as error:
        load_robot(robot_file(changes))
    assert "mine.yaml" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_key_given_twice_is_an_error(tmp_path):
    path = tmp_path / "twice.yaml"
    path.write_text((ROBOTS / "escher" / "escher.yaml").read_text() + "\nhip: [0.0, 0.1, 0.9]\n")
    with pytest.raises(InputError, match="twice"):
        load_robot(path)


def test_a_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match=r"none\.yaml"):
        load_robot(tmp_path / "none.yaml")
