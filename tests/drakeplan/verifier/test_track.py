"""Momenta and joint torques of the model, against closed forms and differences."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from drakeplan.verifier import UnreadablePlan, verify
from drakeplan.verifier.plan_file import PlanFile, read_plan
from drakeplan.verifier.robot import RobotModel
from drakeplan.verifier.track import follow

FRAMES = 6


@pytest.fixture(scope="module")
def standing(good: Path) -> PlanFile:
    """The first posture, held for a few frames; the forces are those of the plan's first knot."""
    plan = read_plan(good)
    q, v = np.tile(plan["motion/q"][0], (FRAMES, 1)), np.zeros((FRAMES, plan["motion/v"].shape[1]))
    return dataclasses.replace(
        plan, data=plan.data | {"motion/t": 0.02 * np.arange(FRAMES), "motion/q": q, "motion/v": v}
    )


@pytest.fixture(scope="module")
def robot(standing: PlanFile) -> RobotModel:
    return RobotModel(Path(standing.attributes["robot_model"]))


def test_a_robot_that_drifts_as_a_rigid_body_has_its_mass_times_velocity_and_no_spin(
    standing: PlanFile, robot: RobotModel
) -> None:
    v_WB = np.array([0.3, -0.2, 0.1])
    v = standing["motion/v"].copy()
    v[:, 3:6] = v_WB
    track = follow(robot, dataclasses.replace(standing, data=standing.data | {"motion/v": v}), [])
    np.testing.assert_allclose(track.linear, np.tile(robot.mass * v_WB, (FRAMES, 1)), atol=1e-9)
    np.testing.assert_allclose(track.angular, 0.0, atol=1e-9)


def test_linear_momentum_is_mass_times_the_rate_of_the_centre_of_mass(good: Path, robot: RobotModel) -> None:
    """Central differences; what is left is the third derivative of the CoM's course, which has corners."""
    plan = read_plan(good)
    track, t = follow(robot, plan, []), plan["motion/t"]
    rate = (track.com[2:] - track.com[:-2]) / (t[2:] - t[:-2])[:, None]
    gap = np.linalg.norm(robot.mass * rate - track.linear[1:-1], axis=1)
    assert np.median(gap) < 0.01
    assert np.linalg.norm(track.linear, axis=1).max() > 1.0


def test_torques_at_rest_hold_the_weight_less_the_work_of_the_contacts(standing: PlanFile, robot: RobotModel) -> None:
    """Virtual work: tau_j = d/dq_j (M g z_com - sum of F . p + turn), with the contacts' points fixed to their bodies."""
    plant, context = robot.plant, robot.plant_context
    held, force = standing["centroidal/contact"][0], standing["centroidal/force_W"][0]
    q0 = standing["motion/q"][0]
    plant.SetPositions(context, q0)
    points = {}
    for e in np.flatnonzero(held >= 0):
        X_WC = standing["contacts/X_WC"][held[e]]
        p_cop = X_WC[:3, 3] + X_WC[:3, :2] @ standing["centroidal/cop_C"][0, e]
        body = robot.frames[e].body()
        points[e] = body, plant.EvalBodyPoseInWorld(context, body).inverse() @ p_cop
        assert abs(standing["centroidal/torque_n"][0, e]) < 1e-6, "this twin leaves the torques about normals out"

    def energy(q: np.ndarray) -> float:
        plant.SetPositions(context, q)
        work = sum(force[e] @ (plant.EvalBodyPoseInWorld(context, body) @ p_BP) for e, (body, p_BP) in points.items())
        return robot.mass * 9.81 * plant.CalcCenterOfMassPositionInWorld(context)[2] - work

    step = 1e-5  # [rad]
    expected = []
    for velocity in robot.actuated:
        change = step * np.eye(len(q0))[velocity + 1]
        expected.append((energy(q0 + change) - energy(q0 - change)) / (2 * step))
    torque = follow(robot, standing, []).torque
    np.testing.assert_allclose(torque, np.tile(expected, (FRAMES - 1, 1)), atol=1e-3)
    assert np.abs(expected).max() > 10.0


def test_a_torque_about_the_normal_of_a_level_sole_is_taken_by_that_legs_yaw(
    standing: PlanFile, robot: RobotModel
) -> None:
    """Only joints about the vertical feel it, and the other leg does not."""
    more = standing["centroidal/torque_n"].copy()
    more[:, 0] += 5.0  # [N m] on the left foot
    turned = dataclasses.replace(standing, data=standing.data | {"centroidal/torque_n": more})
    change = (follow(robot, turned, []).torque - follow(robot, standing, []).torque)[0]
    hip = robot.actuator_names.index("left_hip_yaw")
    assert change[hip] == pytest.approx(-5.0, abs=0.05)
    assert np.abs(change[[i for i, name in enumerate(robot.actuator_names) if "right" in name]]).max() < 1e-9


def test_a_faster_joint_takes_torque_for_its_inertia_and_damping(standing: PlanFile, robot: RobotModel) -> None:
    """tau grows by damping times speed where a joint turns steadily about an axis that nothing swings around."""
    v, joint = standing["motion/v"].copy(), robot.actuator_names.index("right_wrist_roll")
    v[:, robot.actuated[joint]] = 2.0
    moving = dataclasses.replace(standing, data=standing.data | {"motion/v": v})
    steady = follow(robot, moving, []).torque[0, joint] - follow(robot, standing, []).torque[0, joint]
    assert steady == pytest.approx(0.1 * 2.0, abs=0.02)  # escher's damping [N m s/rad]


@pytest.fixture(scope="module")
def with_torques(good: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plan that holds, with the torques that its model needs."""
    path = tmp_path_factory.mktemp("torques") / "good.h5"
    shutil.copy(good, path)
    plan = read_plan(good)
    model = RobotModel(Path(plan.attributes["robot_model"]))
    torque = follow(model, plan, []).torque
    with h5py.File(path, "r+") as file:
        file["motion/tau"] = np.vstack([torque, torque[-1:]])
        file["motion"].attrs["actuator_names"] = model.actuator_names
    return path


def test_torques_in_the_file_are_those_of_the_model(good: Path, with_torques: Path, tmp_path: Path) -> None:
    assert verify(with_torques).check("stored torques").ok
    assert verify(good).check("stored torques").where == "the file has none"
    for row in (3, -1):
        path = tmp_path / f"{row}.h5"
        shutil.copy(with_torques, path)
        with h5py.File(path, "r+") as file:
            file["motion/tau"][row, 4] += 1e-3
        report = verify(path)
        assert report.failed == ("stored torques",)
        assert report.check("stored torques").worst == pytest.approx(1e-3)


def test_torques_of_other_actuators_cannot_be_read(with_torques: Path, tmp_path: Path) -> None:
    def names(file: h5py.File) -> None:
        file["motion"].attrs["actuator_names"] = list(file["motion"].attrs["actuator_names"])[::-1]

    def width(file: h5py.File) -> None:
        tau = file["motion/tau"][:, 1:]
        del file["motion/tau"]
        file["motion/tau"] = tau

    for number, (damage, said) in enumerate(((names, "actuator names"), (width, "actuators"))):
        path = tmp_path / f"{number}.h5"
        shutil.copy(with_torques, path)
        with h5py.File(path, "r+") as file:
            damage(file)
        with pytest.raises(UnreadablePlan, match=said):
            verify(path)
