"""A contact that is changed by hand is verified as it is then; a plan in memory is verified as its file would be."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from drakeplan.plan.plan import CHANGED, Plan
from drakeplan.plan.plan_file import read_plan, write_plan
from drakeplan.plan.verified import verify
from scenes.input_error import InputError
from scenes.robots.robot import load_robot

LEFT_STEP = 3  # the contact that the left foot makes at its first step


def moved(plan: Plan, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Plan:
    X_WC = plan.contacts.X_WC[LEFT_STEP].copy()
    X_WC[:3, 3] += [x, y, z]
    return plan.with_contact(LEFT_STEP, X_WC)


def test_a_contact_moved_by_nothing_is_accepted(stepping_plan: Plan) -> None:
    same = moved(stepping_plan)
    assert verify(same).holds
    np.testing.assert_array_equal(same.contacts.X_WC, stepping_plan.contacts.X_WC)
    assert same.provenance[CHANGED] == [LEFT_STEP]


def test_a_contact_moved_off_the_terrain_is_refuted(stepping_plan: Plan) -> None:
    failed = verify(moved(stepping_plan, z=0.05)).failed
    assert {"contact on surface", "support on terrain"} <= set(failed)
    assert "support on terrain" in verify(moved(stepping_plan, x=30.0)).failed


def test_a_contact_moved_on_the_ground_is_refuted_because_the_motion_is_not_remade(stepping_plan: Plan) -> None:
    failed = verify(moved(stepping_plan, x=0.1)).failed
    assert "held contacts stay" in failed
    assert "contact on surface" not in failed


def test_more_friction_than_the_scene_has_is_refuted(stepping_plan: Plan) -> None:
    rough = stepping_plan.with_contact(LEFT_STEP, stepping_plan.contacts.X_WC[LEFT_STEP], friction=0.9)
    assert "contact friction" in verify(rough).failed


def test_the_plan_itself_stays_as_it_was_and_its_file_knows_of_the_change(stepping_plan: Plan, tmp_path: Path) -> None:
    before = stepping_plan.contacts.X_WC.copy()
    other = moved(moved(stepping_plan, x=0.01), y=0.01).with_contact(0, before[0])
    np.testing.assert_array_equal(stepping_plan.contacts.X_WC, before)
    write_plan(other, tmp_path / "plan.h5")
    assert read_plan(tmp_path / "plan.h5").provenance[CHANGED] == [0, LEFT_STEP]


@pytest.mark.parametrize("index", [-1, 99])
def test_a_contact_that_is_not_there_is_refused(stepping_plan: Plan, index: int) -> None:
    with pytest.raises(InputError, match=f"expected an index from 0 to {len(stepping_plan.contacts) - 1}, got {index}"):
        stepping_plan.with_contact(index, np.eye(4))


@pytest.mark.parametrize("pose", [np.eye(3), np.full((4, 4), np.nan)])
def test_what_is_no_pose_is_refused(stepping_plan: Plan, pose: np.ndarray) -> None:
    with pytest.raises(InputError, match="expected a finite"):
        stepping_plan.with_contact(0, pose)


def test_the_scene_of_a_plan_is_the_one_that_it_was_planned_on(stepping_plan: Plan) -> None:
    scene = stepping_plan.scene()
    assert [surface.name for surface in scene.terrain.surfaces] == ["ground", "wall"]
    np.testing.assert_allclose(scene.terrain.triangles, stepping_plan.triangles, atol=1e-12)


# ---- verify


def test_a_plan_its_file_and_any_name_of_its_robot_give_one_verdict(stepping_plan: Plan, tmp_path: Path) -> None:
    path = tmp_path / "Plän über Stufen.h5"
    write_plan(stepping_plan, path)
    escher = load_robot("escher")
    reports = [verify(stepping_plan), verify(path), verify(str(path), robot="escher"), verify(path, escher.model)]
    reports += [verify(stepping_plan, robot=escher), verify(stepping_plan, robot=escher.source)]
    assert all(report.holds for report in reports)
    assert len({report.checks for report in reports}) == 1
    assert reports[1].path == str(path) and "memory" in reports[0].path


def test_a_plan_whose_model_lies_elsewhere_here_is_verified_all_the_same(stepping_plan: Plan) -> None:
    assert verify(dataclasses.replace(stepping_plan, robot_model="/elsewhere/escher.urdf")).holds


def test_what_cannot_be_verified_says_why(stepping_plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such plan file"):
        verify(tmp_path / "none.h5")
    (tmp_path / "other.urdf").write_text("<robot/>")
    with pytest.raises(InputError, match="another robot model"):
        verify(stepping_plan, tmp_path / "other.urdf")

    class Result:
        plan = stepping_plan

    for wrong, hint in ((Result(), "Result: give its attribute plan"), (3, "got int"), (None, "got NoneType")):
        with pytest.raises(TypeError, match=hint):
            verify(wrong)  # type: ignore[arg-type]
